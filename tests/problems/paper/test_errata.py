"""Misprints of the paper: each test states the right value and the number of the erratum.

References
----------
"Comparison of external damping models in a large deformation problem", Tables 1 to 4, 10, 11, Eq. (21)-(25).
The right values were computed independently, without ANCF and without CasADi.
"""

import math

import casadi as cs
import numpy as np
import pytest
from numpy.polynomial import Polynomial

from ancf_casadi import Beam, Model, Modes, QuadraticDamping, RayleighDamping, natural_modes
from ancf_casadi.damping import DRAG_CONSTANT
from ancf_casadi.decay.closed_forms import equivalent_damping_ratio
from problems import fit_rayleigh
from tests.problems.paper import numbers as paper

ANGULAR = 2 * math.pi * np.array(paper.TARGET_FREQUENCIES)
LENGTH = 0.5  # m, Table 1
STANDARD_DENSITY, STANDARD_FREQUENCIES = 7850.0, (1.67, 10.47, 29.32, 57.46, 94.97)  # Table 10: errata 1 and 2
ALPHA, BETA, BETA_PRINTED = 0.228, 3.18e-5, 3.18e-4  # Table 3: erratum 4
PROPORTIONAL_RATIOS = (0.0100, 0.0028, 0.0032, 0.0050, 0.0070)  # Table 11: erratum 5
EQUIVALENT_RATIOS = (0.0100, 0.0028, 0.0028, 0.0023, 0.0030)  # Table 4: erratum 6
QUADRATIC_RATIOS = (0.0100, 0.0016, 0.0008, 0.0004, 0.00022)  # Table 11: erratum 7
QUADRATIC_AMPLITUDES = (0.076, 0.0092, 0.0076, 0.0038, 0.0018)  # m, at which Eq. (26) gives these ratios: erratum 7


@pytest.fixture(scope="module")
def weightless() -> Modes:
    """Five modes of the beam of Table 1 without gravity."""
    return natural_modes(Model(paper.standard_beam().with_(gravity=(0.0, 0.0))), count=5)


def tip_amplitudes(ratios: tuple[float, ...], eta1: tuple[float, ...], eta2: tuple[float, ...]) -> np.ndarray:
    """Return the tip amplitudes (m) at which Eq. (26) gives these equivalent ratios."""
    return (np.array(ratios) - np.array(eta1) / (2 * ANGULAR)) * 3 * math.pi / (4 * np.array(eta2))


class TestDensity:
    """Erratum 1: Tables 1 and 9 say 8000 kg/m^3; Table 10 "Standard" needs 7850, and no gravity."""

    EXACT = (1.671033189, 10.472186237, 29.322424698, 57.460249429, 94.985909456)

    def test_7850_gives_the_printed_frequencies(self):
        beam = paper.standard_beam().with_(gravity=(0.0, 0.0), density=STANDARD_DENSITY)
        frequencies = natural_modes(Model(beam), count=5).frequencies
        assert frequencies == pytest.approx(self.EXACT, rel=2e-4)
        assert frequencies[:4].round(2).tolist() == list(STANDARD_FREQUENCIES[:4])
        assert frequencies[4] == pytest.approx(STANDARD_FREQUENCIES[4], abs=0.04)

    def test_8000_does_not(self, weightless):
        assert weightless.frequencies == pytest.approx((1.6553, 10.3735, 29.0462, 56.9190, 94.0912), rel=2e-4)
        assert (np.abs(weightless.frequencies / STANDARD_FREQUENCIES - 1) > 8e-3).all()


class TestProportional:
    def test_beta_is_a_tenth_of_the_printed(self):
        """Erratum 4: Eq. (17) with Table 2 gives 3.18E-5 s, and the printed alpha."""
        fit = fit_rayleigh(paper.TARGET_FREQUENCIES[:2], paper.DAMPING_RATIOS[:2])
        assert fit.alpha == pytest.approx(0.228181, abs=5e-7)
        assert fit.beta == pytest.approx(3.18013e-5, abs=5e-11)
        assert fit.alpha == pytest.approx(ALPHA, abs=5e-4)
        assert fit.beta == pytest.approx(BETA, abs=5e-8)

    def test_only_that_beta_reproduces_table_2(self, weightless):
        """The ratios of modes 1 and 2; the printed beta would damp mode 2 more than four times as strongly."""
        modes = Modes(weightless.equilibrium, np.array(paper.TARGET_FREQUENCIES), weightless.shapes)
        right = RayleighDamping(ALPHA, BETA, stiffness="tangent").damping_ratios(modes, np.zeros(5))
        printed = RayleighDamping(ALPHA, BETA_PRINTED, stiffness="tangent").damping_ratios(modes, np.zeros(5))
        assert right[:2] == pytest.approx(paper.DAMPING_RATIOS[:2], rel=2e-3)
        assert printed[1] > 4 * paper.DAMPING_RATIOS[1]

    def test_ratios_of_the_higher_modes(self):
        """Erratum 5: Eq. (16) gives 0.3358, 0.5656, 0.9057 %; Table 11 prints 0.32, 0.50, 0.70 %."""
        fit = fit_rayleigh(paper.TARGET_FREQUENCIES[:2], paper.DAMPING_RATIOS[:2])
        ratios = fit.alpha / (2 * ANGULAR) + fit.beta * ANGULAR / 2
        assert 100 * ratios[2:] == pytest.approx([0.3358, 0.5656, 0.9057], abs=5e-5)
        assert (ratios[2:] > PROPORTIONAL_RATIOS[2:]).all()


