"""
A decay with standard errors
============================

Frequency and damping ratio of a noisy free decay, with standard errors.

A mode of 1.85 Hz and 1 % damping is released from 50 mm and filmed for 5 s at 500 frames per second, with 1 mm of
noise.  No unbiased fit has smaller standard errors than the Cramer-Rao bounds, 8.4e-5 Hz and 4.5e-5, which
this fit reaches.
"""

import casadi as cs
import numpy as np

from ancf_casadi.decay.closed_forms import linear_decay
from problems import fit_decay

time = np.arange(0.0, 5.0, 1 / 500)
exact = linear_decay(cs.DM(time), *map(cs.DM, (2 * np.pi * 1.85, 0.01, 0.050, 0.0))).full().ravel()
record = exact + 1e-3 * np.random.default_rng(1).standard_normal(time.size)
fit = fit_decay(time, record, rest="zero")

if __name__ == "__main__":
    print(fit.report())
    fit.figure().savefig("decay.png")
