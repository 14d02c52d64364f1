"""A fit uses the part of a record that is a free decay, says which and how much it explains, or refuses it."""

import re

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from ancf_casadi import Measurement, separate_takes
from ancf_casadi.exceptions import AncfError, FitError
from ancf_casadi.records.sensor import Sensor
from problems import fit_decay, fit_decays


def decay(time, frequency, ratio, amplitude=1.0, phase=0.0):
    omega = 2 * np.pi * frequency
    return amplitude * np.exp(-ratio * omega * time) * np.cos(omega * np.sqrt(1 - ratio**2) * time + phase)


def covers(fit, frequency, ratio, errors=4.0):
    """Return whether a fit is right within four standard errors."""
    error = fit.standard_errors
    return (
        abs(fit.frequency - frequency) < errors * error["frequency"]
        and abs(fit.damping_ratio - ratio) < errors * error["damping_ratio"]
    )


# Outliers


def record_with_outliers(seed, count):
    """Return times, values, frequency, damping ratio, and the places of the outliers, 1.5 to 10 amplitudes large."""
    rng = np.random.default_rng(seed)
    frequency, size = rng.uniform(0.8, 12.0), int(rng.integers(800, 8000))
    time = np.arange(size) / (frequency * rng.uniform(8, 120))
    ratio = float(np.clip(rng.uniform(0.3, 4) / (2 * np.pi * frequency * time[-1]), 2e-4, 0.1))
    amplitude = 10 ** rng.uniform(-4, 0)
    values = decay(time, frequency, ratio, amplitude, rng.uniform(0, 6.28))
    values += amplitude * 10 ** rng.uniform(-3, -1.3) * rng.normal(size=size)
    places = np.sort(rng.choice(np.arange(4, size - 4, 8), count, replace=False))
    values[places] = amplitude * rng.choice([-1, 1], count) * rng.uniform(1.5, 10, count)
    return time, values, frequency, ratio, places


@pytest.mark.parametrize("place", [3989, 1000, 40])
def test_an_outlier_is_named_and_left_out_and_not_taken_for_the_release(place):
    time = np.arange(0, 70, 0.01)
    clean = decay(time, 1.2, 0.003, 0.5) + 0.005 * np.random.default_rng(3).normal(size=time.size)
    values = clean.copy()
    values[place] = 1.4
    fit, expected = fit_decay(time, values), fit_decay(time, clean)
    assert fit.release_time == 0.0
    assert fit.damping_ratio == pytest.approx(
        expected.damping_ratio, abs=0.2 * expected.standard_errors["damping_ratio"]
    )
    assert any(f"1 outlier was left out, at {time[place]:g} s" in note for note in fit.warnings)


def test_a_clean_record_has_no_outlier():
    time = np.arange(0, 20, 0.01)
    noise = 0.005 * np.random.default_rng(3).normal(size=time.size)
    for values in (
        decay(time, 1.2, 0.01),
        np.where(time < 5.0, 0.0, decay(time - 5.0, 1.2, 0.01)),
        decay(time, 30.0, 0.001),
    ):
        assert not [note for note in fit_decay(time, values + noise).warnings if "outlier" in note]


@pytest.mark.slow
def test_records_with_outliers_are_fitted_as_those_without():
    covered = 0
    for seed in range(100):
        time, values, frequency, ratio, _ = record_with_outliers(seed, 1 + 19 * (seed % 2))
        try:
            covered += covers(fit_decay(time, values), frequency, ratio)
        except AncfError:
            continue
    assert covered >= 98


# Random responses


def random_response(seed, frequency, ratio, periods, samples_per_period=30.0, settled=True):
    """Return times and values of an oscillator under white noise, from rest if it has not settled."""
    omega, rate = 2 * np.pi * frequency, samples_per_period * frequency
    size = int(periods * samples_per_period)
    numerator, denominator, _ = cont2discrete(([1], [1, 2 * ratio * omega, omega**2]), 1 / rate, "zoh")
    before = (2000 + round(0.5 / ratio * samples_per_period)) * settled
    values = lfilter(numerator.ravel(), denominator, np.random.default_rng(seed).normal(size=size + before))
    return np.arange(size) / rate, 100 * values[before:]


