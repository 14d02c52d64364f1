"""The table [response]: steady vibration of the beam under harmonic excitation, over a range of frequencies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.dynamics.tip_load import HarmonicLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.document.model_document import Document
from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction.reduced import ReducedModel, reduce_model
from ancf_casadi.response.curve import ResponseCurve
from ancf_casadi.response.tracing import MOST_POINTS, POINTS, frequency_response
from ancf_casadi.support.inputs import choice, is_sequence, located, physical, positive, vector, whole
from problems.tables.simulation import read_markers
from problems.tables.study import Study

KEYS = """\
  [response]    steady vibration: frequencies = [FROM, TO] (Hz);
                base_amplitudes (m) or tip_forces (N), one number or several
                levels; direction; model ("reduced" or "full"), modes (of the
                reduced model, 8), points (least number on a curve, 60),
                tolerance (error of each motion relative to its size, 1e-4)
  [markers]     NAME = arc length from the clamp (m): points in the output
"""
REQUIRED = {"frequencies"}
OPTIONAL = {"base_amplitudes", "tip_forces", "direction", "model", "modes", "points", "tolerance"}
MODELS = ("reduced", "full")
MODES = 8  # of the reduced model, if the beam has as many
TOLERANCE = 1e-4  # few harmonics suffice for it, even under friction
LARGEST_TOLERANCE = 0.01
MOST_LEVELS = 20


@dataclass(frozen=True, eq=False)
class ResponseTask:
    """The arguments of ``frequency_response`` from a file, one curve per level of the excitation.

    Parameters
    ----------
    model : Model
        The beam.
    damping : DampingLaw or None
        The law, or the sum of several.
    frequencies : (float, float)
        Frequencies at which the curves begin, and towards which they go, Hz.
    levels : tuple of float
        Amplitudes of the excitation: of the base, m, or of the force at the tip, N.
    driven : {"base", "tip"}
        Place of the excitation.
    direction : (float, float)
        Its direction, a unit vector.
    modes : int
        Number of modes of the reduced model; 0 for the full beam.
    points : int
        Least number of points of a curve.
    tolerance : float
        Largest estimated error of each motion, relative to its size.
    markers : mapping of str to float
        Arc lengths of the points to output by name, m.
    """

    model: Model
    damping: DampingLaw | None
    frequencies: tuple[float, float]
    levels: tuple[float, ...]
    driven: str
    direction: tuple[float, float]
    modes: int
    points: int
    tolerance: float
    markers: Mapping[str, float]

    @cached_property
    def body(self) -> Model | ReducedModel:
        """The full beam, or its reduced model with the damping law.

        Raises
        ------
        InputError
            If the reduced model does not have a force of the law.
        EquilibriumError
            If there is no stable equilibrium under gravity.
        """
        return reduce_model(self.model, modes=self.modes, damping=self.damping) if self.modes else self.model

    @property
    def unit(self) -> str:
        """Unit of the levels."""
        return "m" if self.driven == "base" else "N"

    def excitation(self, level: float) -> dict[str, Any]:
        """Return the excitation of a level as the argument ``base`` or ``load`` of ``frequency_response``."""
        start, (x, y) = self.frequencies[0], self.direction
        if self.driven == "base":
            return {"base": HarmonicBase(level, start, direction=self.direction)}
        return {"load": HarmonicLoad((level * x, level * y), start)}

    def curve(self, level: float) -> ResponseCurve:
        """Return the response curve of a level.

        Raises
        ------
        InputError, EquilibriumError, NumericsError, ContinuationError
            As ``frequency_response``.
        """
        return frequency_response(
            self.body,
            self.frequencies,
            damping=None if self.modes else self.damping,  # a reduced model has its law
            points=self.points,
            tolerance=self.tolerance,
            **self.excitation(level),
        )


def response_task(study: Study, source: Document) -> ResponseTask:
    """Return the steady vibration of a beam with its damping.

    Raises
    ------
    InputError
        If the table is missing, a key or value cannot be used, or a marker is not on the beam.
    """
    table, where = study.table("response", REQUIRED, OPTIONAL), study.where("response")
    with located(where):
        first, last = (physical(f, "frequencies") for f in vector(table["frequencies"], "frequencies"))
        if first == last:
            raise InputError(f"must be [FROM, TO], two different values, got {first:g} twice", "frequencies")
        x, y = vector(table.get("direction", (1.0, 0.0)), "direction")
        size = math.hypot(x, y)
        if not size:
            raise InputError("must not be zero", "direction")
        driven, levels = _levels(table)
        modes = _modes(table, source.model)
        points = whole(table.get("points", POINTS), "points", 2, MOST_POINTS)
        tolerance = positive(table.get("tolerance", TOLERANCE), "tolerance")
        if tolerance > LARGEST_TOLERANCE:
            raise InputError(f"must be at most {LARGEST_TOLERANCE:g}, got {tolerance:g}", "tolerance")
    return ResponseTask(
        source.model,
        source.damping,
        (first, last),
        levels,
        driven,
        (x / size, y / size),
        modes,
        points,
        tolerance,
        read_markers(study, source.model),
    )


def _levels(table: Mapping[str, Any]) -> tuple[str, tuple[float, ...]]:
    """Return the place of the excitation and its amplitudes."""
    given = [key for key in ("base_amplitudes", "tip_forces") if key in table]
    if len(given) != 1:
        raise InputError("give either base_amplitudes (m) or tip_forces (N)", "base_amplitudes")
    (key,) = given
    values = table[key] if is_sequence(table[key]) else [table[key]]
    if not 1 <= len(values) <= MOST_LEVELS:
        raise InputError(f"must have 1 to {MOST_LEVELS} levels, got {len(values)}", key)
    return key.partition("_")[0], tuple(physical(value, key) for value in values)


def _modes(table: Mapping[str, Any], model: Model) -> int:
    """Return the number of modes of the reduced model; 0 for the full beam."""
    most = model.size - model.free.start
    if choice(table.get("model", "reduced"), MODELS, "model") == "full":
        if "modes" in table:
            raise InputError("belongs to the reduced model; leave it out", "modes")
        return 0
    return whole(table["modes"], "modes", 1, most) if "modes" in table else min(MODES, most // 2)
