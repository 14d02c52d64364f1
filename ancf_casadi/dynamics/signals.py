"""What an exported model takes and gives, entry by entry: name, unit, description and value.

One table serves all forms of the model, so that a header, an FMU and a document name the same thing alike:

    parameters p    gravity, the properties of the elements one element after the other, those of the damping law
    state           free coordinates q and their rates v, absolute, in the laboratory frame; of the reduced model, which
                    has no properties among its parameters, modal coordinates and their rates
    base            displacement (x, y) and rotation of the clamp from where the beam is at rest, with their first and
                    second rates; a rotation turns the axis of the beam counterclockwise

Elements count from 1 at the clamp; node i ends element i, and node 0 is clamped, or free behind an elastic clamp.
Names are identifiers of C.  The projection B of a generic damping law is no parameter: the shapes of its modes are part
of the law; nor are a mass at the tip and the stiffness of the clamp, which are part of the beam.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.equilibrium import Equilibrium

PROPERTY_UNITS = {"width": "m", "thickness": "m", "density": "kg/m3", "elastic_modulus": "Pa"}
LAW_PARAMETERS = {
    "alpha": ("1/s", "damping proportional to the mass"),
    "beta": ("s", "damping proportional to the stiffness"),
    "eta1": ("1/s", "linear air drag by mass per length"),
    "eta2": ("1/m", "quadratic air drag by mass per length"),
    "ratio": ("1", "damping ratio of mode"),
}
COORDINATES = (("x", "m", "position, x"), ("y", "m", "position, y"), ("slope_x", "1", "slope dr/ds, x"),
               ("slope_y", "1", "slope dr/ds, y"))  # fmt: skip
BASE = (("base_x", "m", "displacement of the clamp, x"), ("base_y", "m", "displacement of the clamp, y"),
        ("base_angle", "rad", "rotation of the clamp, counterclockwise"))  # fmt: skip


@dataclass(frozen=True)
class Signal:
    """One number that goes into the model or comes out of it.

    Parameters
    ----------
    name : str
        Its name, an identifier of C.
    unit : str
        SI unit, in characters of ASCII; ``1`` if it has none.
    description : str
        What it is.
    value : float
        Value of a parameter, or start of a state or an input.
    """

    name: str
    unit: str
    description: str
    value: float = 0.0


@dataclass(frozen=True, eq=False)
class MotionFunctions:
    """An equation of motion as CasADi Functions, and what their entries mean: what C, an FMU and a file are made from.

    Parameters
    ----------
    parameters, states, base, outputs : tuple of Signal
        What the entries of p, of (q, v), of base and of (tip, markers, energies) are, with the values of the model.
    rhs : Function
        (q, v, base, p) -> a, the second rates of q.
    step : Function
        (q, v, base, p, h) -> q_next, v_next, after a time h (s); base (9, k) at k instants of the step.
    tip : Function
        (q, base) -> r, the position of the tip (2,), m.
    markers : Function
        (q, base) -> r, the positions of the points asked for (2, k), m.
    energies : Function
        (q, v, base, p) -> T kinetic, U strain, V of gravity, J.
    """

    parameters: tuple[Signal, ...]
    states: tuple[Signal, ...]
    base: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    rhs: cs.Function
    step: cs.Function
    tip: cs.Function
    markers: cs.Function
    energies: cs.Function

    @property
    def named(self) -> dict[str, cs.Function]:
        """All Functions by the names they have here, which are those in C."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.type == "cs.Function"}

    @property
    def functions(self) -> tuple[cs.Function, ...]:
        """All Functions."""
        return tuple(self.named.values())

    @property
    def free(self) -> int:
        """Number of coordinates q."""
        return len(self.states) // 2


def values(signals: Sequence[Signal]) -> Array:
    """Return the values of some signals."""
    return np.array([signal.value for signal in signals], dtype=float)


def parameter_signals(equations: Equations) -> tuple[Signal, ...]:
    """Return the parameters p, in their order, with the values of the beam and the law."""
    described = [(f"gravity_{c}", "m/s2", f"acceleration of gravity, {c}") for c in "xy"]
    for i in range(1, equations.model.beam.elements + 1):
        described += [
            (f"{name}_{i}", PROPERTY_UNITS[name], f"{name.replace('_', ' ')} of element {i}") for name in PROPERTIES
        ]
    taken: set[str] = set()
    for name, _ in equations.law.parameters:
        described.append((_unique(name, taken), *_of_law(name)))
    own = equations.parameters[: equations.parameters.size - equations.projection.size]
    return tuple(Signal(*about, float(value)) for about, value in zip(described, own, strict=True))


def state_signals(equilibrium: Equilibrium) -> tuple[Signal, ...]:
    """Return the state (q, v), in its order, started at rest in an equilibrium."""
    model = equilibrium.model
    positions, rates = [], []
    for k in range(model.size)[model.free]:
        node, component = divmod(k - NODE * model.root, NODE)
        name, unit, what = COORDINATES[component]
        start = float(equilibrium.coordinates[k])
        positions.append(Signal(f"{name}_{node}", unit, f"{what}, of node {node}", start))
        rates.append(Signal(f"rate_{name}_{node}", _rate(unit), f"rate of {name}_{node}"))
    return (*positions, *rates)


def modal_signals(frequencies: Sequence[float]) -> tuple[Signal, ...]:
    """Return modal coordinates (q, v), at rest, of modes of some frequencies in Hz."""
    unit, known = "m kg^0.5", list(enumerate(frequencies, start=1))
    return (
        *(Signal(f"q_{k}", unit, f"modal coordinate of mode {k}, {f:.6g} Hz") for k, f in known),
        *(Signal(f"rate_q_{k}", _rate(unit), f"rate of q_{k}") for k, _ in known),
    )


def base_signals() -> tuple[Signal, ...]:
    """Return the motion of the clamp: displacements and rotation, their rates, and the rates of those."""
    return (
        *(Signal(name, unit, what) for name, unit, what in BASE),
        *(Signal(f"{name}_rate", _rate(unit), f"rate of {name}") for name, unit, _ in BASE),
        *(Signal(f"{name}_rate2", _rate(unit, 2), f"second rate of {name}") for name, unit, _ in BASE),
    )


def output_signals(markers: Sequence[float] = ()) -> tuple[Signal, ...]:
    """Return what the Functions ``tip``, ``markers`` and ``energies`` give, in this order."""
    points = [("tip", "the tip")]
    points += [(f"marker_{k}", f"the point at arc length {float(s):g} m") for k, s in enumerate(markers, start=1)]
    return (
        *(Signal(f"{name}_{c}", "m", f"position of {where}, {c}") for name, where in points for c in "xy"),
        Signal("kinetic_energy", "J", "kinetic energy"),
        Signal("strain_energy", "J", "strain energy"),
        Signal("gravity_energy", "J", "potential energy in the field of gravity, 0 at the origin"),
    )


def _of_law(name: str) -> tuple[str, str]:
    mode = re.fullmatch(r"ratio(\d+)", name)
    unit, what = LAW_PARAMETERS.get("ratio" if mode else name, ("SI", f"{name} of the damping law"))
    return unit, f"{what} {mode[1]}" if mode else what


def _unique(name: str, taken: set[str]) -> str:
    """Return the name, numbered where laws that act together share it."""
    found, number = name, 1
    while found in taken:
        number += 1
        found = f"{name}_{number}"
    taken.add(found)
    return found


def _rate(unit: str, order: int = 1) -> str:
    below = "s" if order == 1 else f"s{order}"
    return f"{unit}/{below}"
