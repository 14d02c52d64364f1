"""The equation of motion as named CasADi Functions, for optimisation, control and code of one's own.

With the free coordinates q, their rates v and accelerations a (absolute, in the laboratory frame), the motion ``base``
of the clamp (displacement x, y and rotation; their first and second rates) and the parameters p (gravity, properties of
the elements, those of the damping law),

    residual(q, v, a, base, p) = M a_e + Q_damp + Q_e - Q_g    (free rows; a_e the accelerations of all nodes)
    rhs(q, v, base, p) = a, which makes the residual zero.

The mass matrix depends on p but not on the motion, and does not mix x and y; rhs factorises it each time, in linear
time.  ``signals`` names every entry of q, v, base and p.  All Functions are of CasADi's MX type and differentiable.
How far ``equilibrium`` and ``frequencies`` reach: ``statics``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.dynamics.base_motion import Piece
from ancf_casadi.dynamics.equations import Equations, clamped_node
from ancf_casadi.dynamics.signals import (
    MotionFunctions,
    base_signals,
    output_signals,
    parameter_signals,
    state_signals,
    values,
)
from ancf_casadi.export.functions.statics import equilibrium_function, frequencies_function
from ancf_casadi.export.functions.step import step_function
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.inputs import numbers
from ancf_casadi.vibration.modes import natural_modes


@dataclass(frozen=True, eq=False)
class BeamFunctions(MotionFunctions):
    """A beam under a damping law as CasADi Functions; made by ``beam_functions``.

    Parameters
    ----------
    parameters, states, base, outputs, rhs, tip, markers, energies
        As those of ``MotionFunctions``; a is in m/s^2 and 1/s^2.
    residual : Function
        (q, v, a, base, p) -> r, N and N m.
    residual_jacobians : Function
        (q, v, a, base, p) -> dr_dq, dr_dv, dr_da, dr_dbase, dr_dp; sparse, but dr_dv under a generic law.
    mass : Function
        p -> M, sparse.
    tangent_stiffness : Function
        (q, base, p) -> K, of the elastic force, sparse.
    damping_force : Function
        (q, v, base, p) -> Q_damp, on the left of the equation of motion.
    equilibrium : Function
        p -> q at rest, base at rest; nan where none was found.
    frequencies : Function
        p -> f, the lowest natural frequencies about the equilibrium, Hz; nan where they are not certain.
    step : Function
        (q, v, base, p, h) -> q_next, v_next, after a time h (s); base (9, 2) at the instants ``STAGES`` of the step.
    """

    residual: cs.Function
    residual_jacobians: cs.Function
    mass: cs.Function
    tangent_stiffness: cs.Function
    damping_force: cs.Function
    equilibrium: cs.Function
    frequencies: cs.Function


def beam_functions(
    model: Model, damping: DampingLaw | None = None, *, markers: Sequence[float] = (), modes: int = 5
) -> BeamFunctions:
    """Return the equation of motion of a beam as CasADi Functions.

    Parameters
    ----------
    model : Model
        The beam, whose properties are the values of the parameters.
    damping : DampingLaw, optional
        The damping law; undamped if not given.
    markers : sequence of float
        Arc lengths of the points whose positions ``markers`` gives, m.
    modes : int
        How many natural frequencies.

    Raises
    ------
    InputError
        If a marker is not on the beam, or there are not so many modes.
    EquilibriumError
        If the beam has no stable equilibrium under gravity.
    """
    equations = Equations(model, RayleighDamping() if damping is None else damping)
    markers = numbers(markers, "markers")
    points = [model.interpolation(s) for s in markers]
    first = natural_modes(model, count=modes)
    parameters, clamp = parameter_signals(equations), base_signals()

    q, v, a = (cs.MX.sym(name, len(range(model.size)[model.free])) for name in ("q", "v", "a"))
    base, p = cs.MX.sym("base", len(clamp)), cs.MX.sym("p", len(parameters))
    symbols = {"q": q, "v": v, "a": a, "base": base, "p": p}
    B, free = cs.DM(equations.projection), model.free
    with_projection = cs.vertcat(p, cs.vec(B))
    balance = equations.balance(with_projection)
    clamped = [node[: free.start] for node in cs.vertsplit(_clamped_node(model, base), NODE)]
    e, e_t, e_tt = (cs.vertcat(*parts) for parts in zip(clamped, (q, v, a), strict=True))

    forces = balance.damping(e, e_t) + balance.conservative(e)
    residual = (balance.inertia(e_tt) + forces)[free]
    driving = (balance.inertia(cs.vertcat(clamped[2], cs.MX(a.numel(), 1))) + forces)[free]
    mass = model.mass(balance.properties)[free, free]
    local = balance.local_damping(e, e_t)[free]
    stiffness = model.tangent_stiffness(e, balance.properties)[free, free]
    dr_dq, dr_dv = stiffness + _jacobian(local, q), _jacobian(local, v)
    if B.numel():
        turned = balance.turned_projection(e)[free, :]
        dr_dv += turned @ cs.diag(balance.modal_coefficients) @ turned.T

    def function(name: str, inputs: Sequence[str], **outputs: cs.MX) -> cs.Function:
        return cs.Function(name, [symbols[key] for key in inputs], [*outputs.values()], [*inputs], [*outputs])

    motion, place = ("q", "v", "base", "p"), ("q", "base")
    equilibrium = equilibrium_function(first.equilibrium, equations, values(parameters))
    whole = function("residual", ("q", "v", "a", "base", "p"), r=residual)
    jacobians = function(
        "residual_jacobians",
        ("q", "v", "a", "base", "p"),
        dr_dq=dr_dq,
        dr_dv=dr_dv,
        dr_da=mass,
        dr_dbase=_jacobian(residual, base),
        dr_dp=_jacobian(residual, p),
    )
    three = cs.Function("three_jacobians", [q, v, a, base, p], [dr_dq, dr_dv, mass])
    return BeamFunctions(
        parameters=parameters,
        states=state_signals(first.equilibrium),
        base=clamp,
        outputs=output_signals(markers),
        residual=whole,
        residual_jacobians=jacobians,
        rhs=function("rhs", motion, a=-_divide(driving, mass, model)),
        mass=function("mass", ("p",), M=mass),
        tangent_stiffness=function("tangent_stiffness", ("q", "base", "p"), K=stiffness),
        damping_force=function("damping_force", motion, Q=balance.damping(e, e_t)[free]),
        tip=function("tip", place, r=cs.DM(model.interpolation(model.beam.length)) @ e),
        markers=function("markers", place, r=cs.horzcat(cs.MX(2, 0), *(cs.DM(point) @ e for point in points))),
        energies=function(
            "energies",
            motion,
            T=cs.dot(e_t, balance.inertia(e_t)) / 2,
            U=model.strain_energy(e, balance.properties),
            V=-cs.dot(e, model.gravity_force(balance.properties, balance.gravity)),
        ),
        equilibrium=equilibrium,
        frequencies=frequencies_function(first, equations, equilibrium),
        step=step_function(whole, three, first),
    )


def _clamped_node(model: Model, base: cs.MX) -> cs.MX:
    """Return position, velocity and acceleration of the clamped node, (12,)."""
    where, rate, rate2 = cs.vertsplit(base, 3)
    t = cs.MX.sym("t")
    piece = Piece(math.inf, lambda t, parameters: where + rate * t + rate2 * t**2 / 2)
    (node,) = cs.graph_substitute([clamped_node(model, piece, t, cs.MX(0, 1))], [t], [cs.MX(0.0)])
    return node


def _jacobian(expression: cs.MX, symbol: cs.MX) -> cs.MX:
    """Return a Jacobian made of one derivative at a time, which keeps the C short."""
    return cs.jacobian(expression, symbol, {"helper_options": {"max_num_dir": 1}})


def _divide(forces: cs.MX, mass: cs.MX, model: Model) -> cs.MX:
    """Return M^-1 Q; x and y have the same mass matrix, and one factor of half the size serves both."""
    x, y = slice(0, None, 2), slice(1, None, 2)
    whole = model.mass(model.properties)[model.free, model.free]
    if cs.norm_inf(whole[x, y]) > 0 or cs.norm_inf(whole[x, x] - whole[y, y]) > 0:
        return cs.solve(mass, forces, "ldl")
    each = cs.solve(mass[x, x], cs.horzcat(forces[x], forces[y]), "ldl")
    return cs.vec(each.T)
