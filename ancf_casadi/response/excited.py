"""A system with its excitation, and the motion of its points.

The displacement of a point of a beam is taken relative to the base, in the direction ``Beam.across``, unless stated
otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import NoneType
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.placed_load import TIP
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.loads import PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction.forces import BASE_SIZE
from ancf_casadi.reduction.reduced import ReducedModel, reduce_model, reduced_motion
from ancf_casadi.response.harmonic_balance.balance import (
    FIRST_HARMONICS,
    HarmonicBalance,
    Setting,
    basis_at,
    fourier,
    initial_samples,
)
from ancf_casadi.response.harmonic_balance.beams import STRAIGHT, full_system, reduced_system
from ancf_casadi.response.harmonic_balance.system import (
    BEAM_EXCITATION,
    Drive,
    HarmonicForce,
    SecondOrderSystem,
    beam_drive,
    force_drive,
    no_drive,
)
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, unit_vector, whole
from ancf_casadi.vibration.modes import natural_modes

Body = Model | ReducedModel | SecondOrderSystem


@dataclass(frozen=True, eq=False)
class Excited:
    """A system with its excitation."""

    system: SecondOrderSystem
    drive: Drive
    body: Model | ReducedModel | None  # None for a system of the user
    law: DampingLaw | None = None  # of the beam
    mode: int = 1  # of the beam, from 1; amplitudes refer to its reference point
    place: PointLoad = TIP  # of the load

    @property
    def model(self) -> Model | None:
        """The full model of the beam."""
        return self.body.model if isinstance(self.body, ReducedModel) else self.body

    @cached_property
    def reference(self) -> float:
        """Arc length of the point to which amplitudes refer: the tip, or if it is held that of ``Modes``, m."""
        model = self.model
        if model is None:
            return math.nan
        if not model.beam.tip_is_held:
            return model.beam.length
        return natural_modes(model, count=self.mode).reference_points[-1]

    @property
    def unit(self) -> str:
        """Unit of a displacement; empty for the coordinates of another system than a beam."""
        return "m" if self.model is not None else ""

    @property
    def symmetric(self) -> bool:
        """True if the motion may have the mirror symmetry of the system: a beam is then excited across its axis."""
        ax, ay = self.model.beam.axis if self.model else (0.0, 0.0)
        along = abs(self.drive.direction[0] * ax + self.drive.direction[1] * ay)
        return bool((self.system.mirror < 0.0).any()) and along <= STRAIGHT

    @property
    def balance(self) -> HarmonicBalance:
        """The equations with the initial numbers of harmonics and samples."""
        series = fourier(FIRST_HARMONICS, initial_samples(FIRST_HARMONICS), self.symmetric)
        return HarmonicBalance(self.system, self.drive, series)

    def kinematics(self, C: Array, setting: Setting, phases: Array) -> tuple[Array, Array, Array]:
        """Return coordinates and velocities (n, k), and the excitation (e, k), at phases (k,), rad."""
        harmonics = len(C) // 2
        basis = basis_at(phases, harmonics)
        slope = basis @ fourier(harmonics, 2 * len(C)).derivative
        u, _, _ = self.drive.samples(phases, setting.omega, setting.amplitude)
        return (basis @ C).T, setting.omega * (slope @ C).T, u

    def displacement(
        self, q: Any, u: Any, point: float | None, direction: Sequence[float] | None, *, relative: bool
    ) -> Any:
        """Return the displacement of a point of a beam, m, or a coordinate of a system, (1, k)."""
        model = self.model
        if model is None:
            return q[whole(0 if point is None else point, "point", 0, self.system.size - 1), :]
        interpolation = model.interpolation(self.reference if point is None else point)
        unit_direction = np.array(unit_vector(model.beam.across if direction is None else direction, "direction"))
        if isinstance(self.body, ReducedModel):
            motion = reduced_motion(self.body.projection, q, 0 * q, u[:BASE_SIZE, :], cs.DM(2, 1))
            shape = cs.DM(interpolation[:1, ::2] @ self.body.projection.shape)
            relative_position = cs.vertcat(*(shape @ coordinates for coordinates in motion.parts))
        else:
            axis = cs.repmat(cs.DM(model.beam.axis), 1, q.size2())
            relative_position = cs.DM(interpolation) @ model.whole(q, cs.vertcat(u[:2, :], axis)) - u[:2, :]
        position = relative_position if relative else relative_position + u[:2, :]
        return cs.DM(unit_direction).T @ position


def excite(
    body: Body,
    damping: DampingLaw | None,
    base: BaseMotion | None = None,
    load: TipLoad | None = None,
    force: HarmonicForce | None = None,
    *,
    mode: int | None = None,
) -> Excited:
    """Return a beam or a system with its excitation, or without excitation for a free vibration in a mode."""
    check_instance(body, "model", Model, ReducedModel, SecondOrderSystem)
    check_instance(damping, "damping", DampingLaw, NoneType)
    if isinstance(body, SecondOrderSystem):
        for name, argument in (("damping", damping), ("base", base), ("load", load)):
            if argument is not None:
                raise InputError("belongs to a beam; a SecondOrderSystem has its own, and takes a HarmonicForce", name)
        return Excited(body, no_drive(body.excitation) if mode else force_drive(force, body.excitation), None)
    if force is not None:
        raise InputError("belongs to a SecondOrderSystem; a beam takes a HarmonicBase or a HarmonicLoad", "force")
    drive = no_drive(BEAM_EXCITATION) if mode else beam_drive(base, load)
    place = TIP if load is None else load.place or TIP
    if isinstance(body, ReducedModel):
        if damping is not None:
            body = reduce_model(body.model, modes=body.modes, damping=damping)
        damping, system = body.law, reduced_system(body, place)
    else:
        assert isinstance(body, Model)
        damping = RayleighDamping() if damping is None else damping
        system = full_system(body, damping, place)
    return Excited(system, drive, body, damping, mode or 1, place)


def half_range(values: Array) -> float:
    """Return half the peak-to-peak value of equally spaced samples of a period."""
    return (_extreme(values) + _extreme(-values)) / 2


def _extreme(values: Array) -> float:
    """Return the largest value, by a parabola through the largest sample and its neighbours."""
    k = int(values.argmax())
    before, at, after = values[k - 1], values[k], values[(k + 1) % len(values)]
    curvature = before - 2 * at + after
    return float(at - (after - before) ** 2 / (8 * curvature)) if curvature else float(at)
