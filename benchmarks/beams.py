"""Beams that several benchmarks share; keywords are those of ``Beam.uniform``."""

from typing import Any

from ancf_casadi import Beam

BENDING_STIFFNESS = 210e9 * 5e-3 * 0.5e-3**3 / 12  # of the steel strip, N m^2
DAMPING_RATIOS = (0.0100, 0.0028, 0.0028, 0.0023, 0.0030)  # of the steel strip, Table 2 of the paper


def steel(elements: int = 20, **changes: Any) -> Beam:
    """Return the hanging steel strip of the paper, Table 1."""
    strip = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
    return Beam.uniform(**strip | changes, elements=elements)


def silicone(elements: int, **changes: Any) -> Beam:
    """Return a soft, hanging silicone strip."""
    strip = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 264e3}
    return Beam.uniform(**strip | changes, elements=elements)
