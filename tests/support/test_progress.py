"""The counter of steps: shown on a terminal, silent elsewhere, and without effect if none is open."""

import io
import sys

from ancf_casadi.support import progress


def test_a_file_stays_empty(monkeypatch):
    monkeypatch.setattr(progress, "BAR_DELAY", 0.0)
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress.counter("fit"):
        for _ in range(3):
            progress.count_step()
    assert sys.stderr.getvalue() == ""


def test_steps_are_counted_by_the_open_counter_alone(monkeypatch):
    plural = []
    monkeypatch.setattr(progress.tqdm, "update", lambda bar, n=1: plural.append(n))
    progress.count_step()
    with progress.counter("fit"):
        progress.count_step()
        progress.count_step()
    progress.count_step()
    assert plural == [1, 1]


def test_a_function_is_called_at_each_step_in_place_of_a_counter():
    calls = []
    with progress.counted(lambda: calls.append(None)), progress.counter("fit"):
        progress.count_step()
    progress.count_step()
    assert len(calls) == 1
    assert progress.progress_line("fit", 15, 2.0) == "fit: 15 steps, 00:02,  7.50 steps/s"
