"""End of an excitation in a decay record, from exact motions of one mode; plain decays are not cut."""

import math

import casadi as cs
import numpy as np
import pytest

from ancf_casadi.decay.closed_forms import friction_decay, linear_decay
from ancf_casadi.decay.release import find_end_of_excitation, find_release
from problems import fit_decay

FREQUENCY = 1.85  # Hz
ω = 2 * math.pi * FREQUENCY
ENDS = "the end of an excitation"


def excited(ζ, ratio, periods, free, *, from_rest, phase=0.0, laboratory=False, rate=60.0):
    """Time, displacement by its largest, and end of the force: x'' + 2 zeta omega x' + omega^2 x = -u'', exactly.

    The base moves like u = sin(ratio omega t + phase) and stops where its speed is zero; x is relative to it, or in the
    laboratory.
    """
    Ω = ratio * ω
    stop = (round((Ω * periods / FREQUENCY + phase) / math.pi - 0.5) + 0.5) * math.pi / Ω - phase / Ω
    t = np.arange(0.0, stop + free / FREQUENCY, 1 / rate)
    gain = Ω**2 / (ω**2 - Ω**2 + 2j * ζ * ω * Ω)
    steady, speed = ((gain * (1j * Ω) ** k * np.exp(1j * (Ω * np.append(t, stop) + phase))).imag for k in (0, 1))
    start = (-steady[0], -speed[0]) if from_rest else (0.0, 0.0)
    ω_d = ω * math.sqrt(1 - ζ**2)

    def decay(t, r0, v0):
        z = (r0 - 1j * (v0 + ζ * ω * r0) / ω_d) * np.exp((-ζ * ω + 1j * ω_d) * t)
        return z.real, ((-ζ * ω + 1j * ω_d) * z).real

    transient, rate_of_it = decay(np.append(t, stop), *start)
    x = (steady + transient)[:-1]
    x[t >= stop] = decay(t[t >= stop] - stop, (steady + transient)[-1], (speed + rate_of_it)[-1])[0]
    x += np.sin(Ω * np.minimum(t, stop) + phase) * laboratory
    return t, x / abs(x).max(), stop


def test_the_motion_obeys_its_equation_and_is_smooth_where_the_force_ends():
    t, x, stop = excited(0.01, 0.99, 20, 10, from_rest=True, rate=1e4)
    h = t[1]
    free = t[1:-1] > stop + h
    residual = np.diff(x, 2) / h**2 + 2 * 0.01 * ω * (x[2:] - x[:-2]) / (2 * h) + ω**2 * x[1:-1]
    assert abs(residual[free]).max() < 1e-3 * ω**2
    assert abs(residual[~free][:-2]).max() > 0.01 * ω**2
    assert abs(np.diff(x)).max() < 1.1 * ω * h


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ζ", "noise", "least"), [(0.002, 0.01, 18), (0.01, 0.1, 17), (0.03, 0.01, 18), (0.03, 0.1, 17)]
)
def test_frequency_and_damping_after_an_excitation_are_unbiased(ζ, noise, least):
    """18 records with the force on for 8 to 40 periods, steady or growing, at resonance, 1 % below or 2 % above.

    The mean score is within 4/18^1/2 of 0; the median of its square, 0.455 of a normal one, is known to 0.17.
    """
    rng, scores, found = np.random.default_rng(3), [], 0
    for k in range(18):
        t, x, stop = excited(
            ζ, (1.0, 0.99, 1.02)[k % 3], rng.uniform(8, 40), min(60.0, max(20.0, 1.5 / (2 * math.pi * ζ))),
            from_rest=bool(rng.integers(2)), phase=rng.uniform(0, 6), laboratory=bool(rng.integers(2)),
        )  # fmt: skip
        fit = fit_decay(t, x + noise * rng.standard_normal(len(t)))
        found += fit.release_reason == ENDS
        assert fit.release_reason != ENDS or -3.0 < (fit.release_time - stop) * FREQUENCY < 9.0
        errors = fit.standard_errors
        scores.append(
            [(fit.frequency - FREQUENCY) / errors["frequency"], (fit.damping_ratio - ζ) / errors["damping_ratio"]]
        )
    assert found >= least
    assert (abs(np.mean(scores, axis=0)) < 4 / math.sqrt(18)).all()
    assert (abs(np.median(np.square(scores), axis=0) - 0.455) < 0.6).all()
    assert ((np.abs(scores) < 2.0).mean(axis=0) >= 0.8).all()


