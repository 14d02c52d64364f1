"""A step with modal parameters identified from free decays, Eq. (10): Tables 2 and 4, Figures 5 to 9 of the paper.

The decays are measured files, or synthetic ones: Eq. (9) or (27) with given parameters and seeded white noise.  Every
figure and table made from synthetic decays says so.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal, Self, final

import casadi as cs
import numpy as np
from msgspec import Meta

from ancf_casadi.decay.closed_forms import linear_decay, quadratic_decay
from ancf_casadi.decay.rest import Rest
from ancf_casadi.estimation.agreement import part_estimates
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure, si_prefix
from ancf_casadi.support.inputs import check_keys, error_prefix
from ancf_casadi.support.specs import UNLISTED, Positive, Spec, convert
from ancf_casadi.support.tables import Cell, Table, finite_or_none
from problems.decay.fitting import fit_decay
from problems.decay.laws import Law
from problems.decay.result import DecayFit
from problems.spec.file import StudyFile
from problems.spec.record_files import ColumnSpec
from problems.study.compute import Compute
from problems.study.drawing import band, draw_band, line, new_figure
from problems.study.step import Finding, Findings, Printed, Step, Study, beside_printed, printed_numbers

PRINTED = ("frequency", "damping_ratio", "eta1", "eta2")
SYNTHETIC_RATE, SYNTHETIC_DURATION, SYNTHETIC_STD = 500.0, 5.0, 0.2e-3  # 1/s, s, m, of synthetic decays
MOST_DECAY_SAMPLES = 10_000_000  # of a synthetic decay


class DecayRecord(ColumnSpec, frozen=True, kw_only=True):
    """A measured free decay."""

    release_time: Annotated[float, Meta(description="s")] = math.nan

    def decay(self, file: StudyFile, where: str) -> Decay:
        """Read the decay from the file of measurements beside that of the study."""
        return Decay(self.measurement(file, where), "", self.release_time)


class SyntheticDecay(Spec, frozen=True):
    """Parameters of a free decay by Eq. (9), with a damping ratio, or by Eq. (27), with eta1 and eta2."""

    frequency: Positive
    amplitude: Positive
    damping_ratio: Annotated[float, Meta(ge=0.0, lt=1.0)] | None = None
    eta1: Positive | None = None
    eta2: Positive | None = None

    def __post_init__(self) -> None:
        """Refuse parameters of both laws, or of none."""
        present = (self.damping_ratio is not None, self.eta1 is not None, self.eta2 is not None)
        if present not in ((True, False, False), (False, True, True)):
            raise InputError("give either damping_ratio, or both of eta1 (1/s) and eta2 (1/m)")


@dataclass(frozen=True)
class Decay:
    """A decay to fit."""

    record: Measurement
    synthetic: str  # description of a synthetic record; empty for a measured one
    release_time: float  # start of the decay, s; nan if it is to be detected


@dataclass(frozen=True)
class FittedDecay:
    """The fit of a decay as plain data."""

    numbers: dict[str, Any]  # as in ``results.json``
    amplitude_error: float  # standard error of the amplitude, m; nan if unknown
    motion: Array  # (3, k): times from the release on, s, record and fit
    first_periods: Array  # (2, k): fine times over the first periods, s, and fit


def fit_plain(decay: Decay, law: str, rest: Rest | None) -> FittedDecay:
    """Fit a decay, and return the fit as plain data."""
    release = None if math.isnan(decay.release_time) else decay.release_time
    record = decay.record
    with error_prefix(record.name):
        fit: DecayFit = fit_decay(record, law=law, rest=rest, release_time=release)  # type: ignore[arg-type]
    per_period = len(fit.time) / max(1.0, fit.frequency * float(fit.time[-1] - fit.time[0]))
    periods = min(12, max(3, 300 / per_period), len(fit.time) / per_period)  # drawn in detail
    fine_time = fit.release_time + np.linspace(0.0, periods / fit.frequency, int(40 * periods))
    motion = np.array([fit.time, np.interp(fit.time, record.time, record.values), fit.displacement(fit.time)])
    first_periods = np.array([fine_time, fit.displacement(fine_time)])
    return FittedDecay(_numbers(fit), fit.standard_errors.get("amplitude", math.nan), motion, first_periods)


def unbounded_coefficients(fit: DecayFit) -> tuple[float, float, Array]:
    """Return eta1 (1/s) and eta2 (1/m) of a quadratic decay without the bounds of its fit, and their covariance (2, 2).

    A fit whose eta2 is at its bound 0 would understate the errors; one Gauss-Newton step without bounds gives the pair.
    """
    all_free = replace(fit.fit, active_bounds=np.zeros(len(fit.fit.names), dtype=bool))
    values, covariance = part_estimates(all_free, np.ones(len(fit.fit.residuals), dtype=bool))
    pair = list(fit.indices[1:3])  # after the frequency
    return float(values[pair[0]]), float(values[pair[1]]), covariance[np.ix_(pair, pair)]


def _numbers(fit: DecayFit) -> dict[str, Any]:
    def error(name: str) -> float | None:
        return finite_or_none(fit.standard_errors.get(name, math.nan))

    unbounded = None  # coefficients of the quadratic law as if they had no bounds, and their covariance
    if fit.law == "quadratic":
        eta1, eta2, covariance = unbounded_coefficients(fit)
        unbounded = {"eta1": eta1, "eta2_per_m": eta2, "covariance": covariance.tolist()}
    return {
        "law": fit.law,
        "frequency_hz": fit.frequency,
        "frequency_stderr_hz": error("frequency"),
        "damping_ratio": fit.damping_ratio,
        "damping_ratio_stderr": error("damping_ratio"),
        "equivalent_damping_ratio": fit.damping_ratio,
        "amplitude_m": fit.amplitude,
        "eta1": fit.eta1,
        "eta1_stderr": error("eta1"),
        "eta2_per_m": fit.eta2,
        "eta2_stderr_per_m": error("eta2"),
        "correlation": finite_or_none(fit.correlation),
        "unbounded": unbounded,
        "warnings": list(fit.warnings),
    }


@final
@dataclass(frozen=True, kw_only=True)
class Decays(Step):
    """Free decays, one per mode, and their fits."""

    kind, about, heading = "decays", "free decays: {}", "Free decays"

    law: Literal[Law, "auto"] = "linear"
    rest: Annotated[Rest | None, Meta(description="default: constant; with the law auto the best")] = None
    records: Annotated[
        tuple[Any, ...] | None,
        Meta(
            description="default: the tables [[decays]]; or {synthetic = {frequency (Hz), amplitude (m), "
            "damping_ratio; or eta1 (1/s), eta2 (1/m)}}"
        ),
    ] = None
    sample_rate: Annotated[Positive, Meta(description="1/s, of synthetic decays")] = SYNTHETIC_RATE
    duration: Annotated[Positive, Meta(description="s")] = SYNTHETIC_DURATION
    std: Annotated[float, Meta(ge=0.0, description="m")] = SYNTHETIC_STD
    seed: Annotated[int, Meta(ge=0)] | None = None
    printed: Annotated[Printed, Meta(description="{frequency (Hz), damping_ratio (%), eta1, eta2}")] = field(
        default_factory=dict
    )
    sources: Annotated[tuple[Any, ...], UNLISTED] = ()  # synthetic decays, and measured ones that are not read yet
    places: Annotated[str, UNLISTED] = ""  # where the file lists them, for messages

    def checked(self, study: Study, where: str) -> Self:
        """Return the step with its synthetic decays, and the tables of its measured ones."""
        tables = study.file.several("decays") if self.records is None else self.records
        if not tables:
            raise InputError("is missing; name the records, or add tables [[decays]]", f"{where}: records")
        places = study.file.where("decays") if self.records is None else f"{where}: records"
        sources: list[Decay | DecayRecord] = []
        for k, table in enumerate(tables, start=1):
            place = f"{places}: {k}"
            if isinstance(table, dict) and "synthetic" in table:
                check_keys(table, {"synthetic"}, set(), place)
                parameters = convert(table["synthetic"], SyntheticDecay, f"{place}: synthetic")
                seed = study.seed if self.seed is None else self.seed
                with error_prefix(place):
                    sources.append(synthetic_decay(parameters, k, seed, self.sample_rate, self.duration, self.std))
            else:
                sources.append(convert(table, DecayRecord, place))
        printed = printed_numbers(self.printed, dict.fromkeys(PRINTED, len(sources)), where)
        files = study.file.only(set())
        return replace(self, records=None, sources=tuple(sources), places=places, printed=printed, file=files)

    @property
    def decays(self) -> tuple[Decay, ...]:
        """The decays, of which the measured ones are read from their files."""
        return tuple(
            source.decay(self.file, f"{self.places}: {k}") if isinstance(source, DecayRecord) else source
            for k, source in enumerate(self.sources, start=1)
        )

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the table of modal parameters, and a figure per record."""
        decays = self.decays
        fits = fit_all(compute, decays, self.law, self.rest)
        return decays_finding(compute, decays, fits, self.printed, with_law=self.law == "auto")


