"""The table [response]: steady vibration of the beam under harmonic excitation, over a range of frequencies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.dynamics.tip_load import HarmonicLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction.reduced import ReducedModel, reduce_model
from ancf_casadi.response.curve import ResponseCurve
from ancf_casadi.response.tracing import CURVE_POINTS, MOST_CURVE_POINTS, frequency_response
from ancf_casadi.support.inputs import unit_vector, whole
from problems.schema.beam import DAMPED_HELP, read_damped
from problems.schema.motion import MARKERS_KEYS, read_markers
from problems.schema.table import Positive, StudyFile, read, told

RESPONSE_MODES = 8  # of the reduced model, if the beam has as many
RESPONSE_TOLERANCE = 1e-4  # few harmonics suffice for it, even under friction

Levels = Positive | Annotated[tuple[Positive, ...], Meta(min_length=1, max_length=20)]


class ResponseTable(Struct, frozen=True):
    """Keys of the table [response]; 0 stands for what is not given."""

    frequencies: Annotated[tuple[Positive, Positive], Meta(description="[FROM, TO], Hz")]
    base_amplitudes: Annotated[Levels, Meta(description="m, one number or several levels")] = ()
    tip_forces: Annotated[Levels, Meta(description="N, instead of base_amplitudes")] = ()
    direction: tuple[float, float] = (1.0, 0.0)
    model: Literal["reduced", "full"] = "reduced"
    modes: Annotated[int, Meta(ge=1, description=f"of the reduced model, {RESPONSE_MODES}")] = 0
    points: Annotated[int, Meta(ge=2, le=MOST_CURVE_POINTS, description=f"least number on a curve, {CURVE_POINTS}")] = (
        CURVE_POINTS
    )
    tolerance: Annotated[
        float, Meta(gt=0.0, le=0.01, description=f"error of each motion relative to its size, {RESPONSE_TOLERANCE:g}")
    ] = RESPONSE_TOLERANCE


RESPONSE_HELP = DAMPED_HELP + told("[response]", "steady vibration: {}", ResponseTable) + MARKERS_KEYS


@dataclass(frozen=True, eq=False)
class ResponseTask:
    """The arguments of ``frequency_response`` from a file, one curve per level of the excitation."""

    model: Model
    damping: DampingLaw | None
    table: ResponseTable
    modes: int  # of the reduced model; 0 for the full beam
    markers: Mapping[str, float]  # arc length of each point to output, m

    @property
    def driven(self) -> str:
        """Place of the excitation, "base" or "tip"."""
        return "base" if self.table.base_amplitudes else "tip"

    @property
    def levels(self) -> tuple[float, ...]:
        """Amplitudes of the excitation: of the base, m, or of the force at the tip, N."""
        levels = self.table.base_amplitudes or self.table.tip_forces
        return levels if isinstance(levels, tuple) else (levels,)

    @cached_property
    def body(self) -> Model | ReducedModel:
        """The full beam, or its reduced model with the damping law."""
        return reduce_model(self.model, modes=self.modes, damping=self.damping) if self.modes else self.model

    @property
    def unit(self) -> str:
        """Unit of the levels."""
        return "m" if self.driven == "base" else "N"

    def excitation(self, level: float) -> dict[str, Any]:
        """Return the excitation of a level as the argument ``base`` or ``load`` of ``frequency_response``."""
        start, direction = self.table.frequencies[0], unit_vector(self.table.direction, "direction")
        if self.driven == "base":
            return {"base": HarmonicBase(level, start, direction=direction)}
        return {"load": HarmonicLoad((level * direction[0], level * direction[1]), start)}

    def curve(self, level: float) -> ResponseCurve:
        """Return the response curve of a level."""
        return frequency_response(
            self.body,
            self.table.frequencies,
            damping=None if self.modes else self.damping,  # a reduced model has its law
            points=self.table.points,
            tolerance=self.table.tolerance,
            **self.excitation(level),
        )


def read_response(given: str | StudyFile) -> ResponseTask:
    """Read a beam, its damping, and its harmonic excitation over a range of frequencies."""
    file = StudyFile.of(given)
    source, where = read_damped(file), file.where("response")
    table = read(file.needed("response"), ResponseTable, where)
    first, last = table.frequencies
    if first == last:
        raise InputError(f"must be [FROM, TO], two different values, got {first:g} twice", f"{where}: frequencies")
    unit_vector(table.direction, f"{where}: direction")
    if bool(table.base_amplitudes) == bool(table.tip_forces):
        raise InputError("give either base_amplitudes (m) or tip_forces (N)", f"{where}: base_amplitudes")
    modes, markers = _modes(table, source.model, f"{where}: modes"), read_markers(file, source.model)
    return ResponseTask(source.model, source.damping, table, modes, markers)


def _modes(table: ResponseTable, model: Model, where: str) -> int:
    """Return the number of modes of the reduced model; 0 for the full beam."""
    most = model.freedoms
    if table.model == "full":
        if table.modes:
            raise InputError("belongs to the reduced model; leave it out", where)
        return 0
    return whole(table.modes, where, 1, most) if table.modes else min(RESPONSE_MODES, most // 2)
