"""Efficiency and coverage of fits over as many seeds as the tests have no time for.

.venv/bin/python -m pytest benchmarks/fit_coverage.py
"""

import numpy as np
import pytest

from tests.coverage import covers
from tests.problems.decay import test_fitting as decay
from tests.problems.frf import test_fitting as frf
from tests.problems.frf.test_fitting import four_modes as four_modes


@pytest.mark.parametrize("seeds", [20, 1000])
@pytest.mark.parametrize("k", range(5))
def test_decay_fits_are_efficient(k, seeds):
    """The scatter of n fits is known to 1/(2 n)^(1/2) of itself, the mean to 1/n^(1/2); limits at 3.6 times these."""
    efficiency, bias, hits = decay.many_fits(decay.MODES[k], decay.CRAMER_RAO[k], seeds)
    np.testing.assert_allclose(efficiency, 1.0, atol=3.6 / (2 * seeds) ** 0.5)
    assert (np.abs(bias) < 3.6 / seeds**0.5).all()
    assert all(covers(held, seeds) for held in hits)


@pytest.mark.parametrize("seeds", [5, 200])
@pytest.mark.parametrize("kind", ["constant", "relative", "falling", "shared"])
def test_modes_of_frequency_response_functions(four_modes, kind, seeds):
    f, modes = four_modes
    values = frf.modal_sum(f, modes)
    hits = [hit for seed in range(seeds) for hit in frf.contained(f, modes, values, kind, seed)]
    assert covers(sum(hits), len(hits))
