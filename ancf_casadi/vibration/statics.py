"""The stable static equilibrium that a straight beam reaches as gravity, loads and displacements of supports grow.

Newton's method converges from a neighbouring equilibrium.  The load factor therefore grows from 0, where the beam is
straight, in steps that keep the rotation of every slope small.  A step that fails or rotates a slope too far is halved,
so the solver follows the path instead of jumping to another equilibrium.

A step that ends in an unstable equilibrium has passed a critical point.  The path is then followed from the last stable
equilibrium by pseudo-arclength continuation (``ancf_casadi.vibration.continuation``): through limit points, and, where
a bifurcation takes the stability of the path, along the path that crosses there.  Loads that favour one side bend the
beam to this side before it buckles; only a perfectly symmetric beam has a choice, which ``side`` makes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ancf_casadi.exceptions import EquilibriumError, InputError
from ancf_casadi.mechanics.loads import LineLoad, Load, PointLoad, loads_text
from ancf_casadi.mechanics.mesh_limits import SHORT_ELEMENTS_ADVICE, warn_of_overbent_elements
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import check_instance, instances, limited_number, limited_vector, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.last_calls import keep_last
from ancf_casadi.vibration.assembly import Position, Structure
from ancf_casadi.vibration.continuation import (
    MAX_STEP,
    PathPoint,
    PathStep,
    ProportionalLoading,
    branch_tangent,
    follow_path,
    longest_step,
    null_shape,
)
from ancf_casadi.vibration.eigensolver import moves_freely
from ancf_casadi.vibration.equilibrium import MAX_ROTATION, Equilibrium, neighbouring_equilibrium

MAX_PATH_STEPS = 500  # along the path to a stable equilibrium; buckled, slack and hanging strips take 10 to 150


def static_equilibrium(
    model: Model,
    *,
    tip_force: tuple[float, float] = (0.0, 0.0),
    tip_moment: float = 0.0,
    loads: Sequence[Load] = (),
    side: int = 1,
) -> Equilibrium:
    """Return the stable equilibrium reached from the straight beam as gravity, loads and displacements grow together.

    A beam that buckles on the way bends to the side that the loads favour.  ``equilibrium_path`` gives the unstable
    equilibria too.

    Parameters
    ----------
    model : Model
        The beam.
    tip_force : (float, float)
        Force at the tip in the laboratory frame, N.
    tip_moment : float
        Moment at the tip, positive counterclockwise, N m.
    loads : sequence of PointLoad or LineLoad
        Further loads, at any points and along any parts of the beam.
    side : {1, -1}
        Side to which a beam buckles if neither loads nor shape favour one: that of the largest displacement along
        positive x or y, or the other.

    Raises
    ------
    InputError
        If a load is not finite, or not on the beam.
    EquilibriumError
        If no path of equilibria leads to a stable one under the full load.

    Warns
    -----
    UserWarning
        If an element bends by more than a cubic element can follow.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, Pin, static_equilibrium
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> rest = static_equilibrium(Model(beam), tip_force=(0.02, 0.0))
    >>> print(f"{1e3 * rest.tip[0]:.0f} mm sideways, {1e3 * (rest.tip[1] + beam.length):.0f} mm up")
    59 mm sideways, 4 mm up

    A strip between two pins buckles as they approach each other:

    >>> pins = Pin(0.0), Pin(0.5, displacement=(-0.02, 0.0))
    >>> strip = Model(beam.with_(axis=(1.0, 0.0), gravity=(0.0, 0.0), supports=pins))
    >>> [round(1e3 * float(static_equilibrium(strip, side=side).position(0.25)[1])) for side in (1, -1)]
    [63, -63]
    """
    check_instance(model, "model", Model)
    force, moment = limited_vector(tip_force, "tip_force"), limited_number(tip_moment, "tip_moment")
    other_loads, side = instances(loads, "loads", PointLoad, LineLoad, minimum=0), whole(side, "side", -1, 1)
    if side == 0:
        raise InputError("must be 1 or -1", "side")
    straight = Equilibrium(model, model.straight, force, moment, loads=other_loads)
    position = stable_position(model, straight.all_loads, side=side)
    warn_of_overbent_elements(model, position.coordinates)
    return replace(straight, coordinates=position.coordinates.copy(), remainder=position.remainder.copy())


@keep_last(8)
@lasting_interrupts()
def stable_position(model: Model, loads: tuple[Load, ...], *, side: int) -> Position:
    """Return the coordinates of ``static_equilibrium``, without a warning; a run finds those of an earlier one again.

    The mesh of too short elements is unstable where the beam is not, so that its stability tells nothing.
    """
    loading = ProportionalLoading(model, loads, with_weight=True)
    position, factor = _follow_load(loading, stable=not model.has_short_elements)
    if factor < 1.0:
        position = _follow_path(loading, side)
    for array in (position.coordinates, position.remainder):
        array.setflags(write=False)
    return position


def primary_equilibrium(model: Model, loads: Sequence[Load], start: Equilibrium | None = None) -> Equilibrium:
    """Return the equilibrium under loads on the primary path, stable or not; branches are not taken.

    The path begins with the straight beam, and supports and gravity grow with the loads; or at another equilibrium of
    the model, and the loads alone change.
    """
    loading = ProportionalLoading(model, tuple(loads), with_weight=True)
    at, factor = _follow_load(loading, stable=False, start=start)
    if factor < 1.0:
        raise _no_equilibrium(loading, factor)
    return Equilibrium(model, at.coordinates, remainder=at.remainder, loads=loading.loads)


def _follow_load(
    loading: ProportionalLoading, *, stable: bool, start: Equilibrium | None = None
) -> tuple[Position, float]:
    """Return the last equilibrium, or the last stable one, up to the full load in steps of the load, and its factor.

    The path begins as that of ``primary_equilibrium``.
    """
    position = Position.of(loading.model.straight) if start is None else start.exact
    angle = max((abs(support.angle) for support in loading.model.beam.supports), default=0.0)
    factor, trials, longest = 0.0, 0, 1.0 if start else MAX_ROTATION / max(angle, MAX_ROTATION)
    step = longest
    # a path that needs smaller steps of the load factor, or more of them, is close to a critical point
    while factor < 1.0 and step >= 1e-5 and trials < 500:
        trials += 1
        s = min(factor + step, 1.0)
        loads = tuple(load.scaled(s) for load in loading.loads)
        if start is None:
            model, relief = loading.model_at(s), (1.0 - s) * loading.weight
            motion = model.way_to_supports(position.coordinates) if loading.moves else None
        else:
            model, relief, motion = loading.model, 0.0, None
            loads += tuple(load.scaled(1.0 - s) for load in start.all_loads)
        trial = neighbouring_equilibrium(Structure.of(model, loads), position, relief, motion)
        if trial is None:
            step /= 2
            continue
        if stable and not Equilibrium(model, trial.coordinates, remainder=trial.remainder, loads=loads).stable:
            break
        position, factor = trial, s
        step = min(2 * step, longest)
    return position, factor


def _follow_path(loading: ProportionalLoading, side: int) -> Position:
    """Return the stable equilibrium under the full load at the end of the path from the straight beam."""
    straight, factor = loading.model.straight, 0.0
    point = PathPoint(loading, loading.model.of_free(straight), 0.0, np.zeros_like(straight))
    try:
        tangent = point.tangent(np.append(np.zeros(point.q.size), 1.0))
    except np.linalg.LinAlgError:
        raise _no_equilibrium(loading, factor) from None
    steps, unstable_modes = follow_path(point, tangent, longest_step(tangent)), 0
    for _ in range(MAX_PATH_STEPS):
        path_step = next(steps, None)
        if path_step is None or path_step.end.negative > 1:  # negative eigenvalues of the tangent stiffness
            break
        if path_step.critical is not None and path_step.kind == "bifurcation" and not unstable_modes:
            steps, unstable_modes = _follow_branch(path_step.critical, side), 1
            continue
        unstable_modes = path_step.end.negative
        if not unstable_modes:
            factor = max(factor, path_step.end.factor)
            if factor >= 1.0:
                return path_step.end.at
    raise _no_equilibrium(loading, factor, snaps=unstable_modes > 0)


def _follow_branch(crossing: PathPoint, side: int) -> Iterator[PathStep]:
    """Follow the path that crosses at a bifurcation: to a side, or to the other one if only that is stable."""
    shape = null_shape(crossing)
    branches = [
        follow_path(crossing, branch_tangent(crossing, shape, branch_side), MAX_STEP, regular=False)
        for branch_side in (side, -side)
    ]
    first_steps = [next(branch, None) for branch in branches]
    k = next((k for k, step in enumerate(first_steps) if step is not None and step.end.negative == 0), 0)
    first_step = first_steps[k]
    if first_step is not None:
        yield first_step
        yield from branches[k]


def _no_equilibrium(loading: ProportionalLoading, factor: float, *, snaps: bool = False) -> EquilibriumError:
    """Return the error of a path of equilibria that has none, or none that is stable, beyond a load factor."""
    advice = (
        ". Either an element bends by more than half a radian, which a cubic cannot follow (use more elements), or the "
        "beam buckles, or a value is in the wrong unit"
    )
    if moves_freely(Structure.of(loading.model_at(0.0)), Position.of(loading.model.straight)):
        advice = (
            ": the supports do not hold the beam against rigid motions. Hold it, turn it to where it hangs, or "
            "simulate its motion from start='straight'"
        )
    elif loading.model.has_short_elements:
        advice = f": {SHORT_ELEMENTS_ADVICE}"
    elif snaps:
        advice = (
            ": there the path of equilibria turns unstable, and the beam snaps to a distant shape. Simulate the "
            "motion, use more elements if one bends by more than half a radian, or follow the path by equilibrium_path"
        )
    return EquilibriumError(
        f"no static equilibrium was found beyond {factor:.4g} of the load ({loads_text(loading.loads)}, "
        f"gravity {loading.model.beam.gravity} m/s^2){advice}"
    )
