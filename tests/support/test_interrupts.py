"""Ctrl-C while a solver library runs."""

import contextlib
import gc
import importlib
import os
import signal
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Beam, Measurement, Model, RayleighDamping, run_all, simulate
from ancf_casadi.estimation.solver import nlp
from ancf_casadi.estimation.solver.nlp import solve_nlp
from ancf_casadi.support.interrupts import (
    REPEAT,
    delayed_interrupts,
    has_interrupt,
    lasting_interrupts,
    noted_interrupts,
    raised_endings,
    stoppable,
)
from problems import MarkerRecord, fit_beam, fit_decay, reproduce, run_study


@pytest.fixture(scope="module")
def long_fit():
    """A fit that takes many seconds."""
    strip = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 264e3}
    model = Model(Beam.uniform(**strip, elements=4, axis=(1.0, 0.0), gravity=(0.0, -1.0)))
    run = simulate(model, damping=RayleighDamping(alpha=2.0), start="straight", duration=3.0, sample_rate=40.0)
    record = MarkerRecord(run.time, run.tip, start="straight")
    return lambda: fit_beam(model, record, RayleighDamping(alpha=1.0), tolerance=1e-12)


@pytest.mark.slow
def test_ctrl_c_ends_a_fit_within_a_second(long_fit):
    begin = time.monotonic()
    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        long_fit()
    assert 1.0 < time.monotonic() - begin < 2.0


@pytest.mark.slow
def test_an_event_ends_a_fit_in_another_thread_within_a_second(long_fit):
    stop = threading.Event()

    def work():
        with stoppable(stop):
            return long_fit()

    with ThreadPoolExecutor(1) as thread:
        future = thread.submit(work)
        time.sleep(1.0)
        begin = time.monotonic()
        stop.set()
        with pytest.raises(KeyboardInterrupt):
            future.result()
        assert time.monotonic() - begin < 1.0
        assert thread.submit(has_interrupt).result() is False


@pytest.mark.parametrize("is_set", [False, True])
def test_an_event_takes_the_place_of_errors_and_of_results(is_set):
    stop = threading.Event()
    with pytest.raises(KeyboardInterrupt if is_set else ZeroDivisionError), stoppable(stop):
        if is_set:
            stop.set()
        assert has_interrupt() is is_set
        _ = 1 / 0
    assert not has_interrupt()


