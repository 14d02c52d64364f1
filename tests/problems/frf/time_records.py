"""Force and acceleration over time of two modes under a hammer or a shaker, with noise on both channels."""

from functools import partial

import numpy as np
from scipy.signal import butter, cont2discrete, lfilter, sosfilt

from ancf_casadi import Measurement, Sensor
from problems import fit_frf, frf_of

MODES = ((8.0, 0.010, 1.0), (21.0, 0.006, -0.6))  # frequency (Hz), damping ratio, modal constant (1/kg)
RATE, FINER = 200.0, 10  # samples per second of the records, and of the simulation per sample


def acceleration(force, step):
    """Response of the modes to a force that is linear between samples, exact."""
    response = 0.0
    for frequency, ratio, constant in MODES:
        natural = 2 * np.pi * frequency
        system = ([constant, 0.0, 0.0], [1.0, 2 * ratio * natural, natural**2])
        numerator, denominator, _ = cont2discrete(system, step, method="foh")
        response = response + lfilter(numerator.ravel(), denominator, force)
    return response


def take(force, rng, response_noise, force_noise):
    """Records of a fine force, with noise relative to the largest value of each channel."""
    response = acceleration(force, 1 / (RATE * FINER))
    time = np.arange(len(force) // FINER) / RATE
    records = []
    for values, noise, quantity in ((force, force_noise, "force"), (response, response_noise, "acceleration")):
        sampled = values[::FINER][: len(time)]
        sampled = sampled + noise * np.abs(sampled).max() * rng.normal(size=len(time))
        records.append(Measurement(time, sampled, quantity, Sensor(quantity)))
    return tuple(records)


def hammer(rng, *, hits=(1.0, 13.0, 27.0, 39.0), end=52.0, bounces=(), noise=(3e-3, 3e-3)):
    """Hits of random height, smooth pulses of 30 ms; bounces follow after 0.12 s."""
    time = np.arange(round(end * RATE * FINER)) / (RATE * FINER)
    force = np.zeros(len(time))
    for hit in (*hits, *(hits[k] + 0.12 for k in bounces)):
        inside = (time >= hit) & (time <= hit + 0.03)
        force += inside * rng.uniform(20.0, 60.0) * np.sin(np.pi * (time - hit) / 0.03) ** 2
    return take(force, rng, *noise)


def shaker(rng, *, duration=200.0, noise=(1e-2, 1e-2)):
    """Random force up to 50 Hz."""
    white = rng.normal(size=round((duration + 20.0) * RATE * FINER))
    force = sosfilt(butter(4, 50.0, output="sos", fs=RATE * FINER), white)
    records = take(force, rng, *noise)
    return tuple(record.cut(20.0) for record in records)


def fit_records(records, settings, seed):
    """Fit the functions that the records of a seed give."""
    record = frf_of(*records(np.random.default_rng(seed)), **settings)
    return fit_frf(record, frequencies=[mode[0] for mode in MODES])


def intervals_hold(fit, level=0.95):
    """Whether the interval of each frequency and damping ratio holds the truth, and the standardised errors."""
    truth = {}
    for k, (frequency, ratio, _) in enumerate(MODES, start=1):
        truth |= {f"frequency_{k}": frequency, f"damping_ratio_{k}": ratio}
    intervals, errors, estimates = fit.intervals(level), fit.standard_errors, fit.estimates
    return [(intervals[n][0] <= v <= intervals[n][1], (estimates[n] - v) / errors[n]) for n, v in truth.items()]


CASES = {  # records of a random generator, and settings of frf_of
    "hammer": (hammer, {}),
    "exponential window": (hammer, {"time_constant": 3.0}),
    "double hits": (partial(hammer, bounces=(1, 3)), {}),
    "early hits": (partial(hammer, hits=(1.0, 4.0, 7.0, 10.0, 13.0, 16.0), end=19.5), {}),  # 22 % of mode 1 is left
    "one hit": (partial(hammer, hits=(1.0,), end=15.0), {}),
    "shaker": (shaker, {}),
    "short shaker": (partial(shaker, duration=40.0), {}),  # 0.6 lines per half-power bandwidth
    "noisy force": (partial(shaker, noise=(1e-2, 5e-2)), {}),
}