@pytest.mark.parametrize("ζ", [0.02, 0.05])
@pytest.mark.parametrize("driven", [400, 800, 1360])
def test_a_short_decay_is_found_after_a_long_excitation(ζ, driven):
    """The decay lasts for 25 or 10 periods, of which the record has 1400."""
    t, x, stop = excited(ζ, 1.0, driven, 1400 - driven, from_rest=True)
    fit = fit_decay(t, x + 1e-3 * np.random.default_rng(0).standard_normal(len(t)))
    assert fit.release_reason == ENDS and -1.0 < (fit.release_time - stop) * FREQUENCY < 6.0
    low, high = fit.intervals()["damping_ratio"]
    assert low < ζ < high < low + ζ / 3


@pytest.mark.slow
def test_without_the_finder_the_damping_would_be_wrong():
    t, x, _ = excited(0.01, 0.99, 20, 25, from_rest=False)
    y = x + 0.01 * np.random.default_rng(1).standard_normal(len(t))
    whole, fit = fit_decay(t, y, release_time=0.0), fit_decay(t, y)
    assert whole.standard_errors["damping_ratio"] > 10 * fit.standard_errors["damping_ratio"]
    assert abs(whole.damping_ratio - 0.01) > 50 * whole.fit.white_errors[whole.fit.names.index("zeta")]
    assert abs(fit.damping_ratio - 0.01) < 3 * fit.standard_errors["damping_ratio"]
    assert f"({ENDS})" in fit.report() and fit.to_dict()["release_reason"] == ENDS
    assert "(given)" in whole.report()


def plain(kind, rng, t):
    """Return a free decay, normalised to a largest value of 1."""
    far, near = ω * 6.3, ω * rng.uniform(1.02, 1.5)
    first = {"η1": rng.uniform(0.0, 0.3), "e0": 0.1, "φ": rng.uniform(0, 6)}
    damped = np.array(linear_decay(cs.DM(t), ω, rng.uniform(0.001, 0.03), 0.1, rng.normal())).ravel()
    beating = {
        "two modes": lambda: linear_decay(cs.DM(t), near, rng.uniform(0.001, 0.03), rng.normal() / 10, 0.0),
        "a far mode": lambda: linear_decay(cs.DM(t), far, rng.uniform(0.001, 0.03), rng.normal() / 10, 0.0),
    }
    curve = {
        "linear": lambda: linear_decay(cs.DM(t), ω, rng.choice([0.0, 0.002, 0.03, 0.2]), 0.1, rng.normal()),
        "quadratic": lambda: friction_decay(cs.DM(t), ω, 0.0, first["η1"], rng.uniform(0, 3), 0.1, first["φ"]),
        "friction": lambda: friction_decay(cs.DM(t), ω, rng.uniform(0.05, 0.5), first["η1"], 0.0, 0.1, first["φ"]),
        "drift": lambda: damped + rng.normal() * (t / t[-1]) ** rng.integers(1, 3),
    } | {name: (lambda other=other: damped + np.array(other()).ravel()) for name, other in beating.items()}
    y = np.asarray(curve[kind]()).ravel()
    return y / abs(y).max()


