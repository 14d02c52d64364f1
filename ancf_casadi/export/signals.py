"""What the exported model takes and gives, entry by entry: name, unit, description and value.

One table serves all forms of the model, so that a header, an FMU and a document name the same thing alike:

    parameters p    gravity, the properties of the elements one element after the other, those of the damping law
    state           free coordinates q and their rates v, absolute, in the laboratory frame
    base            displacement (x, y) and rotation of the clamp from where the beam is at rest, with their first and
                    second rates; a rotation turns the axis of the beam counterclockwise

Elements count from 1 at the clamp; node i ends element i, and node 0 is clamped, or free behind an elastic clamp.
Names are identifiers of C.  The projection B of a generic damping law is no parameter: the shapes of its modes are part
of the law; nor are a mass at the tip and the stiffness of the clamp, which are part of the beam.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.beam import PROPERTIES
from ancf_casadi.equations import Equations
from ancf_casadi.equilibrium import Equilibrium
from ancf_casadi.model import NODE

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


def values(signals: Sequence[Signal]) -> NDArray[np.float64]:
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
    unit, what = LAW_PARAMETERS["ratio" if mode else name]
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
