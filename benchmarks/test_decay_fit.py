"""Time of a decay fit to the raw signal: limit 0.1 s for 5000 samples."""

import math

import casadi as cs
import numpy as np
import pytest

from ancf_casadi.decay.closed_forms import linear_decay
from problems.decay.fitting import fit_decay


@pytest.mark.parametrize("law", ["linear", "quadratic", "friction"])
@pytest.mark.parametrize(("frequency", "ratio", "r0"), [(1.85, 0.0100, 0.050), (88.60, 0.0030, 0.005)])
def test_decay_fit(benchmark, frequency, ratio, r0, law):
    time = np.arange(5000) / 1000
    record = np.asarray(linear_decay(cs.DM(time), 2 * math.pi * frequency, ratio, r0, 0.0)).ravel()
    record += 2e-4 * np.random.default_rng(1).standard_normal(len(time))
    fit = benchmark(fit_decay, time, record, law=law)
    assert fit.frequency == pytest.approx(frequency, rel=1e-4)
