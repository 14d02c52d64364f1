"""Frequency matching: find the beam nearest to a given one that has the measured modes, Tables 9 and 10.

    match = match_frequencies(beam, targets=(1.85, 10.19, 26.84), unknowns=(Smooth("thickness"), Global("density")))
    print(match.report())

The unknowns (``unknowns``) are factors on the properties of the beam, within bounds.  The targets (``measured_modes``)
are natural frequencies and, if measured, mode shapes, with their standard deviations.  If there are more unknowns than
data, a family of beams fits: a preference (``preference``) selects one of them, and the result states which properties
the data leave open (``identifiability``).  If no beam within the bounds has the targets, least squares gives the
nearest beam, and ``objective="worst-error"`` the one with the smallest possible largest relative error (``program``).

References
----------
"Comparison of external damping models in a large deformation problem", Section 5.1.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import partial
from types import NoneType
from typing import Any, get_args

import numpy as np

from ancf_casadi.exceptions import NumericsError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, choice, whole
from ancf_casadi.support.parallel import run_all
from ancf_casadi.vibration.modal_state import ModalState, modes_near
from problems.matching.design_space import DesignSpace
from problems.matching.identifiability import Identifiability
from problems.matching.measured_modes import MeasuredModes
from problems.matching.preference import LeastChange, Preference, Smoothness
from problems.matching.program import Optimum, solve
from problems.matching.response import Matching, Objective
from problems.matching.result import FrequencyMatch
from problems.matching.unknowns import PAPER_UNKNOWNS, PropertyUnknown


def match_frequencies(
    beam: Beam,
    *,
    targets: MeasuredModes | Sequence[float],
    unknowns: Sequence[PropertyUnknown] = PAPER_UNKNOWNS,
    bounds: float = 0.10,
    preference: Preference | None = None,
    objective: Objective = "least-squares",
    guess: Sequence[float] | None = None,
    starts: int = 1,
    seed: int = 0,
    executor: Executor | None = None,
    jobs: int = 1,
) -> FrequencyMatch:
    """Find the beam nearest to a given one that has the measured modes.

    If no beam within the bounds has them, the result is the nearest one; see its ``warnings``, ``max_relative_error``
    and ``at_bound``.

    Parameters
    ----------
    beam : Beam
        The given beam; its gravity acts.
    targets : sequence of float, or MeasuredModes
        Measured natural frequencies of the lowest modes, ascending, Hz; or frequencies and shapes with their standard
        deviations.
    unknowns : sequence of Global, PerElement, Smooth
        Properties that may change; if not given, width and thickness of each element, and density and elastic modulus.
    bounds : float
        Largest relative change of a property whose unknown states no bounds, above 0 and at most 1.
    preference : LeastChange or Smoothness, optional
        Criterion that selects one of the beams that fit; the least change if not given.
    objective : {"least-squares", "worst-error"}
        Minimise the squared residuals, or the largest relative frequency error, whatever the standard deviations.
    guess : sequence of float, optional
        First values of the unknowns, in their order: factors, and coefficients of smooth properties; those of the given
        beam if not given.
    starts : int
        Number of solutions: the first from the guess, the others from random values within the bounds.
    seed : int
        Seed of the random values.
    executor : Executor, optional
        Runs the solutions; ``jobs`` processes if not given.
    jobs : int
        Number of processes if no executor is given.  With more than 1, a script must call this function under
        ``if __name__ == "__main__":``.

    Raises
    ------
    InputError
        If the targets are not positive and ascending (without shapes), are more than the modes of the mesh, or match no
        mode of the beam; if a point is off the beam, the bounds are not in (0, 1], there is no unknown, a property has
        two, or the guess is not within the bounds.
    EquilibriumError
        If the beam has no stable equilibrium.
    FitError
        If IPOPT converges from no start.

    Examples
    --------
    >>> from ancf_casadi import Beam
    >>> from problems import match_frequencies
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> match = match_frequencies(beam, targets=(1.85, 10.3), bounds=0.10)
    >>> [round(frequency, 3) for frequency in match.frequencies]
    [1.85, 10.3]
    >>> matched = match.beam
    """
    check_instance(beam, "beam", Beam)
    measured = MeasuredModes.of(targets)
    measured.check_beam(beam)
    space = DesignSpace(beam, unknowns, bounds)  # type: ignore[arg-type]
    choice(objective, get_args(Objective), "objective")
    check_instance(preference, "preference", LeastChange, Smoothness, NoneType)
    starts, jobs, seed = whole(starts, "starts", 1, 10_000), whole(jobs, "jobs", 1), whole(seed, "seed", 0)
    first = space.check_guess(guess)
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
    # largest relative difference of objectives that count as the same optimum
    reached = sum(optimum.value - best.value <= 1e-3 * best.value + 1e-6 for optimum in optima)
    settings = {"unknowns": space.unknowns, "bounds": bounds, "preference": preference, "objective": objective}
    again = partial(_again, beam, guess=guess, starts=starts, seed=seed, **settings)
    return _result(matching, best, build_seconds, (starts, reached, starts - len(optima)), again)


def _again(beam: Beam, targets: Any, **settings: Any) -> FrequencyMatch:
    return match_frequencies(beam, targets=targets, **settings)


def _attempt(matching: Matching, start: Array) -> Optimum | NumericsError:
    try:
        return solve(matching, start)
    except NumericsError as error:
        return error


def _result(
    matching: Matching,
    optimum: Optimum,
    build_seconds: float,
    starts: tuple[int, int, int],
    again: Callable[[Any], FrequencyMatch],
) -> FrequencyMatch:
    """Return the match at an optimum; ``starts`` counts all starts, those that ended there, and those that failed."""
    space, full, m = matching.space, matching.response("least-squares"), optimum.m
    state = matching.state(m)
    return FrequencyMatch(
        beam=space.changed(m),
        targets=matching.measured.frequencies,
        standard=tuple(matching.standard.frequencies.tolist()),
        frequencies=tuple(state.frequencies.tolist()),
        iterations=optimum.iterations,
        build_seconds=build_seconds,
        solve_seconds=optimum.seconds,
        matching=matching,
        unknowns=m,
        modes=tuple((state.numbers + 1).tolist()),
        mac=_mac(matching, state) if matching.measured.shapes else None,
        residuals=full.residuals(m) / matching.unit,
        multipliers=optimum.multipliers,
        identifiability=Identifiability(
            space=space,
            values=m,
            jacobian=full.jacobian(m) / matching.unit,
            prior=matching.preference_matrix * (matching.noisy and matching.preference.weight is not None),
            noisy=matching.noisy,
        ),
        starts=starts[0],
        reached=starts[1],
        failed=starts[2],
        again=again,
    )


def _mac(matching: Matching, state: ModalState) -> Array:
    """Return the MAC of the measured shapes with all of the lowest modes at the optimum, followed or not."""
    free = matching.model.size - matching.model.free.start
    # modes above the highest followed mode that the MAC includes
    lowest = modes_near(state.structure, state.at, min(int(state.numbers.max()) + 1 + 2, free))
    assert lowest is not None  # the equilibrium of the optimum is stable
    return matching.measured.mac(matching.observer @ lowest.shapes)
