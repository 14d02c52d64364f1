"""Peaks of amplitude spectra."""

import numpy as np
import pytest

from ancf_casadi import Measurement
from ancf_casadi.decay.spectrum import clear_peaks


def peaks_of(values, rate=100.0, most=6):
    frequency, amplitude = Measurement(np.arange(len(values)) / rate, values).spectrum()
    return frequency[clear_peaks(frequency, amplitude, most)]


@pytest.fixture
def time():
    return np.arange(4000) / 100.0


def noise(count, seed, scale=1.0):
    return scale * np.random.default_rng(seed).normal(size=count)


def test_modes_are_found_with_the_highest_first(time):
    decays = [(5.0, 0.05, 1.5), (1.0, 0.1, 9.4), (0.2, 0.2, 26.0)]  # amplitude, rate (1/s), frequency (Hz)
    swing = sum(a * np.exp(-rate * time) * np.cos(2 * np.pi * f * time) for a, rate, f in decays)
    assert peaks_of(swing + noise(time.size, 0, 0.01)) == pytest.approx([1.5, 9.4, 26.0], abs=0.03)


def test_only_as_many_as_asked_for(time):
    swing = sum(np.sin(2 * np.pi * f * time) for f in (3.0, 11.0, 23.0))
    assert len(peaks_of(swing, most=2)) == 2


def test_noise_on_the_flank_of_a_peak_is_no_peak(time):
    swing = np.exp(-0.4 * time) * np.cos(2 * np.pi * 6.0 * time)
    for seed in range(20):
        assert peaks_of(swing + noise(time.size, seed, 1e-3)) == pytest.approx([6.0], abs=0.03)


def test_white_noise_has_hardly_any_peaks():
    assert sum(len(peaks_of(noise(4000, seed))) for seed in range(50)) <= 2
