"""The printed numbers of the paper that tests and benchmarks share.

SI units; frequencies are in Hz, damping ratios are fractions, eta2 is in 1/m.

References
----------
J. W. Lee, H. W. Kim, H. C. Ku, W. S. Yoo, "Comparison of external damping models in a large deformation problem",
Journal of Sound and Vibration 325 (2009) 722-741, Tables 1, 2, 4, 9 and 10.
"""

from __future__ import annotations

from ancf_casadi.mechanics.beam import Beam
from problems.paper import inputs, tables_09_10

ELEMENTS = inputs.STANDARD_BEAM.elements  # Section 5.1
TARGET_FREQUENCIES, DAMPING_RATIOS = inputs.FREQUENCIES, inputs.RATIOS  # Table 2
ETA1, ETA2 = inputs.ETA1, inputs.ETA2  # Table 4
EQUIVALENT_AMPLITUDES = inputs.AMPLITUDES  # of the tip, m, at which Eq. (26) has the ratios that Table 4 prints

# Tables 9 and 10: width, thickness, density and elastic modulus of the matched beam, and its frequencies
_WIDTH, _THICKNESS, _DENSITY, _MODULUS = tables_09_10.PROPERTIES
OPTIMUM = {
    "width": 1e-3 * _WIDTH,
    "thickness": 1e-3 * _THICKNESS,
    "density": _DENSITY,
    "elastic_modulus": 1e9 * _MODULUS,
}
OPTIMUM_FREQUENCIES = tables_09_10.OPTIMUM


def standard_beam() -> Beam:
    """Return the hanging beam of Table 1 with the mesh of Section 5.1."""
    return inputs.STANDARD_BEAM
