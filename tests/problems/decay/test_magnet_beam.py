"""A measured beam with magnets at its tip, driven and then free: its frequency falls from 38.9 to 36.9 Hz."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from ancf_casadi import Measurement, damping_curve
from problems import fit_decay

FILE = Path(__file__).parents[4] / "shared" / "data" / "magnet_beam" / "decay_f_42p05_ampl_2p0_0.lvm"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FILE.is_file(), reason="the measured records are not part of the repository"),
]


def smooth_rms(time, y, frequency, terms=8):
    """Return what a smooth amplitude and a smooth phase leave: both smooth functions of the time are of the amplitude.

    The terms are polynomials of ln(1 + t), fitted by Gauss-Newton steps.
    """
    t = time - time[0]
    u = 2 * np.log1p(t) / np.log1p(t[-1]) - 1
    ω = 2 * np.pi * frequency
    slow = np.convolve(2 * y * np.exp(-1j * ω * t), np.ones(81) / 81, "same")
    size = np.abs(slow)
    clear = (t > 0.05) & (size > 0.02 * size.max())
    phase = (np.unwrap(np.angle(slow)) + ω * t)[clear]
    own = [chebyshev.chebfit(u[clear], values, terms - 1, w=size[clear]) for values in (np.log(size[clear]), phase)]
    basis, unknowns = chebyshev.chebvander(u, terms - 1), np.concatenate(own)
    for _ in range(12):
        amplitude, angle = np.exp(basis @ unknowns[:terms]), basis @ unknowns[terms:]
        swing, across = amplitude * np.cos(angle), -amplitude * np.sin(angle)
        columns = np.column_stack([basis * swing[:, None], basis * across[:, None], np.ones(len(t))])
        step = np.linalg.lstsq(columns, y - swing)[0]
        left, unknowns = y - swing - columns @ step, unknowns + step[:-1]
    return float(np.sqrt(np.mean(left**2)))


def test_one_law_leaves_as_little_as_a_smooth_function():
    record = Measurement.from_file(FILE, column="Strain_0")
    fit = fit_decay(record, law="auto")
    assert fit.release_time == pytest.approx(12.4, abs=0.1)
    assert fit.release_reason == "the end of an excitation"
    assert fit.frequency_law == "quadratic"
    assert fit.frequency == pytest.approx(36.87, abs=0.05)
    decay = record.values[-fit.samples :]
    assert fit.residual_rms < 1.5 * smooth_rms(fit.time, decay, fit.frequency)


def test_windows_of_its_decay_have_the_errors_of_their_scatter():
    record = Measurement.from_file(FILE, column="Strain_0")
    curve = damping_curve(record, release_time=12.376, periods=8.0)
    errors = np.sqrt(
        curve.frequency_errors[:-2] ** 2 + 4 * curve.frequency_errors[1:-1] ** 2 + curve.frequency_errors[2:] ** 2
    )
    score = np.diff(curve.frequency, 2) / errors
    late = score[len(score) // 4 :]
    assert 0.5 < np.sqrt(np.mean(late**2)) < 1.5
