import numpy as np
import pytest

from problems.frf.refinement import fitted_deviations


@pytest.mark.parametrize(("sensor", "force"), [(0.1, 1e-3), (0.01, 1e-6), (1e-4, 1e-4), (0.0, 1e-3)])
def test_the_variance_of_a_function_is_the_most_likely_one(sensor, force):
    """No other ratio of A and B is more likely; searches in both stopped early."""
    f = np.linspace(1.0, 10.0, 100)
    power = np.abs(sum(1 / (natural**2 - f**2 + 0.02j * natural * f) for natural in (2.0, 5.0, 8.0))) ** 2
    true = sensor * np.median(power) + force * power
    for seed in range(20):
        squares = true * np.random.default_rng(seed).exponential(size=len(f))
        variances = (
            fitted_deviations(np.sqrt(squares)[:, None], np.sqrt(power)[:, None], np.zeros((len(f), 1)))[:, 0] ** 2
        )
        grid = np.geomspace(1e-7, 10.0, 200)
        shapes = np.median(power) + np.concatenate([[0.0], grid / grid.max() * 1e5])[:, None] * power
        deviances = len(f) * np.log(np.mean(squares / shapes, axis=1)) + np.log(shapes).sum(axis=1) + len(f)
        assert np.sum(np.log(variances) + squares / variances) < deviances.min() + 0.01