@pytest.mark.parametrize(("count", "least"), [(10, 9), pytest.param(100, 98, marks=pytest.mark.slow)])
def test_random_responses_are_refused(count, least):
    """Those that fade within the record may look like a free decay at its end."""
    refused = 0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        ratio = 10 ** rng.uniform(-2.0, -1.0)
        try:
            fit_decay(*random_response(seed, rng.uniform(0.8, 12.0), ratio, rng.uniform(100, 400)))
        except AncfError as error:
            refused += "random excitation" in str(error)
    assert refused >= least


@pytest.mark.slow
def test_short_and_lightly_damped_random_responses_are_refused_or_right():
    """From rest or stationary; some look like a driven motion and a free decay, or like several releases."""
    accepted = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        frequency, ratio, length = rng.uniform(1, 5), 10 ** rng.uniform(-2.7, -1.3), 10 ** rng.uniform(1.3, 2.3)
        samples, periods = 100 / frequency, length * frequency
        time, values = random_response(rng, frequency, ratio, periods, samples, settled=bool(seed % 2))
        try:
            accepted += not covers(fit_decay(time, values), frequency, ratio)
        except AncfError as error:
            accepted += "random excitation" not in str(error)
    assert accepted <= 2


@pytest.mark.slow
def test_driven_and_released_oscillators_are_hardly_ever_taken_for_random_responses():
    """A harmonic force near the resonance grows over up to half of its time, and ends."""
    refused = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        frequency, ratio, rate = rng.uniform(1, 5), 10 ** rng.uniform(-2.7, -1.3), rng.uniform(15, 60)
        early, late = int(rng.uniform(10, 60) * rate), int(max(rng.uniform(1, 5) / (2 * np.pi * ratio), 12) * rate)
        count = np.arange(early)
        ramp = np.minimum(count / (1 + rng.uniform(0, early / 2)), 1.0)
        force = np.append(ramp * np.sin(2 * np.pi * rng.uniform(0.95, 1.05) * count / rate), np.zeros(late))
        pole = np.exp(2 * np.pi / rate * complex(-ratio, np.sqrt(1 - ratio**2)))
        values = lfilter([1.0], [1.0, -pole], force.astype(complex)).imag
        values = values / np.abs(values).max() + 10 ** rng.uniform(-3, -1) * rng.normal(size=values.size)
        try:
            fit_decay(np.arange(values.size) / (rate * frequency), values)
        except FitError as error:
            refused += "random excitation" in str(error)
    assert refused <= 1


def test_a_fit_states_the_share_that_it_explains_and_refuses_below_a_half():
    time = np.arange(0, 20, 0.01)
    noise = 1e-3 * np.random.default_rng(0).normal(size=time.size)
    values = decay(time, 1.2, 0.01) + noise
    fit = fit_decay(time, values + 0.5 * np.cos(2 * np.pi * 9.0 * time))
    motion, other = np.var(decay(time, 1.2, 0.01)), 0.125
    assert fit.explained_share == pytest.approx(motion / (motion + other), abs=2e-3)
    assert fit.to_dict()["explained_share"] == fit.explained_share
    assert f"{100 * fit.explained_share:.4g} % of the motion from the release on" in fit.report()
    assert fit_decay(time, values).explained_share == pytest.approx(1.0, abs=1e-5)
    others = 0.45 * (np.cos(2 * np.pi * 9.0 * time) + np.cos(2 * np.pi * 17.0 * time))
    with pytest.raises(FitError, match=r"explains only \d+ % .*fit_modes"):
        fit_decay(time, values + others, release_time=0.0)


# Blows


