"""Inputs and outputs of an exported model: name, unit, description and value of each entry.

All export formats share these tables, so that a C header, an FMU and a document use the same names:

    parameters p    gravity, the properties of each element in turn, the parameters of the damping law
    state           free coordinates q and velocities v in the laboratory frame; in the reduced model, whose parameters
                    contain no properties, modal coordinates and their velocities
    base            displacement (x, y) and rotation of the base, with which all supports and springs move, their
                    velocities, and their accelerations; a positive rotation turns counterclockwise

Elements are numbered from 1.  Node i ends element i, and node 0 begins the beam.  Coordinates that a support holds are
not among q; a node that slides in a slanted direction has one along it.  Names are C identifiers.  The projection B of
a modal (generic) law, and supports and attachments, are fixed in the model and are therefore not parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.mechanics.lumped import BEAM_UNITS, PROPERTIES
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import instances
from ancf_casadi.support.tables import Displayed, plural
from ancf_casadi.vibration.equilibrium import Equilibrium

COORDINATES = (("x", "m", "position, x"), ("y", "m", "position, y"), ("slope_x", "1", "slope dr/ds, x"),
               ("slope_y", "1", "slope dr/ds, y"))  # fmt: skip
SLIDING = ("slide", "m", "position along the direction of sliding")
BASE_SIGNALS = (("base_x", "m", "displacement of the base, x"), ("base_y", "m", "displacement of the base, y"),
        ("base_angle", "rad", "rotation of the base, counterclockwise"))  # fmt: skip


@dataclass(frozen=True)
class Signal:
    """A scalar input or output of an exported model.

    Parameters
    ----------
    name : str
        Name, a C identifier.
    unit : str
        SI unit, in ASCII; ``1`` for a dimensionless signal.
    description : str
        Meaning.
    value : float
        Value of a parameter, or start value of a state or an input.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2)
    >>> signal = reduced.parameters[1]
    >>> signal.name, signal.unit, signal.value
    ('gravity_y', 'm/s2', -9.81)
    """

    name: str
    unit: str
    description: str
    value: float = 0.0


@dataclass(frozen=True, eq=False)
class MotionFunctions(Displayed):
    """An equation of motion as CasADi Functions with named entries, the source of C code, FMUs and function files.

    Parameters
    ----------
    parameters : tuple of Signal
        The entries of p, with the values of the model.
    states : tuple of Signal
        The entries of (q, v), with the state of the model at rest.
    base : tuple of Signal
        The entries of base.
    outputs : tuple of Signal
        The entries of (tip, markers, energies, clamp_force).
    length : float
        Length of the beam, m.
    rhs : Function
        (q, v, base, p) -> a, the accelerations of q.
    step : Function
        (q, v, base, p, h) -> q_next, v_next after a step h (s); base (9, k) at k instants of the step.
    tip : Function
        (q, base) -> r, the position of the tip (2,), m.
    markers : Function
        (q, base) -> r, the positions of the markers (2, k), m.
    energies : Function
        (q, v, base, p) -> T kinetic, U strain, V gravitational, J.
    clamp_force : Function
        (q, v, a, base, p) -> F, the force of clamp, supports and springs on a beam without load (2,), N.

    Examples
    --------
    ``beam_functions`` and ``reduce_model`` return them:

    >>> from ancf_casadi import Beam, Model, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2)
    >>> reduced.free, list(reduced.named)
    (2, ['rhs', 'step', 'tip', 'markers', 'energies', 'clamp_force', 'mass', 'coordinates'])
    >>> reduced.rhs.name_in()
    ['q', 'v', 'base', 'p']
    """

    parameters: tuple[Signal, ...]
    states: tuple[Signal, ...]
    base: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    length: float
    rhs: cs.Function
    step: cs.Function
    tip: cs.Function
    markers: cs.Function
    energies: cs.Function
    clamp_force: cs.Function

    @property
    def named(self) -> dict[str, cs.Function]:
        """All Functions by name; their names in C are the same."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.type == "cs.Function"}

    @property
    def functions(self) -> tuple[cs.Function, ...]:
        """All Functions."""
        return tuple(self.named.values())

    @property
    def free(self) -> int:
        """Number of coordinates q."""
        return len(self.states) // 2

    def _summary(self) -> str:
        names = ", ".join(parameter.name for parameter in self.parameters)
        return f"{plural(len(self.states) // 2, 'coordinate')}, parameters {names}"


