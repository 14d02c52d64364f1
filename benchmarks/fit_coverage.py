"""Efficiency and coverage of fits over as many seeds as the tests have no time for.

.venv/bin/python -m pytest benchmarks/fit_coverage.py
"""

import numpy as np
import pytest

from tests.coverage import covers
from tests.problems.decay import test_fitting as decay
from tests.problems.frf import test_fitting as frf
from tests.problems.frf.test_fitting import four_modes as four_modes


@pytest.mark.parametrize("k", range(5))
def test_decay_fits_are_efficient(k):
    """A standard deviation of 1000 fits is known to 2.2 %, a mean to 3.2 % of one, a coverage of 0.95 to 0.007."""
    efficiency, bias, hits = decay.many_fits(decay.MODES[k], decay.CRAMER_RAO[k], 1000)
    np.testing.assert_allclose(efficiency, 1.0, atol=0.08)
    assert (np.abs(bias) < 0.12).all()
    assert all(covers(held, 1000) for held in hits)


@pytest.mark.parametrize("kind", ["constant", "relative", "falling", "shared"])
def test_modes_of_frequency_response_functions(four_modes, kind):
    f, modes = four_modes
    values = frf.modal_sum(f, modes)
    hits = [hit for seed in range(200) for hit in frf.contained(f, modes, values, kind, seed)]
    assert covers(sum(hits), len(hits))