def blow(seed):
    """Return what a sensor of any kind reads of three modes of a cantilever, struck at 0.5 s, and the truth."""
    rng = np.random.default_rng(seed)
    frequencies, ratios = rng.uniform(1.5, 12.0) * np.array([1.0, 6.27, 17.5]), 10 ** rng.uniform(-2.7, -1.5, 3)
    step = 1 / (frequencies[2] * rng.uniform(8, 16))
    length = min(0.5 + rng.uniform(2.0, 5.0) / (2 * np.pi * frequencies[0] * ratios[0]), 8000 * step)
    time, contact, derivatives = (
        np.arange(0, length, step),
        rng.uniform(0.1, 1.5) / frequencies[2],
        int(rng.integers(3)),
    )
    since = time - 0.5
    force = np.where(
        (since >= 0) & (since < max(contact, step)), np.sin(np.pi * since / max(contact, step)) + 0.01, 0.0
    )
    values = np.zeros(time.size)
    for omega, ratio, size in zip(2 * np.pi * frequencies, ratios, rng.uniform(0.3, 1.0, 3), strict=True):
        pole = omega * complex(-ratio, np.sqrt(1 - ratio**2))
        values += size / omega * lfilter([1.0], [1.0, -np.exp(pole * step)], force * pole**derivatives).imag
    values /= np.abs(values).max()
    values += 10 ** rng.uniform(-3.5, -1.5) * rng.normal(size=time.size)
    sensor = Sensor(("displacement", "velocity", "acceleration")[derivatives])
    return Measurement(time, values, sensor=sensor), frequencies, ratios


@pytest.mark.slow
def test_after_a_blow_a_mode_is_fitted_within_its_errors_or_the_others_are_named():
    """In accelerations and after short blows, the higher modes are the larger ones at first."""
    right = named = 0
    for seed in range(60):
        record, frequencies, ratios = blow(seed)
        try:
            fit = fit_decay(record)
        except FitError as error:
            named += "fit_modes fits several modes" in str(error)
            continue
        mode = int(np.argmin(np.abs(np.log(frequencies / fit.frequency))))
        right += covers(fit, frequencies[mode], ratios[mode])
    assert right + named >= 59
    assert right >= 45


# Several releases


def record_of_takes(seed, takes):
    rng = np.random.default_rng(seed)
    frequency, step = rng.uniform(0.8, 8.0), 1 / rng.uniform(15, 80)
    ratio = 10 ** rng.uniform(-2.5, -1.3)
    lengths = np.maximum(rng.uniform(1.0, 3.0, takes) / (2 * np.pi * ratio), 8.0)  # periods
    pieces = [
        decay(np.arange(0, length, step), 1.0, ratio, rng.uniform(0.5, 1.0), rng.uniform(0, 6.28)) for length in lengths
    ]
    values = np.concatenate(pieces)
    values += 10 ** rng.uniform(-3, -1.7) * rng.normal(size=values.size)
    return np.arange(values.size) * step / frequency, values, frequency, ratio, np.cumsum([0, *map(len, pieces)])[:-1]


@pytest.mark.parametrize("takes", [2, 3, 5])
def test_several_releases_are_counted_and_the_last_is_fitted_or_all(takes):
    time, values, frequency, ratio, begins = record_of_takes(takes, takes)
    fit = fit_decay(time, values)
    assert covers(fit, frequency, ratio)
    assert fit.release_time >= time[begins[-1]]
    assert any(f"{takes} releases" in note for note in fit.warnings)
    parts = separate_takes(Measurement(time, values))
    fits = fit_decays(parts)
    assert len(fits) == takes
    assert all(part.time[0] >= time[begin] for part, begin in zip(parts, begins, strict=True))
    assert fits.estimates["frequency"] == pytest.approx(frequency, abs=4 * fits.standard_errors["frequency"])
    assert fits.standard_errors["frequency"] < fit.standard_errors["frequency"]


@pytest.mark.parametrize("rest", [0.0, 1.0])
@pytest.mark.parametrize("duration", [0.3, 0.6])
def test_a_pull_of_less_than_a_period_is_named_and_a_later_release_leaves_it_out(duration, rest):
    frequency, ratio = 0.8, 0.01
    release = rest + duration / frequency
    time = np.arange(0.0, 25.0, 0.01)
    pulled = np.clip((time - rest) / (release - rest), 0.0, 1.0)
    record = np.where(time < release, pulled**2 * (3 - 2 * pulled), decay(time - release, frequency, ratio))
    record += 1e-3 * np.random.default_rng(5).normal(size=time.size)
    assert "they hold a pull" in " ".join(fit_decay(time, record).warnings)
    later = fit_decay(time, record, release_time=release)
    assert covers(later, frequency, ratio) and "they hold a pull" not in " ".join(later.warnings)


