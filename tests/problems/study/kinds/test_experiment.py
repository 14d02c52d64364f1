"""A simulated experiment against the prediction of each law, closed forms, and the other integrator."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from ancf_casadi import Beam, InputError, Model, natural_modes
from problems.study.kinds.experiment import ExperimentResult, RequestedRun, decay_curve, participation, run_experiment
from tests.problems.paper import numbers as paper

LAWS = {
    "generic": ({"law": "modal", "ratios": list(paper.DAMPING_RATIOS), "frequencies": list(paper.TARGET_FREQUENCIES)},),
    "proportional": ({"law": "rayleigh", "alpha": 0.228181, "beta": 3.18013e-5, "stiffness": "tangent"},),
    "quadratic": ({"law": "quadratic", "eta1": 0.15, "eta2": 0.11},),
}


@dataclass(frozen=True)
class Case:
    """An experiment: the arguments of ``run_experiment``, and the length of the fitted decay."""

    beam: Beam
    run: RequestedRun
    terms: tuple[dict, ...] = ()
    window: float = 0.3
    method: str = "radau"

    def result(self, **run: float) -> ExperimentResult:
        """Return the result with other numbers of the run."""
        own = replace(self.run, **run, relative_window=self.window)
        return run_experiment(self.beam, self.terms, own, self.method)


@pytest.fixture(scope="module")
def third(paper_beam) -> Case:
    """The third mode of the paper's beam on a coarse mesh, which is quick to simulate, without damping."""
    return Case(paper_beam(5), RequestedRun(mode=3, amplitude=1.5e-3, stop=1.2))


@pytest.fixture(scope="module")
def first(third) -> Case:
    """The first mode at a large swing, 7.6 cm of 50 cm."""
    return replace(third, run=RequestedRun(mode=1, amplitude=0.076, stop=1.5))


@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_decay_after_the_stop_has_the_predicted_ratio(third, name):
    """The whole beam, driven and stopped, against the prediction of each law for the mode and amplitude."""
    result = replace(third, terms=LAWS[name]).result()
    assert result.numbers["expected_damping_ratio"] > 4e-4
    assert result.numbers["damping_ratio"] == pytest.approx(
        result.numbers["expected_damping_ratio"], abs=2e-6, rel=1e-3
    )
    assert result.numbers["frequency_hz"] == pytest.approx(result.numbers["natural_frequency_hz"], rel=1e-3)
    assert result.numbers["reached_amplitude_m"] == pytest.approx(1.5e-3, rel=0.01)
    assert result.numbers["amplitude_m"] < result.numbers["reached_amplitude_m"]


@pytest.mark.slow
def test_no_law_is_no_damping(third):
    """The integrator damps a thousand times less than the weakest law, and the amplitude is as planned."""
    result = third.result()
    assert result.numbers["expected_damping_ratio"] == 0.0
    assert abs(result.numbers["damping_ratio"]) < 1e-6
    assert result.numbers["amplitude_m"] == pytest.approx(1.5e-3, rel=0.01)
    assert np.ptp(decay_curve(result).amplitude) < 2e-3 * result.numbers["amplitude_m"]


@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_first_mode_at_large_swing(first, name):
    """The ratio is the predicted one, within 2 %.

    The amplitude grows from 0 in three periods; its last extreme is at most half a period before the stop.
    """
    result = replace(first, terms=LAWS[name]).result()
    assert (1 - 0.5 / 3) * first.run.amplitude < result.numbers["reached_amplitude_m"] < first.run.amplitude
    assert result.numbers["amplitude_m"] > 0.05
    assert result.numbers["damping_ratio"] == pytest.approx(result.numbers["expected_damping_ratio"], rel=0.02)


