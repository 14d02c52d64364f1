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
from types import NoneType
from typing import Any, get_args

import numpy as np

from ancf_casadi.decay.first_guess import DecayGuess
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.rest_position import Rest
from ancf_casadi.decay.smooth import AMPLITUDE_SPAN
from ancf_casadi.estimation.block import Block
from ancf_casadi.estimation.problem import FitProblem
from ancf_casadi.estimation.solve import solve
from ancf_casadi.estimation.solver.unknown import Priors, Unknown, with_guesses
from ancf_casadi.exceptions import FitError, InputError, NumericsError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import root_mean_square
from ancf_casadi.support.inputs import check_instance, choice, flag, is_sequence, numbers, physical, shown
from ancf_casadi.support.progress import counter
from problems.beam.curves.checks import level_notes, orient, phase_locked
from problems.beam.curves.record import ResponseRecord
from problems.decay.block import DecayBlock, SmoothnessBlock
from problems.decay.free_decay import DecayMode, clean_record
from problems.decay.laws import RATIO_BOUNDS, DecayModel, Law, with_priors
from problems.decay.result import DecayFit
from problems.decay.solution import fit_record
from problems.mode.curve_block import ModeCurveBlock, constant_unit, mode_curve_block
from problems.mode.oscillator import (
    LEAST_RATIO,
    Points,
    balance_points,
    law_at,
    median_modal_constant,
    mode_guess,
    motion_amplitudes,
    reading_factor,
    regression_start,
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
    decays, curves = _sort_records(records)
    choice(law, get_args(Law), "law")
    choice(frequency_law, get_args(FrequencyLaw), "frequency_law")
    robust = flag(robust, "robust")
    check_instance(priors, "priors", Mapping, NoneType)
    given_constant = None if modal_constant is None else physical(modal_constant, "modal_constant")
    requested = DecayModel(law, rest, frequency_law, ratio_bounds)
    releases = [None] * len(decays) if release_times is None else numbers(release_times, "release_times")
    if len(releases) != len(decays):
        raise InputError(f"has {len(releases)} values for {len(decays)} decays", "release_times")
    separate_fits = [
        fit_record(decay, requested, release_time=t, robust=robust) for decay, t in zip(decays, releases, strict=True)
    ]
    factors = [reading_factor(curve) for curve in curves]
    angles = [float(np.angle(factor[0])) for factor in factors]
    corrections = [orient(curve, angle) for curve, angle in zip(curves, angles, strict=True)]
    curves = [curve for curve, _ in corrections]
    notes = (*(note for _, note in corrections if note), *level_notes(curves, factors))
    if (
        not decays
        and given_constant is None
        and all(phase_locked(curve, angle) for curve, angle in zip(curves, angles, strict=True))
    ):
        raise FitError(
            "all points are at the resonance: the records determine zeta/modal_constant, but not zeta and "
            "modal_constant each; add a decay or points beside the resonance, or give modal_constant"
        )
    problem, starts, model, laws = _mode_problem(requested, decays, separate_fits, curves, given_constant, robust)
    problem = replace(problem, unknowns=tuple(with_priors(problem.unknowns, priors or {}, requested)))
    try:
        with counter("fit", shown=flag(progress, "progress")):
            solution = solve(problem, starts)
    except FitError as error:
        raise FitError("; ".join([*notes, str(error)]), error.stats) from None
    amplitudes = np.concatenate([*(fit.amplitude_range for fit in separate_fits), *map(motion_amplitudes, curves)])
    smallest, largest = float(amplitudes.min()), float(amplitudes.max())
    refit = partial(fit_mode, law=law, frequency_law=frequency_law, modal_constant=modal_constant,
                    rest=rest, ratio_bounds=ratio_bounds, priors=priors, robust=robust)  # fmt: skip
    return ModeFit(solution.fit, solution, model, requested, laws, smallest, largest, notes, again=refit)


def _is_vector(values: Any) -> bool:
    return is_sequence(values) and not is_sequence(next(iter(values), None))


def _sort_records(records: Any) -> tuple[list[Measurement], list[ResponseRecord]]:
    """Return the decays and the response curves."""
    is_pair = is_sequence(records) and len(records) == 2 and all(map(_is_vector, records))
    items = [records] if is_pair or not is_sequence(records) else list(records)
    decays: list[Measurement] = []
    curves: list[ResponseRecord] = []
    for k, item in enumerate(items, start=1):
        if isinstance(item, ResponseRecord):
            if not item.excitation_unit:
                raise InputError(
                    f"record {k}: needs excitation_unit, the unit of its levels, in place of a beam", "records"
                )
            curves.append(item)
        elif isinstance(item, Measurement):
            decays.append(clean_record(item))
        elif is_sequence(item) and len(item) == 2:
            decays.append(clean_record(*item))
        else:
            raise InputError(
                f"record {k}: must be a Measurement, (times, displacements) or a ResponseRecord, got {shown(item)}",
                "records",
            )
    if not items:
        raise InputError("must hold at least one record", "records")
    units = {sensor.motion_unit for sensor in (*(decay.sensor for decay in decays), *(c.sensor for c in curves))}
    if len(units) > 1:
        named = ", ".join(sorted(unit or "strain" for unit in units))
        raise InputError(f"measure different motions, in {named}; convert them, or fit them apart", "records")
    return decays, curves


def _mode_problem(
    requested: DecayModel,
    decays: Sequence[Measurement],
    separate_fits: Sequence[DecayFit],
    curves: Sequence[ResponseRecord],
    given_constant: float | None,
    robust: bool,
) -> tuple[FitProblem, list[dict[str, float]], DecayModel, tuple[str, ...]]:
    """Return the problem, the starts of its solution, the model of the mode, and the unknowns of its laws."""
    largest = max(separate_fits, key=lambda fit: fit.amplitude) if separate_fits else None
    largest_amplitude = max((float(motion_amplitudes(curve).max()) for curve in curves), default=0.0)
    reference, span = (largest.model.reference, largest.model.span) if largest else (largest_amplitude, _span(curves))
    sensor = decays[0].sensor if decays else curves[0].sensor
    model = replace(requested, rest="zero", reference=reference, span=span, sensor=sensor)
    units = list(dict.fromkeys(str(curve.excitation_unit) for curve in curves))
    names = {unit: "modal_constant" + f"_{k}" * (len(units) > 1) for k, unit in enumerate(units, start=1)}
    groups = {
        name: balance_points([curve for curve in curves if curve.excitation_unit == unit])
        for unit, name in names.items()
    }
    starts = _start_values(model, groups, given_constant, largest)
    start = starts[0]
    law_unknowns = model.mode_unknowns(_start_guess(model, start))
    law_names = tuple(unknown.name for unknown in law_unknowns)
    unknowns = [
        unknown
        for unknown in with_guesses(largest.fit.unknowns if largest else law_unknowns, start)
        if unknown.name in law_names
    ]
    blocks = list[Block]()
    if separate_fits:
        fitted_decays = []
        for k, fit in enumerate(separate_fits, start=1):
            curve_names = tuple(name if name in law_names else f"{name}_{k}" for name in fit.fit.names)
            model_of_decay = replace(fit.model, reference=reference, span=span, lags=bool(curves))
            mode = DecayMode(model_of_decay, curve_names)
            fitted_decays.append(replace(fit.decay, modes=(mode,)))
            release_unknowns = [unknown for unknown in fit.fit.unknowns if unknown.name not in law_names]
            release_unknowns = with_guesses(release_unknowns, fit.fit.estimates)
            unknowns += [replace(unknown, name=f"{unknown.name}_{k}") for unknown in release_unknowns]
        residuals = [fit.fit.residuals[fit.rows] for fit in separate_fits]
        blocks.append(DecayBlock.of(fitted_decays).with_noise(residuals, robust=robust))
    if curves:
        motion_unit = curves[0].sensor.motion_unit
        if given_constant is None:
            for excitation_unit, name in names.items():
                unit = constant_unit(motion_unit, excitation_unit)
                unknowns.append(Unknown(name, start[name], start[name], 0.0, unit=unit))
        blocks.append(_with_first_weights(mode_curve_block(model, curves, law_names, names, given_constant), start))
    blocks += map(SmoothnessBlock.of, model.smooth)
    return FitProblem(tuple(blocks), tuple(unknowns), robust), starts, model, law_names


def _span(curves: Sequence[ResponseRecord]) -> float:
    """Return the span of a smooth law: the largest amplitude over the smallest, if that is more than usual.

    Over a smaller span, the law would swing between the amplitudes of a few curves.
    """
    amplitudes = np.concatenate([motion_amplitudes(curve) for curve in curves])
    return max(float(amplitudes.max() / amplitudes.min()), AMPLITUDE_SPAN)


def _with_first_weights(block: ModeCurveBlock, start: Mapping[str, float]) -> ModeCurveBlock:
    """Return curves with standard deviations as large as the residuals at a start, which set the accuracy of a fit."""
    try:
        size = max(root_mean_square(block.at(start)[0]), 1.0)
    except NumericsError:
        return block
    return replace(block, weights=block.weights.improved([np.array([size])] * len(block.weights.lengths)), before=block)


def _start_values(
    model: DecayModel, groups: Mapping[str, Points], given_constant: float | None, decay: DecayFit | None
) -> list[dict[str, float]]:
    """Return starting values by name: those of a decay, and of a regression of the points of each modal constant."""
    starts = [] if decay is None else [decay.fit.estimates]
    starts += [regression_start(model, groups, given_constant)] if groups else []
    for start in starts:
        for constant, points in groups.items():
            if not start.get(constant, 0.0) > 0.0:
                start[constant] = median_modal_constant(model, points, start)
    return starts


def _start_guess(model: DecayModel, start: Mapping[str, float]) -> DecayGuess:
    """Return the guess of a decay for the mode of a start."""
    (ratio,), (frequency,) = law_at(model, np.array([model.reference]), start)
    return mode_guess(2 * math.pi * frequency, max(ratio, LEAST_RATIO), model.reference)