@pytest.mark.parametrize("drag", [0.02, 0.3])
def test_drag_under_the_linear_law_is_not_taken_for_a_pull(drag):
    time = np.arange(0.0, 25.0, 0.01)
    record = np.cos(2 * np.pi * 0.8 * time) / (1 + drag * time)
    warnings = fit_decay(time, record + 1e-3 * np.random.default_rng(5).normal(size=time.size)).warnings
    assert warnings and "they hold a pull" not in " ".join(warnings)


def test_one_release_is_one_take():
    time = np.arange(0, 20, 0.01)
    beat = decay(time, 1.2, 0.01) + decay(time, 1.3, 0.01, 0.6)
    for values in (decay(time, 1.2, 0.01), np.where(time < 5.0, 0.0, decay(time - 5.0, 1.2, 0.01)), beat):
        noisy = values + 1e-3 * np.random.default_rng(0).normal(size=time.size)
        assert len(separate_takes(Measurement(time, noisy))) == 1


@pytest.mark.slow
def test_the_last_of_several_releases_is_fitted():
    covered = 0
    for seed in range(100):
        time, values, frequency, ratio, _ = record_of_takes(seed, 2 + seed % 4)
        try:
            covered += covers(fit_decay(time, values), frequency, ratio)
        except FitError:  # named
            covered += 1
    assert covered >= 98


# Heavily damped, in any unit of time, and quantised


def heavy_release(seed):
    """Return times and values of a release from rest, in a third of the records after a while at rest."""
    rng = np.random.default_rng(seed)
    frequency, ratio = rng.uniform(0.3, 20.0), rng.uniform(0.6, 0.8)
    omega, step = 2 * np.pi * frequency, 1 / (frequency * rng.uniform(20, 300))
    damped, time = omega * np.sqrt(1 - ratio**2), np.arange(0, rng.uniform(2.0, 6.0) / frequency, step)
    values = np.exp(-ratio * omega * time) * (np.cos(damped * time) + ratio * omega / damped * np.sin(damped * time))
    if seed % 3 == 0:
        values = np.append(np.ones(int(0.3 * time.size)), values)
    values = values + 10 ** rng.uniform(-3.3, -2) * rng.normal(size=values.size)
    return np.arange(values.size) * step, values, frequency, ratio


@pytest.mark.parametrize("ratio", [0.6, 0.7, 0.8])
def test_a_heavily_damped_release_from_rest_is_fitted(ratio):
    omega, time = np.pi, np.arange(0, 5, 0.01)
    damped = omega * np.sqrt(1 - ratio**2)
    values = np.exp(-ratio * omega * time) * (np.cos(damped * time) + ratio * omega / damped * np.sin(damped * time))
    values += 1e-3 * np.random.default_rng(0).normal(size=time.size)
    for settings in ({}, {"release_time": 0.0}):
        fit = fit_decay(time, values, **settings)
        assert fit.damping_ratio == pytest.approx(ratio, abs=0.01)
        assert covers(fit, 0.5, ratio)


@pytest.mark.slow
def test_heavily_damped_releases_are_fitted():
    covered = 0
    for seed in range(100):
        time, values, frequency, ratio = heavy_release(seed)
        try:
            covered += covers(fit_decay(time, values), frequency, ratio)
        except AncfError:
            continue
    assert covered >= 98


@pytest.mark.parametrize("unit", [1e-9, 1e-4, 1e7])
def test_no_unit_of_time_is_too_small_or_too_large(unit):
    time = np.arange(0, 20, 0.01)
    values = decay(time, 1.9, 0.01, 0.02) + 1e-4 * np.random.default_rng(0).normal(size=time.size)
    fit, expected = fit_decay(unit * time, values), fit_decay(time, values)
    assert unit * fit.frequency == pytest.approx(expected.frequency, rel=1e-9)
    assert fit.damping_ratio == pytest.approx(expected.damping_ratio, rel=1e-6)
    assert fit.warnings == expected.warnings


