"""Steps with the beam: its properties, its modes, and a match to measured frequencies: Tables 1, 9, 10 of the paper."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Annotated, Self, final

import numpy as np
from msgspec import Meta

from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.export.identification import Identification
from ancf_casadi.export.model_document import Document
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.lumped import PROPERTIES, property_unit
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import BeamSpec
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.support.inputs import error_prefix, whole
from ancf_casadi.support.specs import UNLISTED, convert
from ancf_casadi.support.tables import Table, to_json
from ancf_casadi.vibration.modes import STATIONS, Modes, natural_modes
from problems.matching.frequency_matching import match_frequencies
from problems.matching.result import FrequencyMatch
from problems.spec.beam import DampedBeam
from problems.spec.file import NO_FILE, StudyFile
from problems.spec.match import MOST_ELEMENTS, MatchTable
from problems.study.compute import Compute
from problems.study.formatting import shown
from problems.study.step import NO_FINDING, Finding, Findings, Printed, Step, Study, printed_numbers, study_table

LENGTH_ROW = ("length", "mm", 1e3)
MATERIAL_ROWS = (("density", "kg/m³", 1.0), ("elastic_modulus", "GPa", 1e-9))
ELEMENT_ROWS = {  # of each element, which a match may change, by the kind of the sections
    "rectangle": (("width", "mm", 1e3), ("thickness", "mm", 1e3), *MATERIAL_ROWS),
    "round": (("diameter", "mm", 1e3), *MATERIAL_ROWS),
    "stiffness": (("bending_stiffness", "N m²", 1.0), ("axial_stiffness", "N", 1.0), ("mass_per_length", "kg/m", 1.0)),
}


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
            description="{value = [length (mm), width (mm), thickness (mm), density (kg/m^3), elastic modulus (GPa)]}; "
            "of other sections, the rows of the table"
        ),
    ] = field(default_factory=dict)

    def prepare(self, study: Study, where: str) -> Self:
        """Return the step with its printed numbers."""
        return replace(self, printed=printed_numbers(self.printed, {"value": len(_beam_rows(study.model.beam))}, where))

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the table of properties."""
        return properties_finding(self.beam_in(findings), findings[self.beam]).beside_print(self.printed)