def synthetic_decay(
    parameters: SyntheticDecay,
    mode: int,
    seed: int,
    sample_rate: float = SYNTHETIC_RATE,
    duration: float = SYNTHETIC_DURATION,
    std: float = SYNTHETIC_STD,
) -> Decay:
    """Return a decay by Eq. (9) or (27) with white noise, released at rest at time 0."""
    if sample_rate * duration > MOST_DECAY_SAMPLES:
        raise InputError(
            f"gives {sample_rate * duration:.3g} samples, {MOST_DECAY_SAMPLES:g} at most; lower the rate", "duration"
        )
    time = np.arange(0.0, duration, 1 / sample_rate)
    ω, amplitude = cs.DM(2 * math.pi * parameters.frequency), cs.DM(parameters.amplitude)
    if parameters.eta1 is not None and parameters.eta2 is not None:
        η1, η2 = cs.DM(parameters.eta1), cs.DM(parameters.eta2)
        exact = quadratic_decay(cs.DM(time), ω, η1, η2, amplitude, cs.DM(0.0))
    elif parameters.damping_ratio is not None:
        exact = linear_decay(cs.DM(time), ω, cs.DM(parameters.damping_ratio), amplitude, cs.DM(0.0))
    noise = std * np.random.default_rng((seed, mode)).standard_normal(len(time))
    law = "Eq. (27)" if parameters.damping_ratio is None else "Eq. (9)"
    about = (
        f"Synthetic decays by {law}, because no raw record was published: {sample_rate:g} samples/s, {duration:g} s, "
        f"white noise of {1e3 * std:g} mm, seed {seed}."
    )
    return Decay(Measurement(time, exact.full().ravel() + noise, f"mode {mode}, synthetic"), about, 0.0)


