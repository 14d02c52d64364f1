"""The counter of steps: shown on a terminal, silent elsewhere, and without effect if none is open."""

import io
import sys

import pytest

from ancf_casadi.support import progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def shown(monkeypatch):
    """Run three steps with a stream as standard error, and return what it shows."""
    monkeypatch.setattr(progress, "BAR_DELAY", 0.0)
    monkeypatch.setenv("COLUMNS", "80")

    def run(stream: io.StringIO) -> str:
        monkeypatch.setattr(sys, "stderr", stream)
        with progress.counter("fit"):
            for _ in range(3):
                progress.count_step()
        return stream.getvalue()

    return run


def test_a_terminal_shows_the_title(shown):
    assert "fit: 0 steps" in shown(Terminal())


def test_a_file_stays_empty(shown):
    assert shown(io.StringIO()) == ""


def test_steps_are_counted_by_the_open_counter_alone(monkeypatch):
    counted = []
    monkeypatch.setattr(progress.tqdm, "update", lambda bar, n=1: counted.append(n))
    progress.count_step()
    with progress.counter("fit"):
        progress.count_step()
        progress.count_step()
    progress.count_step()
    assert counted == [1, 1]
