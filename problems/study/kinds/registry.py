"""All kinds of parts, in the order of the help."""

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

MODULES = (
    beam, modes, decays, rayleigh, matching, simulation, response, motion, comparison, transients, amplitudes, shapes,
    integrators, resonances, effects, change, combined, drawings, omitted,
)  # fmt: skip
KINDS: dict[str, Kind] = {module.KIND.name: module.KIND for module in MODULES}
