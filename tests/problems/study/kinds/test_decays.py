"""Decays of a study: synthetic ones that are Eq. (9) or (27) with white noise, measured ones, and their fits."""

import math
from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import FitError, InputError, Measurement
from ancf_casadi.decay.closed_forms import linear_decay, quadratic_decay
from ancf_casadi.records.sensor import Sensor
from problems.paper import table_02, table_04
from problems.study.kinds.decays import SYNTHETIC_STD, SyntheticDecay, decays_finding, fit_plain, synthetic_decays
from problems.study.study import run_study
from tests.problems.conftest import column
from tests.problems.paper import numbers as paper

QUADRATIC = SyntheticDecay(3.0, 0.02, eta1=0.3, eta2=5.0), SyntheticDecay(7.0, 0.02, eta1=0.2, eta2=8.0)


def exact(name: str) -> list[np.ndarray]:
    """The closed forms with the numbers of the paper."""
    time = cs.DM(np.arange(0.0, 5.0, 1 / 500))
    angular = [2 * math.pi * f for f in paper.TARGET_FREQUENCIES]
    if name == "quadratic":
        rows = zip(angular, paper.ETA1, paper.ETA2, paper.EQUIVALENT_AMPLITUDES, strict=True)
        return [quadratic_decay(time, *map(cs.DM, row), cs.DM(0.0)).full().ravel() for row in rows]
    amplitudes = (0.050, 0.015, 0.008, 0.005, 0.005)
    rows = zip(angular, paper.DAMPING_RATIOS, amplitudes, strict=True)
    return [linear_decay(time, *map(cs.DM, row), cs.DM(0.0)).full().ravel() for row in rows]


class TestSynthetic:
    @pytest.mark.parametrize(("name", "decays"), [("linear", table_02.DECAYS), ("quadratic", table_04.DECAYS)])
    def test_is_the_closed_form_and_white_noise(self, name, decays):
        """Noise of the stated size, not correlated in time or between modes."""
        noises = []
        for decay, clean in zip(decays, exact(name), strict=True):
            assert len(decay.record.time) == 2500
            assert "white noise of 0.2 mm" in decay.synthetic
            noises.append(decay.record.values - clean)
        for k, noise in enumerate(noises):
            assert np.std(noise) == pytest.approx(SYNTHETIC_STD, rel=0.06)
            assert abs(np.mean(noise)) < 4 * SYNTHETIC_STD / math.sqrt(noise.size)
            for other in (noise[1:], *(another[1:] for another in noises[:k])):
                assert abs(np.corrcoef(noise[:-1], other)[0, 1]) < 4 / math.sqrt(noise.size)

    def test_is_the_same_each_time_and_differs_with_the_seed(self):
        one, two, same = (synthetic_decays(QUADRATIC, seed)[0].record.values for seed in (1, 2, 1))
        assert not np.array_equal(one, two)
        assert np.array_equal(one, same)


def test_a_fit_names_the_record_that_cannot_be_fitted():
    decay, _ = synthetic_decays(QUADRATIC, 3)
    still = replace(decay, record=Measurement(decay.record.time, 0 * decay.record.values, decay.record.name))
    with pytest.raises((InputError, FitError), match="mode 1"):
        fit_plain(still, "linear", None)


@pytest.mark.slow
def test_a_measured_record_is_not_called_synthetic(study_file, tmp_path):
    """A file in mm with a release in the middle."""
    time = np.arange(0.0, 4.0, 0.005)
    omega, after = 2 * math.pi * 4.0, np.maximum(time - 0.5, 0.0)
    motion = 8.0 * np.exp(-0.01 * omega * after) * np.cos(omega * after)
    motion += 1e-3 * np.random.default_rng(1).standard_normal(time.size)
    np.savetxt(tmp_path / "tip.csv", np.c_[time, motion], delimiter=",", header="time_s,tip_mm", comments="")
    report = run_study(study_file('[[decays]]\nfile = "tip.csv"\nrelease_time = 0.5\n'), tmp_path / "results")
    (measured,) = report.results["decays"]
    assert not measured["synthetic"]
    assert measured["frequency_hz"] * math.sqrt(1 - 0.01**2) == pytest.approx(4.0, rel=2e-4)
    assert measured["amplitude_m"] == pytest.approx(8e-3, rel=0.01)
    assert "SYNTHETIC" not in report.steps[0].figures[0].svg


def test_amplitudes_of_different_sensors_stand_below_their_own_units():
    decay, _ = synthetic_decays(QUADRATIC, 3)
    turned = replace(decay, record=replace(decay.record, sensor=Sensor("slope")))
    records = [decay, turned]
    (table,) = decays_finding(records, [fit_plain(record, "quadratic", None) for record in records]).tables
    for quantity, units in {"amplitude": ("m", "rad"), "eta2": ("1/m", "1/rad")}.items():
        in_first, in_second = (column(table, f"{quantity}, {unit}") for unit in units)
        assert math.isfinite(in_first[0]) and math.isnan(in_first[1])
        assert math.isnan(in_second[0]) and math.isfinite(in_second[1])


@pytest.mark.slow
def test_a_changed_file_is_fitted_again(study_file, tmp_path):
    """A result is kept under what its files hold, not under their names."""
    time = np.arange(0.0, 4.0, 0.005)
    path = study_file('[[decays]]\nfile = "tip.csv"\n')
    found = []
    for frequency in (4.0, 5.0):
        omega = 2 * math.pi * frequency
        motion = 8.0 * np.exp(-0.01 * omega * time) * np.cos(omega * time)
        np.savetxt(tmp_path / "tip.csv", np.c_[time, motion], delimiter=",", header="time_s,tip_mm", comments="")
        found.append(run_study(path, tmp_path / "results").results["decays"][0]["frequency_hz"])
    assert found == pytest.approx([4.0, 5.0], rel=2e-4)