def properties_finding(beam: Beam, origin: Finding = NO_FINDING) -> Finding:
    """Return the table of properties of a beam; its origin, if it was identified, holds the guess and the errors."""
    errors, rows = origin.errors or {}, _beam_rows(beam)
    scaled = tuple(scale * errors.get(name, math.nan) for name, _, scale in rows)
    guess = origin.guess.beam() if origin.guess else None
    beams = {"guess": guess, "value": beam} if guess else {"value": beam}
    means = zip(*map(_means, beams.values()), strict=True)
    cells = [(name.replace("_", " "), unit, *values) for (name, unit, _), values in zip(rows, means, strict=True)]
    names = [name for name, *_ in rows[1:]]  # of properties that each element has
    varying = [name for name in names if np.ptp(getattr(beam, name)) > 0.0]
    notes = [f"{beam.elements} elements; axis {beam.axis}, gravity {beam.gravity} m/s²."]
    if varying:
        notes.append(f"Means over the elements: {', '.join(varying).replace('_', ' ')} vary along the beam.")
    if beam.section_shape:
        notes.append(f"Sections: {', '.join(map(repr, dict.fromkeys(beam.sections)))}.")
    for name, value in beam.lumped.items():
        scale, unit = (1e3, "g") if property_unit(name) == "kg" else (1.0, property_unit(name))
        error = scale * errors.get(name, math.nan)
        first = f"; guess {scale * guess.lumped.get(name, 0.0):.4g} {unit}" if guess and name in errors else ""
        notes.append(f"{name.replace('_', ' ').capitalize()}: {shown(scale * value, error)} {unit}{first}.")
    if beam.supports != (Clamp(),):
        notes.append(f"Supports: {', '.join(map(repr, beam.supports)) or 'none'}.")
    title = "Properties of the identified beam" if guess else "Properties of the beam"
    heads = ("property", "unit", *beams)
    table = study_table(title, heads, cells, *notes, errors={"value": scaled} if errors else None)
    data = {
        **{name: list(map(float, getattr(beam, name))) for name in dict.fromkeys((*PROPERTIES, *names))},
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
        finding = compute(modes_finding, self.beam_in(findings), self.modes, compute.formats)
        if errors := findings[self.beam].frequency_errors:
            (table,) = finding.tables
            column_errors = {"f_Hz": (*errors, *[None] * self.modes)[: self.modes]}
            table = replace(table, title=f"{table.title} of the identified beam", errors=column_errors)
            finding = replace(finding, tables=(table,))
        return finding.beside_print({"f_Hz": self.printed.get("frequency")})


def modes_finding(beam: Beam, count: int, formats: tuple[str, ...]) -> Finding:
    """Return the lowest modes of a beam."""
    modes = natural_modes(Model(beam), count=count)
    data = {"frequency_hz": modes.frequencies.tolist(), "equilibrium_tip_m": modes.equilibrium.tip.tolist()}
    files = {"shapes.csv": _shapes(modes).csv().encode()}
    caption = "Mode shapes about the equilibrium."
    return Finding.of(modes, caption, formats, data=data, files=files, beam=BeamSpec.of(beam))


def _shapes(modes: Modes) -> Table:
    """Return the shapes along the beam; the tip moves by 1 in each."""
    arc = np.linspace(0.0, modes.model.beam.length, STATIONS)
    names = [f"mode{k}_{axis}" for k in range(1, modes.count + 1) for axis in "xy"]
    rows = np.column_stack([arc, np.moveaxis(modes.along(arc), 0, 1).reshape(len(arc), -1)])
    return Table("shapes", "Mode shapes", ("arc_length_m", *names), rows.tolist())


def _means(beam: Beam) -> tuple[float, ...]:
    """Return the mean of each property in the order and the units of its rows."""
    return tuple(scale * float(np.mean(getattr(beam, name))) for name, _, scale in _beam_rows(beam))


def _beam_rows(beam: Beam) -> tuple[tuple[str, str, float], ...]:
    """Return name, unit and scale of the properties of a beam; of sections of several kinds, as of rectangles."""
    kinds = {shape.kind for shape in beam.shapes}
    return (LENGTH_ROW, *ELEMENT_ROWS[kinds.pop() if len(kinds) == 1 else "rectangle"])


def match_finding(beam: Beam, table: MatchTable, file: StudyFile = NO_FILE, formats: tuple[str, ...] = ()) -> Finding:
    """Match a beam, whose damping is that of a file."""
    match = match_frequencies(beam, **table.request())
    if match.max_relative_error > 0.5:  # of a frequency; such a beam is not the one that was measured
        raise FitError(match.warnings[0])
    data = match.to_dict()
    data["elastic_modulus_per_element"] = data["elastic_modulus"]
    data["density_per_element"] = data["density"]
    data["elastic_modulus"], data["density"] = data["elastic_modulus"][0], data["density"][0]
    model = Model(match.beam)
    damping = DampedBeam.of(file).damping_on(model) if file.tables else None
    document = Document(model, damping, [Identification.of(match)])
    caption = (
        "Natural frequencies relative to the measured ones, before and after matching, and the properties along the "
        "beam relative to the given ones.  Shaded: changes of single elements that fit equally well."
    )
    return Finding.of(
        match,
        caption,
        formats,
        data=data,
        tables=(_mean_properties(beam, match), match.tables()[0]),
        files={"matched.json": to_json(document.to_dict()).encode()},
        beam=BeamSpec.of(match.beam),
    )


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
        columns = {"standard": modes, "optimum": modes, "value": len(_beam_rows(study.model.beam)) - 1}
        printed = printed_numbers(self.printed, columns, where)
        undamped = DampedBeam.of(study.file).undamped
        file = NO_FILE if undamped else study.file.only({"beam", "damping"})  # for the document of the matched beam
        return replace(self, table=table, printed=printed, file=file)

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the matched beam."""
        match = compute(match_finding, self.beam_in(findings), self.table, self.file, compute.formats)
        printed = self.printed.get
        return match.beside_print({"mean": printed("value")},
                                  {"before": printed("standard"), "matched": printed("optimum")})  # fmt: skip


def _mean_properties(beam: Beam, match: FrequencyMatch) -> Table:
    """Return mean and extremes along the beam of each property, beside the mean of the given beam."""
    rows = []
    for (name, unit, scale), before in list(zip(_beam_rows(beam), _means(beam), strict=True))[1:]:  # without the length
        values = scale * np.array(getattr(match.beam, name))
        numbers = (before, float(values.mean()), float(values.min()), float(values.max()))
        rows.append((name.replace("_", " "), unit, *numbers))
    heads = ("property", "unit", "before", "mean", "smallest", "largest")
    notes = (
        f"{match.iterations} iterations of IPOPT.",
        "Mean, smallest and largest value along the beam.",
        *match.table().notes,
    )
    return study_table("Properties of the matched beam", heads, rows, *notes)
