"""A step with modal parameters identified from free decays, Eq. (10): Tables 2 and 4, Figures 5 to 9 of the paper.

The decays of users are measured files; those of the paper are synthetic: Eq. (9) or (27) with given parameters and
seeded white noise.  Every figure and table made from synthetic decays says so.
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
from ancf_casadi.decay.rest_position import Rest
from ancf_casadi.estimation.agreement import subset_estimates
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure, si_prefix
from ancf_casadi.support.inputs import error_prefix
from ancf_casadi.support.specs import convert
from ancf_casadi.support.tables import Cell, Table, finite_or_none
from problems.decay.fitting import fit_decay
from problems.decay.laws import Law
from problems.decay.result import DecayFit
from problems.spec.file import StudyFile
from problems.spec.record_files import ColumnSpec
from problems.study.compute import Compute
from problems.study.drawing import band, draw_band, line, new_figure
from problems.study.step import Finding, Findings, Printed, Step, Study, printed_numbers, table_beside_print

PRINTED = ("frequency", "damping_ratio", "eta1", "eta2")
SYNTHETIC_RATE, SYNTHETIC_DURATION, SYNTHETIC_STD = 500.0, 5.0, 0.2e-3  # 1/s, s, m, of synthetic decays


class DecayRecord(ColumnSpec, frozen=True, kw_only=True):
    """A measured free decay."""

    release_time: Annotated[float, Meta(description="s")] = math.nan

    def decay(self, file: StudyFile, where: str) -> Decay:
        """Read the decay from the file of measurements beside that of the study."""
        return Decay(self.measurement(file, where), "", self.release_time)


@dataclass(frozen=True)
class SyntheticDecay:
    """Parameters of a free decay by Eq. (9), with a damping ratio, or by Eq. (27), with eta1 and eta2."""

    frequency: float
    amplitude: float
    damping_ratio: float = 0.0
    eta1: float | None = None
    eta2: float = 0.0


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
    values, covariance = subset_estimates(all_free, np.ones(len(fit.fit.residuals), dtype=bool))
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

    kind, heading = "decays", "Free decays"
    reading = frozenset({"decays"})

    law: Literal[Law, "auto"] = "linear"
    rest: Annotated[Rest | None, Meta(description="default: constant; with the law auto the best")] = None
    printed: Annotated[Printed, Meta(description="{frequency (Hz), damping_ratio (%), eta1, eta2}")] = field(
        default_factory=dict
    )

    def prepare(self, study: Study, where: str) -> Self:
        """Return the step with the tables of its decays, and its printed numbers."""
        study.file.require("decays", "each names the file of a free decay")
        printed = printed_numbers(self.printed, dict.fromkeys(PRINTED, len(_records(study.file))), where)
        return replace(super().prepare(study, where), printed=printed)

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the table of modal parameters, and a figure per record."""
        decays = [record.decay(self.file, place) for place, record in _records(self.file).items()]
        fits = fit_all(compute, decays, self.law, self.rest)
        return decays_finding(compute, decays, fits, self.printed, with_law=self.law == "auto")


def _records(file: StudyFile) -> dict[str, DecayRecord]:
    """Return the tables [[decays]] by their places."""
    places = {f"{file.where('decays')}: {k}": table for k, table in enumerate(file.several("decays"), start=1)}
    return {place: convert(table, DecayRecord, place) for place, table in places.items()}


def synthetic_decay(parameters: SyntheticDecay, mode: int, seed: int) -> Decay:
    """Return a decay by Eq. (9) or (27) with white noise, released at rest at time 0."""
    time = np.arange(0.0, SYNTHETIC_DURATION, 1 / SYNTHETIC_RATE)
    ω, amplitude, rest = (cs.DM(value) for value in (2 * math.pi * parameters.frequency, parameters.amplitude, 0.0))
    if parameters.eta1 is None:
        law, exact = "Eq. (9)", linear_decay(cs.DM(time), ω, cs.DM(parameters.damping_ratio), amplitude, rest)
    else:
        η1, η2 = cs.DM(parameters.eta1), cs.DM(parameters.eta2)
        law, exact = "Eq. (27)", quadratic_decay(cs.DM(time), ω, η1, η2, amplitude, rest)
    noise = SYNTHETIC_STD * np.random.default_rng((seed, mode)).standard_normal(len(time))
    about = (
        f"Synthetic decays by {law}, because no raw record was published: {SYNTHETIC_RATE:g} samples/s, "
        f"{SYNTHETIC_DURATION:g} s, white noise of {1e3 * SYNTHETIC_STD:g} mm, seed {seed}."
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
    return table_beside_print(title, [*columns], cells, *sources, errors=errors, printed=printed_by_head)


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
