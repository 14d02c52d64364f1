"""The error of an oscillation that was rounded to steps, against rounded oscillations."""

import numpy as np
import pytest

from ancf_casadi.decay.quantisation import rounding_errors

THETA = 2 * np.pi * (np.arange(2000) + 0.5) / 2000


def amplitude_error(amplitude, rest):
    """Return the amplitude and the rest position that rounding to steps of 1 adds."""
    added = np.round(rest + amplitude * np.cos(THETA)) - rest - amplitude * np.cos(THETA)
    return 2 * np.mean(added * np.cos(THETA)), np.mean(added)


@pytest.mark.parametrize(("low", "high"), [(0.6, 1.6), (1.5, 3.0), (3.0, 8.0)])
def test_rounding_errors_are_as_large_as_those_of_rounded_oscillations(low, high):
    a = np.linspace(low, high, 60)
    errors = np.array([[amplitude_error(one, rest) for one in a] for rest in np.linspace(-0.5, 0.5, 11)])
    curves = 2.0 * rounding_errors(2.0 * a, np.ones(60), 2.0, 0.0) / 4.0  # in steps
    for actual, expected in ((errors[..., 0], curves[:, :2]), (errors[..., 1], curves[:, 2:])):
        size = np.sqrt(np.mean(np.sum(expected**2, axis=1)))
        assert 0.6 * size < np.sqrt(np.mean(actual**2)) < 1.05 * size
        assert np.abs(actual).max() < 3.5 * size


def test_noise_takes_the_place_of_rounding():
    a = np.linspace(1.0, 3.0, 60)
    quiet, noisy = (np.abs(rounding_errors(a, np.ones(60), 1.0, rms)).max() for rms in (0.2, 0.8))
    assert noisy < 1e-3 * quiet
