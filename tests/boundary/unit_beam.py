"""The beam of the reference cases in dimensionless form."""

from typing import Any

import numpy as np

from ancf_casadi import Beam

AXIAL = 1e8  # E A in E I/L^2
HERE: dict[str, Any] = {"axis": (1.0, 0.0), "gravity": (0.0, 0.0)}


def unit_beam(elements: int, *, axial: float = AXIAL, **settings: Any) -> Beam:
    """Return a beam with L = E I = mu = 1 along x without gravity, unless ``settings`` of ``Beam.uniform`` differ."""
    thickness = np.sqrt(12 / axial)
    section = {"length": 1.0, "width": 1.0, "thickness": thickness, "density": 1 / thickness}
    given = {**section, "elastic_modulus": axial / thickness, "elements": elements, **HERE, **settings}
    return Beam.uniform(**given)
