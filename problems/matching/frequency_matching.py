"""Frequency matching: the beam nearest to a given one whose modes are the measured ones, Tables 9 and 10.

    match = match_frequencies(beam, targets=(1.85, 10.19, 26.84), unknowns=(Smooth("thickness"), Global("density")))
    print(match.report())

Unknowns (``matching_unknowns``) are factors on the beam's properties, within bounds.  Targets (``measured_modes``) are
natural frequencies and, if measured, mode shapes, with their standard deviations.  More unknowns than data leave a
family of beams; a preference (``matching_preference``) picks the answer, and what the data cannot tell is part of the
result (``matching_identifiability``).  Where the bounds do not admit the targets, least squares gives the nearest beam,
and ``objective="worst-error"`` the smallest worst relative error that is possible.

References
----------
"Comparison of external damping models in a large deformation problem", Section 5.1.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial
from types import NoneType
from typing import get_args

import numpy as np

from ancf_casadi.exceptions import FitError, NumericsError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, choice, whole
from ancf_casadi.support.parallel import run_all
from ancf_casadi.vibration.modes import natural_modes
from problems.matching.design_space import DesignSpace
from problems.matching.identifiability import Identifiability
from problems.matching.measured_modes import MeasuredModes
from problems.matching.preference import LeastChange, Preference, Smoothness
from problems.matching.problem import Optimum, solve
from problems.matching.response import Matching, Objective
from problems.matching.result import FrequencyMatch
from problems.matching.unknowns import PAPER, PropertyUnknown

MOST_STARTS = 10_000
SAME = 1e-9  # relative difference between the frequencies of the program and those computed afresh
SAME_VALUE = 1e-3  # relative difference between the objectives of one optimum reached twice


def match_frequencies(
    beam: Beam,
    *,
    targets: MeasuredModes | Sequence[float],
    unknowns: Sequence[PropertyUnknown] = PAPER,
    bounds: float = 0.10,
    preference: Preference | None = None,
    objective: Objective = "least-squares",
    start: Sequence[float] | None = None,
    starts: int = 1,
    seed: int = 0,
    executor: Executor | None = None,
    jobs: int = 1,
) -> FrequencyMatch:
    """Find the beam nearest to a given one that has the measured modes.

    Where the bounds do not admit the targets, the answer is the nearest within the bounds; ``warnings``,
    ``max_relative_error`` and ``at_bound`` tell.

    Parameters
    ----------
    beam : Beam
        The beam to start from; its gravity acts.
    targets : sequence of float, or MeasuredModes
        Measured natural frequencies of the lowest modes, ascending, Hz; or frequencies and shapes with their standard
        deviations.
    unknowns : sequence of Global, PerElement, Smooth
        What may change; if not given, width and thickness of each element, and density and elastic modulus.
    bounds : float
        Largest relative change of a property whose unknown states none, above 0 and at most 1.
    preference : LeastChange or Smoothness, optional
        Which of the beams that fit is meant; the one changed least if not given.
    objective : {"least-squares", "worst-error"}
        Whether to minimise the squared residuals, or the largest relative frequency error whatever the deviations.
    start : sequence of float, optional
        Values to start from, in the order of the unknowns: factors, and coefficients of smooth properties.  The given
        beam if there are none.
    starts : int
        How many starts: this one, and others drawn at random within the bounds.
    seed : int
        What they are drawn from.
    executor : Executor, optional
        Where the starts are solved from; ``jobs`` processes if not given.
    jobs : int
        Processes, where no executor is given; with more than 1 a script must call this under
        ``if __name__ == "__main__":``.

    Raises
    ------
    InputError
        If the targets are not positive and ascending (without shapes), more than the mesh has modes, or like no mode of
        the beam; points off the beam, bounds not in (0, 1], unknowns none or twice, or the start not within the bounds.
    EquilibriumError
        If the beam has no stable equilibrium.
    FitError
        If IPOPT converges from no start, or the modes found are not those of the beam computed afresh.
    """
    check_instance(beam, "beam", Beam)
    measured = MeasuredModes.of(targets)
    measured.check_beam(beam)
    space = DesignSpace(beam, unknowns, bounds)  # type: ignore[arg-type]
    choice(objective, get_args(Objective), "objective")
    check_instance(preference, "preference", LeastChange, Smoothness, NoneType)
    starts, jobs, seed = whole(starts, "starts", 1, MOST_STARTS), whole(jobs, "jobs", 1), whole(seed, "seed", 0)
    first = space.check_start(start)
    began = time.perf_counter()
    matching = Matching(space, measured, preference or LeastChange(), objective)
    _ = matching.standard
    build_seconds = time.perf_counter() - began

    generator = np.random.default_rng(seed)
    points = [first, *(space.random(generator) for _ in range(starts - 1))]
    attempts = run_all([partial(_attempt, matching, point) for point in points], executor=executor, jobs=jobs)
    optima = [attempt for attempt in attempts if isinstance(attempt, Optimum)]
    if not optima:
        raise next(attempt for attempt in attempts if isinstance(attempt, NumericsError))
    best = min(optima, key=lambda optimum: optimum.value)
    reached = sum(optimum.value - best.value <= SAME_VALUE * best.value + 1e-6 for optimum in optima)
    return _result(matching, best, build_seconds, (starts, reached, starts - len(optima)))


def _attempt(matching: Matching, start: Array) -> Optimum | NumericsError:
    try:
        return solve(matching, start)
    except NumericsError as error:
        return error


def _result(matching: Matching, optimum: Optimum, build_seconds: float, starts: tuple[int, int, int]) -> FrequencyMatch:
    space, response, m = matching.space, matching.response(), optimum.m
    state, matched = response.state(m), space.changed(m)
    free = matching.model.size - matching.model.free.start
    modes = natural_modes(Model(matched), count=min(int(state.numbers.max()) + 3, free))
    frequencies = modes.frequencies[state.numbers]
    if np.abs(state.frequencies / frequencies - 1).max() > SAME:
        raise FitError("the modes found are not those of the beam; start nearer to the measured frequencies")
    mac = None
    if matching.measured.shapes:
        mac = matching.measured.mac(matching.observer @ modes.shapes)
    noisy = matching.measured.frequency_std is not None
    full = matching.response("least-squares")
    return FrequencyMatch(
        beam=matched,
        targets=matching.measured.frequencies,
        standard=tuple(matching.standard.frequencies.tolist()),
        frequencies=tuple(frequencies.tolist()),
        active_bounds=space.active_bounds(m),
        iterations=optimum.iterations,
        build_seconds=build_seconds,
        solve_seconds=optimum.seconds,
        matching=matching,
        unknowns=m,
        modes=tuple((state.numbers + 1).tolist()),
        mac=mac,
        residuals=full.residuals(m) / matching.unit,
        multipliers=optimum.multipliers,
        identifiability=Identifiability(
            space=space,
            values=m,
            jacobian=full.jacobian(m) / matching.unit,
            prior=matching.weights * (noisy and matching.preference.weight is not None),
            noisy=noisy,
        ),
        starts=starts[0],
        reached=starts[1],
        failed=starts[2],
    )
