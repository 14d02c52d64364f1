"""Amplitude and phase over time, against known ones."""

import math

import numpy as np
import pytest

from ancf_casadi.decay.track import track_oscillation


def chirp(time, amplitude, drop=0.06):
    """A decay whose frequency of 1 Hz at rest is lower by 6 % at the release."""
    A = amplitude * np.exp(-0.004 * time)
    return A, 2 * math.pi * (time - drop * (1 - np.exp(-0.004 * time)) / 0.004)


@pytest.mark.parametrize("periods", [40.0, 2000.0])
def test_amplitude_and_phase_are_followed_over_any_number_of_periods(periods):
    """The phase of 1 Hz, the frequency of the carrier, is off by 15 periods at the end of 2000."""
    time = np.arange(0.0, periods, 0.1)
    A, phase = chirp(time, 0.01)
    noise = 1e-4 * np.random.default_rng(1).standard_normal(len(time))
    found = track_oscillation(time, A * np.cos(phase) + 0.3 + noise, 2 * math.pi)
    end = min(periods, math.log(100) / 0.004)  # noise of 1 % of the first amplitude
    assert found.time[-1] > 0.85 * end
    right, turned = chirp(found.time, 0.01)
    np.testing.assert_allclose(found.amplitude, right, rtol=0.05, atol=2e-4)  # the carrier is off by up to 6 %
    cycles = (found.phase - turned) / (2 * math.pi)
    visible = right > 1e-3
    assert np.abs(cycles - round(cycles[0]))[visible].max() < 0.03


def test_a_gap_is_left_out():
    time = np.arange(0.0, 60.0, 0.05)
    time = time[(time < 20.0) | (time > 26.3)]
    A, phase = chirp(time, 0.01)
    found = track_oscillation(time, A * np.cos(phase), 2 * math.pi)
    assert not ((found.time > 20.5) & (found.time < 25.8)).any()
    np.testing.assert_allclose(found.amplitude, chirp(found.time, 0.01)[0], rtol=0.05)


def test_a_record_shorter_than_a_window_has_no_track():
    assert len(track_oscillation(np.linspace(0.0, 0.5, 12), np.ones(12), 2 * math.pi).time) == 0
