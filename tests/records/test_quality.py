"""Clipped and aliased records are said to be so by inspect and by fits; clean ones are not accused."""

import json

import numpy as np
import pytest

from ancf_casadi import Measurement
from ancf_casadi.records.processing import quality_warnings
from problems import MotionRecord, fit_decay, fit_modes
from problems.cli import main

RATE = 200.0
TIME = np.arange(4000) / RATE
DECAY = np.exp(-0.2 * TIME) * np.cos(2 * np.pi * 4.0 * TIME)


def noisy(values, seed=0, size=1e-3):
    return values + size * np.random.default_rng(seed).standard_normal(values.size)


def rounded(values, bits):
    step = 2.2 / 2**bits
    return np.round(values / step) * step


def clean(kind, rng):
    """Return a clean record of 40 to 6000 samples."""
    count, period, ratio = int(rng.choice([40, 300, 1000, 6000])), rng.uniform(12.0, 150.0), 10 ** rng.uniform(-3.5, -1)
    angle = 2 * np.pi * np.arange(count) / period
    swing = np.cos(angle + rng.uniform(0.0, 6.28))
    held = angle < angle[count // 5]
    values = {
        "decay": np.exp(-ratio * angle) * swing,
        "square": np.exp(-max(ratio, 1e-3) * angle) * np.tanh(rng.uniform(1.0, 5.0) * swing),
        "friction": np.maximum(1 - ratio * angle, 0.0) * swing,
        "steady": swing,
        "held": np.where(held, 1.0, np.exp(-ratio * (angle - angle[count // 5])) * np.cos(angle - angle[count // 5])),
        "beat": 0.5 * swing + 0.5 * np.cos(1.05 * angle),
    }[kind]
    values = noisy(values, rng.integers(1000), rng.choice([0.0, 1e-4, 1e-2, 5e-2]))
    bits = rng.choice([0, 2, 3, 4, 6, 8, 12, 16])
    return rounded(values, bits) if bits else values


@pytest.mark.parametrize("kind", ["decay", "square", "friction", "steady", "held", "beat"])
def test_clean_records_are_not_accused(kind):
    rng = np.random.default_rng(1)
    for _ in range(60):
        values = clean(kind, rng)
        assert quality_warnings(np.arange(values.size) / RATE, values) == []


@pytest.mark.parametrize("level", [0.5, 0.8, 0.9])
@pytest.mark.parametrize("bits", [8, 12, 0])
@pytest.mark.parametrize("sides", [1, 2])
def test_clipping_is_found(level, bits, sides):
    decay = noisy(np.exp(-0.1 * TIME) * np.cos(2 * np.pi * 4.0 * TIME))
    clipped = np.clip(decay, -level if sides == 2 else -2.0, level)
    (text,) = quality_warnings(TIME, rounded(clipped, bits) if bits else clipped)
    assert "the record is clipped" in text and text.count("swings at") == sides


@pytest.mark.parametrize("place", [0.97, 0.99, 1.0])
def test_a_peak_at_half_the_sampling_rate_is_found(place):
    values = noisy(DECAY) + 0.05 * np.cos(np.pi * place * np.arange(TIME.size))
    (text,) = quality_warnings(TIME, values)
    assert f"a peak at {0.5 * RATE * place:.3g}"[:14] in text
    inside = noisy(DECAY) + 0.05 * np.cos(np.pi * 0.9 * np.arange(TIME.size))  # a mode, as far as anyone can see
    assert quality_warnings(TIME, inside) == []


@pytest.mark.slow
def test_inspect_and_fits_say_it(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    clipped = 5.0 * np.clip(noisy(DECAY), -0.8, 0.8)
    np.savetxt("a.csv", np.column_stack([TIME, clipped]), delimiter=",", header="t_s,x", comments="")
    told = ["no unit is given for 2 'x'; SI units are assumed", "the record is clipped"]
    assert main(["inspect", "a.csv", "--json"]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert [any(text in note for note in notes) for text in told] == [True, True]
    for command in (["fit-decay"], ["fit-decay", "--modes", "1"]):
        assert main([*command, "a.csv", "--end", "3"]) == 0
        printed = " ".join(capsys.readouterr().out.split())
        assert [printed.count(text) for text in told] == [1, 1], command


def test_fits_of_arrays_say_it_and_parts_without_it_do_not():
    record = Measurement(TIME, np.clip(noisy(DECAY), -0.8, 0.8))
    assert any("is clipped" in text for text in fit_decay(record.cut(end=5.0)).warnings)
    assert any("is clipped" in text for text in fit_modes(record.cut(end=5.0), modes=1).warnings)
    assert any("is clipped" in text for text in MotionRecord([record]).notes)
    assert not any("is clipped" in text for text in fit_decay(record.cut(2.0, 7.0)).warnings)
