"""Frequency matching: find the beam nearest to a given one that has the measured modes, Tables 9 and 10.

    match = match_frequencies(beam, targets=(1.85, 10.19, 26.84), unknowns=(Smooth("thickness"), Global("density")))
    print(match.report())

The unknowns (``unknowns``) are factors on the properties of the beam, within bounds.  The targets (``measured_modes``)
are natural frequencies and, if measured, mode shapes, with their standard deviations.  If there are more unknowns than
data, a family of beams fits: a preference (``design_space``) selects one of them, and the result states which
properties the data leave open (``identifiability``).  If no beam within the bounds has the targets, least squares gives
the nearest beam, and ``objective="worst-error"`` the one with the smallest possible largest relative error.

With the residuals r(m) of frequencies and shapes (``response``), the nonlinear programs are

    least-squares    minimise  1/2 |t|^2 + p(m)/w     subject to  r(m) = w^(1/2) t,    w = 1e-8,
    worst-error      minimise  t + p(m)               subject to  -t <= f_k(m)/target_k - 1 <= t,

and the bounds.  p is u^2 times the preference, with u as in ``response``; worst-error always prefers the least change.
The auxiliary unknowns t keep r(m) in the constraints, which are met to rounding; the gradient of |r|^2/(2 w) would
magnify the rounding by 1/w.

Equilibrium and modes are computed at each m, with exact first and second derivatives
(``ancf_casadi.vibration.modal_state``).  With equilibrium and eigenpairs as unknowns too, the program would need no
inner solver.  But it would have 527 unknowns instead of 47 at 20 elements, take 23 iterations instead of 10, find no
solution in 200 iterations at 80 elements, and could end at the wrong mode.

References
----------
"Comparison of external damping models in a large deformation problem", Section 5.1.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from types import NoneType
from typing import Any, get_args

import casadi as cs
import numpy as np

from ancf_casadi.estimation.solver.nlp import NlpSolution, solve_nlp
from ancf_casadi.estimation.solver.unknown import Priors, Unknown, with_prior
from ancf_casadi.exceptions import InputError, NumericsError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.callbacks import Differentiable
from ancf_casadi.support.inputs import check_instance, check_keys, choice, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.parallel import run_all
from ancf_casadi.vibration.modal_state import ModalState, modes_near
from problems.matching.design_space import WEIGHT, DesignSpace, LeastChange, Smoothness
from problems.matching.identifiability import Identifiability
from problems.matching.measured_modes import MeasuredModes
from problems.matching.response import Matching, Objective
from problems.matching.result import FrequencyMatch
from problems.matching.unknowns import PAPER_UNKNOWNS, USUAL_UNKNOWNS, PropertyUnknown

TIE_WEIGHT = 1e-6  # weight of p in worst-error: a mean square change of 1 costs as much as an error of TIE_WEIGHT/2
SAME_OPTIMUM = (1e-3, 1e-6)  # largest difference of objectives of the same optimum, relative and absolute
MATCHING_OPTIONS: dict[str, Any] = {
    "no_nlp_grad": True,  # CasADi would differentiate the callbacks twice, and cannot
    "ipopt.tol": 1e-8,
    "ipopt.compl_inf_tol": 1e-11,  # separates active from inactive bounds clearly
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 200,
    "ipopt.mu_strategy": "adaptive",  # half the iterations if the targets are out of reach
    "ipopt.nlp_scaling_method": "none",  # the program is scaled here
}


@lasting_interrupts()
def match_frequencies(
    beam: Beam,
    *,
    targets: MeasuredModes | Sequence[float],
    unknowns: Sequence[PropertyUnknown] = PAPER_UNKNOWNS,
    bounds: float = 0.10,
    preference: LeastChange | None = None,
    objective: Objective = "least-squares",
    priors: Priors | None = None,
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
        Properties that may change; if not given, width and thickness of each element, and density and elastic modulus;
        the diameter takes the place of width and thickness of round sections, and the bending stiffness of each element
        and the mass per length that of all of these for sections of given stiffness.
    bounds : float
        Largest relative change of a property whose unknown states no bounds, above 0 and at most 1.
    preference : LeastChange or Smoothness, optional
        Criterion that selects one of the beams that fit; the least change if not given.
    objective : {"least-squares", "worst-error"}
        Minimise the squared residuals, or the largest relative frequency error, whatever the standard deviations.
    priors : mapping, optional
        What is known of a property before the match, by its name in ``match.estimates``: mean and standard deviation,
        or median, relative standard deviation and ``"log-normal"``: ``{"density": (7850.0, 50.0)}``.  The targets need
        standard deviations.
    guess : sequence of float, optional
        First values of the unknowns, in their order: factors, and coefficients of smooth properties; those of the given
        beam if not given.
    starts : int
        Number of solutions: the first from the guess, the others from random values within the bounds.
    seed : int
        Seed of the random values.
    executor, jobs
        As in ``run_all``, for the solutions.

    Raises
    ------
    InputError
        If the targets are not positive and ascending (without shapes), are more than the modes of the mesh, or match no
        mode of the beam; if a point is off the beam, the bounds are not in (0, 1], there is no unknown, a property has
        two, or the guess is not within the bounds; if a prior is unusable, or has no standard deviation beside it.
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
    if unknowns is PAPER_UNKNOWNS:
        unknowns = USUAL_UNKNOWNS.get(frozenset(shape.kind for shape in beam.shapes), unknowns)
    space = DesignSpace(beam, unknowns, bounds)  # type: ignore[arg-type]
    choice(objective, get_args(Objective), "objective")
    check_instance(preference, "preference", LeastChange, Smoothness, NoneType)
    check_instance(priors, "priors", Mapping, NoneType)
    starts, jobs, seed = whole(starts, "starts", 1, 10_000), whole(jobs, "jobs", 1), whole(seed, "seed", 0)
    first_values = space.check_guess(guess)
    start_time = time.perf_counter()
    prior_properties = _prior_properties(space, priors or {})
    if prior_properties and not (measured.frequency_std and objective == "least-squares"):
        raise InputError("need frequency_std of the targets, and the objective least-squares, to be weighed", "priors")
    matching = Matching(space, measured, preference or LeastChange(), objective, prior_properties)
    _ = matching.standard  # the modes of the given beam, as part of building the problem
    build_seconds = time.perf_counter() - start_time

    generator = np.random.default_rng(seed)
    points = [first_values, *(space.random(generator) for _ in range(starts - 1))]
    attempts = run_all([partial(_attempt, matching, point) for point in points], executor=executor, jobs=jobs)
    optima = [attempt for attempt in attempts if isinstance(attempt, NlpSolution)]
    if not optima:
        raise next(attempt for attempt in attempts if isinstance(attempt, NumericsError))
    best = min(optima, key=lambda optimum: optimum.objective)
    tolerance = SAME_OPTIMUM[0] * best.objective + SAME_OPTIMUM[1]
    m, free = best.x[: space.size], space.single
    multipliers = np.empty(len(free))
    multipliers[free] = np.abs(space.map[free] @ best.bound_multipliers[: space.size])
    multipliers[~free] = np.abs(best.constraint_multipliers[len(best.constraint_multipliers) - np.sum(~free) :])
    state = matching.state(m)
    settings = {"unknowns": space.unknowns, "bounds": bounds, "preference": preference, "objective": objective}
    settings |= {"priors": priors, "guess": guess, "starts": starts, "seed": seed}
    return FrequencyMatch(
        beam=space.changed_beam(m),
        targets=measured.frequencies,
        standard=tuple(matching.standard.frequencies.tolist()),
        frequencies=tuple(state.frequencies.tolist()),
        iterations=best.iterations,
        build_seconds=build_seconds,
        solve_seconds=best.solve_seconds,
        matching=matching,
        unknowns=m,
        modes=_mode_numbers(matching, state),
        mac=_shape_mac(matching, state) if measured.shapes else None,
        residuals=matching.residuals(m) / matching.unit,
        multipliers=multipliers,
        identifiability=Identifiability(matching, m),
        starts=starts,
        reached=sum(optimum.objective <= best.objective + tolerance for optimum in optima),
        failed=starts - len(optima),
        again=partial(_again, beam, **settings),
    )


def _prior_properties(space: DesignSpace, priors: Priors) -> tuple[Unknown, ...]:
    """Return the properties with priors."""
    check_keys(dict(priors), set(), set(space.factor_names), "priors")
    values = dict(zip(space.factor_names, space.given_values.tolist(), strict=True))
    return tuple(
        with_prior(Unknown(name, values[name], lower=0.0 if values[name] > 0.0 else -math.inf), prior)
        for name, prior in priors.items()
    )


def _again(beam: Beam, targets: Any, **settings: Any) -> FrequencyMatch:
    return match_frequencies(beam, targets=targets, **settings)


def _attempt(matching: Matching, start: Array) -> NlpSolution | NumericsError:
    try:
        return _solve_program(matching, start)
    except NumericsError as error:
        return error


def _solve_program(matching: Matching, start: Array) -> NlpSolution:
    """Solve the program of a matching from a start within the bounds; m comes first among its variables."""
    space, size, at_start = matching.space, matching.space.size, matching.residuals(start)
    count, worst = len(at_start), matching.objective == "worst-error"
    x, r = cs.MX.sym("x", size + (1 if worst else count)), cs.MX.sym("r", count)
    m, t, rows = x[:size], x[size:], cs.sparsify(cs.DM(space.map[~space.single]))
    if worst:
        relative, targets = matching.relative, matching.measured.count
        errors = r[:targets] * cs.DM(relative)
        # test_smallest_worst_error fails with t itself: CasADi 3.8 derives a scalar beside a callback wrongly
        limit = cs.repmat(t, targets, 1)
        constraints, f, weights = cs.vertcat(errors - limit, errors + limit), t, LeastChange(TIE_WEIGHT).matrix(space)
        constraint_lower, constraint_upper = np.repeat([[-math.inf, 0.0], [0.0, math.inf]], targets, axis=1)
        first_auxiliary, lowest_auxiliary = np.abs(at_start[:targets] * relative).max(keepdims=True), 0.0
    else:
        constraints, f = r - math.sqrt(WEIGHT) * t, cs.dot(t, t) / 2
        weights = matching.preference_matrix * (matching.unit**2 / WEIGHT)
        constraint_lower = constraint_upper = np.zeros(count)
        first_auxiliary, lowest_auxiliary = at_start / math.sqrt(WEIGHT), -math.inf
    change = m - cs.DM(space.standard)
    f += cs.bilin(cs.sparsify(cs.DM(weights)), change, change) / 2
    g = cs.vertcat(constraints, rows @ change)

    computed = Differentiable(lambda m: (matching.residuals(m), matching.jacobian(m)), count, size)
    curvature = Differentiable(  # its own derivatives are never asked for
        lambda z: (matching.curvature(z[:size], z[size:]).ravel(), np.empty(0)), size**2, size + count
    )
    σ, y, no_parameters = cs.MX.sym("sigma"), cs.MX.sym("y", g.numel()), cs.MX.sym("p", 0)
    residual_curvature = cs.reshape(curvature(cs.vertcat(m, cs.jtimes(g, r, y, True))), size, size)
    curvature_block = cs.diagcat(residual_curvature, cs.DM(t.numel(), t.numel()))
    lagrangian_curvature = cs.triu(σ * cs.hessian(f, x)[0] + curvature_block)
    hessian = cs.Function("hess_lag", [x, no_parameters, σ, y], [lagrangian_curvature])
    lower, upper = space.room(space.standard)
    return solve_nlp(
        {"x": x, "f": f, "g": cs.substitute(g, r, computed(m))},
        np.append(start, first_auxiliary),
        lower=np.append(space.standard + space.from_factors(lower, -math.inf), np.full(t.numel(), lowest_auxiliary)),
        upper=np.append(space.standard + space.from_factors(upper, math.inf), np.full(t.numel(), math.inf)),
        constraint_lower=np.append(constraint_lower, lower[~space.single]),
        constraint_upper=np.append(constraint_upper, upper[~space.single]),
        options={**MATCHING_OPTIONS, "hess_lag": hessian},
        advice="give another guess, more starts or other bounds, or let fewer properties change",
    )


def _mode_numbers(matching: Matching, state: ModalState) -> tuple[int, ...]:
    """Return the numbers, from 1, of the modes of the targets at the optimum.

    Without measured shapes, a mode keeps its number among modes whose frequencies differ by rounding alone.
    """
    numbers = state.numbers
    if not matching.measured.shapes and (numbers != matching.numbers).any():
        frequencies = _lowest_modes(matching, state).frequencies[matching.numbers]
        numbers = np.where(np.isclose(frequencies, state.frequencies, rtol=1e-9, atol=0.0), matching.numbers, numbers)
    return tuple((numbers + 1).tolist())


def _shape_mac(matching: Matching, state: ModalState) -> Array:
    """Return the MAC of the measured shapes with all of the lowest modes at the optimum, followed or not."""
    return matching.measured.mac(matching.observer @ _lowest_modes(matching, state).shapes)


def _lowest_modes(matching: Matching, state: ModalState) -> ModalState:
    """Return the lowest modes at the optimum, two more than those of the targets."""
    highest = int(max(state.numbers.max(), matching.numbers.max()))
    lowest = modes_near(state.structure, state.at, min(highest + 1 + 2, matching.model.freedoms))
    assert lowest is not None  # the equilibrium of the optimum is stable
    return lowest
