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

from ancf_casadi import Model, Modes, RayleighDamping, natural_modes
from ancf_casadi.damping import DRAG_CONSTANT
from ancf_casadi.decay.closed_forms import equivalent_damping_ratio
from tests.problems.paper import numbers as paper

ANGULAR = 2 * math.pi * np.array(paper.TARGET_FREQUENCIES)
LENGTH = 0.5  # m, Table 1
STANDARD_DENSITY, STANDARD_FREQUENCIES = 7850.0, (1.67, 10.47, 29.32, 57.46, 94.97)  # Table 10: errata 1 and 2
ALPHA, BETA, BETA_PRINTED = 0.228, 3.18e-5, 3.18e-4  # Table 3: erratum 4
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
    def test_only_that_beta_reproduces_table_2(self, weightless):
        """The ratios of modes 1 and 2; the printed beta would damp mode 2 more than four times as strongly."""
        modes = Modes(weightless.equilibrium, np.array(paper.TARGET_FREQUENCIES), weightless.shapes)
        right = RayleighDamping(ALPHA, BETA, stiffness="tangent").damping_ratios(modes, np.zeros(5))
        printed = RayleighDamping(ALPHA, BETA_PRINTED, stiffness="tangent").damping_ratios(modes, np.zeros(5))
        assert right[:2] == pytest.approx(paper.DAMPING_RATIOS[:2], rel=2e-3)
        assert printed[1] > 4 * paper.DAMPING_RATIOS[1]


class TestQuadratic:
    def test_eta2_is_per_millimetre(self):
        """Erratum 6: the ratios of Table 4 then imply tip amplitudes that a thin beam of 0.5 m can reach."""
        amplitudes = tip_amplitudes(EQUIVALENT_RATIOS, paper.ETA1, paper.ETA2)
        assert 1e3 * amplitudes == pytest.approx([76.0, 14.9, 7.6, 5.5, 14.4], abs=0.06)
        assert amplitudes == pytest.approx(paper.EQUIVALENT_AMPLITUDES, rel=0.01)

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
