"""All kinds of parts, in the order of the help: those of any study, and those that only the study of the paper has."""

from __future__ import annotations

from problems.study.kind import Kind
from problems.study.kinds import (
    beam,
    comparison,
    decays,
    drawings,
    matching,
    modes,
    motion,
    omitted,
    rayleigh,
    simulation,
)
from problems.study.kinds.drag import change, combined, effects
from problems.study.kinds.experiments import amplitudes, integrators, shapes, transients
from problems.study.kinds.steady import resonances, response

USUAL = tuple(
    module.KIND
    for module in (
        beam, modes, decays, rayleigh, matching, simulation, response, motion, comparison, transients,
    )
)  # fmt: skip
OF_PAPER = tuple(
    module.KIND
    for module in (
        amplitudes, shapes, integrators, resonances, effects, change, combined, drawings, omitted,
    )
)  # fmt: skip
KINDS: dict[str, Kind] = {kind.name: kind for kind in (*USUAL, *OF_PAPER)}
