"""Properties of a beam as quantities of a fit: single properties, combinations, and the factors on them.

``bending_stiffness`` is E I = E b h^3/12 and ``mass_per_length`` is rho b h, means over the elements.  As unknowns they
change the modulus or the density alone, which is the same for a beam that hardly stretches.

Small deflections are linear in 1/(E I) and 1/k, and so are, nearly, the squares of the periods of vibration.
Stiffnesses therefore enter a fit by their reciprocals: the unknown is E_0/E or k_0/k, with a first value E_0 or k_0,
and is named ``1/elastic_modulus`` or ``1/clamp_stiffness``.  A rigid clamp has 1/k = 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ancf_casadi.mechanics.beam import LUMPED, UNITS, Beam


@dataclass(frozen=True)
class Combination:
    """A product of powers of properties.

    Parameters
    ----------
    driven : str
        Property that changes if the combination is an unknown.
    powers : mapping
        Exponents by property.
    constant : float
        Constant factor.
    unit : str
        SI unit.
    """

    driven: str
    powers: Mapping[str, int]
    constant: float
    unit: str


COMBINED: Mapping[str, Combination] = {
    "bending_stiffness": Combination("elastic_modulus", {"elastic_modulus": 1, "width": 1, "thickness": 3}, 1 / 12,
                                     "N m^2"),
    "mass_per_length": Combination("density", {"density": 1, "width": 1, "thickness": 1}, 1.0, "kg/m"),
}  # fmt: skip
ALL_UNITS: Mapping[str, str] = {**UNITS, **{name: own.unit for name, own in COMBINED.items()}}
CLAMP = "clamp_stiffness"
STIFFNESSES = (CLAMP, "elastic_modulus", "bending_stiffness")
INVERSE = "1/"  # prefix of the unknown that is the reciprocal of a property


def value_of(beam: Beam, name: str) -> float:
    """Return a property or a combination of a beam, SI units; the mean over its elements."""
    if name in LUMPED:
        return float(getattr(beam, name))
    own = COMBINED.get(name, Combination(name, {name: 1}, 1.0, ""))
    powers = [np.array(getattr(beam, one)) ** power for one, power in own.powers.items()]
    return float(own.constant * np.mean(np.prod(powers, axis=0)))


def unknown_of(name: str) -> str:
    """Return the name of the unknown by which a property enters a fit."""
    return INVERSE + name if name in STIFFNESSES else name


def names_of(unknowns: Sequence[str]) -> tuple[str, ...]:
    """Return the properties that the unknowns of a fit stand for."""
    return tuple(name.removeprefix(INVERSE) for name in unknowns)


def factors_of(unknowns: Mapping[str, cs.MX]) -> dict[str, cs.MX]:
    """Return the factors on single properties from the unknowns of a fit by name."""
    factors = {}
    for unknown, value in unknowns.items():
        name = unknown.removeprefix(INVERSE)
        own = COMBINED[name].driven if name in COMBINED else name
        factors[own] = value if name == unknown else 1 / value
    return factors


def relative_quantity(name: str, unknowns: Mapping[str, cs.MX]) -> cs.MX:
    """Return a property or a combination relative to its first value."""
    factors = factors_of(unknowns)
    powers = COMBINED[name].powers if name in COMBINED else {name: 1}
    product = cs.MX(1.0)
    for one, power in powers.items():
        product *= factors.get(one, cs.MX(1.0)) ** power
    return product


def quantities(unknowns: Sequence[str]) -> tuple[str, ...]:
    """Return the properties, and the combinations, that the unknowns of a fit change."""
    known = names_of(unknowns)
    changing = set(factors_of({name: cs.MX(1.0) for name in unknowns}))
    return (*known, *(name for name, own in COMBINED.items() if name not in known and changing & set(own.powers)))