def synthetic_decays(parameters: Iterable[SyntheticDecay], seed: int) -> list[Decay]:
    """Return synthetic decays of modes 1, 2, ... with the usual samples and noise."""
    return [synthetic_decay(of_mode, mode, seed) for mode, of_mode in enumerate(parameters, start=1)]


def fit_all(compute: Compute, decays: Sequence[Decay], law: str, rest: Rest | None) -> list[FittedDecay]:
    """Fit decays by a law."""
    return compute.all(fit_plain, [(decay, law, rest) for decay in decays], 0.2)


def decays_finding(
    compute: Compute,
    decays: Sequence[Decay],
    fits: Sequence[FittedDecay],
    printed: Printed | None = None,
    *,
    with_law: bool = False,
) -> Finding:
    """Return the table of modal parameters of fitted decays, one per mode, and a figure per record."""
    data = [
        {"mode": mode, "record": decay.record.name, "synthetic": bool(decay.synthetic), **fit.numbers}
        for mode, (decay, fit) in enumerate(zip(decays, fits, strict=True), start=1)
    ]
    warnings = tuple(f"{row['record']}: {warning}" for row in data for warning in row["warnings"])
    table = _parameter_table(decays, fits, printed or {}, with_law=with_law)
    drawings = [
        (_caption(mode, decay, fit), _decay_figure, decay, fit, _figure_title(mode, decay, fit))
        for mode, (decay, fit) in enumerate(zip(decays, fits, strict=True), start=1)
    ]
    return Finding(data, (table,), compute.drawings(*drawings), warnings)


