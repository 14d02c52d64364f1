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
from ancf_casadi.support.inputs import error_prefix
from ancf_casadi.support.specs import convert
from ancf_casadi.support.tables import Cell
from problems.decay.fitting import fit_decay
from problems.decay.laws import DECAY_TERMS, Law
from problems.decay.result import DecayFit
from problems.spec.file import StudyFile
from problems.spec.record_files import ColumnSpec
from problems.study.compute import Compute
from problems.study.drawing import mark_synthetic
from problems.study.step import Finding, Findings, Printed, Step, Study, join_findings, printed_numbers, study_table

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


def fit_plain(decay: Decay, law: str, rest: Rest | None, formats: tuple[str, ...] = ()) -> Finding:
    """Fit a decay; the numbers of the fit have those of the quadratic law without its bounds beside them."""
    release = None if math.isnan(decay.release_time) else decay.release_time
    record = decay.record
    with error_prefix(record.name):
        fit: DecayFit = fit_decay(record, law=law, rest=rest, release_time=release)  # type: ignore[call-overload]
    unbounded = None
    if fit.law == "quadratic":
        eta1, eta2, covariance = unbounded_coefficients(fit)
        unbounded = {"eta1": eta1, "eta2_per_m": eta2, "covariance": covariance.tolist()}
    data = {
        "record": record.name,
        "synthetic": bool(decay.synthetic),
        **fit.to_dict(),
        "equivalent_damping_ratio": fit.damping_ratio,
        "unbounded": unbounded,
    }
    caption = (
        f"{record.name}: free decay and its fit.  Below: record less fit, its autocorrelation, and damping ratio and "
        "frequency against amplitude."
    )
    warnings = tuple(f"{record.name}: {warning}" for warning in fit.warnings)
    draw = (lambda: mark_synthetic(fit.figure())) if decay.synthetic else fit.figure
    return Finding.of(fit, caption, formats, draw, data=data, warnings=warnings)


def unbounded_coefficients(fit: DecayFit) -> tuple[float, float, Array]:
    """Return eta1 (1/s) and eta2 (1/m) of a quadratic decay without the bounds of its fit, and their covariance (2, 2).

    A fit whose eta2 is at its bound 0 would understate the errors; one Gauss-Newton step without bounds gives the pair.
    """
    all_free = replace(fit.fit, active_bounds=np.zeros(len(fit.fit.names), dtype=bool))
    values, covariance = subset_estimates(all_free, np.ones(len(fit.fit.residuals), dtype=bool))
    pair = list(fit.indices[1:3])  # after the frequency
    return float(values[pair[0]]), float(values[pair[1]]), covariance[np.ix_(pair, pair)]


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
        printed = printed_numbers(self.printed, dict.fromkeys(PRINTED, len(decay_records(study.file))), where)
        return replace(super().prepare(study, where), printed=printed)

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the table of modal parameters, and a figure per record."""
        decays = [record.decay(self.file, place) for place, record in decay_records(self.file).items()]
        fits = fit_all(compute, decays, self.law, self.rest, compute.formats)
        return decays_finding(decays, fits, self.printed, with_law=self.law == "auto")


def decay_records(file: StudyFile) -> dict[str, DecayRecord]:
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


def fit_all(
    compute: Compute, decays: Sequence[Decay], law: str, rest: Rest | None, formats: tuple[str, ...] = ()
) -> list[Finding]:
    """Fit decays by a law."""
    return compute.all(fit_plain, [(decay, law, rest, formats) for decay in decays])


def decays_finding(
    decays: Sequence[Decay], fits: Sequence[Finding], printed: Printed | None = None, *, with_law: bool = False
) -> Finding:
    """Return the table of modal parameters of fitted decays, one per mode, and their figures."""
    data = [{"mode": mode, **fit.data} for mode, fit in enumerate(fits, start=1)]
    estimates = [{estimate["name"]: estimate for estimate in fit["estimates"]} for fit in data]
    key, laws = "mode" if all(fit["synthetic"] for fit in data) else "record", [fit["law"] for fit in data]
    columns: dict[str, Sequence[Cell]] = {key: [fit[key] for fit in data]}
    errors, printed_by_head, missing = {}, {}, {"value": math.nan, "standard_error": None, "unit": ""}
    if with_law or len({*laws}) > 1:
        columns["law"] = laws
    terms = dict.fromkeys(term for law in laws for term in DECAY_TERMS[law])
    for name in ("frequency", *terms, "damping_ratio", "amplitude"):
        rows = [by_name.get(name, missing) for by_name in estimates]
        for unit in dict.fromkeys(row["unit"] for row in rows if row is not missing):  # records of several sensors
            scale, shown_unit = (100.0, "%") if name == "damping_ratio" else (1.0, unit)
            head = f"{name.replace('_', ' ')}, {shown_unit}".removesuffix(", ")
            in_unit: list[dict[str, Any]] = [row if row["unit"] == unit else missing for row in rows]
            columns[head] = [scale * row["value"] for row in in_unit]
            errors[head] = [scale * (row["standard_error"] or math.nan) for row in in_unit]
            printed_by_head[head] = (printed or {}).get(name)
    if "eta2" in terms:
        columns["correlation"] = [fit["correlation"] for fit in data]
    sources = dict.fromkeys(decay.synthetic for decay in decays if decay.synthetic)
    title = "Modal parameters from free decays" + "; synthetic data" * bool(sources)
    table = study_table(title, [*columns], zip(*columns.values(), strict=True), *sources, errors=errors)
    return join_findings(data, fits, tables=(table,), text="").beside_print(printed_by_head)
