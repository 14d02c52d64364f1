"""Damping laws and properties of a beam from any mix of measurements, and the comparison of laws on them.

    fit = fit_beam(model, [decay, sag, frequencies, curve], law, unknowns=["elastic_modulus", "tip_mass"])
    print(fit.report())

Each kind of record is a block of residuals (``ancf_casadi.estimation.block``), with the physics that explains it:

    motions          large motion of the nonlinear beam, integrated with exact derivatives (``motions``)
    response curves  steady vibration of the reduced beam by harmonic balance (``curves``)
    static tests, natural frequencies    equilibria and modes with exact derivatives (``values``)

All blocks share the unknowns (``unknowns``), and one loop fits them (``ancf_casadi.estimation.solve``).  Records of
several configurations of one beam, such as with and without an added mass, hold the model of their configuration.

Two optima may fit static tests and frequencies equally well, most of all where a tip mass and a soft clamp compete: a
cantilever with the tip mass m has exactly the frequencies of one with the clamp stiffness k if m/mu = E I/k, because
both have the equation

    1 + cos b cosh b = a b (sin b cosh b - cos b sinh b),    a = m/(mu L) or E I/(k L),    b^4 = mu omega^2 L^4/(E I).

A fit of either to such values therefore has several starts, and its intervals cover all optima that fit.

For large motion, this replaces the fit of the closed form (27), which has no inertia along the beam, no higher modes,
and no effect of the deflected shape on the drag.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 3 and 4.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from types import NoneType
from typing import Any

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.damping.law import SumOfLaws
from ancf_casadi.estimation.block import Block, Computed
from ancf_casadi.estimation.comparison import LawComparison
from ancf_casadi.estimation.prediction import PredictedChannel, RecordPrediction
from ancf_casadi.estimation.problem import FitProblem
from ancf_casadi.estimation.solve import solve
from ancf_casadi.estimation.solver.unknown import Priors, Unknown
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.mechanics.mesh_limits import bends_allowed
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import (
    check_fields,
    check_instance,
    flag,
    instances,
    is_sequence,
    positive,
    shown,
    whole,
)
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.parallel import run_all
from ancf_casadi.support.progress import counter
from problems.beam.curves.block import curve_block
from problems.beam.curves.record import ResponseRecord
from problems.beam.motions.block import MotionBlock, motion_block
from problems.beam.motions.marker_record import MarkerRecord, motion_record
from problems.beam.motions.record import MotionRecord
from problems.beam.motions.weights import coarse_or_wanted, coarse_tolerance
from problems.beam.properties import (
    CLAMP_STIFFNESS,
    first_values,
    is_property,
    property_owners,
    property_unknown,
    with_clamp,
)
from problems.beam.result import BeamFit, law_name
from problems.beam.unknowns import (
    BASE_AMPLITUDE,
    GROUPS,
    LOADS,
    NATURAL_FREQUENCIES,
    Bounds,
    mode_at_peak,
    of_curves,
    of_law,
    of_motions,
    sought_frequencies,
    starts,
    with_bounds_and_priors,
)
from problems.beam.values.records import FrequencyRecord, PropertyRecord, StaticRecord, ValueBlock

Record = Measurement | MotionRecord | MarkerRecord | ResponseRecord | StaticRecord | FrequencyRecord


@dataclass(frozen=True)
class FitSettings:
    """The settings of ``fit_beam``."""

    unknowns: Sequence[str] | None = None
    fixed: Sequence[str] = ()
    bounds: Bounds | None = None
    priors: Priors | None = None
    robust: bool = False
    tolerance: float | None = None
    modes: int | None = None
    harmonics: int = 5

    def __post_init__(self) -> None:
        """Validate what does not depend on the records."""
        for name in ("bounds", "priors"):
            check_instance(getattr(self, name), name, Mapping, NoneType)
        check_fields(self, robust=flag)
        if self.tolerance is not None:
            check_fields(self, tolerance=positive)


@lasting_interrupts()
def fit_beam(
    model: Model,
    records: Record | Sequence[Record],
    damping: DampingLaw | None = None,
    *,
    unknowns: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
    bounds: Bounds | None = None,
    priors: Priors | None = None,
    robust: bool = False,
    tolerance: float | None = None,
    modes: int | None = None,
    harmonics: int = 5,
    progress: bool = False,
) -> BeamFit:
    """Estimate a damping law, and properties of a beam, from any mix of measurements.

    Parameters
    ----------
    model : Model
        The beam; its properties are the guesses of those to be estimated.
    records : record, or sequence of records
        The measurements.  Motions: MotionRecord, MarkerRecord, or a Measurement, which is released from rest on a fixed
        base at time 0.  Steady vibration: ResponseRecord.  Beams at rest and small vibration: StaticRecord and
        FrequencyRecord, which hold the model of their configuration; in a mix they need standard deviations.
    damping : DampingLaw, optional
        The law; its parameters (``damping.parameters``) are the guesses.  None if there is no damping.
    unknowns : sequence of str, optional
        What else to estimate: properties, each by a factor common to all elements, or to those in brackets, as
        ``thickness[1:5]``: ``width``, ``thickness``, ``diameter``, ``density``, ``elastic_modulus``,
        ``bending_stiffness`` (E I, by the modulus), ``mass_per_length`` (by the density); lumped properties, named as
        in ``Beam.lumped``: ``tip_mass``, ``mass_2``, ``clamp_stiffness``, ``spring_y``, ``natural_curvature``,
        ``prestress`` and so on, of which a name means the same part in all configurations that have it;
        ``natural_frequencies``; ``excitation`` (common) or ``excitations`` (one for each response curve);
        ``base_amplitude``; ``start_force_x``, ``start_force_y``, ``start_moment`` and their ``_rate``.  If not given,
        natural frequencies for response curves alone, for these together with others the elastic modulus, or the
        bending stiffness of sections of given stiffness.  A rigid clamp gets a stiffness of 10 E I/L as its first
        value.
    fixed : sequence of str
        Parameters of the law to keep at their guesses.
    bounds : mapping, optional
        Bounds (lower, upper) by name of the unknown, SI units.  By default parameters of the law are at least 0 (and
        ratios at most 1); properties from a tenth to ten times the first value, masses and dashpots from 0, and
        springs from a hundredth, to a hundred times, clamps from 0.01 to 1e5 E I/L, a natural curvature or prestress
        up to ten times to either side; natural frequencies within 10 %; excitations from 0.5 to 1.5; loads unbounded.
    priors : mapping, optional
        Mean and standard deviation of an unknown by name before the fit, SI units: ``{"excitation": (1, 0.01)}``; or
        median and relative standard deviation of a positive one: ``{"tip_mass": (0.01, 0.1, "log-normal")}``.
    robust : bool
        Whether to use the pseudo-Huber loss, which limits the influence of outliers.
    tolerance : float, optional
        Tolerance of the integration of motions.  If not given, the fit selects one whose error typically shifts
        no estimate by more than a tenth of its standard error.
    modes, harmonics : int
        Numbers of modes and of harmonics of the first fit of response curves; if not given, two modes more than the
        highest that the records are about.
    progress : bool
        Count the steps of the fit on a terminal.

    Raises
    ------
    InputError
        If a name is unknown, a point is not on the beam, nothing is to be estimated, a guess is not within its bounds,
        the models of the records are not of the same beam, a record whose load is to be estimated does not start from
        an equilibrium, or values have no standard deviations to be weighed by.
    EquilibriumError
        If a beam has no stable equilibrium.
    FitError
        If the fit does not converge, or the records determine combinations of the unknowns only, which the message
        names.

    Examples
    --------
    Recover a damping coefficient from a motion of the tip; ``simulate`` stands in for the measurement here:

    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, simulate
    >>> from problems import FrequencyRecord, MarkerRecord, fit_beam
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model, base = Model(beam), HarmonicBase(amplitude=5e-3, frequency=1.9)
    >>> true, guess = RayleighDamping(alpha=0.5), RayleighDamping(alpha=0.2)
    >>> run = simulate(model, damping=true, base=base, duration=0.25, sample_rate=50.0)
    >>> motion = MarkerRecord(run.time, run.tip, base=base)
    >>> fit = fit_beam(model, motion, guess)
    >>> print(f"{fit.estimates['alpha']:.3f} {fit.units['alpha']}")
    0.500 1/s

    The elastic modulus from natural frequencies:

    >>> record = FrequencyRecord(model, [1.90, 10.8, 30.1], std=[0.01, 0.05, 0.15])
    >>> fit = fit_beam(model, record, unknowns=["elastic_modulus"])
    >>> value, error = fit.estimates["elastic_modulus"], fit.standard_errors["elastic_modulus"]
    >>> print(f"{value / 1e9:.0f} +- {error / 1e9:.0f} GPa")
    219 +- 1 GPa
    """
    settings = FitSettings(unknowns, fixed, bounds, priors, robust, tolerance, modes, harmonics)
    with counter("fit", shown=flag(progress, "progress")), bends_allowed():
        problem, start_model, first = beam_problem(model, records, damping, settings)
        only_values = all(isinstance(block, ValueBlock) for block in problem.blocks)
        motions = [(block.model, block.numbered) for block in problem.blocks if isinstance(block, MotionBlock)]
        solution = solve(problem, starts(problem.unknowns, first, motions, only_values=only_values))
    again = partial(fit_beam, model, damping=damping, **vars(settings))
    law = damping or SumOfLaws(())
    return BeamFit(solution.fit, solution, given=start_model, guess=law, first=first, again=again)


fit_transient = fit_beam  # the first name, from a time when there were fits of motions alone


@dataclass(frozen=True)
class Guesses:
    """The unknowns of a fit of a beam before it, and what their guesses give for its records."""

    unknowns: tuple[Unknown, ...]
    records: RecordPrediction


@lasting_interrupts()
def compute_guesses(model: Model, records: Any, damping: DampingLaw | None = None, **settings: Any) -> Guesses:
    """Compute the records from the guesses with which ``fit_beam`` would begin, whose arguments these are.

    Raises
    ------
    InputError, EquilibriumError
        As in ``fit_beam``.
    FitError
        If the values of a record cannot be computed.
    """
    with bends_allowed():
        problem, *_ = beam_problem(model, records, damping, FitSettings(**settings))
        guesses = {unknown.name: unknown.guess for unknown in problem.unknowns}
        channels: list[PredictedChannel] = []
        for block in problem.blocks:
            computed = Computed(guesses, block.residuals_at(guesses))
            if block.failure:
                raise FitError(f"the record cannot be computed from the guesses: {block.failure}")
            channels += block.channels(computed)
            block.close()
    return Guesses(problem.unknowns, RecordPrediction("beam", tuple(channels)))


def beam_problem(
    model: Model, records: Any, damping: DampingLaw | None, settings: FitSettings, *, apart: bool = False
) -> tuple[FitProblem, Model, dict[str, float]]:
    """Return the problem of ``fit_beam``, the model with first values, and those of the unknown properties by name.

    The blocks are those of motions, of response curves and of values; with ``apart``, each record has its own, and its
    phases count as right.
    """
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    motions, curves, values = _sort_records(records)
    law = damping or SumOfLaws(())
    wanted = _unknown_names(settings.unknowns, motions, curves, values)
    if settings.unknowns is None and "stiffness" in {shape.kind for shape in model.beam.shapes}:
        wanted = tuple("bending_stiffness" if name == "elastic_modulus" else name for name in wanted)
    all_records: Sequence[Any] = (*motions, *curves, *values)
    models_of_records = [model, *(record.model or model for record in all_records)]
    configurations = {id(configuration): configuration for configuration in models_of_records}
    clamped = with_clamp(list(configurations.values())) if CLAMP_STIFFNESS in wanted else configurations.values()
    models = dict(zip(configurations, clamped, strict=True))
    first = first_values(list(models.values()), [name for name in wanted if is_property(name)])
    for configuration in models.values():
        property_owners(configuration.beam, tuple(first))  # check
    frequencies = sought_frequencies(model) if curves else np.zeros(0)
    listed = [
        *of_law(damping, settings.fixed),
        *(property_unknown(name, value, list(models.values())) for name, value in first.items()),
        *of_curves(wanted, frequencies, curves),
        *of_motions(wanted, model, motions),
    ]
    if not listed:
        raise InputError("nothing is to be estimated; name properties, or free a parameter of the law", "unknowns")
    bounded = tuple(with_bounds_and_priors(listed, settings.bounds or {}, settings.priors or {}))
    blocks: list[Block] = []
    load = tuple(name.removeprefix("start_") for name in LOADS if name in wanted)
    for configuration, numbered in _by_configuration(motions, model, models, apart):
        coarse = coarse_tolerance([record for _, record in numbered], configuration.beam.length)
        tolerance = coarse_or_wanted(coarse, settings.tolerance) if settings.tolerance else coarse
        accuracy: Any = {"tolerance": tolerance, "wanted": settings.tolerance, "robust": settings.robust}
        blocks.append(motion_block(configuration, numbered, law, first, load=load, **accuracy))
    for configuration, numbered in _by_configuration(curves, model, models, apart):
        highest = 1 + max(mode_at_peak(record, frequencies) for record in curves)
        modes = settings.modes
        mode_count = highest + 2 if modes is None else whole(modes, "modes", 1, configuration.freedoms)
        names, harmonics = [unknown.name for unknown in bounded], whole(settings.harmonics, "harmonics", 1)
        block = curve_block(configuration, numbered, law, names, first, modes=mode_count, harmonics=harmonics)
        blocks.append(block if apart else block.orient(frequencies))
    totals, counts = Counter(record.name for record in values), Counter[str]()
    for record in values:
        counts[record.name] += 1
        number = str(counts[record.name]) if totals[record.name] > 1 else ""  # among the records of this name
        blocks.append(ValueBlock(record.with_model(models[id(record.model)]), first, number))
    return FitProblem(tuple(blocks), bounded, settings.robust), models[id(model)], first


@lasting_interrupts()
def compare_laws(
    model: Model,
    records: Any,
    laws: Sequence[DampingLaw],
    *,
    executor: Executor | None = None,
    jobs: int = 1,
    progress: bool = False,
    **settings: Any,
) -> LawComparison[BeamFit]:
    """Fit several damping laws to any mix of measurements, and select one by information criteria.

    Parameters
    ----------
    model, records
        As in ``fit_beam``.
    laws : sequence of DampingLaw
        Laws with guesses of their parameters, the simplest first.
    executor, jobs, progress
        As in ``run_all``; the laws are fitted in parallel.  With ``jobs`` above 1 a script must call this under
        ``if __name__ == "__main__":``.
    **settings
        Further settings of ``fit_beam``.

    Raises
    ------
    InputError
        If there is no law, or as in ``fit_beam``.
    FitError
        If a fit does not converge.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, QuadraticDamping, RayleighDamping, simulate
    >>> from problems import MarkerRecord, compare_laws
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model, base = Model(beam), HarmonicBase(amplitude=5e-3, frequency=1.9)
    >>> true, laws = QuadraticDamping(eta2=2.0), [RayleighDamping(alpha=0.2), QuadraticDamping(eta2=1.0)]
    >>> run = simulate(model, damping=true, base=base, duration=0.25, sample_rate=50.0)
    >>> comparison = compare_laws(model, MarkerRecord(run.time, run.tip, base=base), laws)
    >>> type(comparison.best.law).__name__, round(comparison.best.estimates["eta2"], 2)
    ('QuadraticDamping', 2.0)
    """
    laws = instances(laws, "laws", DampingLaw)
    tasks = [partial(fit_beam, model, records, law, **settings) for law in laws]
    fits: list[Any] = run_all(tasks, executor=executor, jobs=jobs, progress=progress, title="laws")
    terms = tuple(tuple(parameter.name for parameter in law.parameters) for law in laws)
    return LawComparison(tuple(law_name(law) for law in laws), tuple(fits), terms)


def _sort_records(
    records: Any,
) -> tuple[tuple[MotionRecord, ...], tuple[ResponseRecord, ...], tuple[PropertyRecord, ...]]:
    """Return the motions, the response curves and the records of values."""
    record_list = instances(records if is_sequence(records) else [records], "records", object)
    motions, curves, values = [], [], []
    for record in record_list:
        if isinstance(record, ResponseRecord):
            if record.excitation_unit:
                raise InputError(
                    f"{record.label}: needs base or load in place of excitation_unit; or use fit_mode", "records"
                )
            curves.append(record)
        elif isinstance(record, PropertyRecord):
            values.append(record)
        else:
            motions.append(motion_record(record))
    stated = {record.stds is not None for record in values}
    if len(stated) > 1:
        raise InputError("some have standard deviations and some have none; give them for all, or for none", "records")
    if stated == {False} and (motions or curves):
        raise InputError(
            "values need standard deviations, to be weighed against motions and response curves", "records"
        )
    return tuple(motions), tuple(curves), tuple(values)


def _unknown_names(
    unknowns: Any, motions: Sequence[Any], curves: Sequence[Any], values: Sequence[Any]
) -> tuple[str, ...]:
    """Return the names of the unknowns besides those of the law and of the sensors."""
    if unknowns is None:
        return () if not curves else ("elastic_modulus",) if motions or values else (NATURAL_FREQUENCIES,)
    if not is_sequence(unknowns):
        raise InputError(f"must be a sequence of names, got {shown(unknowns)}", "unknowns")
    names = tuple(unknowns)
    for name in names:
        if not isinstance(name, str) or not (is_property(name) or name in GROUPS):
            raise InputError(
                f"must be properties of the beam, or among {', '.join(GROUPS)}, got {shown(name)}", "unknowns"
            )
    if len(set(names)) < len(names):
        raise InputError("must be different names", "unknowns")
    needed = {NATURAL_FREQUENCIES: curves, "excitation": curves, "excitations": curves, BASE_AMPLITUDE: motions}
    needed |= dict.fromkeys(LOADS, motions)
    for name in names:
        if name in needed and not needed[name]:
            raise InputError(f"{name} belongs to a kind of record that is not among the records", "unknowns")
    if NATURAL_FREQUENCIES in names and (motions or values or any(map(is_property, names))):
        raise InputError(
            f"{NATURAL_FREQUENCIES} are those of the reduced model alone; with other records, or properties, "
            "name properties",
            "unknowns",
        )
    return names


def _by_configuration(
    records: Sequence[Any], model: Model, models: Mapping[int, Model], apart: bool
) -> list[tuple[Model, list[Any]]]:
    """Return each configuration, or each record, with its records, numbered from 1 among all of their kind."""
    groups: dict[tuple[int, int], list[tuple[int, Any]]] = {}
    for number, record in enumerate(records, start=1):
        groups.setdefault((id(record.model or model), number if apart else 0), []).append((number, record))
    return [(models[key], numbered) for (key, _), numbered in groups.items()]
