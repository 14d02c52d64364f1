"""Names and units of the properties of a beam: those of its elements, and the lumped ones.

Names of lumped properties may end in a number, such as ``mass_2``; ``spring_stiffness`` stands for all springs.
"""

from __future__ import annotations

import re

from ancf_casadi.mechanics.beam import PROPERTIES

BEAM_UNITS = {
    "width": "m",
    "thickness": "m",
    "density": "kg/m^3",
    "elastic_modulus": "Pa",
    "tip_mass": "kg",
    "mass": "kg",
    "rotary_inertia": "kg m^2",
    "clamp_stiffness": "N m/rad",
    "rotational_spring": "N m/rad",
    "spring_x": "N/m",
    "spring_y": "N/m",
    "spring_stiffness": "N/m",
    "dashpot_x": "N s/m",
    "dashpot_y": "N s/m",
    "natural_curvature": "1/m",
    "prestress": "Pa",
}
LUMPED_KINDS = tuple(name for name in BEAM_UNITS if name not in PROPERTIES)


def lumped_kind(name: str) -> str:
    """Return the name of a lumped property without its number; empty if the name is not that of a lumped property."""
    kind = re.sub("_[0-9]+$", "", name)
    return kind if kind in LUMPED_KINDS else ""


def unit_of(name: str) -> str:
    """Return the SI unit of a property; a name may have elements in brackets, or a number."""
    return BEAM_UNITS[lumped_kind(name) or name.partition("[")[0]]