class TestQuadratic:
    def test_eta2_is_per_millimetre(self):
        """Erratum 6: the ratios of Table 4 then imply tip amplitudes that a thin beam of 0.5 m can reach."""
        amplitudes = tip_amplitudes(EQUIVALENT_RATIOS, paper.ETA1, paper.ETA2)
        assert 1e3 * amplitudes == pytest.approx([76.0, 14.9, 7.6, 5.5, 14.4], abs=0.06)
        assert amplitudes == pytest.approx(paper.EQUIVALENT_AMPLITUDES, rel=0.01)

    def test_per_metre_the_beam_would_swing_76_m(self):
        per_metre = tuple(1e-3 * eta2 for eta2 in paper.ETA2)
        amplitudes = tip_amplitudes(EQUIVALENT_RATIOS, paper.ETA1, per_metre)
        assert amplitudes[0] == pytest.approx(76.0, abs=0.06)
        assert (amplitudes > 10 * LENGTH).all()

    def test_linear_part_of_table_11(self):
        """Erratum 7: eta1 of mode 1 applies to all modes, a constant decay rate."""
        linear = equivalent_damping_ratio(cs.DM(paper.ETA1[0]), cs.DM(0), cs.DM(ANGULAR), cs.DM(0)).full().ravel()
        assert 100 * linear == pytest.approx([0.6452, 0.1171, 0.0445, 0.0224, 0.0135], abs=5e-5)

    def test_amplitudes_implied_by_table_11(self):
        """Erratum 7: they differ from those of Table 4, which would give 1.00, 0.187, 0.080, 0.048, 0.081 %."""
        implied = tip_amplitudes(QUADRATIC_RATIOS, paper.ETA1[:1] * 5, paper.ETA2[:1] * 5)
        assert 1e3 * implied == pytest.approx([76.0, 9.2, 7.6, 3.8, 1.8], abs=0.06)
        assert implied == pytest.approx(QUADRATIC_AMPLITUDES, rel=0.02)
        eta1, eta2 = cs.DM(paper.ETA1[0]), cs.DM(paper.ETA2[0])
        of_table_4 = equivalent_damping_ratio(eta1, eta2, cs.DM(ANGULAR), cs.DM(paper.EQUIVALENT_AMPLITUDES))
        assert 100 * of_table_4.full().ravel() == pytest.approx([1.00, 0.187, 0.080, 0.048, 0.081], abs=6e-4)


class TestDragConstant:
    """Erratum 12: 0.74 in Eq. (24)-(25) is 876/1183 for the shape (21), and less for the true modes."""

    def test_of_the_assumed_shape(self):
        """S = (6 xi^2 - 4 xi^3 + xi^4)/3: Eq. (22) and (24) are right."""
        S = Polynomial([0, 0, 6, -4, 1]) / 3
        square, cube = (power.integ()(1.0) for power in (S**2, S**3))
        assert square == pytest.approx(104 / 405, rel=1e-14)
        assert cube == pytest.approx(2336 / 12285, rel=1e-14)
        assert cube / square == pytest.approx(876 / 1183, rel=1e-14)
        assert pytest.approx(1183 / 876, rel=1e-15) == DRAG_CONSTANT

    @pytest.mark.parametrize(("elements", "error"), [(20, 2e-4), (60, 5e-5)])
    def test_of_the_true_modes(self, elements, error):
        """int |phi|^3 / int phi^2, from the equivalent ratios 4 eta2 c A/(3 pi) at eta2 A = 1."""
        beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
                            elements=elements, gravity=(0.0, 0.0))  # fmt: skip
        ratios = QuadraticDamping(eta2=1.0).damping_ratios(natural_modes(Model(beam), count=5), np.ones(5))
        constants = ratios * 3 * math.pi / 4 / DRAG_CONSTANT
        assert constants == pytest.approx([0.7389, 0.6471, 0.6320, 0.6227, 0.6177], abs=error)
