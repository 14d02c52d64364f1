"""Expected standard errors of experiments, before anything is measured.

    found = plan(model, {"release": PlannedRecord.motion(...), "sag": PlannedRecord.static(...)}, law,
                 unknowns=["elastic_modulus"])
    found.errors_of({"release": 2, "sag": 1})       # standard error of each unknown
    found.best(budget=4)                            # the list of four records that is worth measuring

The values of each candidate are computed at the guesses: motions by integration, response curves by harmonic balance,
static tests and natural frequencies by Newton's method and an eigenvalue problem.  With these in place of measured
values, a record is a block of ``fit_beam``, with the same residuals, unknowns and derivatives.  Standard errors and
lists follow from its Jacobian (``problems.planning.design``).  They hold as far as the residuals are linear in the
unknowns within the standard errors, and the guesses are near the truth.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from types import NoneType
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.estimation.block import Block
from ancf_casadi.estimation.solver.unknown import Coordinates, Priors, Unknown
from ancf_casadi.exceptions import AncfError, FitError, InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance
from ancf_casadi.support.interrupts import delayed_interrupts, lasting_interrupts
from ancf_casadi.support.parallel import run_all
from problems.beam.curves.block import CurveBlock
from problems.beam.curves.driven import small_response
from problems.beam.curves.record import ResponseRecord
from problems.beam.curves.response_block import FREE, first_weights
from problems.beam.fitting import FitSettings, beam_problem
from problems.beam.motions.block import MotionBlock, motion_block, sensor_noise
from problems.beam.motions.record import MotionRecord
from problems.beam.motions.weights import first_weights as motion_weights
from problems.beam.properties import property_owners
from problems.beam.result import BeamFit
from problems.beam.unknowns import COMMON, sought_frequencies
from problems.beam.values.records import PropertyRecord, ValueBlock
from problems.beam.values.response import place
from problems.planning.design import ExpectedRecord
from problems.planning.record import PlannedRecord, Template, with_values
from problems.planning.result import Plan

VALUE_TOLERANCE = 1e-8  # tolerance of the integrator that computes the values of a motion
LINEAR_SHARE = 0.05  # amplitude at which the search for a response begins, relative to the linear response
LARGEST_MISS = 1e-4  # largest relative error of the level of a computed response


@lasting_interrupts()
def plan(
    model: Model,
    candidates: Mapping[str, PlannedRecord],
    damping: DampingLaw | None = None,
    *,
    unknowns: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
    priors: Priors | None = None,
    before: BeamFit | None = None,
    modes: int | None = None,
    harmonics: int = 5,
    executor: Executor | None = None,
    jobs: int = 1,
    progress: bool = False,
) -> Plan:
    """Compute the standard errors that experiments on a beam will have, before anything is measured.

    Parameters
    ----------
    model : Model
        The beam with guesses of its properties.
    candidates : mapping of str to PlannedRecord
        The experiments that could be done, by name.
    damping : DampingLaw, optional
        The law with guesses of its parameters.
    unknowns, fixed, priors, modes, harmonics
        What to estimate, and what is known before, as in ``fit_beam``.  Unknowns of a single record, such as its
        release or the zero of a sensor, are estimated with each record anew.
    before : BeamFit, optional
        A fit of earlier records.  Its information counts, its noise is that of the same sensors where no standard
        deviation is given, and the colour of its noise makes the motions that are planned less certain, by
        ``fit.fit.noise.inflation``.  Priors that it had are not to be given again.
    executor, jobs, progress
        As in ``run_all``; the candidates are computed in parallel.  With ``jobs`` above 1 a script must call this under
        ``if __name__ == "__main__":``.

    Returns
    -------
    Plan
        Expected standard errors, best lists, sensor places and durations.

    Raises
    ------
    InputError
        If there is no candidate, a noise is not known, or as in ``fit_beam``.
    EquilibriumError, FitError
        If the values of a candidate cannot be computed.

    Examples
    --------
    Which tells more of the elastic modulus and the density of a strip: its sag under a weight, or its frequencies?

    >>> from ancf_casadi import Beam, Model, PointLoad, Sensor
    >>> from problems import PlannedRecord, plan
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
    ...                     elements=4, axis=(1.0, 0.0))
    >>> model, down = Model(beam), Sensor("displacement", direction=(0.0, -1.0))
    >>> sag = PlannedRecord.static(model, [PointLoad.hung(2e-3, point=0.4)], down, std=2e-4)
    >>> tones = PlannedRecord.natural_frequencies(model, [1, 2], std=[0.01, 0.02])
    >>> found = plan(model, {"sag": sag, "tones": tones}, unknowns=["elastic_modulus", "density"])
    >>> {name: f"{error:.2g}" for name, error in found.errors_of({"sag": 1, "tones": 1}).items()}
    {'elastic_modulus': '1.1e+09', 'density': '46'}
    >>> found.best(budget=4, goal="density")
    {'sag': 3, 'tones': 1}
    """
    check_instance(model, "model", Model)
    check_candidates(candidates)
    check_instance(before, "before", BeamFit, NoneType)
    templates = _templates(candidates, model, before)
    settings = FitSettings(unknowns, fixed, priors=priors, modes=modes, harmonics=harmonics)
    problem, _, values = beam_problem(model, templates, damping, settings, apart=True)
    shared_names = {*values, COMMON, *(parameter.name for parameter in (damping.parameters if damping else ()))}
    all_unknowns = [replace(unknown, guess=1.0) if _is_frequency(unknown) else unknown for unknown in problem.unknowns]
    shared = [unknown for unknown in all_unknowns if unknown.name in shared_names or _is_frequency(unknown)]
    if not shared:
        raise InputError("there is nothing that records share; name properties, or free the law", "unknowns")
    growth = max(before.fit.noise.inflation, 1.0) if before else 1.0
    kinds = MotionRecord, ResponseRecord, PropertyRecord  # in the order of the blocks
    order = [k for kind in kinds for k, template in enumerate(templates) if isinstance(template, kind)]
    blocks, tasks = dict(zip(order, problem.blocks, strict=True)), []
    for k, name in enumerate(candidates):
        block = blocks[k]
        number = block.numbered[0][0] if isinstance(block, MotionBlock | CurveBlock) else 0
        if isinstance(block, CurveBlock):  # without the levels of other records
            levels = re.compile(rf"(?!excitation_).*|excitation_{number}")
            block = replace(block, names=tuple(filter(levels.fullmatch, block.names)))
        of_record = re.compile(rf".+_{number}(_\d+)?")
        own = tuple(unknown for unknown in all_unknowns if of_record.fullmatch(unknown.name) and unknown not in shared)
        tasks.append(partial(_expect_record, name, block, tuple(shared), own, growth))
    results = run_all(tasks, executor=executor, jobs=jobs, progress=progress, title="candidates")
    costs = tuple(candidate.cost for candidate in candidates.values())
    records, expected = (tuple(column) for column in zip(*results, strict=True))
    return Plan(tuple(candidates), costs, tuple(shared), records, expected, _prior(shared, before), model)


def _is_frequency(unknown: Unknown) -> bool:
    """Return whether an unknown is the factor on a natural frequency."""
    return unknown.name.startswith("frequency_")


def check_candidates(candidates: Mapping[str, PlannedRecord]) -> None:
    """Check that the candidates are planned records by name, and that there is at least one."""
    check_instance(candidates, "candidates", Mapping)
    if not candidates:
        raise InputError("must hold at least one candidate", "candidates")
    for name, candidate in candidates.items():
        check_instance(name, "candidates", str)
        check_instance(candidate, f"candidates: {name}", PlannedRecord)


def _templates(candidates: Mapping[str, PlannedRecord], model: Model, before: BeamFit | None) -> list[Template]:
    """Return the candidates as records with known noise; response curves have their peaks at natural frequencies."""
    noise = sensor_noise(before.solution.problem.blocks) if before else {}
    templates: list[Template] = []
    for name, candidate in candidates.items():
        template = candidate.template
        if isinstance(template, ResponseRecord):  # its standard deviations have defaults
            distance = np.abs(np.log(template.f[:, None] / sought_frequencies(model))).min(axis=1)
            templates.append(replace(template, values=template.a / (LINEAR_SHARE + distance)))
            continue
        stds: list[Any] = []
        if isinstance(template, MotionRecord):
            stds = [channel.std or noise.get(channel.sensor) for channel in template.own_channels]
            channels = zip(template.own_channels, stds, strict=True)
            template = replace(template, channels=[replace(channel, std=std) for channel, std in channels])
        else:
            stds = [template.stds]
        if any(std is None for std in stds):
            raise InputError("is needed: nothing else tells the noise", f"candidates: {name}: std")
        templates.append(template)
    return templates


def _expect_record(
    name: str, block: Block, shared: Sequence[Unknown], own_unknowns: Sequence[Unknown], growth: float
) -> tuple[Template, ExpectedRecord]:
    """Return a candidate with computed values, and the dependence of its residuals on shared and own unknowns."""
    unknowns = [*shared, *own_unknowns]
    y = Coordinates.of(unknowns)
    guesses = {unknown.name: unknown.guess for unknown in unknowns}
    try:
        record, block = _with_computed_values(block, guesses)
        jacobian = block.linearised(unknowns, y.guess)[1]
        if block.failure or not np.isfinite(jacobian).all():
            raise FitError(block.failure or "the derivatives of its values are not finite")
        block.close()
    except AncfError as error:
        kind = InputError if isinstance(error, InputError) else FitError
        raise kind(f"the candidate {name!r} cannot be computed: {error}") from None
    prior_weights = y.slopes(y.guess) * y.scale / [unknown.prior_std for unknown in unknowns]
    times, places = np.full(len(jacobian), math.nan), [math.nan] * len(block.series)
    if isinstance(block, MotionBlock):
        times, places = block.times, [place(block.model, channel.sensor) for channel in block.sensors]
    return record, ExpectedRecord(
        jacobian=jacobian,
        shared=len(shared),
        prior_jacobian=np.diag(prior_weights)[len(shared) :],
        lengths=tuple(block.series),
        places=np.array(places),
        times=times,
        negligible=block.negligible,
        growth=growth if isinstance(block, MotionBlock) else 1.0,
    )


def _with_computed_values(block: Block, guesses: Mapping[str, float]) -> tuple[Template, Block]:
    """Return the record of a block, and the block, with values computed at the guesses of the unknowns."""
    if isinstance(block, ValueBlock):
        respond = block.record.response(property_owners(block.record.model.beam, tuple(block.first)))
        test = with_values(block.record, respond(np.ones(len(block.first)))[0])
        return test, replace(block, record=test)
    if isinstance(block, CurveBlock):
        curve = with_values(block.records[0], _steady_values(block, guesses))
        return curve, replace(block, numbered=((block.numbered[0][0], curve),), weights=first_weights([curve]))
    assert isinstance(block, MotionBlock)
    number, template = block.numbered[0]
    trial = replace(block, weights=motion_weights([template]), tolerance=VALUE_TOLERANCE)
    unknowns = {name: cs.MX(value) for name, value in guesses.items() if not name.startswith("zero_")}
    with delayed_interrupts():
        residuals = np.asarray(cs.evalf(trial.residuals(unknowns))).ravel()
    if trial.failure:
        raise FitError(trial.failure)
    measured = np.concatenate([channel.measurement.values for channel in template.own_channels])
    record = with_values(template, measured + np.concatenate(trial.weights.split(residuals)))
    return record, motion_block(block.model, [(number, record)], block.damping, block.first, load=block.load)


def _steady_values(block: CurveBlock, guesses: Mapping[str, float]) -> Array:
    """Return amplitude, phase and level of the steady motions of a curve, on the branch that begins at rest, (m, 3)."""
    number, template = block.numbered[0]
    driven = block.driven_beams(guesses)[0]
    unshifted = replace(template, values=template.a)  # the first point counts as the peak: no shift of the frequencies
    response = small_response(driven, unshifted, float(template.f[0]), block.system_unknowns(guesses))
    linear = response.amplitudes * template.a
    start = with_values(template, np.column_stack([LINEAR_SHARE * linear, np.zeros((len(linear), 2))]))
    free = replace(block, numbered=((number, start),), weights=first_weights([start]), looseness=FREE)
    values = free.motions(guesses)[0][0]
    missed = np.abs(values[:, 2] / template.a - 1) > LARGEST_MISS
    if missed.any():
        raise FitError(f"no motion with the level of the excitation is found at {template.f[missed][0]:.5g} Hz")
    return np.asarray(values)


def _prior(shared: Sequence[Unknown], before: BeamFit | None) -> Array:
    """Return the information of priors and of an earlier fit on the shared unknowns, in units of their scales."""
    y = Coordinates.of(shared)
    steps = y.slopes(y.guess) * y.scale  # changes of the unknowns
    weights = steps / [unknown.prior_std for unknown in shared]
    information = np.diag(weights**2)
    if before is not None:
        names = tuple(before.estimates)
        rows = [k for k, unknown in enumerate(shared) if unknown.name in names and unknown.name not in before.at_bound]
        columns = [names.index(shared[k].name) for k in rows]
        earlier_information = np.linalg.inv(before.covariance[np.ix_(columns, columns)])
        information[np.ix_(rows, rows)] += earlier_information * np.outer(steps[rows], steps[rows])
    return information
