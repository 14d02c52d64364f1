"""The reduced beam under a harmonic excitation, and a sensor on it, as Functions of one instant.

The equation of motion of the modal coordinates q (``ancf_casadi.reduction``) is

    0 = R = M(q) a + h(q, v, u, p) + diag((c_k^2 - 1) w_k^2) q + (E - 1) dU/dq - Q_tip(q, l sin tau),

with the phase tau = omega t and the size l of the excitation: the amplitude of the base motion u = l d sin tau along d,
m, or the multiple of a tip load.  The unknowns s are the parameters p of the damping law, the factors c on the natural
frequencies, and the factor E on the elastic modulus, to which the strain energy U is proportional.  The linear
stiffness that is added to mode k makes its angular frequency at rest c_k w_k exactly.  A model whose frequencies differ
from the measured ones by more than a fraction of the damping ratio has another response altogether, so that the factors
belong to every fit of a damping law.

The sensor reads an expression of the nodal coordinates that belong to q (``derivatives.reading``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as cs

from ancf_casadi.dynamics.derivatives.reading import SampledMotion
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.tip_load import LOAD
from ancf_casadi.reduction import ReducedModel
from problems.response.record import ResponseRecord

INPUTS = ("q", "v", "a", "tau", "omega", "size", "s")
VARIED = ("q", "v", "a", "size", "s")  # inputs by which the Functions have Jacobians


@dataclass(frozen=True, eq=False)
class Driven:
    """A reduced beam under the excitation of a record.

    Parameters
    ----------
    modes : int
        Number of modes n.
    shared : int
        Number of unknowns s.
    forces : Function
        (q, v, a, tau, omega, size, s) -> R (n,), and its Jacobians by q, v, a, size and s.
    reading : Function
        The same inputs -> the reading of the sensor, and its Jacobians by q, v, a, size and s.
    """

    modes: int
    shared: int
    forces: cs.Function
    reading: cs.Function


def driven(reduced: ReducedModel, record: ResponseRecord, make: Callable[[cs.Function], cs.Function]) -> Driven:
    """Return a reduced beam under the kind of excitation of a record, with its sensor.

    Parameters
    ----------
    reduced : ReducedModel
        The beam and the damping law.
    record : ResponseRecord
        The excitation and the sensor.
    make : callable
        Compiles the Functions, or leaves them to the virtual machine.

    Raises
    ------
    InputError
        If the sensor is not on the beam.
    """
    n, laws = reduced.count, len(reduced.law.parameters)
    q, v, a = (cs.SX.sym(name, n) for name in "qva")
    tau, omega, size, s = (
        cs.SX.sym(name, k) for name, k in (("tau", 1), ("omega", 1), ("size", 1), ("s", laws + n + 1))
    )
    base, load = _excitation(record, tau, omega, size)
    p = cs.vertcat(cs.SX(reduced.values[:2]), s[:laws])
    stiffness = (s[laws:-1] ** 2 - 1) * cs.DM(reduced.modes.angular_frequencies**2)
    _, U, _ = reduced.energies(q, v, base, p)
    R = reduced.mass(q) @ (a - reduced.rhs(q, v, base, p)) - _at_tip(reduced, q, base, load)
    R += stiffness * q + (s[-1] - 1) * cs.gradient(U, q)
    symbols = q, v, a, tau, omega, size, s
    y = _sensor(reduced, record)(q, v, a, base, load, s[:laws])
    return Driven(n, laws + n + 1, make(_with_jacobians("forces", R, symbols)), _with_jacobians("reading", y, symbols))


def _with_jacobians(name: str, value: cs.SX, symbols: tuple[cs.SX, ...]) -> cs.Function:
    """Return a Function for an expression and its Jacobians by q, v, a, size and s."""
    jacobians = [cs.densify(cs.jacobian(value, symbols[INPUTS.index(x)])) for x in VARIED]
    return cs.Function(
        name, [*symbols], cs.cse([cs.densify(value), *jacobians]), [*INPUTS], ["value", *(f"by_{x}" for x in VARIED)]
    )


def _excitation(record: ResponseRecord, tau: cs.SX, omega: cs.SX, size: cs.SX) -> tuple[cs.SX, cs.SX]:
    """Return the motion of the clamp, (9,) as in ``ReducedFunctions``, and the load at the tip, (3,)."""
    if record.load is not None:
        return cs.SX.zeros(9), size * cs.sin(tau) * cs.DM([*record.load.force, record.load.moment])
    direction = record.base.direction if record.base is not None else (0.0, 0.0)
    u = size * cs.vertcat(*direction, 0.0)
    return cs.vertcat(u * cs.sin(tau), u * omega * cs.cos(tau), -u * omega**2 * cs.sin(tau)), cs.SX.zeros(LOAD)


def _at_tip(reduced: ReducedModel, q: cs.SX, base: cs.SX, load: cs.SX) -> cs.SX:
    """Return the modal force of a load at the tip, (n,)."""
    e, _ = reduced.coordinates(q, cs.SX.zeros(q.numel()), base)
    position, x, y = e[-4:-2], e[-2], e[-1]
    turn = (x * cs.jacobian(y, q) - y * cs.jacobian(x, q)) / (x**2 + y**2)
    return (load[:2].T @ cs.jacobian(position, q) + load[2] * turn).T


def _sensor(reduced: ReducedModel, record: ResponseRecord) -> cs.Function:
    """Return the reading of the sensor as a Function (q, v, a, base, load, parameters of the law)."""
    n, equations = reduced.count, Equations(reduced.model, reduced.law)
    q, v, a = (cs.MX.sym(name, n) for name in "qva")
    base, load, law = cs.MX.sym("base", 9), cs.MX.sym("load", LOAD), cs.MX.sym("law", len(reduced.law.parameters))
    e, e_t = reduced.coordinates(q, v, base)
    rates = (q, v), (v, a), (base, cs.vertcat(base[3:], cs.MX.zeros(3)))
    e_tt = sum((cs.jtimes(e_t, x, x_t) for x, x_t in rates), cs.MX.zeros(e.numel()))
    gravity, properties, _, projection = equations.layout.split(equations.parameters)
    parameters = cs.vertcat(cs.DM(gravity), cs.DM(properties), law, cs.DM(projection))
    y = SampledMotion(equations, e, e_t, e_tt, load, parameters).read(record.sensor)
    return cs.Function("sensor", [q, v, a, base, load, law], [y]).expand()
