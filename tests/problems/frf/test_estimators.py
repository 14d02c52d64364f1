"""Frequency response functions from force and response over time; ``benchmarks/frf_coverage.py`` has more seeds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from ancf_casadi import InputError, Measurement, Sensor
from problems import fit_decay, fit_frf, frf_of
from problems.frf.record import FrfRecord
from tests.coverage import covers
from tests.problems.frf.time_records import (
    CASES,
    MODES,
    RATE,
    acceleration,
    fit_records,
    hammer,
    intervals_hold,
    shaker,
)

FREQUENCIES = [mode[0] for mode in MODES]


def true_function(frequencies):
    """Accelerance of the modes."""
    s = 2j * np.pi * frequencies
    return sum(c * s**2 / (s**2 + 4 * np.pi * z * f * s + (2 * np.pi * f) ** 2) for f, z, c in MODES)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_intervals_cover_and_no_estimate_is_biased(case):
    results = np.array([intervals_hold(fit_records(*CASES[case], seed)) for seed in range(32)])
    assert covers(int(results[:, :, 0].sum()), results[:, :, 0].size)
    assert (np.abs(results[:, :, 1].mean(axis=0)) < 3.5 / 32**0.5).all()


@pytest.mark.parametrize(("records", "lines"), [(hammer, 600), (shaker, 1400)], ids=["hammer", "shaker"])
def test_a_hammer_and_a_shaker_are_told_apart_and_give_the_modes(records, lines):
    record = frf_of(*records(np.random.default_rng(1)))
    assert record.kind == "accelerance" and len(record.frequencies) > lines
    assert record.window.hann == (records is shaker)
    fit = fit_frf(record, frequencies=FREQUENCIES)
    assert all(abs(score) < 4.0 for _, score in intervals_hold(fit))
    assert not [warning for warning in fit.warnings if "leakage" in warning]


def test_the_damping_of_an_exponential_window_is_not_that_of_the_modes():
    force, response = hammer(np.random.default_rng(0), noise=(1e-5, 1e-5))
    fit = fit_frf(frf_of(force, response, time_constant=1.0), frequencies=FREQUENCIES)
    np.testing.assert_allclose(fit.damping_ratios, [mode[1] for mode in MODES], rtol=1e-3)


def test_poles_to_start_from_lose_the_damping_of_an_exponential_window():
    force, response = hammer(np.random.default_rng(0))
    fit = fit_frf(frf_of(force, response, time_constant=2.0))
    np.testing.assert_allclose(fit.frequencies, FREQUENCIES, rtol=1e-3)
    np.testing.assert_allclose(fit.damping_ratios, [mode[1] for mode in MODES], rtol=0.02)


def test_the_leakage_of_a_hann_window_adds_damping_unless_it_is_modelled():
    record = frf_of(*shaker(np.random.default_rng(0)), block=5.0)
    bare = FrfRecord(record.frequencies, record.values, record.kind, std=record.std)
    ratios = [fit_frf(one, frequencies=FREQUENCIES).damping_ratios[0] for one in (record, bare)]
    assert ratios[0] == pytest.approx(0.01, rel=0.15) and ratios[1] > 0.013


@pytest.mark.parametrize("noise", [(0.0, 0.0), (1e-2, 1e-2)])
def test_leakage_that_follows_from_the_force_is_removed(noise):
    """Two takes of different lengths, with a clipped block and two outputs; leakage changes a damping ratio by 1 %."""
    rng, ratios = np.random.default_rng(0), [mode[1] for mode in MODES]
    takes = [shaker(rng, duration=duration, noise=noise) for duration in (25.0, 31.0)]
    clipped = takes[0][1].values.copy()
    peak = int(np.argmax(clipped))
    clipped[peak - 1 : peak + 2] = clipped[peak]
    responses = [[record, Measurement(record.time, -0.5 * record.values, sensor=record.sensor)] for _, record in takes]
    responses[0][0] = Measurement(takes[0][1].time, clipped, sensor=takes[0][1].sensor)
    record = frf_of([force for force, _ in takes], responses)
    assert any("left out: overload" in note for note in record.notes)
    fit = fit_frf(record, frequencies=FREQUENCIES)
    np.testing.assert_allclose(fit.damping_ratios, ratios, rtol=1e-3 if not noise[0] else 0.02)
    with_leakage = fit_frf(replace(record, scatter=None), frequencies=FREQUENCIES)
    assert np.abs(with_leakage.damping_ratios / ratios - 1).max() > 0.01


def test_weights_without_leakage_follow_from_the_power_of_the_force_and_the_fitted_function():
    """The variance is A/G_ff + B |H|^2 with the A of the noise of the sensor; Welch's method of SciPy gives G_ff."""
    force, response = shaker(np.random.default_rng(0), noise=(1e-2, 3e-2))
    fit = fit_frf(frf_of(force, response, block=10.0), frequencies=FREQUENCIES)
    lines, power = welch(force.values, RATE, nperseg=round(10.0 * RATE), detrend=False)
    shapes = [1 / np.interp(fit.record.frequencies, lines, power), np.abs(fit.synthesised()[0, 0]) ** 2]
    relative = np.column_stack(shapes) * fit.refinement.weights**2
    factors = np.linalg.lstsq(relative, np.ones(len(relative)))[0]
    np.testing.assert_allclose(relative @ factors, 1.0, rtol=1e-2)
    assert shapes[0].max() > 50.0 * shapes[0].min() and (factors[1] * shapes[1] > 3.0 * factors[0] * shapes[0]).any()
    white = 2 * (1e-2 * np.abs(response.values).max()) ** 2 / RATE  # spectral density of the noise
    assert factors[0] == pytest.approx(white / fit.record.scatter.averages, rel=0.25)


