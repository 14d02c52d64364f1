"""Time of fits of several modes to long records: limit 10 s for a decay and for frequency response functions."""

import numpy as np
import pytest

from problems import FrfRecord, fit_frf, fit_modes


@pytest.mark.parametrize(
    ("rate", "modes"),
    [
        (1000.0, [(1.9, 0.005, 1.0), (11.0, 0.004, 0.3), (31.0, 0.003, 0.1)]),
        (500.0, [(10.9, 0.002, 1.0), (61.0, 0.002, 0.3), (131.0, 0.001, 0.1), (180.0, 0.001, 0.05)]),
    ],
    ids=["low", "high"],
)
def test_fit_modes(benchmark, rate, modes):
    time, rng = np.arange(50_000) / rate, np.random.default_rng(0)
    turns = 2 * np.pi * time
    y = sum(size * np.exp(-ratio * f * turns) * np.cos(f * turns + 0.5) for f, ratio, size in modes)
    fits = benchmark.pedantic(fit_modes, args=(time, y + 2e-3 * rng.standard_normal(len(time))), rounds=1)
    assert [fit.frequency for fit in fits] == pytest.approx([f for f, *_ in modes], rel=1e-4)


@pytest.mark.parametrize(("count", "outputs", "ratio"), [(4, 3, 0.01), (6, 4, 0.005)])
def test_fit_frf(benchmark, count, outputs, ratio):
    """Twenty lines in the half-power bandwidth at the lower end of a decade."""
    rng, lines = np.random.default_rng(0), np.arange(10.0, 100.0, ratio)
    own = np.geomspace(12.0, 83.0, count) * rng.uniform(0.97, 1.03, count)
    parts = [np.outer(rng.normal(size=outputs), f**2 / (f**2 - lines**2 + 2j * ratio * f * lines)) for f in own]
    values = np.sum(parts, axis=0)
    noise = 1e-3 * np.median(np.abs(values)) * (rng.normal(size=(2, *values.shape)).T @ [1, 1j]).T
    fit = benchmark.pedantic(fit_frf, args=(FrfRecord(lines, values + noise, "receptance"),), rounds=1)
    assert fit.frequencies == pytest.approx(own, rel=1e-4)


def test_fit_frf_with_leakage(benchmark):
    """Averages over Hann windows deform each resonance: impulse response times lag window; 1 % of noise."""
    rng, lines = np.random.default_rng(0), np.arange(2501) * 0.2
    window = np.hanning(2 * len(lines) - 2)
    lags = np.correlate(window, window, "full")[len(window) - 1 :] / np.sum(window**2)
    modes = [(20.0, 0.005), (60.0, 0.004), (120.0, 0.003), (200.0, 0.003), (300.0, 0.002), (420.0, 0.002)]
    turns = np.pi * np.arange(len(window)) / lines[-1]
    response = sum((-1) ** k * f * np.exp(-ζ * f * turns) * np.sin(f * turns) for k, (f, ζ) in enumerate(modes))
    values = np.fft.rfft(response * lags)[5:] * (1 + 0.01 * (rng.normal(size=(2, len(lines) - 5)).T @ [1, 1j]))
    record = FrfRecord(np.array(lines[5:], dtype=float), values, "receptance")
    fit = benchmark.pedantic(fit_frf, args=(record,), rounds=1)
    assert fit.frequencies == pytest.approx([f for f, _ in modes], rel=1e-3)
    assert sum(note.startswith("one mode") for note in fit.warnings) <= 1
