"""Local maxima, against those of SciPy."""

import numpy as np
from scipy.signal import find_peaks

from ancf_casadi.support.arrays import maxima


def test_maxima_are_those_of_scipy():
    values = np.random.default_rng(0).standard_normal(1000)
    np.testing.assert_array_equal(maxima(values), find_peaks(values)[0])
    assert not maxima(np.array([2.0, 1.0])).size and not maxima(np.arange(5.0)).size
