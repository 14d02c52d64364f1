"""All kinds of parts, in the order of the help: those of any study, and those that only the study of the paper has."""

from __future__ import annotations

from problems.study.kinds.beam import BeamProperties, ModesOfBeam
from problems.study.kinds.decays import Decays
from problems.study.kinds.drag.change import RatioChange
from problems.study.kinds.drag.combined import CombinedLaw
from problems.study.kinds.drag.effects import EtaEffects
from problems.study.kinds.drawings import DrawingPart, Omitted
from problems.study.kinds.experiments.transients import Transients
from problems.study.kinds.experiments.views import Amplitudes, Integrators, Shapes
from problems.study.kinds.matching import Match
from problems.study.kinds.motion import Comparison, MotionFit
from problems.study.kinds.rayleigh import Rayleigh
from problems.study.kinds.simulation import SimulationPart
from problems.study.kinds.steady.resonances import Resonances
from problems.study.kinds.steady.response import ResponsePart
from problems.study.part import Part

USUAL: tuple[type[Part], ...] = (
    BeamProperties, ModesOfBeam, Decays, Rayleigh, Match, SimulationPart, ResponsePart, MotionFit, Comparison,
    Transients,
)  # fmt: skip
OF_PAPER: tuple[type[Part], ...] = (
    Amplitudes, Shapes, Integrators, Resonances, EtaEffects, RatioChange, CombinedLaw, DrawingPart, Omitted,
)  # fmt: skip
KINDS = {kind.kind: kind for kind in (*USUAL, *OF_PAPER)}
