"""Places in the file of a study that hold the guesses of its fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from ancf_casadi.damping.spec import law_spec
from ancf_casadi.mechanics.lumped import changed_properties
from problems.spec.beam import DampedBeam
from problems.spec.editing import Place, value_at
from problems.spec.file import StudyFile


def guess_places(file: StudyFile, names: Sequence[str]) -> dict[str, Place]:
    """Return where the guesses of unknowns of a fit stand in its study, by name, as far as they do."""
    beam = DampedBeam.of(file)
    entries: list[Place] = []
    for k, law in enumerate(beam.laws):
        values = [parameter.value for parameter in law.parameters]
        spec = msgspec.to_builtins(law_spec(law, beam.model))
        for j, value in enumerate(values):
            changed = law.with_parameters([*values[:j], 0.5 * value, *values[j + 1 :]])
            entries.append(("damping", k, *_difference(spec, msgspec.to_builtins(law_spec(changed, beam.model)))))
    parameters = beam.damping.parameters if beam.damping and entries else ()
    places = [(parameter.name, entry) for parameter, entry in zip(parameters, entries, strict=True)]
    places += [(name, ("beam", key)) for name in names for key in (name, *changed_properties(name))]
    return {name: place for name, place in reversed(places) if name in names and value_at(file.tables, place)}


def _difference(first: Any, second: Any) -> Place:
    """Return the place of the value that differs in plain data."""
    if not isinstance(first, dict | list | tuple):
        return ()
    steps = first if isinstance(first, dict) else range(len(first))
    step = next(step for step in steps if first[step] != second[step])
    return (step, *_difference(first[step], second[step]))
