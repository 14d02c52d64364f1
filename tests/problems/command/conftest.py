"""Commands run in a folder of their own, and the signals that they read."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from problems.cli import main

NOISE = 2e-5  # m


class Run(NamedTuple):
    """Exit code, standard output and standard error of a command."""

    code: int
    out: str
    err: str


@pytest.fixture
def run(tmp_path, monkeypatch, capsys) -> Callable[..., Run]:
    """Run a command in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> Run:
        try:
            code = main(arguments)
        except SystemExit as stopped:  # an option that argparse refuses
            code = stopped.code
        return Run(code, *capsys.readouterr())

    return call


@pytest.fixture
def decay(tmp_path) -> Callable[..., Path]:
    """Write a sum of decaying modes with noise, each (frequency in Hz, damping ratio, amplitude in m)."""

    def write(name: str, *modes: tuple[float, float, float], seed: int = 1, head: str = "time_s,tip_mm") -> Path:
        time = np.arange(0.0, 5.0, 0.002)
        motion = NOISE * np.random.default_rng(seed).standard_normal(time.size)
        for frequency, ratio, amplitude in modes:
            omega = 2 * np.pi * frequency
            motion += amplitude * np.exp(-ratio * omega * time) * np.cos(omega * np.sqrt(1 - ratio**2) * time)
        path = tmp_path / name
        np.savetxt(path, np.column_stack([time, 1e3 * motion]), delimiter=",", header=head, comments="", fmt="%.8g")
        return path

    return write
