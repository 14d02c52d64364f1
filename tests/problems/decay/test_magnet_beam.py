"""A measured beam with magnets at its tip, driven and then free: its frequency falls from 38.9 to 36.9 Hz."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ancf_casadi import Measurement, damping_curve
from problems import fit_decay

FILE = Path(__file__).parents[4] / "shared" / "data" / "magnet_beam" / "decay_f_42p05_ampl_2p0_0.lvm"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FILE.is_file(), reason="the measured records are not part of the repository"),
]


def test_one_law_leaves_as_little_as_a_smooth_function():
    record = Measurement.from_file(FILE, column="Strain_0")
    fit = fit_decay(record, law="auto")
    assert fit.release_time == pytest.approx(12.4, abs=0.1)
    assert fit.release_reason == "the end of an excitation"
    assert fit.frequency_law == "quadratic"
    assert fit.ends_of_range.frequency[0] == pytest.approx(36.87, abs=0.05)
    smooth = fit_decay(record, law=fit.law, frequency_law="smooth", rest=fit.model.rest)
    assert smooth.residual_rms < fit.residual_rms < 1.5 * smooth.residual_rms


def test_a_smooth_frequency_does_not_leave_what_noise_hides():
    """Zero crossings give 36.9 Hz at small amplitudes."""
    fit = fit_decay(Measurement.from_file(FILE, column="Strain_0"), law="power", frequency_law="smooth")
    assert fit.ends_of_range.frequency[0] == pytest.approx(36.9, abs=0.3)


def test_windows_of_its_decay_have_the_errors_of_their_scatter():
    record = Measurement.from_file(FILE, column="Strain_0")
    curve = damping_curve(record, release_time=12.376, periods=8.0)
    errors = np.sqrt(
        curve.frequency_errors[:-2] ** 2 + 4 * curve.frequency_errors[1:-1] ** 2 + curve.frequency_errors[2:] ** 2
    )
    score = np.diff(curve.frequency, 2) / errors
    late = score[len(score) // 4 :]
    assert 0.5 < np.sqrt(np.mean(late**2)) < 1.5
