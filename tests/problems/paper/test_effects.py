"""Decays under eta1 and eta2: the start, Eq. (27) against Eq. (26), the beam against both, and the words of Table 6."""

import math

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Model, QuadraticDamping, natural_modes
from ancf_casadi.decay.closed_forms import quadratic_envelope
from problems.paper.effects import (
    Envelope,
    characteristics,
    crossing,
    displace_tip,
    peaks,
    ratios_over_time,
    simulate_decay,
    tune_beam,
)
from tests.decay.integration import drag_motion

TIME = np.linspace(0.0, 15.0, 3001)
START = 0.2126  # m, from which Quadratic 3 and 4 cross at 5 s


def by_formula(frequency, eta1, eta2, amplitude=0.076):
    parameters = (2 * math.pi * frequency, eta1, eta2, amplitude)
    return Envelope(TIME, quadratic_envelope(cs.DM(TIME), *map(cs.DM, parameters)).full().ravel())


@pytest.fixture(scope="module")
def decay(paper_beam):
    """Three seconds from 76 mm under both coefficients."""
    return simulate_decay(paper_beam(10), QuadraticDamping(0.3, 0.5), frequency=1.85, duration=3.0)


def test_a_tuned_beam_has_the_frequency_and_no_weight(paper_beam):
    beam = tune_beam(paper_beam(4, elastic_modulus=(200e9, 210e9, 190e9, 220e9)), 5.0)
    assert natural_modes(Model(beam), count=1).frequencies[0] == pytest.approx(5.0)
    assert beam.gravity == (0.0, 0.0)
    assert beam.elastic_modulus[3] / beam.elastic_modulus[2] == pytest.approx(220 / 190)


@pytest.mark.parametrize("axis", [(0.0, -1.0), (1.0, 0.0), (-0.6, 0.8)])
def test_a_decay_starts_in_mode_1_without_stretching_the_beam(paper_beam, axis):
    modes = natural_modes(Model(paper_beam(10, axis=axis, gravity=(0.0, 0.0))), count=3)
    start = displace_tip(modes, 0.076)
    across = start.tip @ np.array([-axis[1], axis[0]])
    assert abs(across) == pytest.approx(0.076)
    first, *remaining = (abs(modes.modal_coordinate(start.coordinates, mode)) for mode in range(3))
    assert max(remaining) < 0.002 * first
    points = np.array([modes.model.interpolation(s) @ start.coordinates for s in np.linspace(0.0, 0.5, 2001)])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(0.5, rel=1e-6)
    assert np.linalg.norm(start.tip) < 0.4995  # a mode shape of this amplitude would stretch to 0.506 m


def test_for_a_small_amplitude_the_start_is_mode_1_alone(paper_beam):
    modes = natural_modes(Model(paper_beam(20, gravity=(0.0, 0.0))), count=3)
    start = displace_tip(modes, 1e-3)
    first, *remaining = (abs(modes.modal_coordinate(start.coordinates, mode)) for mode in range(3))
    assert max(remaining) < 2e-4 * first


def test_the_motion_by_the_formula_solves_eq_26_from_rest(decay):
    """Against a numerical solution of one mode, 0.1 zeta of the start; as printed, Eq. (27) is off by zeta."""
    omega, law = 2 * np.pi * decay.frequency, decay.law
    zeta = law.eta1 / (2 * omega) + 4 * law.eta2 * 0.076 / (3 * np.pi)
    exact, _ = drag_motion(law.eta1, law.eta2, omega, [0.076, 0.0], decay.time)
    assert decay.formula_tip[0] == pytest.approx(0.076)
    assert abs(decay.formula_tip - exact).max() < 0.15 * zeta * 0.076
    printed = decay.formula.amplitude * np.cos(omega * decay.time)
    assert abs(printed - exact).max() > 0.6 * zeta * 0.076


def test_the_beam_decays_as_the_formula_says_within_a_percent_at_76_mm(decay):
    ratios = [decay.envelope.at(t) / decay.formula.at(t) for t in (0.5, 1.5, 3.0)]
    assert ratios == pytest.approx([1.0, 1.0, 1.0], abs=0.01)
    assert decay.formula.at(3.0) < 0.6 * 0.076


