"""One mode from free decays and response curves together.

    fit = fit_mode([decay, curve_up, curve_down], law="quadratic", frequency_law="logarithmic")

All records share the laws of the mode: its frequency and its rate of decay against the amplitude.  Each decay adds its
release, each kind of excitation its modal constant (``decays``).  The loop of all fits
(``ancf_casadi.estimation.solve``) weighs the records by the scatter of their residuals.

The fit starts from the largest decay, and from regressions of the curves (``oscillator``), whichever ends in the better
optimum.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from types import NoneType
from typing import Any, get_args

import numpy as np

from ancf_casadi.decay.first_guess import DecayGuess
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.rest_position import Rest
from ancf_casadi.decay.smooth import AMPLITUDE_SPAN
from ancf_casadi.estimation.block import Block
from ancf_casadi.estimation.solve import FitProblem, FitSolution, solve
from ancf_casadi.estimation.solver.unknown import Priors, Unknown, started
from ancf_casadi.exceptions import FitError, InputError, NumericsError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array, root_mean_square
from ancf_casadi.support.inputs import check_instance, choice, flag, is_sequence, numbers, physical, shown
from ancf_casadi.support.progress import counter
from problems.beam.curves.checks import level_notes, oriented, phase_locked
from problems.beam.curves.record import ResponseRecord
from problems.decay.laws import RATIO_BOUNDS, DecayModel, Law, with_priors
from problems.decay.result import DecayFit
from problems.decay.solution import (
    MAX_ITERATIONS,
    allow_for_late_residuals,
    allow_for_rounding,
    as_record,
    fit_record,
    has_converged,
    without_smoothness_test,
)
from problems.mode.decays import (
    DecayBlock,
    ModeCurveBlock,
    SmoothnessBlock,
    constant_unit,
    curves_of_mode,
    decay_block,
    mode_decay,
    release_unknowns,
    smoothness_block,
)
from problems.mode.oscillator import (
    LEAST_RATIO,
    from_points,
    guess_of,
    law_at,
    modal_constant_of,
    motion_amplitudes,
    points_of,
    reading_factor,
)
from problems.mode.result import ModeFit

Decay = Measurement | tuple[Any, Any]


def fit_mode(
    records: Decay | ResponseRecord | Sequence[Decay | ResponseRecord],
    *,
    law: Law = "linear",
    frequency_law: FrequencyLaw = "constant",
    modal_constant: float | None = None,
    rest: Rest = "constant",
    release_times: Sequence[float] | None = None,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
    priors: Priors | None = None,
    robust: bool = False,
    progress: bool = False,
) -> ModeFit:
    """Fit one mode to free decays and response curves together, without a model of the structure.

    Parameters
    ----------
    records : record, or sequence of records
        Decays: Measurement, or (times, displacements), s and m.  Response curves: ResponseRecord with the unit of its
        levels (``excitation_unit``).  All sensors measure the motion of one point, or derivatives of it.
    law : {"linear", "quadratic", "friction", "power", "smooth"}
        Damping law, as in ``fit_decay``.
    frequency_law : {"constant", "linear", "quadratic", "power", "logarithmic", "smooth"}
        Frequency against amplitude, as in ``fit_decay``.
    modal_constant : float, optional
        Force per mass and unit level: 1/kg (1/mass) for a force at the sensor, without unit for a motion of the base.
        Estimated if not given, one for each unit of levels.
    rest, ratio_bounds
        As in ``fit_decay``.
    release_times : sequence of float, optional
        Start of the free decay in each decay, s; detected if not given.
    priors : mapping, optional
        What is known of an unknown before the fit, by its name in ``fit.fit.names``, or as ``damping_ratio`` (linear
        law), ``frequency`` (Hz; constant law) or ``frequency_at_zero`` (Hz, at zero amplitude; linear, quadratic or
        power law): mean and standard deviation, or median, relative standard deviation and ``"log-normal"``:
        ``{"modal_constant": (0.5, 0.02, "log-normal")}``.
    robust : bool
        Whether to use the pseudo-Huber loss, which limits the influence of outliers.
    progress : bool
        Count the steps of the fit on a terminal.

    Raises
    ------
    InputError
        If a record is not usable, sensors measure different motions, or an option is unknown.
    FitError
        If the fit does not converge, explains less than half of the motion of a record, ends with most unknowns at
        bounds, or the records determine combinations of the unknowns only.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import ResponseRecord, fit_mode
    >>> f, rng = np.linspace(9.5, 10.5, 41), np.random.default_rng(0)
    >>> receptance = 2.0 / (4 * np.pi**2 * (10.0**2 - f**2 + 0.2j * f))  # modal mass 0.5 kg, damping ratio 1 %
    >>> noise = 1 + 0.01 * (rng.standard_normal(41) + 1j * rng.standard_normal(41))
    >>> fit = fit_mode(ResponseRecord(f, 0.3 * receptance * noise, levels=np.full(41, 0.3), excitation_unit="N"))
    >>> print(f"{fit.frequency:.2f} Hz, {100 * fit.damping_ratio:.2f} %, {1 / fit.estimates['modal_constant']:.2f} kg")
    10.00 Hz, 1.00 %, 0.50 kg
    """
    decays, curves = _sorted(records)
    choice(law, get_args(Law), "law")
    choice(frequency_law, get_args(FrequencyLaw), "frequency_law")
    robust = flag(robust, "robust")
    check_instance(priors, "priors", Mapping, NoneType)
    known = None if modal_constant is None else physical(modal_constant, "modal_constant")
    stated = DecayModel(law, rest, frequency_law, ratio_bounds)
    releases = [None] * len(decays) if release_times is None else numbers(release_times, "release_times")
    if len(releases) != len(decays):
        raise InputError(f"has {len(releases)} values for {len(decays)} decays", "release_times")
    alone = [fit_record(one, stated, release_time=t, robust=robust) for one, t in zip(decays, releases, strict=True)]
    factors = [reading_factor(one) for one in curves]
    turned = [oriented(one, float(np.angle(factor[0]))) for one, factor in zip(curves, factors, strict=True)]
    curves = [one for one, _ in turned]
    pairs = list(zip(curves, factors, strict=True))
    notes = (*(note for _, note in turned if note), *level_notes(curves, factors))
    if not decays and known is None and all(phase_locked(one, float(np.angle(f[0]))) for one, f in pairs):
        raise FitError(
            "all points are at the resonance: the records determine zeta/modal_constant, but not zeta and "
            "modal_constant each; add a decay or points beside the resonance, or give modal_constant"
        )
    problem, starts, model, laws = _stated(stated, decays, alone, curves, known, robust)
    problem = replace(problem, unknowns=tuple(with_priors(problem.unknowns, priors or {}, stated)))
    try:
        with counter("fit", shown=flag(progress, "progress")):
            solution = _with_noise_of_decays(_settled(solve(problem, starts)))
    except FitError as error:
        raise FitError("; ".join([*notes, str(error)]), error.stats) from None
    measured = [one.amplitude_range for one in alone]
    measured += [(float(own.min()), float(own.max())) for own in map(motion_amplitudes, curves)]
    smallest, largest = min(low for low, _ in measured), max(high for _, high in measured)
    again = partial(fit_mode, law=law, frequency_law=frequency_law, modal_constant=modal_constant,
                    rest=rest, ratio_bounds=ratio_bounds, priors=priors, robust=robust)  # fmt: skip
    return ModeFit(solution.fit, solution, model, stated, laws, smallest, largest, notes, again=again)


def _sorted(records: Any) -> tuple[list[Measurement], list[ResponseRecord]]:
    """Return the decays and the response curves."""
    pair = isinstance(records, tuple) and len(records) == 2 and not isinstance(records[0], Measurement | ResponseRecord)
    given = [records] if pair or not is_sequence(records) else list(records)
    decays, curves = list[Measurement](), list[ResponseRecord]()
    for k, one in enumerate(given, start=1):
        if isinstance(one, ResponseRecord):
            if not one.excitation_unit:
                raise InputError(
                    f"record {k}: needs excitation_unit, the unit of its levels, in place of a beam", "records"
                )
            curves.append(one)
        elif isinstance(one, Measurement):
            decays.append(as_record(one, None))
        elif is_sequence(one) and len(one) == 2:
            decays.append(as_record(*one))
        else:
            raise InputError(
                f"record {k}: must be a Measurement, (times, displacements) or a ResponseRecord, got {shown(one)}",
                "records",
            )
    if not given:
        raise InputError("must hold at least one record", "records")
    units = {one.motion_unit for one in [*(own.sensor for own in decays), *(own.sensor for own in curves)]}
    if len(units) > 1:
        named = ", ".join(sorted(unit or "strain" for unit in units))
        raise InputError(f"measure different motions, in {named}; convert them, or fit them apart", "records")
    return decays, curves


def _stated(
    stated: DecayModel,
    decays: Sequence[Measurement],
    alone: Sequence[DecayFit],
    curves: Sequence[ResponseRecord],
    known: float | None,
    robust: bool,
) -> tuple[FitProblem, list[dict[str, float]], DecayModel, tuple[str, ...]]:
    """Return the problem, the starts of its solution, the model of the mode, and the unknowns of its laws."""
    first = max(alone, key=lambda one: one.amplitude) if alone else None
    top = max((float(motion_amplitudes(one).max()) for one in curves), default=0.0)
    reference, span = (first.model.reference, first.model.span) if first else (top, _span(curves))
    sensor = decays[0].sensor if decays else curves[0].sensor
    model = replace(stated, rest="zero", reference=reference, span=span, sensor=sensor)
    units = list(dict.fromkeys(str(one.excitation_unit) for one in curves))
    names = {unit: "modal_constant" + f"_{k}" * (len(units) > 1) for k, unit in enumerate(units, start=1)}
    starts = [{names.get(name, name): value for name, value in one.items()}
              for one in _starts(model, curves, units, known, first)]  # fmt: skip
    best = starts[0]
    own = model.mode_unknowns(_guess(model, best))
    shared = tuple(one.name for one in own)
    unknowns = [one for one in started(first.fit.unknowns if first else own, best) if one.name in shared]
    blocks = list[Block]()
    if alone:
        parts = [
            mode_decay(k, one, fit, replace(fit.model, reference=reference, span=span), shared)
            for k, (one, fit) in enumerate(zip(decays, alone, strict=True), start=1)
        ]
        blocks.append(decay_block(parts))
        unknowns += [one for part in parts for one in release_unknowns(part, shared)]
    if curves:
        free = tuple(names.values()) if known is None else ()
        unit = curves[0].sensor.motion_unit
        unknowns += [Unknown(names[one], best[names[one]], best[names[one]], 0.0, unit=constant_unit(unit, one))
                     for one in units if free]  # fmt: skip
        blocks.append(_weighed(curves_of_mode(model, curves, shared, names, known), best))
    blocks += map(smoothness_block, model.smooth)
    return FitProblem(tuple(blocks), tuple(unknowns), robust), starts, model, shared


def _settled(solution: FitSolution) -> FitSolution:
    """Return the solution with the sizes of the changes of smooth laws that its residuals show."""
    smoothness = _smoothness(solution)
    for _ in range(MAX_ITERATIONS if smoothness.size else 0):
        before, problem = smoothness, solution.problem
        solution = solve(replace(problem, unknowns=tuple(started(problem.unknowns, solution.fit.estimates))))
        smoothness = _smoothness(solution)
        if has_converged(before, smoothness):
            break
    return solution


def _smoothness(solution: FitSolution) -> Array:
    """Return the standard deviations of the changes of smooth laws."""
    blocks = [block for block in solution.problem.blocks if isinstance(block, SmoothnessBlock)]
    return np.array([float(block.weights.deviations[0]) for block in blocks])


def _span(curves: Sequence[ResponseRecord]) -> float:
    """Return the span of a smooth law: the largest amplitude over the smallest, if that is more than usual.

    Over a smaller span, the law would swing between the amplitudes of a few curves.
    """
    amplitudes = np.concatenate([motion_amplitudes(curve) for curve in curves])
    return max(float(amplitudes.max() / amplitudes.min()), AMPLITUDE_SPAN)


def _with_noise_of_decays(solution: FitSolution) -> FitSolution:
    """Return a solution whose noise is as in ``fit_decay``, with the scatter between late parts and the rest."""
    solution = replace(solution, fit=without_smoothness_test(solution.fit))
    for block, fitted in solution.parts:
        if isinstance(block, DecayBlock):
            ends = fitted.rows.start + np.cumsum([0, *block.series])
            decays = [slice(*pair) for pair in pairwise(ends.tolist())]
            noise_free = fitted.scale * block.negligible / math.sqrt(len(fitted.fit.residuals))
            pairs = zip(block.decays, block.weights.deviations.tolist(), strict=True)
            rounding = [fitted.scale / std * one.rounding(fitted.fit.estimates) for one, std in pairs]
            fit = allow_for_rounding(fitted.fit, decays, rounding)
            return replace(solution, fit=allow_for_late_residuals(fit, decays, noise_free))
    return solution


def _weighed(block: ModeCurveBlock, start: Mapping[str, float]) -> ModeCurveBlock:
    """Return curves with standard deviations as large as residuals at a start, for the accuracy of the first fit."""
    try:
        size = root_mean_square(block.at(start)[0])
    except NumericsError:
        return block
    weights = block.weights
    known = np.zeros(len(weights.lengths), dtype=bool)
    for group, given in zip(weights.groups, weights.known, strict=True):
        known[list(group)] = given
    deviations = np.where(known, weights.deviations, max(size, 1.0) * weights.deviations)
    return replace(block, weights=replace(weights, deviations=deviations), before=block)


def _starts(
    model: DecayModel,
    curves: Sequence[ResponseRecord],
    units: Sequence[str],
    known: float | None,
    decay: DecayFit | None,
) -> list[dict[str, float]]:
    """Return values by name of the laws, and by unit of the modal constants, to start from."""
    groups = {unit: points_of([one for one in curves if one.excitation_unit == unit]) for unit in units}
    starts = [] if decay is None else [decay.fit.estimates]
    starts += [from_points(model, groups, known)] if groups else []
    for start in starts:
        for unit, group in groups.items():
            if not start.get(unit, 0.0) > 0.0:
                start[unit] = modal_constant_of(model, group, start)
    return starts


def _guess(model: DecayModel, start: Mapping[str, float]) -> DecayGuess:
    """Return the mode of a start as the guess of a decay."""
    ratio, frequency = law_at(model, np.array([model.reference]), start)
    return guess_of(2 * math.pi * float(frequency[0]), max(float(ratio[0]), LEAST_RATIO), model.reference)
