"""A part with modal parameters identified from free decays, Eq. (10): Tables 2 and 4, Figures 5 to 9 of the paper.

The decays are measured files, or synthetic ones: Eq. (9) or (27) with given parameters and seeded white noise.  Every
figure and table made from synthetic decays says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypedDict, final

import casadi as cs
import numpy as np

from ancf_casadi.decay.closed_forms import linear_decay, quadratic_decay
from ancf_casadi.estimation.result import known
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import prefixed
from ancf_casadi.support.inputs import check_keys, choice, flag, located, number, physical, positive, shown, whole
from problems.decay.fitting import fit_decay
from problems.decay.laws import LAWS
from problems.decay.result import DecayFit
from problems.schema.motion import READING, read_measured
from problems.study.data_table import Column, DataTable, printed_values
from problems.study.drag.combined_law import ModeCoefficients
from problems.study.drawing import Drawing, band, draw_band, drawn, line, new_figure
from problems.study.kind import Kind
from problems.study.part import Effort, Finding, Heading, Outcome, Part, Task
from problems.study.source import Source, printed_numbers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KEYS = """\
  kind = "decays"       free decays: law ("auto", "linear", "quadratic", ...;
                        default: the best for each measured record), offset (true or false), records = [{file,
                        column, unit, time, time_unit, rate, from, to,
                        release_time}, ...] (default: the tables [[decays]]), or
                        records = [{synthetic = {frequency (Hz), amplitude (m),
                        damping_ratio; or eta1 (1/s), eta2 (1/m)}}, ...] with rate
                        (1/s), duration (s), noise (m) and seed;
                        printed = {frequency (Hz), damping_ratio (%), eta1, eta2}
