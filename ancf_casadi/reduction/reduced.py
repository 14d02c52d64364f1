"""The reduced model: CasADi Functions of a few modal coordinates, made from the full model.

    M(q) q_tt = -h(q, q_t, base, p)

keeps the large bending of the beam, its inertia, gravity and damping; axial motion, whose waves would set the step of
an integrator, is left out (``slopes``, ``projection``).  Small motion about the rest has the modes of the full beam.
What a few modes cannot follow grows with the amplitude: ``docs/reduction.md`` shows how much.

As all Functions are straight lines of scalar operations on vectors of a few numbers, they are fast as C code.  They
leave by the ways of the full model (``write_c``, ``save_functions``, ``write_fmu``), or in C together with it:
``write_c(beam_functions(model, law), folder, also=reduced.functions)``.

One step of time.  With w_k the natural frequencies, q_tt = -w^2 q + N(q, q_t, t), and the exact flow E(t) of the linear
part carries the classical Runge-Kutta method of order 4 for the rest (Lawson's method):

    k1 = N(x),  k2 = N(E(h/2)(x + h/2 k1)),  k3 = N(E(h/2) x + h/2 k2),  k4 = N(E(h) x + h E(h/2) k3),
    x_next = E(h)(x + h/6 k1) + h/3 E(h/2)(k2 + k3) + h/6 k4.

Small motion is exact with any step; only what is nonlinear or damped asks for small ones.

References
----------
Lawson 1967, "Generalized Runge-Kutta processes for stable systems with large Lipschitz constants", SIAM Journal on
Numerical Analysis 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import NoneType
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.signals import (
    MotionFunctions,
    base_signals,
    modal_signals,
    output_signals,
    parameter_signals,
    values,
)
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction.kinematics import selected, slopes_of
from ancf_casadi.reduction.projection import BASE, Projected, projection_of
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, numbers, whole
from ancf_casadi.vibration.modes import Modes, natural_modes

MOST_DRAG_POINTS = 100
STAGES = 3  # instants of a step at which the base motion is needed: begin, middle, end


@dataclass(frozen=True, eq=False)
class ReducedFunctions(MotionFunctions):
    """A beam in a few modes as CasADi Functions, called ``reduced_rhs`` and so on.

    The modal coordinates q (m,) are those of the mass-normalised modes, m kg^1/2; v are their rates.  ``base`` (9,) is
    displacement (x, y; m) and rotation (rad) of the clamp, their rates, and the rates of those; p (2 + l,) is gravity
    (x, y; m/s^2) and the parameters of the damping law.

    Parameters
    ----------
    parameters, states, base, outputs, rhs, tip, markers, energies
        As those of ``MotionFunctions``; a is q_tt, in m kg^1/2/s^2.
    step : Function
        (q, v, base, p, h) -> q_next, v_next after h seconds, with base (9, 3) at the begin, middle and end of the step.
    mass : Function
        (q) -> M.
    coordinates : Function
        (q, v, base) -> e, e_t, nodal coordinates of the full model and their rates (4 n + 4,).
    """

    mass: cs.Function
    coordinates: cs.Function


@dataclass(frozen=True, eq=False)
class ReducedModel(ReducedFunctions):
    """A beam in a few modes, with what it was made from; made by ``reduce_model``.

    Parameters
    ----------
    modes : Modes
        The modes kept.
    law : DampingLaw
        The damping law.
    parameters, states, base, outputs, rhs, step, mass, energies, tip, markers, coordinates
        As those of ``ReducedFunctions``.
    """

    modes: Modes
    law: DampingLaw

    @property
    def model(self) -> Model:
        """The full model."""
        return self.modes.model

    @property
    def count(self) -> int:
        """Number of modes m."""
        return self.modes.count

    @property
    def values(self) -> Array:
        """The values of p."""
        return values(self.parameters)


def reduce_model(
    model: Model,
    *,
    modes: int | Modes = 5,
    damping: DampingLaw | None = None,
    markers: Sequence[float] = (),
    points: int | None = None,
    drag_points: int | None = None,
) -> ReducedModel:
    """Make the reduced model of a beam.

    Parameters
    ----------
    model : Model
        The full model.
    modes : int or Modes
        How many modes to keep, or the modes themselves, whose equilibrium is then the rest.
    damping : DampingLaw, optional
        The damping law; undamped if not given.  Not with the ``reference`` stiffness, which resists rotations.
    markers : sequence of float
        Arc lengths of the points whose positions ``markers`` gives, m.
    points : int, optional
        Points of the beam whose slope is followed, more than modes and at most all 2 n + 1 nodes and midpoints;
        2 m + 2 if not given.
    drag_points : int, optional
        Points at which the quadratic drag acts, at most 100; 4 m + 4 if not given.

    Raises
    ------
    InputError
        If the modes belong to another model or stretch the beam, a number of points is out of its range, a marker is
        not on the beam, or the damping law is not defined for bending alone.
    EquilibriumError
        If there is no stable equilibrium under gravity.
    """
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    modes = modes if isinstance(modes, Modes) else natural_modes(model, count=modes)
    if modes.model != model:
        raise InputError("belong to another model", "modes")
    law = RayleighDamping() if damping is None else damping
    m, every = modes.count, slopes_of(modes)
    most = len(every.angles)
    points = min(2 * m + 2, most) if points is None else whole(points, "points", m + 1, most)
    usual = min(4 * m + 4, MOST_DRAG_POINTS)
    drag_points = usual if drag_points is None else whole(drag_points, "drag_points", 1, MOST_DRAG_POINTS)
    markers = numbers(markers, "markers")
    projection = projection_of(modes, every, selected(every, points), drag_points)

    full = parameter_signals(Equations(model, law))
    parameters = (*full[:2], *full[2 + model.properties.size :])  # without the properties of the elements
    q, v, base, p = (cs.MX.sym(n, k) for n, k in (("q", m), ("v", m), ("base", BASE), ("p", len(parameters))))
    symbols = {"q": q, "v": v, "base": base, "p": p}
    beam = Projected(projection, q, v, base, p[:2])
    slope, rate = cs.horzcat(*beam.slope), cs.horzcat(*beam.slope_rate)
    position = np.tile([1.0, 0.0], len(projection.slopes.shape) // 2)[:, None]
    e, e_t = (
        cs.vec((cs.DM(projection.slopes.shape) @ part + position @ base[k : k + 2].T).T)
        for k, part in ((0, slope), (3, rate))
    )
    weight, potential = cs.DM(projection.mass_moment), projection.total_mass * base[:2]
    factor = cs.DM(projection.mass_factor)
    moving = projection.total_mass / 2 * cs.sumsqr(base[3:5]) + cs.dot(base[3:5], rate.T @ weight)
    forces = beam.driving() + beam.damping(law, p[2:], modes)

    def function(name: str, inputs: Sequence[str], **outputs: Any) -> cs.Function:
        name = f"reduced_{name}"
        graph = cs.Function(name, [symbols[key] for key in inputs], [*outputs.values()])
        scalars = [cs.SX.sym(key, symbols[key].numel()) for key in inputs]
        return cs.Function(name, scalars, cs.cse(graph.call(scalars)), [*inputs], [*outputs])

    motion = ("q", "v", "base", "p")
    rhs = function("rhs", motion, a=_divide(beam.mass, -forces))
    return ReducedModel(
        modes=modes,
        law=law,
        parameters=parameters,
        states=modal_signals(modes.frequencies.tolist()),
        base=base_signals(),
        outputs=output_signals(markers),
        rhs=rhs,
        step=_step(rhs, modes),
        mass=function("mass", ("q",), M=Projected(projection, q, v, cs.MX.zeros(BASE), p[:2]).mass),
        energies=function(
            "energies",
            motion,
            T=cs.sumsqr(factor @ rate) / 2 + moving,
            U=projection.rest_energy + cs.dot(cs.DM(projection.rest_force) + beam.bending(q) / 2, q),
            V=-cs.dot(p[:2], slope.T @ weight + potential),
        ),
        tip=function("tip", ("q", "base"), r=e[-4:-2]),
        markers=function(
            "markers",
            ("q", "base"),
            r=cs.horzcat(cs.MX(2, 0), *(cs.DM(model.interpolation(s)) @ e for s in markers)),
        ),
        coordinates=function("coordinates", ("q", "v", "base"), e=e, e_t=e_t),
    )


def _divide(matrix: cs.MX, vector: cs.MX) -> cs.MX:
    """Return A^-1 b for a positive definite A, by A = L D L^T as scalar operations."""
    size = vector.numel()
    A, b = cs.SX.sym("A", size, size), cs.SX.sym("b", size)
    L, D, x = [[cs.SX(0)] * size for _ in range(size)], [cs.SX(0)] * size, cs.vertsplit(b)
    for j in range(size):
        D[j] = A[j, j] - sum(L[j][k] ** 2 * D[k] for k in range(j))
        for i in range(j + 1, size):
            L[i][j] = (A[i, j] - sum(L[i][k] * L[j][k] * D[k] for k in range(j))) / D[j]
    for i in range(size):
        x[i] -= sum(L[i][k] * x[k] for k in range(i))
    x = [entry / pivot for entry, pivot in zip(x, D, strict=True)]
    for i in reversed(range(size)):
        x[i] -= sum(L[k][i] * x[k] for k in range(i + 1, size))
    return cs.Function("divide", [A, b], [cs.vertcat(*x)])(matrix, vector)


def _step(rhs: cs.Function, modes: Modes) -> cs.Function:
    """Return (q, v, base, p, h) -> q_next, v_next."""
    q, v, p = (cs.MX.sym(name, rhs.numel_in(name)) for name in ("q", "v", "p"))
    base, h, omega = cs.MX.sym("base", BASE, STAGES), cs.MX.sym("h"), cs.DM(modes.angular_frequencies)
    cosine, sine = cs.cos(omega * h / 2), cs.sin(omega * h / 2)

    def half(x: cs.MX) -> cs.MX:
        """E(h/2) x."""
        return cs.horzcat(
            cosine * x[:, 0] + sine / omega * x[:, 1],
            cosine * x[:, 1] - sine * omega * x[:, 0],
        )

    def rest(x: cs.MX, stage: int) -> cs.MX:
        """N(x)."""
        return cs.horzcat(cs.MX.zeros(modes.count), rhs(x[:, 0], x[:, 1], base[:, stage], p) + omega**2 * x[:, 0])

    x = cs.horzcat(q, v)
    k1 = rest(x, 0)
    k2 = rest(half(x + h / 2 * k1), 1)
    k3 = rest(half(x) + h / 2 * k2, 1)
    k4 = rest(half(half(x) + h * k3), 2)
    found = half(half(x + h / 6 * k1) + h / 3 * (k2 + k3)) + h / 6 * k4
    return cs.Function("reduced_step", [q, v, base, p, h], [found[:, 0], found[:, 1]], ["q", "v", "base", "p", "h"],
                       ["q_next", "v_next"])  # fmt: skip
