"""Steps with the beam: its properties, its modes, and a match to measured frequencies: Tables 1, 9, 10 of the paper."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Self, final

import numpy as np
from msgspec import Meta

from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.export.identification import Identification
from ancf_casadi.export.model_document import Document
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.lumped import property_unit
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import BeamSpec
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.inputs import error_prefix, whole
from ancf_casadi.support.specs import UNLISTED, convert
from ancf_casadi.support.tables import Cell, Table, to_json
from ancf_casadi.vibration.modes import STATIONS, Modes, natural_modes
from problems.matching.frequency_matching import match_frequencies
from problems.spec.beam import DampedBeam
from problems.spec.file import NO_FILE, StudyFile
from problems.spec.match import MOST_ELEMENTS, MatchTable
from problems.study.compute import Compute
from problems.study.drawing import FIGURE_WIDTH, new_figure, series
from problems.study.formatting import shown
from problems.study.step import Finding, Findings, Printed, Step, Study, printed_numbers, table_beside_print

BEAM_ROWS = (("length", "mm", 1e3), ("width", "mm", 1e3), ("thickness", "mm", 1e3), ("density", "kg/m³", 1.0),
        ("elastic_modulus", "GPa", 1e-9))  # fmt: skip
ELEMENT_ROWS = BEAM_ROWS[1:]  # of each element, which a match may change


@final
@dataclass(frozen=True, kw_only=True)
class BeamProperties(Step):
    """The properties of the beam."""

    kind, heading = "beam", "The beam"
    naming = ("beam",)

    beam: Annotated[str, Meta(description='"STEP"')] = ""
    printed: Annotated[
        Printed,
        Meta(
            description="{value = [length (mm), width (mm), thickness (mm), density (kg/m^3), elastic modulus (GPa)]}"
        ),
    ] = field(default_factory=dict)

    def prepare(self, study: Study, where: str) -> Self:
        """Return the step with its printed numbers."""
        return replace(self, printed=printed_numbers(self.printed, {"value": len(BEAM_ROWS)}, where))

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the table of properties."""
        return properties_finding(self.beam_in(findings), self.printed, findings[self.beam])


def properties_finding(beam: Beam, printed: Printed, origin: Finding | None = None) -> Finding:
    """Return the table of properties of a beam; its origin, if it was identified, holds the guess and the errors."""
    errors = (origin and origin.errors) or {}
    scaled = tuple(scale * errors.get(name, math.nan) for name, _, scale in BEAM_ROWS)
    guess = origin.guess.beam() if origin and origin.guess else None
    columns: dict[str, Sequence[Cell]] = {
        "property": [name.replace("_", " ") for name, *_ in BEAM_ROWS],
        "unit": [unit for _, unit, _ in BEAM_ROWS],
        **({"guess": _means(guess)} if guess else {}),
        "value": _means(beam),
    }
    varying = [name for name, *_ in ELEMENT_ROWS if np.ptp(getattr(beam, name)) > 0.0]
    notes = [f"{beam.elements} elements; axis {beam.axis}, gravity {beam.gravity} m/s²."]
    if varying:
        notes.append(f"Means over the elements: {', '.join(varying).replace('_', ' ')} vary along the beam.")
    for name, value in beam.lumped.items():
        scale, unit = (1e3, "g") if property_unit(name) == "kg" else (1.0, property_unit(name))
        error = scale * errors.get(name, math.nan)
        first = f"; guess {scale * guess.lumped.get(name, 0.0):.4g} {unit}" if guess and name in errors else ""
        notes.append(f"{name.replace('_', ' ').capitalize()}: {shown(scale * value, error)} {unit}{first}.")
    if beam.supports != (Clamp(),):
        notes.append(f"Supports: {', '.join(map(repr, beam.supports)) or 'none'}.")
    title = "Properties of the identified beam" if guess else "Properties of the beam"
    table = table_beside_print(
        title, [*columns], zip(*columns.values(), strict=True), *notes, errors={"value": scaled} if errors else None,
        printed={"value": printed.get("value")},
    )  # fmt: skip
    data = {
        **{row: list(np.atleast_1d(getattr(beam, row)).astype(float)) for row, *_ in ELEMENT_ROWS},
        "length": beam.length,
        "elements": beam.elements,
        "axis": list(beam.axis),
        "gravity": list(beam.gravity),
    }
    return Finding(data, (table,), beam=BeamSpec.of(beam))