def test_ctrl_c_ends_a_solver_with_the_iteration_it_meets(monkeypatch):
    x = cs.MX.sym("x", 2)
    valley = {"x": x, "f": (1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2}
    iterations = []

    def interrupted_third():
        iterations.append(len(iterations))
        if len(iterations) == 3:
            signal.raise_signal(signal.SIGINT)

    assert solve_nlp(valley, np.array([-1.2, 1.0])).iterations > 10
    monkeypatch.setattr(nlp, "count_step", interrupted_third)
    with pytest.raises(KeyboardInterrupt):
        solve_nlp(valley, np.array([-1.2, 1.0]))
    assert len(iterations) == 3


def test_a_delayed_interrupt_is_raised_at_the_end_in_place_of_another_error():
    reached = []
    with pytest.raises(KeyboardInterrupt), delayed_interrupts():
        assert not has_interrupt()
        signal.raise_signal(signal.SIGINT)
        assert has_interrupt()
        reached.append(1)
        raise RuntimeError("what a library makes of it")
    assert reached and not has_interrupt()


def test_without_an_interrupt_nothing_is_raised():
    with delayed_interrupts(), noted_interrupts() as noted:
        pass
    assert not noted and not has_interrupt()
    with pytest.raises(RuntimeError, match="own"), delayed_interrupts():
        raise RuntimeError("own")


class Struck(np.ndarray):
    """An array whose conversion by CasADi meets a Ctrl-C; CasADi discards the exception."""

    def astype(self, *arguments, **options):
        signal.raise_signal(signal.SIGINT)
        return super().astype(*arguments, **options)


def converted():
    with contextlib.suppress(NotImplementedError):  # CasADi then does not take it for an array of numbers
        cs.MX.sym("x", 3) + np.ones(3).view(Struck)


def swallowed(seconds=5.0):
    """Meet a Ctrl-C in a CasADi call, and go on for seconds."""
    converted()
    begin = time.monotonic()
    while time.monotonic() < begin + seconds:
        time.sleep(1e-3)
    return "went on"


@pytest.mark.slow
def test_casadi_swallows_a_ctrl_c_and_long_functions_raise_it_again():
    assert swallowed(0.01) == "went on"
    for call in (lasting_interrupts()(swallowed), lambda: run_all([swallowed])):
        began = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            call()
        assert time.monotonic() - began < 2 * REPEAT + 0.5
    time.sleep(2 * REPEAT)  # no signal comes after the end
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_command_raises_again_what_was_swallowed(number):
    with pytest.raises(KeyboardInterrupt), raised_endings() as noted:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(number)
        swallowed_at = time.monotonic()
        while time.monotonic() < swallowed_at + 5.0:
            time.sleep(1e-3)
    assert noted == [number]


@pytest.mark.slow
def test_clean_up_is_not_interrupted_by_a_repetition():
    reached = []
    with pytest.raises(KeyboardInterrupt), lasting_interrupts():
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            time.sleep(3 * REPEAT)
            reached.append("the end")
    assert reached


def test_ctrl_c_takes_the_place_of_errors_and_of_results():
    @lasting_interrupts()
    def work(error):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        if error:
            raise error

    for error in (ValueError("what a library makes of it"), None):
        with pytest.raises(KeyboardInterrupt):
            work(error)


def test_an_exception_that_nobody_can_catch_is_not_printed(capfd):
    class Watched:
        pass

    with pytest.raises(KeyboardInterrupt), lasting_interrupts():
        watched = Watched()
        callback = weakref.ref(watched, lambda _: signal.raise_signal(signal.SIGINT))
        del watched
        gc.collect()
        swallowed()
    assert callback() is None
    assert capfd.readouterr().err == ""


def test_handlers_of_the_program_are_left_alone():
    met = []
    before = signal.signal(signal.SIGINT, lambda *_: met.append(1))
    try:
        with lasting_interrupts():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
    assert met == [1]


DECAY_STUDY = """
[[steps]]
kind = "decays"

[[decays]]
file = "decay.csv"
"""


@pytest.mark.parametrize(
    "work",
    [
        lambda record: fit_decay(record),
        lambda _: run_study("study.toml", "results"),
        lambda _: reproduce("results", quick=True),
    ],
    ids=["fit_decay", "run_study", "reproduce"],
)
def test_ctrl_c_in_a_casadi_call_ends_a_fit_and_a_study(work, tmp_path, monkeypatch):
    for name in ("scipy.optimize", "matplotlib.pyplot"):  # Ctrl-C in an import would leave half a module behind
        importlib.import_module(name)
    monkeypatch.chdir(tmp_path)
    instants = np.arange(0.0, 5.0, 0.01)
    values = 5e-3 * np.exp(-0.3 * instants) * np.cos(19.0 * instants)
    np.savetxt("decay.csv", np.c_[instants, values], delimiter=",", header="time_s,tip_m", comments="")
    Path("study.toml").write_text(DECAY_STUDY)
    exponential, met = cs.exp, []

    def struck(*arguments):
        if not met:
            met.append(time.monotonic())
            converted()
            time.sleep(1e-3)
        return exponential(*arguments)

    monkeypatch.setattr(cs, "exp", struck)
    with pytest.raises(KeyboardInterrupt):
        work(Measurement(instants, values))
    assert time.monotonic() - met[0] < 2.0


def test_a_call_that_notes_a_ctrl_c_ends_first_and_then_the_work_around_it():
    reached = []
    with pytest.raises(KeyboardInterrupt), lasting_interrupts():
        with noted_interrupts() as noted:
            signal.raise_signal(signal.SIGINT)
            reached.append(len(noted))
        reached.append("more work")
    assert reached == [1]