def values(signals: Sequence[Signal]) -> Array:
    """Return the values of signals, each in its SI unit, (k,).

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, reduce_model
    >>> from ancf_casadi.export import values
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2)
    >>> values(reduced.parameters)  # gravity, x and y
    array([ 0.  , -9.81])
    >>> values(reduced.states)
    array([0., 0., 0., 0.])
    """
    return np.array([signal.value for signal in instances(signals, "signals", Signal)], dtype=float)


def parameter_signals(equations: Equations) -> tuple[Signal, ...]:
    """Return the parameters p in order, with the values of the beam and the law."""
    described = [(f"gravity_{c}", "m/s2", f"acceleration of gravity, {c}") for c in "xy"]
    for i, shape in enumerate(equations.model.beam.shapes, start=1):
        where = f"element {i}" if shape.kind == "rectangle" else f"the equivalent rectangle of element {i}"
        described += [
            (f"{name}_{i}", BEAM_UNITS[name].replace("^", ""), f"{name.replace('_', ' ')} of {where}")
            for name in PROPERTIES
        ]
    described += [(parameter.name, parameter.unit, parameter.description) for parameter in equations.law.parameters]
    parameter_values = equations.parameters[: equations.layout["projection"].start]
    return tuple(Signal(*about, float(value)) for about, value in zip(described, parameter_values, strict=True))


def state_signals(equilibrium: Equilibrium) -> tuple[Signal, ...]:
    """Return the state (q, v) in order, starting at rest in an equilibrium."""
    model, coordinates = equilibrium.model, []
    at_rest = model.of_free(equilibrium.coordinates).tolist()
    for k, value in zip(model.first_moved.tolist(), at_rest, strict=True):
        node, component = divmod(k - NODE * model.root, NODE)
        name, unit, description = COORDINATES[component] if model.weights[k] == 1.0 else SLIDING
        coordinates.append(Signal(f"{name}_{node}", unit, f"{description}, of node {node}", value))
    return _with_velocities(coordinates)


def modal_signals(frequencies: Sequence[float]) -> tuple[Signal, ...]:
    """Return the modal coordinates and velocities (q, v), at rest, of modes with the given frequencies (Hz)."""
    numbered = enumerate(frequencies, start=1)
    return _with_velocities(
        [Signal(f"q_{k}", "m kg^0.5", f"modal coordinate of mode {k}, {f:.6g} Hz") for k, f in numbered]
    )


def _with_velocities(coordinates: Sequence[Signal]) -> tuple[Signal, ...]:
    rates = (Signal(f"velocity_{q.name}", f"{q.unit}/s", f"velocity of {q.name}") for q in coordinates)
    return (*coordinates, *rates)


def base_signals(*, turns: bool = True) -> tuple[Signal, ...]:
    """Return the motion of the base: displacements and rotation, their velocities and accelerations.

    A model whose rollers and guides would turn with the base, though they keep their direction, must not turn.
    """
    *displacements, (angle, unit, rotation) = BASE_SIGNALS
    described = rotation if turns else f"{rotation}; keep it 0, as rollers and guides keep their direction"
    return (
        *(Signal(*signal) for signal in (*displacements, (angle, unit, described))),
        *(Signal(f"{name}_velocity", f"{unit}/s", f"velocity of {name}") for name, unit, _ in BASE_SIGNALS),
        *(Signal(f"{name}_acceleration", f"{unit}/s2", f"acceleration of {name}") for name, unit, _ in BASE_SIGNALS),
    )


def output_signals(markers: Sequence[float]) -> tuple[Signal, ...]:
    """Return the outputs of ``tip``, ``markers``, ``energies`` and ``clamp_force``, in this order."""
    points = [("tip", "the tip")]
    points += [(f"marker_{k}", f"the point at arc length {float(s):g} m") for k, s in enumerate(markers, start=1)]
    return (
        *(Signal(f"{name}_{c}", "m", f"position of {where}, {c}") for name, where in points for c in "xy"),
        Signal("kinetic_energy", "J", "kinetic energy"),
        Signal("strain_energy", "J", "strain energy"),
        Signal("gravity_energy", "J", "potential energy of gravity, 0 at the origin"),
        *(Signal(f"clamp_force_{c}", "N", f"force of clamp, supports and springs on the beam, {c}") for c in "xy"),
    )