@final
@dataclass(frozen=True, kw_only=True)
class ModesOfBeam(Step):
    """Natural frequencies and shapes of the lowest modes of the beam."""

    kind, heading = "modes", "Natural modes"
    naming = ("beam",)

    modes: Annotated[int, Meta(ge=1)] = 5
    beam: Annotated[str, Meta(description='"STEP"')] = ""
    printed: Annotated[Printed, Meta(description="{frequency (Hz)}")] = field(default_factory=dict)

    def prepare(self, study: Study, where: str) -> Self:
        """Return the step with its printed numbers."""
        whole(self.modes, f"{where}: modes", 1, study.model.freedoms)
        return replace(self, printed=printed_numbers(self.printed, {"frequency": self.modes}, where))

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the table of frequencies, and the shapes."""
        beam = self.beam_in(findings)
        modes = natural_modes(Model(beam), count=self.modes)
        frequencies = modes.frequencies.tolist()
        errors = findings[self.beam].frequency_errors
        head = "frequency, Hz"
        table = table_beside_print(
            "Natural frequencies" + " of the identified beam" * bool(errors),
            ("mode", head),
            enumerate(frequencies, start=1),
            errors={head: (*errors, *[None] * modes.count)[: modes.count]} if errors else None,
            printed={head: self.printed.get("frequency")},
        )
        figures = compute.drawings(("Mode shapes about the equilibrium.", _mode_shapes, beam, self.modes))
        files = {"shapes.csv": _shapes(modes).csv().encode()}
        tip = modes.equilibrium.tip
        data = {"frequency_hz": frequencies, "equilibrium_tip_m": [float(tip[0]), float(tip[1])]}
        return Finding(data, (table,), figures, text=modes.report(), files=files, beam=BeamSpec.of(beam))


def _mode_shapes(beam: Beam, count: int) -> Figure:
    return natural_modes(Model(beam), count=count).figure()


def _shapes(modes: Modes) -> Table:
    """Return the shapes along the beam; the tip moves by 1 in each."""
    arc = np.linspace(0.0, modes.model.beam.length, STATIONS)
    names = [f"mode{k}_{axis}" for k in range(1, modes.count + 1) for axis in "xy"]
    rows = np.column_stack([arc, np.moveaxis(modes.along(arc), 0, 1).reshape(len(arc), -1)])
    return Table("shapes", "Mode shapes", ("arc_length_m", *names), rows.tolist())


def _means(beam: Beam) -> tuple[float, ...]:
    """Return the mean of each property in the order and the units of ``BEAM_ROWS``."""
    return tuple(scale * float(np.mean(getattr(beam, name))) for name, _, scale in BEAM_ROWS)


@dataclass(frozen=True)
class MatchedBeam:
    """A matched beam as plain data."""

    beam: BeamSpec
    data: dict[str, Any]  # the result for JSON
    ranges: dict[str, Array]  # changes (n, 2) of each property that fit equally well; none if out of reach
    report: str
    document: str  # the beam with the damping of the file, as a JSON document


def match_plain(beam: Beam, table: MatchTable, file: StudyFile = NO_FILE) -> MatchedBeam:
    """Match a beam, whose damping is that of a file."""
    match = match_frequencies(beam, **table.request())
    if match.max_relative_error > 0.5:  # of a frequency; such a beam is not the one that was measured
        raise FitError(match.warnings[0])
    space = match.matching.space
    ranges = {} if match.out_of_reach else space.by_property(match.identifiability.spread - 1)
    data = match.to_dict()
    data["elastic_modulus_per_element"] = data["elastic_modulus"]
    data["density_per_element"] = data["density"]
    data["elastic_modulus"], data["density"] = data["elastic_modulus"][0], data["density"][0]
    model = Model(match.beam)
    document = Document(
        model, DampedBeam.of(file).damping_on(model) if file.tables else None, [Identification.of(match)]
    )
    return MatchedBeam(BeamSpec.of(match.beam), data, ranges, match.report(), to_json(document.to_dict()))


@final
@dataclass(frozen=True, kw_only=True)
class Match(Step):
    """The nearest beam with measured frequencies: the tables [match], [[damping]]."""

    kind, heading = "match", "Beam matched to measured frequencies"
    naming, beam = ("beam",), ""
    printed: Annotated[
        Printed,
        Meta(
            description="{standard (Hz), optimum (Hz), value = [width, thickness (mm), density (kg/m^3), "
            "elastic modulus (GPa)]}"
        ),
    ] = field(default_factory=dict)
    table: Annotated[MatchTable | None, UNLISTED] = None

    def prepare(self, study: Study, where: str) -> Self:
        """Return the step with the table [match]."""
        elements = study.model.beam.elements
        table = convert(study.file.require("match"), MatchTable, study.file.where("match"))
        if elements > MOST_ELEMENTS:
            raise InputError(
                f"a match takes {MOST_ELEMENTS} at most, got {elements}; 20 to 100 are enough",
                f"{study.file.where('beam')}: elements",
            )
        with error_prefix(study.file.where("match")):
            table.request()
        modes = len(table.targets)
        columns = {"standard": modes, "optimum": modes, "value": len(ELEMENT_ROWS)}
        printed = printed_numbers(self.printed, columns, where)
        undamped = DampedBeam.of(study.file).undamped
        file = NO_FILE if undamped else study.file.only({"beam", "damping"})  # for the document of the matched beam
        return replace(self, table=table, printed=printed, file=file)

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the properties, the frequencies, and both as figures."""
        beam = self.beam_in(findings)
        match = compute(match_plain, beam, self.table, self.file, cost=2.0)
        return match_finding(compute, beam, match, self.printed, self.printed_by)