"""
RECORD = {"file", "column", "unit", "from", "to", "release_time", *READING}
PRINTED = ("frequency", "damping_ratio", "eta1", "eta2")
FRAME_RATE, DURATION, NOISE = 500.0, 5.0, 0.2e-3  # 1/s, s, m: of synthetic decays
ZOOMED, SHORT_ZOOM = 12, 3  # periods drawn in detail, and of a record with many samples per period
MOST_SAMPLES = 10_000_000  # of a synthetic decay
MOST_ZOOMED = 300  # samples drawn in detail
WINDOWS = 300  # of the drawn residuals


@dataclass(frozen=True)
class Decay:
    """A decay to fit.

    Parameters
    ----------
    time, values : ndarray
        Times, s, and values in the SI unit of the sensor.
    sensor : Sensor
        The sensor.
    label : str
        Name of the record.
    synthetic : str
        Description of a synthetic record; empty for a measured one.
    release_time : float
        Start of the decay, s; nan if it is to be detected.
    """

    time: Array
    values: Array
    sensor: Sensor
    label: str
    synthetic: str
    release_time: float


class Unbounded(TypedDict):
    """Coefficients under the quadratic law as if they had no bounds (1/s, 1/m), and their covariance (2, 2)."""

    eta1: float
    eta2_per_m: float
    covariance: list[list[float]]


@dataclass(frozen=True)
class FittedDecay:
    """The fit of a decay as plain data.

    Parameters
    ----------
    quantities, errors : dict of str to float
        Estimates and standard errors by name, as in ``DecayFit``.
    law : str
        The law.
    warnings : tuple of str
        Limitations.
    time, measured, fitted : ndarray
        Times from the release on, s, record and fit.
    fine_time, fine : ndarray
        Fine times over the first periods, s, and the fit there.
    unbounded : dict, optional
        Coefficients under the quadratic law as if they had no bounds; None under other laws.
    """

    quantities: dict[str, float]
    errors: dict[str, float]
    law: str
    warnings: tuple[str, ...]
    time: Array
    measured: Array
    fitted: Array
    fine_time: Array
    fine: Array
    unbounded: Unbounded | None


def fit_plain(decay: Decay, law: str, offset: bool) -> FittedDecay:
    """Fit a decay, and return the fit as plain data.

    Raises
    ------
    InputError, FitError
        As ``fit_decay``.
    """
    release = None if math.isnan(decay.release_time) else decay.release_time
    record = Measurement(decay.time, decay.values, decay.label, decay.sensor)
    with located(decay.label):
        fit: DecayFit = fit_decay(record, law=law, offset=offset, release_time=release)  # type: ignore[arg-type]
    names = ("frequency", "damping_ratio", "eta1", "eta2", "amplitude", "correlation")
    per_period = len(fit.time) / max(1.0, fit.frequency * float(fit.time[-1] - fit.time[0]))
    periods = min(ZOOMED, max(SHORT_ZOOM, MOST_ZOOMED / per_period), len(fit.time) / per_period)
    fine_time = fit.release_time + np.linspace(0.0, periods / fit.frequency, int(40 * periods))
    return FittedDecay(
        quantities={name: float(getattr(fit, name)) for name in names},
        errors={name: float(fit.standard_errors.get(name, math.nan)) for name in names},
        law=fit.law,
        warnings=fit.warnings,
        time=fit.time,
        measured=np.interp(fit.time, decay.time, decay.values),
        fitted=np.asarray(fit.displacement(fit.time)),
        fine_time=fine_time,
        fine=np.asarray(fit.displacement(fine_time)),
        unbounded=_unbounded(fit) if fit.law in ("quadratic", "one-mode") else None,
    )


def _unbounded(fit: DecayFit) -> Unbounded:
    found = ModeCoefficients.from_fit(fit)
    return {"eta1": found.eta1, "eta2_per_m": found.eta2, "covariance": found.covariance.tolist()}


class DecayNumbers(TypedDict):
    """Estimates from a free decay."""

    mode: int
    record: str
    synthetic: bool
    law: str
    frequency_hz: float
    frequency_stderr_hz: float | None
    damping_ratio: float
    damping_ratio_stderr: float | None
    equivalent_damping_ratio: float
    amplitude_m: float
    eta1: float
    eta1_stderr: float | None
    eta2_per_m: float
    eta2_stderr_per_m: float | None
    correlation: float | None
    unbounded: Unbounded | None
    warnings: list[str]


@final
@dataclass(frozen=True)
class Decays(Part):
    """Free decays, one per mode, and their fits.

    Parameters
    ----------
    decays : tuple of Decay
        The decays in the order of the modes.
    law : str
        Damping law of the fits.
    offset : bool
        Whether the equilibrium may differ from 0.
    printed : dict
        Printed numbers by column.
    """

    kind = "decays"
    numbers = list[DecayNumbers]

    decays: tuple[Decay, ...]
    law: str
    offset: bool
    printed: dict[str, tuple[float | None, ...]]

    def tasks(self, found: Mapping[str, Outcome], effort: Effort) -> tuple[Task, ...]:
        """Return the fits."""
        return tuple(Task(fit_plain, (decay, self.law, self.offset), 0.2) for decay in self.decays)

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return the table of modal parameters, and a figure per record."""
        fits: Sequence[FittedDecay] = results
        figures = tuple(
            self._drawing(mode, decay, fit)
            for mode, (decay, fit) in enumerate(zip(self.decays, fits, strict=True), start=1)
            if self.heading.draw
        )
        warnings = tuple(
            f"{decay.label}: {warning}"
            for decay, fit in zip(self.decays, fits, strict=True)
            for warning in fit.warnings
        )
        data = [self._data(mode, decay, fit) for mode, (decay, fit) in
                enumerate(zip(self.decays, fits, strict=True), start=1)]  # fmt: skip
        return Finding(Outcome(data), (self._table(fits),), figures, warnings)

    def _table(self, fits: Sequence[FittedDecay]) -> DataTable:
        def column(head: str, name: str, unit: str, scale: float = 1.0) -> Column:
            values = tuple(scale * fit.quantities[name] for fit in fits)
            errors = tuple(scale * fit.errors[name] for fit in fits)
            return Column(head, values, unit, errors, printed_values(self.printed, name))

        columns = [Column("record", tuple(decay.label for decay in self.decays))]
        if all(decay.synthetic for decay in self.decays):
            columns = [Column("mode", tuple(range(1, len(fits) + 1)))]
        if len({fit.law for fit in fits}) > 1 or self.law == "auto":
            columns.append(Column("law", tuple(fit.law for fit in fits)))
        columns.append(column("frequency", "frequency", "Hz"))
        damped_by_rate = any(fit.law != "linear" for fit in fits)
        if damped_by_rate:
            columns += [column("η1", "eta1", "1/s"), column("η2", "eta2", "1/m")]
            columns.append(Column("correlation", tuple(fit.quantities["correlation"] for fit in fits)))
            columns.append(column("amplitude", "amplitude", "mm", 1e3))
        ratio = "equivalent damping ratio" if damped_by_rate else "damping ratio"
        columns.append(column(ratio, "damping_ratio", "%", 100.0))
        sources = dict.fromkeys(decay.synthetic for decay in self.decays if decay.synthetic)
        title = "Modal parameters from free decays"
        if sources:
            title += "; synthetic data"
        notes = (*sources, *self.heading.notes)
        return DataTable(self.heading.name, title, tuple(columns), notes, self.heading.source)

    def _data(self, mode: int, decay: Decay, fit: FittedDecay) -> dict[str, Any]:
        values, errors = fit.quantities, fit.errors
        return {
            "mode": mode,
            "record": decay.label,
            "synthetic": bool(decay.synthetic),
            "law": fit.law,
            "frequency_hz": values["frequency"],
            "frequency_stderr_hz": known(errors["frequency"]),
            "damping_ratio": values["damping_ratio"],
            "damping_ratio_stderr": known(errors["damping_ratio"]),
            "equivalent_damping_ratio": values["damping_ratio"],
            "amplitude_m": values["amplitude"],
            "eta1": values["eta1"],
            "eta1_stderr": known(errors["eta1"]),
            "eta2_per_m": values["eta2"],
            "eta2_stderr_per_m": known(errors["eta2"]),
            "correlation": known(values["correlation"]),
            "unbounded": fit.unbounded,
            "warnings": list(fit.warnings),
        }

    def _drawing(self, mode: int, decay: Decay, fit: FittedDecay) -> Drawing:
        name = f"{self.heading.name}_{mode}"
        values = fit.quantities
        title = f"f = {values['frequency']:.5g} Hz,  ζ = {100 * values['damping_ratio']:.3g} %"
        if fit.law in ("quadratic", "one-mode"):
            title = f"f = {values['frequency']:.5g} Hz,  η1 = {values['eta1']:.3g} 1/s,  η2 = {values['eta2']:.3g} 1/m"
        which = f"Mode {mode}: free decay (synthetic record)" if decay.synthetic else f"Free decay {decay.label}"
        caption = (
            f"{which} and its fit by the {fit.law} law.  Top: extremes over the whole record.  Middle: first periods.  "
            "Bottom: record less fit."
        )
        head = f"mode {mode}" if decay.synthetic else decay.label
        return drawn(name, caption, lambda: _decay_figure(decay, fit, f"{head}:  {title}"))