@pytest.mark.parametrize("kind", ["linear", "quadratic", "friction", "drift", "two modes", "a far mode"])
def test_a_plain_decay_is_never_cut(kind):
    """Records of 3 to 30 s, without noise and with noise of up to a tenth of the amplitude."""
    rng = np.random.default_rng(1)
    for k in range(40):
        t = np.arange(0.0, rng.uniform(3.0, 30.0), 1 / 50)
        y = plain(kind, rng, t) + (0.0, 1e-4, 1e-2, 0.1)[k % 4] * rng.standard_normal(len(t))
        assert find_release(t, y).reason != ENDS


@pytest.mark.parametrize("kind", ["linear", "quadratic", "friction", "drift", "two modes", "a far mode"])
@pytest.mark.parametrize("longest", [1, 12, 200])
def test_a_plain_decay_with_missing_frames_is_hardly_ever_taken_for_an_excitation(kind, longest):
    """Up to 30 % of the frames are missing: single ones, in bursts, or as one gap; one record of 360 fails."""
    rng, taken = np.random.default_rng(6), 0
    for k in range(20):
        t = np.arange(0.0, rng.uniform(14.0, 30.0), 1 / 50)
        y = plain(kind, rng, t) + (0.0, 1e-4, 1e-2, 0.1)[k % 4] * rng.standard_normal(len(t))
        keep = np.ones(len(t), dtype=bool)
        while keep.mean() > 0.7 and (longest < 200 or keep.all()):
            begin = int(rng.integers(len(t)))
            keep[begin : begin + int(rng.integers(1, longest + 1))] = False
        taken += find_end_of_excitation(t[keep], y[keep]) > 0
    assert taken <= (kind == "two modes")


@pytest.mark.slow
def test_an_excitation_that_grows_out_of_the_noise_is_not_taken_for_rest_and_release():
    """From rest, slowly, in noise of a tenth: the first swing above the noise is no release."""
    rng, found = np.random.default_rng(14), 0
    for k in range(16):
        ratio, phase = (1.0, 0.99)[k % 2], rng.uniform(0, 6)
        t, x, _ = excited(0.002, ratio, rng.uniform(8, 40), 40.0, from_rest=True, phase=phase, rate=30.0)
        found += find_release(t, x + 0.1 * rng.standard_normal(len(t))).reason == ENDS
    assert found >= 14


@pytest.mark.parametrize("kind", ["static", "struck"])
@pytest.mark.parametrize("missing", ["none", "a gap"])
def test_a_release_after_rest_is_no_excitation(kind, missing):
    """With little noise, a gap leaves parts of windows, whose amplitudes no model explains beyond a thousandth."""
    rng = np.random.default_rng(12)
    for k in range(60):
        t = np.arange(0.0, 40.0 / FREQUENCY, 1 / (FREQUENCY * rng.choice([4.0, 8.0, 15.0, 40.0])))
        since = np.maximum(t - rng.uniform(0.05, 0.2) * t[-1], 0.0)
        r0, v0 = (1.0, 0.0) if kind == "static" else (0.0, ω)
        x = np.asarray(linear_decay(cs.DM(since), ω, 0.01, r0, v0)).ravel()
        x += (0.0, 1e-4, 0.01, 0.05)[k % 4] * rng.standard_normal(len(t))
        begin = rng.uniform(0.3, 0.7) * t[-1]
        keep = (t < begin) | (t > begin + 4 / FREQUENCY) | (missing == "none")
        assert find_release(t[keep], x[keep]).reason != ENDS


@pytest.mark.slow
def test_the_end_of_an_excitation_is_found_with_dropped_frames():
    rng = np.random.default_rng(7)
    for k in range(8):
        t, x, stop = excited(0.01, (1.0, 0.99, 1.02)[k % 3], 20, 40, from_rest=True)
        keep = rng.random(len(t)) > 0.3
        found = find_release(t[keep], (x + 0.01 * rng.standard_normal(len(t)))[keep])
        assert found.reason == ENDS
        assert -3.0 < (t[keep][found.index] - stop) * FREQUENCY < 9.0