def test_leakage_remains_with_its_errors_if_removal_does_not_settle():
    """Blocks of a second are shorter than the memory of both modes."""
    fit = fit_frf(frf_of(*shaker(np.random.default_rng(1), duration=40.0), block=1.0), frequencies=FREQUENCIES)
    assert fit.record.scatter.takes and fit.standard_errors["damping_ratio_1"] > 0.2 * 0.01
    assert all(abs(score) < 3.0 for _, score in intervals_hold(fit))


def test_the_fit_agrees_with_that_of_the_free_decay_after_a_hit():
    time, rng = np.arange(6000) / 200.0, np.random.default_rng(3)
    force = np.where((time > 1.0) & (time < 1.02), 40.0 * np.sin(np.pi * (time - 1.0) / 0.02), 0.0)
    natural, ratio = 2 * np.pi * 8.0, 0.01
    damped = natural * np.sqrt(1 - ratio**2)
    t = time[:, None] - time[force != 0.0]
    response = np.where(t > 0.0, np.exp(-ratio * natural * t) * np.sin(damped * t), 0.0) @ force[force != 0.0]
    response = Measurement(time, 1e-4 * (response + 0.2 * rng.normal(size=len(time))))
    fit = fit_frf(frf_of(Measurement(time, force, sensor=Sensor("force")), response), frequencies=[8.0])
    decay = fit_decay(*(getattr(response.cut(1.05), name) for name in ("time", "values")))
    for name, value in (("frequency", decay.frequency), ("damping_ratio", decay.damping_ratio)):
        errors = fit.standard_errors[f"{name}_1"], decay.standard_errors[name]
        assert abs(fit.estimates[f"{name}_1"] - value) < 2.5 * np.hypot(*errors)
        assert 0.5 < errors[0] / errors[1] < 2.0


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
@pytest.mark.parametrize("noisy", ["force", "response"])
def test_h1_is_free_of_noise_of_the_response_and_h2_of_that_of_the_force(estimator, noisy):
    noise = (0.0, 0.05) if noisy == "force" else (0.02, 0.0)
    record = frf_of(*shaker(np.random.default_rng(0), noise=noise), estimator=estimator)
    inside = (record.frequencies > 9.0) & (record.frequencies < 40.0)
    ratio = np.abs(record.values[0, 0] / true_function(record.frequencies))[inside]
    coherence = record.coherence[0, 0, inside]
    powers = {("force", "H1"): 1.0, ("force", "Hv"): 0.5, ("response", "H2"): -1.0, ("response", "Hv"): -0.5}
    assert np.median(coherence) < 0.98
    assert np.median(ratio / coherence ** powers.get((noisy, estimator), 0.0)) == pytest.approx(1.0, abs=0.006)


@pytest.mark.parametrize("overlap", [0.0, 0.5, 0.75])
def test_standard_deviations_are_the_scatter_of_functions_from_repeated_records(overlap):
    noise = (0.02, 0.02)
    runs = [frf_of(*shaker(np.random.default_rng(k), duration=60.0, noise=noise), overlap=overlap, block=6.0)
            for k in range(30)]  # fmt: skip
    values = np.array([run.values[0, 0] for run in runs])
    stated = np.sqrt(np.mean([run.std[0, 0] ** 2 for run in runs], axis=0))
    scatter = np.sqrt(np.sum(np.abs(values - values.mean(axis=0)) ** 2, axis=0) / 29)
    quiet = (runs[0].frequencies > 25.0) & (runs[0].frequencies < 45.0)
    assert np.median(scatter[quiet] / stated[quiet]) == pytest.approx(1.0, abs=0.08)