def match_finding(
    compute: Compute,
    beam: Beam,
    match: MatchedBeam,
    printed: Printed | None = None,
    printed_by: str = "printed",
    *,
    weightless: float = 0.0,
) -> Finding:
    """Return properties and frequencies of a matched beam, as tables and figures, beside those of the beam before.

    ``weightless`` is the density (kg/m^3) of a beam without gravity whose frequencies stand beside; none if 0.
    """
    data, printed = match.data, printed or {}
    columns = {"before": data["standard_hz"], "matched": data["matched_hz"]}
    columns |= {f"{printed_by}, {key}": printed[key] for key in ("standard", "optimum") if key in printed}
    figures = compute.drawings(
        ("Properties of the matched beam along its length, relative to the given beam.  "
         "Shaded: changes of single elements that fit equally well.", _profiles, beam, match.beam, match.ranges),
        ("Relative errors of the natural frequencies, without their signs, on a logarithmic scale.",
         _frequency_errors, data["modes"], data["target_hz"], columns),
    )  # fmt: skip
    tables = (
        _properties(beam, match.beam, data, printed.get("value")),
        _frequencies(beam, data, printed, weightless),
    )
    files = {"matched.json": match.document.encode()}
    return Finding(data, tables, figures, tuple(data["warnings"]), text=match.report, files=files, beam=match.beam)


def _properties(
    beam: Beam, matched: BeamSpec, data: Mapping[str, Any], printed: Sequence[float | None] | None
) -> Table:
    rows = []
    for name, unit, scale in ELEMENT_ROWS:
        before, values = scale * float(np.mean(getattr(beam, name))), scale * np.array(getattr(matched, name))
        row = (before, float(values.mean()), float(values.min()), float(values.max()))
        rows.append((name.replace("_", " "), unit, *row))
    heads = ("property", "unit", "before", "mean", "smallest", "largest")
    bounds = ", ".join(data["at_bound"]) or "none"
    notes = (
        f"{data['iterations']} iterations of IPOPT; properties at a bound: {bounds}.",
        "Mean, smallest and largest value along the beam.",
        *data["identified"],
    )
    return table_beside_print("Properties of the matched beam", heads, rows, *notes, printed={"mean": printed})


def _frequencies(beam: Beam, data: Mapping[str, Any], printed: Printed, weightless: float) -> Table:
    columns = {"mode": data["modes"], "measured, Hz": data["target_hz"], "before, Hz": data["standard_hz"]}
    if weightless:
        other = beam.with_(gravity=(0.0, 0.0), density=weightless)
        frequencies = natural_modes(Model(other), count=max(data["modes"])).frequencies
        columns[f"{weightless:g} kg/m³, no gravity, Hz"] = [float(frequencies[mode - 1]) for mode in data["modes"]]
    beside = {[*columns][-1]: printed.get("standard"), "matched, Hz": printed.get("optimum")}
    columns["matched, Hz"] = data["matched_hz"]
    note = f"Largest relative error after matching: {data['max_relative_error']:.1e}."
    title = "Natural frequencies before and after matching"
    return table_beside_print(title, [*columns], zip(*columns.values(), strict=True), note, printed=beside)


def _frequency_errors(
    modes: Sequence[int], target: Sequence[float], columns: Mapping[str, Sequence[float | None]]
) -> Figure:
    """Draw the relative errors on a logarithmic scale, so that those after matching are visible."""
    figure, (axes,) = new_figure(3.2)
    for k, (label, frequencies) in enumerate(columns.items()):
        errors = 100 * np.abs(np.array(frequencies, dtype=float) / np.array(target) - 1)
        axes.plot(modes, np.maximum(errors, 1e-12), **series(k), ms=5, label=label)
    axes.set(yscale="log", xlabel="mode", ylabel="frequency error, %", xticks=modes)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _profiles(beam: Beam, matched: BeamSpec, ranges: Mapping[str, Array]) -> Figure:
    """Draw the properties that vary along the beam among those that may change, or the first of these."""
    from ancf_casadi.figures.beams import properties_figure  # slow to import

    names = [name for name, *_ in ELEMENT_ROWS if name in ranges] or [name for name, *_ in ELEMENT_ROWS]
    along = [name for name in names if np.ptp(getattr(matched, name)) > 0.0] or names[:1]
    changes = {name: np.divide(getattr(matched, name), getattr(beam, name)) - 1 for name in along}
    shown = {name: ranges.get(name, change[:, None]) for name, change in changes.items()}
    return properties_figure(beam, matched.beam(), shown, width=FIGURE_WIDTH)