def _decay_figure(decay: Decay, fit: FittedDecay, title: str) -> Figure:
    """Draw a decay with its fit, its first periods, and the residuals."""
    figure, (whole_record, first, remainder) = new_figure(4.6, 3)
    size, unit = prefixed(float(np.abs(fit.measured).max()), decay.sensor.unit)
    label = "synthetic record" if decay.synthetic else "record"
    frequency = fit.quantities["frequency"]
    draw_band(whole_record, band(fit.time, fit.measured, frequency), 1 / size, filled=True, color="black", label=label)
    draw_band(whole_record, band(fit.time, fit.fitted, frequency), 1 / size, **line(1), lw=1, label="fit")
    shown = fit.time <= fit.fine_time[-1]
    first.plot(fit.time[shown], fit.measured[shown] / size, "k.", ms=3, label=label)
    first.plot(fit.fine_time, fit.fine / size, **line(1), lw=1, label="fit")
    rest = fit.measured - fit.fitted
    rest_size, rest_unit = prefixed(float(np.abs(rest).max()), decay.sensor.unit)
    windows = np.unique(np.linspace(0, len(rest) - 1, min(WINDOWS, len(rest))).astype(int))
    low, high = (extreme.reduceat(rest, windows) / rest_size for extreme in (np.minimum, np.maximum))
    remainder.vlines(fit.time[windows], low, high, color="black", lw=0.7)
    remainder.set(xlabel="time, s", ylabel=f"residual, {rest_unit}" if rest_unit else "residual")
    for axes in (whole_record, first):
        axes.set_ylabel(f"{decay.sensor.quantity}, {unit}" if unit else decay.sensor.quantity)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    figure.align_ylabels()
    figure.suptitle(f"{title}{';  SYNTHETIC DATA' if decay.synthetic else ''}", fontsize=9, ha="left", x=0.02)
    return figure


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> Decays:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a key or value cannot be used, or a file cannot be read.
    """
    options = {"law", "offset", "records", "rate", "duration", "noise", "seed", "printed"}
    check_keys(given, set(), options, where)
    tables = given["records"] if "records" in given else source.file.several("decays")
    if not isinstance(tables, list) or not tables:
        raise InputError("is missing; name the records, or add tables [[decays]]", f"{where}: records")
    decays = []
    for k, table in enumerate(tables, start=1):
        place = f"{where}: records: {k}"
        if isinstance(table, dict) and "synthetic" in table:
            check_keys(table, {"synthetic"}, set(), place)
            with located(place):
                decays.append(_synthetic(table["synthetic"], given, source.seed, k))
        else:
            decays.append(_measured(source, table, place))
    with located(where):
        return Decays(
            heading,
            tuple(decays),
            choice(given.get("law", "linear"), ("auto", *LAWS), "law"),
            flag(given.get("offset", True), "offset"),
            printed_numbers(given, dict.fromkeys(PRINTED, len(decays))),
        )


def _measured(source: Source, table: Any, where: str) -> Decay:
    """Return the decay in a file."""
    check_keys(table, {"file"}, RECORD - {"file"}, where)
    recording = read_measured(source.file, table, where)
    with located(where):
        record = Measurement.from_recording(recording, table.get("column"), unit=table.get("unit"))
        record = record.cut(table.get("from"), table.get("to"))
        release = number(table["release_time"], "release_time") if "release_time" in table else math.nan
    return Decay(record.time, record.values, record.sensor, record.name, "", release)


def _synthetic(table: Any, given: Mapping[str, Any], study_seed: int, mode: int) -> Decay:
    """Return a decay by Eq. (9) or (27) with white noise, released at rest at time 0."""
    if not isinstance(table, dict):
        raise InputError(f"must be a table, got {shown(table)}", "synthetic")
    by_rate = "eta1" in table
    check_keys(table, {"frequency", "amplitude", *(("eta1", "eta2") if by_rate else ("damping_ratio",))}, set(),
               "synthetic")  # fmt: skip
    rate, duration = (
        physical(given.get("rate", FRAME_RATE), "rate"), physical(given.get("duration", DURATION), "duration")
    )  # fmt: skip
    noise, seed = number(given.get("noise", NOISE), "noise"), whole(given.get("seed", study_seed), "seed", 0)
    ω, amplitude = 2 * math.pi * physical(table["frequency"], "frequency"), physical(table["amplitude"], "amplitude")
    if noise < 0.0:
        raise InputError(f"must not be negative, got {noise:g}", "noise")
    if rate * duration > MOST_SAMPLES:
        raise InputError(f"gives {rate * duration:.3g} samples, {MOST_SAMPLES:g} at most; lower the rate", "duration")
    time = np.arange(0.0, duration, 1 / rate)
    if by_rate:
        η = (positive(table["eta1"], "eta1"), positive(table["eta2"], "eta2"))
        exact = quadratic_decay(cs.DM(time), cs.DM(ω), cs.DM(η[0]), cs.DM(η[1]), cs.DM(amplitude), cs.DM(0.0))
    else:
        ζ = number(table["damping_ratio"], "damping_ratio")
        if not 0.0 <= ζ < 1.0:
            raise InputError(f"must be at least 0 and below 1, got {ζ:g}", "damping_ratio")
        exact = linear_decay(cs.DM(time), cs.DM(ω), cs.DM(ζ), cs.DM(amplitude), cs.DM(0.0))
    values = exact.full().ravel() + noise * np.random.default_rng((seed, mode)).standard_normal(len(time))
    law = "Eq. (27)" if by_rate else "Eq. (9)"
    about = (
        f"Synthetic decays by {law}, because no raw record was published: {rate:g} samples/s, {duration:g} s, white "
        f"noise of {1e3 * noise:g} mm, seed {seed}."
    )
    return Decay(time, values, Sensor(), f"mode {mode}, synthetic", about, 0.0)


KIND = Kind(Decays.kind, "Free decays", KEYS, read)