class TestHits:
    def test_double_hits_are_named_and_left_out(self):
        record = frf_of(*hammer(np.random.default_rng(0), bounces=(1,)))
        assert record.notes == ("left out: double hit at 13.01 s",)

    def test_a_double_hit_among_double_hits_is_one(self):
        force, response = hammer(np.random.default_rng(0), bounces=(0, 1, 2))
        assert frf_of(force, response).notes == ("left out: double hit at 1.005 s, 13.01 s, 27 s",)
        with pytest.raises(InputError, match="has no usable hit"):
            frf_of(force.cut(0.0, 35.0), response.cut(0.0, 35.0))

    @pytest.mark.parametrize("channel", [0, 1])
    def test_overloads_are_named_and_left_out(self, channel):
        force, response = hammer(np.random.default_rng(0), noise=(1e-4, 1e-4))
        records, values = [force, response], (force, response)[channel].values.copy()
        peaks = [np.abs(values[(force.time > hit) & (force.time < hit + 3.0)]).max() for hit in (1.0, 13.0, 27.0, 39.0)]
        limit = (0.45, 0.8)[channel] * max(peaks)
        records[channel] = Measurement(force.time, np.clip(values, -limit, limit), sensor=records[channel].sensor)
        (note,) = frf_of(*records).notes
        clearly = (1.3, 1.0)[channel] * limit  # the force is that of three samples or more only beyond it
        loud = [hit for hit, peak in zip((1.005, 13.01, 27.01, 39.01), peaks, strict=True) if peak > clearly]
        assert note.startswith("left out: overload at ") and note.count(" s") == len(loud)
        assert f"{loud[0]:.4g} s" in note

    def test_files_are_averaged_and_named_in_notes(self):
        first, second = hammer(np.random.default_rng(0)), hammer(np.random.default_rng(1), bounces=(0,))
        forces = [Measurement(r.time, r.values, name, r.sensor) for r, name in ((first[0], "a"), (second[0], "b"))]
        record = frf_of(forces, [first[1], second[1]])
        assert record.notes == ("left out: double hit at 1.005 s of b",)
        both, alone = (fit_frf(one, frequencies=FREQUENCIES) for one in (record, frf_of(*first)))
        ratio = both.standard_errors["damping_ratio_1"] / alone.standard_errors["damping_ratio_1"]
        assert 0.4 < ratio < 1.0

    def test_a_vibration_that_is_cut_off_is_noted(self):
        fit = fit_frf(frf_of(*hammer(np.random.default_rng(0)), block=2.0), frequencies=FREQUENCIES)
        assert any("37 % of its vibration is left at the end of a block of 2 s" in note for note in fit.warnings)

    def test_several_outputs(self):
        force, response = hammer(np.random.default_rng(0))
        half = Measurement(response.time, 0.5 * response.values, sensor=response.sensor)
        record = frf_of(force, [response, half], points=(0.3, 0.5))
        assert record.outputs == 2
        np.testing.assert_allclose(record.values[1], 0.5 * record.values[0])


class TestShaker:
    def test_clipped_blocks_are_left_out(self):
        force, response = shaker(np.random.default_rng(0))
        assert not frf_of(force, response).notes
        flat = response.values.copy()
        peak = int(np.argmax(flat))
        flat[peak - 2 : peak + 3] = flat[peak]
        (note,) = frf_of(force, Measurement(response.time, flat, sensor=response.sensor)).notes
        assert note.startswith("left out: overload in 2 of 20 blocks")

    def test_a_random_force_without_a_window_leaks_with_a_note(self):
        record = frf_of(*shaker(np.random.default_rng(0)), window="none")
        assert "the force does not repeat from block to block" in record.notes[0]

    def test_a_periodic_force_needs_no_window(self):
        rng = np.random.default_rng(0)
        period = np.repeat(rng.normal(size=800), 10)
        force = np.tile(period, 12)
        response = acceleration(force, 1 / (RATE * 10))
        time = np.arange(len(force) // 10) / RATE
        records = [
            Measurement(time, v[::10], sensor=Sensor(q)) for v, q in ((force, "force"), (response, "acceleration"))
        ]
        last = [record.cut(20.0) for record in records]
        record = frf_of(*last, window="none", block=4.0, overlap=0.0)
        assert not record.notes and record.coherence.min() > 0.99


def alternating(force):
    """A force at half the sampling rate, which no filter passes."""
    return Measurement(force.time, (-1.0) ** np.arange(len(force.time)), sensor=force.sensor)


@pytest.mark.parametrize(
    ("change", "settings", "message"),
    [
        (lambda f, y: (f, y.cut(1.0)), {}, "has other times than the force"),
        (lambda f, y: ([f], [y, y]), {}, "response: has 2 entries for 1 forces"),
        (lambda f, y: (y, y), {}, "force: is a acceleration; give it a sensor of the quantity 'force'"),
        (lambda f, y: (f, Measurement(y.time, y.values, sensor=Sensor("strain"))), {}, "response: measures strain"),
        (lambda f, y: (f, y), {"window": "hann"}, "window: belongs to a shaker"),
        (lambda f, y: (f, y), {"excitation": "shaker", "time_constant": 1.0}, "time_constant: belongs to the hits"),
        (lambda f, y: (f, y), {"overlap": 1.0}, "overlap: must be between 0 and 0.9"),
        (lambda f, y: (f, y), {"excitation": "shaker", "block": 1e4}, "block: must have 32 samples or more"),
        (lambda f, y: (alternating(f), y), {}, "block: is too short for eight lines with a force"),
        (lambda f, y: (f, y), {"block": 0.1}, "force: has blocks of 20 samples"),
        (lambda f, y: (f, y), {"estimator": "H3"}, "estimator"),
    ],
)  # fmt: skip
def test_unusable_records_are_refused(change, settings, message):
    with pytest.raises(InputError, match=message):
        frf_of(*change(*hammer(np.random.default_rng(0))), **settings)