def _parameter_table(
    decays: Sequence[Decay], fits: Sequence[FittedDecay], printed: Printed, *, with_law: bool
) -> Table:
    rows = [{**fit.numbers, "amplitude_error": fit.amplitude_error} for fit in fits]
    laws = [row["law"] for row in rows]
    columns: dict[str, Sequence[Cell]] = {"record": [decay.record.name for decay in decays]}
    errors: dict[str, Sequence[float | None]] = {}
    printed_by_head = {}

    def add(head: str, name: str, key: str, error: str, scale: float = 1.0) -> None:
        columns[head] = [scale * row[key] for row in rows]
        errors[head] = [None if row[error] is None else scale * row[error] for row in rows]
        printed_by_head[head] = printed.get(name)

    if all(decay.synthetic for decay in decays):
        columns = {"mode": range(1, len(rows) + 1)}
    if with_law or len({*laws}) > 1:
        columns["law"] = laws
    add("frequency, Hz", "frequency", "frequency_hz", "frequency_stderr_hz")
    damped_by_rate = any(law != "linear" for law in laws)
    if damped_by_rate:
        add("η1, 1/s", "eta1", "eta1", "eta1_stderr")
        add("η2, 1/m", "eta2", "eta2_per_m", "eta2_stderr_per_m")
        columns["correlation"] = [row["correlation"] for row in rows]
        add("amplitude, mm", "amplitude", "amplitude_m", "amplitude_error", 1e3)
    ratio = "equivalent damping ratio, %" if damped_by_rate else "damping ratio, %"
    add(ratio, "damping_ratio", "damping_ratio", "damping_ratio_stderr", 100.0)
    sources = dict.fromkeys(decay.synthetic for decay in decays if decay.synthetic)
    title = "Modal parameters from free decays" + "; synthetic data" * bool(sources)
    cells = zip(*columns.values(), strict=True)
    return beside_printed(title, [*columns], cells, *sources, errors=errors, printed=printed_by_head)


def _caption(mode: int, decay: Decay, fit: FittedDecay) -> str:
    name = f"Mode {mode}: free decay (synthetic record)" if decay.synthetic else f"Free decay {decay.record.name}"
    return (
        f"{name} and its fit by the {fit.numbers['law']} law.  Top: extremes over the whole record.  "
        "Middle: first periods.  Bottom: record less fit."
    )


def _figure_title(mode: int, decay: Decay, fit: FittedDecay) -> str:
    numbers, name = fit.numbers, f"mode {mode}" if decay.synthetic else decay.record.name
    if numbers["unbounded"]:
        damping = f"η1 = {numbers['eta1']:.3g} 1/s,  η2 = {numbers['eta2_per_m']:.3g} 1/m"
    else:
        damping = f"ζ = {100 * numbers['damping_ratio']:.3g} %"
    return f"{name}:  f = {numbers['frequency_hz']:.5g} Hz,  {damping}"


def _decay_figure(decay: Decay, fit: FittedDecay, title: str) -> Figure:
    """Draw a decay with its fit, its first periods, and the residuals."""
    figure, (whole_record, first, remainder) = new_figure(4.6, 3)
    (time, measured, fitted), (fine_time, fine) = fit.motion, fit.first_periods
    size, unit = si_prefix(float(np.abs(measured).max()), decay.record.sensor.unit)
    label = "synthetic record" if decay.synthetic else "record"
    frequency = fit.numbers["frequency_hz"]
    draw_band(whole_record, band(time, measured, frequency), 1 / size, filled=True, color="black", label=label)
    draw_band(whole_record, band(time, fitted, frequency), 1 / size, **line(1), lw=1, label="fit")
    shown = time <= fine_time[-1]
    first.plot(time[shown], measured[shown] / size, "k.", ms=3, label=label)
    first.plot(fine_time, fine / size, **line(1), lw=1, label="fit")
    residuals = measured - fitted
    residual_size, residual_unit = si_prefix(float(np.abs(residuals).max()), decay.record.sensor.unit)
    windows = np.unique(np.linspace(0, len(residuals) - 1, min(300, len(residuals))).astype(int))  # as drawn
    low, high = (extreme.reduceat(residuals, windows) / residual_size for extreme in (np.minimum, np.maximum))
    remainder.vlines(time[windows], low, high, color="black", lw=0.7)
    remainder.set(xlabel="time, s", ylabel=f"residual, {residual_unit}" if residual_unit else "residual")
    for axes in (whole_record, first):
        axes.set_ylabel(f"{decay.record.sensor.quantity}, {unit}" if unit else decay.record.sensor.quantity)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    figure.align_ylabels()
    figure.suptitle(f"{title}{';  SYNTHETIC DATA' if decay.synthetic else ''}", fontsize=9, ha="left", x=0.02)
    return figure
