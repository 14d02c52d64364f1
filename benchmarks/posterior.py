"""Simulation-based calibration of ``fit.sample``: the rank of the truth among draws of the posterior is uniform.

    python -m benchmarks.posterior --seeds 200

The truths come from ranges that are wide against the posterior, which has constant densities as priors.  Of 252 draws
of a chain, every fourth counts, so that the ranks from 0 to 63 are nearly independent.  The table has the number of
ranks in each eighth, and the probability of a chi-squared as large if they are uniform.  The seeds are independent:
``--first`` begins at another one.

References
----------
S. Talts et al., Validating Bayesian inference algorithms with simulation-based calibration, arXiv:1804.06788 (2018).
"""

import argparse
import math
import time
import warnings

import numpy as np
from scipy import stats

from problems import fit_decay

TIME = np.linspace(0.0, 8.0, 161)
DRAWS, THINNED, BINS = 252, 4, 8


def ranks(seed):
    """Return the rank of the truth of each quantity."""
    rng = np.random.default_rng(seed)
    ω, decay, amplitude, phase, offset = rng.uniform((10.0, 0.05, 0.015, -1.0, -1e-3), (14.0, 0.25, 0.03, 1.0, 1e-3))
    clean = offset + amplitude * np.exp(-decay * TIME) * np.cos(ω * TIME + phase)
    noise = 1.5e-3 * rng.standard_normal(len(TIME))
    fit = fit_decay(TIME, clean + noise, release_time=0.0)
    samples = fit.sample(draws=DRAWS, chains=1, seed=seed).posterior
    undamped = math.hypot(ω, decay)
    truth = {"frequency": undamped / (2 * math.pi), "damping_ratio": decay / undamped, "offset": offset}
    return [int(np.sum(samples[name].values[0, 3::THINNED] < value)) for name, value in truth.items()]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of changes of ArviZ
        found = np.array([ranks(seed) for seed in range(options.first, options.first + options.seeds)])
    for name, column in zip(("frequency", "damping ratio", "offset"), found.T, strict=True):
        counts = np.bincount(column * BINS // (DRAWS // THINNED + 1), minlength=BINS)
        print(f"{name:15s}", *(f"{count:4d}" for count in counts), f"  p = {stats.chisquare(counts).pvalue:.3f}")
    print(f"{time.process_time() - began:.0f} s of processor time")


if __name__ == "__main__":
    main()