@pytest.mark.parametrize(("amplitude", "step"), [(2.2e-3, 1e-3), (4.4e-3, 1e-3), (2.2e-3, 5e-4)])
def test_a_quantised_record_is_named_as_such_and_not_as_clipped_nor_as_another_mode(amplitude, step):
    time = np.arange(0, 20, 0.01)
    fit = fit_decay(time, step * np.round(decay(time, 1.4, 0.01, amplitude) / step))
    assert covers(fit, 1.4, 0.01)
    assert any(f"steps of {step:g} m" in note for note in fit.warnings)
    assert not [note for note in fit.warnings if "clipped" in note or "another mode" in note]


def test_rounding_is_not_taken_for_a_law_that_does_not_hold():
    """The damping ratio of an early and of a late part differ by what rounding does to the amplitude."""
    time = np.arange(0, 20, 0.01)
    fit = fit_decay(time, 1e-3 * np.round(decay(time, 1.4, 0.00227, 2.2)))
    assert covers(fit, 1.4, 0.00227)
    assert not [note for note in fit.warnings if "does not hold" in note]


@pytest.mark.parametrize("law", ["linear", "auto"])
def test_an_oscillation_within_a_few_steps_is_refused(law):
    time = np.arange(0, 20, 0.01)
    values = decay(time, 1.4, 0.005, 0.9e-3)
    with pytest.raises(FitError, match=r"\d\.\d steps of 0.001 m .*resolution"):
        fit_decay(time, 1e-3 * np.round(values / 1e-3), law=law)
    noisy = values + 0.6e-3 * np.random.default_rng(0).normal(size=time.size)  # which makes up for the steps
    assert covers(fit_decay(time, 1e-3 * np.round(noisy / 1e-3)), 1.4, 0.005)


@pytest.mark.slow
@pytest.mark.parametrize(("fewest", "most", "least"), [(1.6, 3.2, 59), (0.6, 1.6, 12)])
def test_quantised_records_are_fitted_or_refused(fewest, most, least):
    """The error of rounding is systematic, and a fit follows it."""
    fitted = refused = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        frequency, size = rng.uniform(0.8, 8.0), int(rng.integers(600, 6000))
        time = np.arange(size) / (frequency * rng.uniform(12, 100))
        ratio = float(np.clip(rng.uniform(0.3, 2.5) / (2 * np.pi * frequency * time[-1]), 3e-4, 0.05))
        step = 1 / rng.uniform(fewest, most)
        values = decay(time, frequency, ratio, 1.0, rng.uniform(0, 6.28)) + rng.uniform(-0.5, 0.5) * step
        try:
            fitted += covers(fit_decay(time, 1e-3 * step * np.round(values / step)), frequency, ratio)
        except FitError as error:
            refused += "resolution" in str(error)
    assert fitted + refused >= 59
    assert fitted >= least


# Growth


@pytest.mark.parametrize("law", ["linear", "quadratic", "friction", "power"])
@pytest.mark.parametrize("ratio", [-0.001, -0.002])
def test_an_oscillation_that_grows_is_said_to_grow(law, ratio):
    time = np.arange(0, 10, 0.01)
    noise = 1e-5 * np.random.default_rng(1).normal(size=time.size)
    fit = fit_decay(time, decay(time, 2.0, ratio, 2e-3) + noise, law=law)
    stated = re.match(r"the oscillation grows, .* (\S+):", fit.warnings[0])
    assert float(stated[1]) == pytest.approx(ratio, rel=0.02)


def test_an_oscillation_without_damping_does_not_grow():
    time = np.arange(0, 10, 0.01)
    noise = 1e-5 * np.random.default_rng(1).normal(size=time.size)
    assert not any("grows" in text for text in fit_decay(time, decay(time, 2.0, 0.0, 2e-3) + noise).warnings)


def test_a_refused_record_that_grows_is_said_to_grow():
    time = np.arange(0, 10, 0.01)
    noise = 1e-5 * np.random.default_rng(1).normal(size=time.size)
    with pytest.raises(FitError, match=r"grows, .* -0\.01:"):
        fit_decay(time, decay(time, 2.0, -0.01, 2e-3) + noise)