@pytest.mark.slow
def test_quadratic_damping_falls_with_the_amplitude_and_generic_damping_does_not(first):
    """Along one decay: eta1/(2 omega) + 4 eta2 A/(3 pi), and a constant."""
    for name in ("quadratic", "generic"):
        result = replace(first, terms=LAWS[name], window=0.5).result()
        curve = decay_curve(result)
        slope, rest = np.polyfit(curve.amplitude, curve.damping_ratio, 1)
        expected = 4 * 0.11 / (3 * math.pi) if name == "quadratic" else 0.0
        assert slope == pytest.approx(expected, rel=0.1, abs=3e-3)
        if name == "quadratic":
            assert rest == pytest.approx(0.15 / (4 * math.pi * result.numbers["natural_frequency_hz"]), rel=0.05)


@pytest.mark.slow
def test_what_figures_show_is_the_motion(third):
    """Relative to the clamp, from zero on, around the stop, and over the last period.

    The excitation begins with the velocity omega A, which gives mode 1 the amplitude Gamma_1 omega A/omega_1.
    """
    result = replace(third, terms=LAWS["generic"]).result()
    slow = 1.566 * result.numbers["natural_frequency_hz"] * result.numbers["base_amplitude_m"] / 1.876
    assert result.motion[2].max() == pytest.approx(result.numbers["reached_amplitude_m"] + slow, rel=0.05)
    assert result.motion[1, 0] <= 0.0 <= result.motion[2, 0] < 0.2 * result.numbers["reached_amplitude_m"]
    assert result.stop_time[0] < 0.0 < result.stop_time[-1]
    assert result.decay_time[0] >= result.numbers["stop_s"] + 2 / result.numbers["natural_frequency_hz"]
    assert np.ptp(result.shapes[:, -1, 0]) == pytest.approx(2 * result.numbers["reached_amplitude_m"], rel=0.06)
    clamp = result.shapes[:, 0]
    assert np.abs(clamp[:, 0]).max() <= result.numbers["base_amplitude_m"] * (1 + 1e-6)
    assert np.abs(clamp[:, 1]).max() < 1e-12


@pytest.mark.slow
def test_with_a_ramp_the_whole_motion_is_that_of_the_driven_mode_and_reaches_the_same_amplitude(third):
    """Mode 1 keeps what the stop leaves: the clamp rests its amplitude away from its mean position."""
    result = replace(third, terms=LAWS["generic"]).result(ramp=8.0)
    assert result.numbers["reached_amplitude_m"] == pytest.approx(1.5e-3, rel=0.01)
    assert result.motion[2].max() == pytest.approx(result.numbers["reached_amplitude_m"], rel=0.1)
    assert result.numbers["damping_ratio"] == pytest.approx(result.numbers["expected_damping_ratio"], rel=2e-3)


@pytest.mark.slow
def test_drives_at_the_given_frequency_until_the_given_time(third):
    result = replace(third, terms=LAWS["generic"]).result(frequency=28.0, stop=0.8)
    assert 0.8 <= result.numbers["stop_s"] <= 0.8 + 0.5 / 28.0
    assert result.numbers["reached_amplitude_m"] < 1.5e-3  # away from the resonance


@pytest.mark.parametrize(("mode", "gamma"), [(1, 1.5660), (2, 0.8679), (3, 0.5089)])
def test_participation_of_a_uniform_cantilever(paper_beam, mode, gamma):
    """2 sigma/(beta L) times the tip of the shape: 1.566, 0.868, 0.509 by the classical mode shapes."""
    modes = natural_modes(Model(paper_beam(20, gravity=(0.0, 0.0))), count=3)
    assert participation(modes, mode - 1) == pytest.approx(gamma, rel=2e-3)


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        (({"law": "cubic"},), "damping: law: must be one of rayleigh, quadratic,"),
        (({"law": "quadratic", "eta1": -1.0},), "eta1"),
        (({"law": "modal", "ratios": [0.01, 0.01], "frequencies": [1.0]},), "frequencies"),
    ],
)
def test_an_unusable_law_is_refused(third, terms, message):
    with pytest.raises(InputError, match=message):
        replace(third, terms=terms).result()