@pytest.mark.slow
@pytest.mark.parametrize(("eta1", "eta2"), [(2.0, 0.0), (1e-9, 40.0)])
def test_at_small_amplitudes_the_beam_decays_as_one_mode(paper_beam, eta1, eta2):
    """The drag constant of mode 1 is 0.7389, that of the shape (21) 0.7405, 0.2 % more."""
    small = simulate_decay(paper_beam(8), QuadraticDamping(eta1, eta2), frequency=5.0, amplitude=2e-3, duration=1.5)
    drag_constant = 0.7389 / (876 / 1183)
    exact = quadratic_envelope(cs.DM(1.5), *map(cs.DM, (10 * np.pi, eta1, drag_constant * eta2, 2e-3)))
    assert small.envelope.at(1.5) == pytest.approx(float(exact), rel=2e-3)


def test_damping_ratios_along_a_decay_are_those_of_the_formula(decay):
    _, ratio, formula = ratios_over_time(decay)
    assert ratio == pytest.approx(formula, rel=0.05)
    assert formula[0] > 1.2 * formula[-1]


def test_quadratic_3_and_4_cross_at_5_s_as_printed_and_never_with_0_30():
    third = by_formula(1.85, 0.15, 0.11, START)
    assert crossing(third, by_formula(1.85, 3e-4, 0.22, START)) == pytest.approx(5.0, abs=2e-3)
    assert math.isnan(crossing(third, by_formula(1.85, 0.30, 0.22, START)))


def test_an_envelope_gives_amplitudes_and_the_time_to_a_fraction():
    envelope = Envelope(np.array([0.0, 1.0, 2.0]), 0.02 * np.exp([0.0, -1.0, -4.0]))
    assert envelope.at(1.5) == pytest.approx(0.02 * math.exp(-2.5))
    assert envelope.time_to(math.exp(-0.25)) == pytest.approx(0.25)
    assert envelope.time_to(math.exp(-2.5)) == pytest.approx(1.5)
    assert math.isnan(envelope.time_to(math.exp(-5.0)))
    assert math.isnan(envelope.at(2.1))


def test_peaks_lie_on_the_envelope_of_a_decay_between_its_samples():
    time = np.arange(0.0, 5.0, 1 / 73.0)
    omega, rate = 2 * np.pi * 1.85, 0.2
    envelope = peaks(time, np.exp(-rate * time) * (np.cos(omega * time) + rate / omega * np.sin(omega * time)))
    assert np.diff(envelope.time) == pytest.approx(0.5 / 1.85, abs=2e-3)
    assert envelope.amplitude == pytest.approx(np.exp(-rate * envelope.time), rel=1e-3)


def test_the_words_of_table_6_follow_from_eq_27():
    first, second = characteristics(
        [by_formula(f, 2.0, 0.0) for f in (1.0, 5.0, 20.0)], [by_formula(f, 1e-9, 1.0) for f in (1.0, 5.0, 20.0)]
    )
    words = [tuple(row[key] for key in ("gross_motion", "frequency", "residual_motion")) for row in (first, second)]
    assert words[0] == ("rapid decay", "independent", "controllable")
    assert words[1] == ("slow decay", "dependent", "uncontrollable")
    assert first["decay_rates"] == pytest.approx((1.0, 1.0, 1.0))
    ω = 2 * math.pi * np.array([1.0, 5.0, 20.0])
    assert second["left"] == pytest.approx(1 / (1 + 4 * ω * 0.076 * 5 / (3 * math.pi)))


def test_other_coefficients_get_other_words():
    """At 40 Hz a strong quadratic law is the faster of the two, and at 1 Hz the slower."""
    first, second = characteristics(
        [by_formula(f, 0.5, 0.0) for f in (1.0, 40.0)], [by_formula(f, 0.0, 1.0) for f in (1.0, 40.0)]
    )
    assert (first["gross_motion"], second["gross_motion"]) == ("undecided", "undecided")
    assert first["residual_motion"] == "uncontrollable"
