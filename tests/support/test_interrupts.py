"""Ctrl-C while a solver library runs."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ancf_casadi.support.interrupts import delayed_interrupts, interrupted, noted_interrupts

ROOT = Path(__file__).parents[2]
FIT = """
import signal
from ancf_casadi import Beam, Model, RayleighDamping, simulate
from ancf_casadi.dynamics.radau.stepper import Stepper
from problems import MarkerRecord, fit_beam

strip = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 264e3}
model = Model(Beam.uniform(**strip, elements=2, axis=(1.0, 0.0), gravity=(0.0, -1.0)))
law = RayleighDamping(alpha=2.0)
run = simulate(model, damping=law, start="straight", duration=0.3, sample_rate=40.0, method="radau")
record = MarkerRecord(run.time, run.tip, start="straight")
steps, advance = [], Stepper.advance

def counted(self):
    steps.append(self.now)
    if len(steps) == STOP:
        signal.raise_signal(signal.SIGINT)
    advance(self)

Stepper.advance = counted
try:
    fit_beam(model, record, RayleighDamping(alpha=1.0), tolerance=1e-5)
except KeyboardInterrupt:
    print("stopped", len(steps))
else:
    print("done", len(steps))
"""


def stopped_at(step):
    """Return the message of a fit after a Ctrl-C in a step of its integrations, and its number of steps."""
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", FIT.replace("STOP", str(step))],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert not run.stderr
    said, steps = run.stdout.split()
    return said, int(steps)


@pytest.mark.slow
def test_ctrl_c_ends_a_fit_with_the_step_it_meets():
    """In the first motion, outside the solver, and in a later one, within it."""
    said, total = stopped_at(0)
    assert said == "done" and total > 100
    for step in (3, total // 2):
        assert stopped_at(step) == ("stopped", step)


def test_a_delayed_interrupt_is_raised_at_the_end_in_place_of_another_error():
    reached = []
    with pytest.raises(KeyboardInterrupt), delayed_interrupts():
        assert not interrupted()
        signal.raise_signal(signal.SIGINT)
        assert interrupted()
        reached.append(1)
        raise RuntimeError("what a library makes of it")
    assert reached and not interrupted()


def test_without_an_interrupt_nothing_is_raised():
    with delayed_interrupts(), noted_interrupts() as noted:
        pass
    assert not noted and not interrupted()
    with pytest.raises(RuntimeError, match="own"), delayed_interrupts():
        raise RuntimeError("own")
