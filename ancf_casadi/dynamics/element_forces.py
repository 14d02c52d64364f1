"""Functions of one element under a damping law: its contribution to the equation of motion.

With c = (acceleration of gravity, parameters of the law), an element contributes

    Q = M e_tt + Q_damp(e, e_t) + Q_e(e) - Q_g    and the power e_t . Q_damp,

in which Q_damp is the local part of the damping.  The integrators map these Functions over the elements of the beam.
The Functions depend neither on the mesh nor on any value of the beam or the law, so their machine code is short and
serves all beams.

A call from CasADi's virtual machine costs about as much as the forces of an element.  Compiled Functions therefore take
``ELEMENTS_PER_CALL`` elements per call; the last call is padded with copies of the last element.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs

from ancf_casadi.damping import DampingLaw
from ancf_casadi.mechanics.element import Element

ELEMENTS_PER_CALL = 10  # elements per call of a compiled Function


@dataclass(frozen=True, eq=False)
class ElementFunctions:
    """The Functions of one element under a damping law.

    The inputs are coordinates e (d), velocities e_t and accelerations e_tt, the properties p of the element, and c.
    """

    element: Element
    law: DampingLaw
    make: Callable[[cs.Function], cs.Function]  # compiles a Function, or leaves it to the virtual machine

    @cached_property
    def balance(self) -> cs.Function:
        """(e, e_t, e_tt, p, c) -> Q (d,), and the power lost to damping."""
        e, e_t, e_tt, p, c = self._symbols
        damping = self._damping
        weight = self.element.gravity_force(p, c[:2])
        force = self.element.inertia_force(e_tt, p) + damping + self.element.elastic_force(e, p) - weight
        return self._function("balance", [e, e_t, e_tt, p, c], [force, cs.dot(e_t, damping)])

    @cached_property
    def tangents(self) -> cs.Function:
        """(e, e_t, p, c) -> K = dQ/de, D = dQ/de_t and M, (d, d)."""
        e, e_t, _, p, c = self._symbols
        damping = self._damping
        k = self.element.tangent_stiffness(e, p) + cs.jacobian(damping, e)
        outputs = [k, cs.jacobian(damping, e_t), self.element.mass(p)]
        return self._function("tangents", [e, e_t, p, c], outputs, is_diff_in=[False] * 4)

    @cached_property
    def resistance(self) -> cs.Function:
        """(e, e_t, u, w, p, c) -> D u + M w."""
        e, e_t, w, p, c = self._symbols
        u = cs.SX.sym("u", e.numel())
        force = cs.jtimes(self._damping, e_t, u) + self.element.inertia_force(w, p)
        return self._function("resistance", [e, e_t, u, w, p, c], [force], is_diff_in=[False] * 6)

    @cached_property
    def _symbols(self) -> tuple[cs.SX, cs.SX, cs.SX, cs.SX, cs.SX]:
        d, k = self.element.elastic_force.size1_in(0), self.element.elastic_force.size1_in(1)
        sizes = {"e": d, "e_t": d, "e_tt": d, "p": k, "c": 2 + len(self.law.parameters)}
        e, e_t, e_tt, p, c = (cs.SX.sym(name, size) for name, size in sizes.items())
        return e, e_t, e_tt, p, c

    @cached_property
    def _damping(self) -> cs.SX:
        e, e_t, _, p, c = self._symbols
        return self.law.local_force(self.element, e, e_t, p, c[2:]) + self.element.dashpot_force(e_t, p)

    def _function(self, name: str, inputs: list[cs.SX], outputs: list[cs.SX], **options: Any) -> cs.Function:
        """Return a Function of columns, one per element of a call."""
        one = cs.Function(name, inputs, [cs.densify(output) for output in outputs], {"cse": True, **options})
        return self.make(side_by_side(one, **options))


def side_by_side(one: cs.Function, **options: Any) -> cs.Function:
    """Return the Function of ``ELEMENTS_PER_CALL`` columns that evaluates a Function of one column for each."""
    columns = [cs.MX.sym(f"x{k}", one.size1_in(k), ELEMENTS_PER_CALL) for k in range(one.n_in())]
    return cs.Function(one.name(), columns, one.map(ELEMENTS_PER_CALL).call(columns), options)


def mapped(function: cs.Function, *columns: cs.MX) -> list[cs.MX]:
    """Evaluate a Function from ``side_by_side`` for any number of columns."""
    count, together = columns[0].size2(), function.size2_in(0)
    padding = -count % together
    padded = [cs.horzcat(x, cs.repmat(x[:, -1], 1, padding)) if padding else x for x in columns]
    results = function.map((count + padding) // together).call(padded)
    widths = [function.size2_out(k) // together for k in range(function.n_out())]
    return [result[:, : count * width] for width, result in zip(widths, results, strict=True)]
