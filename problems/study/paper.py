"""The numbers printed in the paper, in SI units, with notes on its misprints.

Frequencies are in Hz, damping ratios are fractions.

References
----------
"Comparison of external damping models in a large deformation problem", Tables 1 to 4 and 9 to 12.
"""

from __future__ import annotations

from ancf_casadi.mechanics.beam import Beam

ELEMENTS = 20  # Section 5.1

# Table 1.  The column "Standard" of Table 10 was computed with 7850 kg/m^3 and without gravity.
LENGTH = 0.5
WIDTH = 5e-3
THICKNESS = 0.5e-3
DENSITY = 8000.0
ELASTIC_MODULUS = 210e9
STANDARD_DENSITY = 7850.0

# Table 2
FREQUENCIES = (1.85, 10.19, 26.84, 53.20, 88.60)
DAMPING_RATIOS = (0.0100, 0.0028, 0.0028, 0.0023, 0.0030)

# Table 3.  The printed beta is ten times the result of Eq. (17).
ALPHA = 0.228
BETA_PRINTED = 3.18e-4
BETA = 3.18e-5

# Table 4.  The paper prints eta2 in 1/mm.  At these amplitudes (m), Eq. (26) has the equivalent ratios.
ETA1 = (0.15, 0.31, 0.89, 1.46, 3.00)
ETA2 = (0.11, 0.060, 0.050, 0.050, 0.050)
EQUIVALENT_RATIOS = (0.0100, 0.0028, 0.0028, 0.0023, 0.0030)
EQUIVALENT_AMPLITUDES = (0.076, 0.0149, 0.0076, 0.0055, 0.0144)

# Table 9
OPTIMUM_THICKNESS = 0.49e-3
OPTIMUM_DENSITY = 8108.0
OPTIMUM_ELASTIC_MODULUS = 205.130e9

# Table 10
STANDARD_FREQUENCIES = (1.67, 10.47, 29.32, 57.46, 94.97)
OPTIMUM_FREQUENCIES = (1.84, 10.18, 26.81, 53.15, 88.79)

# Table 11, and the tip amplitudes (m) at which Eq. (26) gives its quadratic row
PROPORTIONAL_RATIOS = (0.0100, 0.0028, 0.0032, 0.0050, 0.0070)
QUADRATIC_RATIOS = (0.0100, 0.0016, 0.0008, 0.0004, 0.00022)
QUADRATIC_AMPLITUDES = (0.076, 0.0092, 0.0076, 0.0038, 0.0018)

# Section 5.2: end of the excitation of each mode, s
STOPS = (15.0, 20.0, 12.0, 10.0, 6.0)


def standard_beam() -> Beam:
    """Return the hanging beam of Table 1 with the mesh of Section 5.1."""
    return Beam.uniform(
        length=LENGTH,
        width=WIDTH,
        thickness=THICKNESS,
        density=DENSITY,
        elastic_modulus=ELASTIC_MODULUS,
        elements=ELEMENTS,
    )
