"""Radau IIA collocation of order 5 for the equation of motion: the Functions of a step.

Stages.  With the nodes c and the weights A of the method and a step h, the increments Z_i of the free coordinates at
the stages t + c_i h determine velocities and accelerations there,

    V = A^-1 Z/h,    a = A^-1 (V - v)/h,    0 = R = M e_tt + Q_damp(e, e_t) + Q_e(e) - Q_g - Q_load   at each stage,

and the last stage is the end of the step.

Newton's method.  T^-1 A^-1 T has one real eigenvalue gamma and one complex pair mu.  If all stages share their
matrices, a real and a complex banded system in N unknowns, with s = gamma/h and s = mu/h,

    (s^2 M + s D + K) dW = T^-1 R,    D = dQ_damp/de_t,    K = d(Q_damp + Q_e - Q_load)/de,

replace one system in 3 N (``elimination``).  D omits the part of low rank: per iteration, the error in a mode of
frequency omega and damping ratio zeta is then multiplied by 2 zeta omega |s|/|s^2 + omega^2|, at most 1.5 zeta, and a
thousandth in the lightly damped modes that a step resolves.  The columns of B would cost more.

Relaxation.  The internal strains z of a Maxwell branch (``damping.viscoelastic``) are linear in the strains s at the
stages.  Collocation of tau z_t = s - z from z_0 gives the overstrains there,

    y_i = sum_j W_ij (s_j - z_0),    W = x A^-1 (1 + x A^-1)^-1,    x = tau/h,

and the strain less the overstrain at the last stage is the next z_0.  In the systems with s = gamma/h and s = mu/h, a
branch of relative modulus g would add g phi(s) J^T D J with phi(s) = tau s/(1 + tau s).  So that K and D stay real, phi
is replaced by alpha + beta h s, fitted by least squares to phi(gamma/h) and to the real and imaginary parts of
phi(mu/h).  The fit is exact in the limits of short and long relaxation times; its error in between, at most 0.1, slows
down the convergence.  The error estimate omits the branches.

As the beam turns, K changes by its axial part, which is thousands of times stiffer than its bending part; in
coordinates that turn with the beam, K hardly changes.  Residuals are therefore turned back to the configuration in
which the matrices were evaluated, and corrections are turned forth from there (``links``).

Prediction.  The collocation polynomial of the last step is extrapolated in the logarithms of the beam's slopes: errors
of the coordinates themselves would stretch the beam.

Error.  The estimate is the embedded formula of order 3 of Hairer and Wanner, filtered by the real system, and like it
without the part of low rank, which would change it by less than 2 zeta.

The virtual machine of CasADi takes longer for one operation on arrays than machine code for the forces of an element.
All that belongs to a node is therefore done in a few compiled passes along the beam, on arrays with a column per link.

References
----------
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer (1996), Sections IV.5 and IV.8.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import SimpleNamespace

import casadi as cs
import numpy as np
import scipy.sparse.linalg

from ancf_casadi.damping.law import rotate_pairs
from ancf_casadi.dynamics.equations import Balance, Equations, map_elements
from ancf_casadi.dynamics.excitation import EXCITATION
from ancf_casadi.dynamics.placed_load import load_force, load_on_element
from ancf_casadi.dynamics.radau.elimination import BLOCK, LINK
from ancf_casadi.dynamics.radau.link import VALUES
from ancf_casadi.dynamics.radau.links import Iterate, Links, Projection
from ancf_casadi.dynamics.radau.tableau import RADAU, STAGES, overstrain_weights
from ancf_casadi.mechanics.element import Group
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array

MIDDLE = STAGES // 2  # stage in which the matrices are taken


@dataclass(frozen=True, eq=False)
class Collocation:
    """The Functions of a step.

    Free coordinates, velocities and accelerations are q, v and a (N,).  Increments Z and corrections dW have a column
    per link with the numbers of its second node (12, links), stage by stage: those of Z are N times the increments of
    the free coordinates, those of dW the real part of W = Z T^-T, and the real and the imaginary part of the complex
    one.  ``excitations`` (16, 3) are those at the stages.  ``turns`` lead to the stages from ``reference``, all
    coordinates (4, nodes) of the configuration in which the matrices were taken.
    """

    equations: Equations

    def __eq__(self, other: object) -> bool:
        """Return whether the Functions are the same: they all follow from the forces, whose parameters are inputs."""
        return isinstance(other, Collocation) and self._text == other._text

    def __hash__(self) -> int:
        """Return the hash of the forces."""
        return hash(self._text)

    @cached_property
    def links(self) -> Links:
        """The links of the beam."""
        return Links(self.equations.model, self.equations.make, self.equations.projection.shape[1])

    @cached_property
    def columns(self) -> cs.Function:
        """(parameters) -> properties and constants, one column per element and stage, and the ``Projection``."""
        balance, model = self._balance, self.equations.model
        along_x = rotate_pairs(balance.projection, model.beam.axis, (1.0, 0.0))
        by_node = cs.horzcat(*map(cs.vec, cs.vertsplit(along_x, NODE)))
        outputs = [*self.element_columns(balance), by_node[:, 0], by_node[:, 1:]]
        return _function("columns", [self._symbols.parameters], outputs)

    def element_columns(self, balance: Balance) -> tuple[cs.MX, cs.MX]:
        """Return the outputs of ``columns``."""
        group = self.equations.model.groups[0]
        properties = group.properties(balance.properties, balance.lumped)
        thrice = np.repeat(np.arange(group.count), STAGES).tolist()
        constants = cs.repmat(cs.vertcat(balance.gravity, balance.coefficients), 1, STAGES * group.count)
        return properties[:, thrice], constants

    @cached_property
    def stages(self) -> cs.Function:
        """(``_symbols``) -> dW, Z, turns, weighted norm of dW.

        Z is corrected by the last dW; the results are the next dW and the turns to the stages.
        """
        s = self._symbols
        # Z minus T dW, turned forth, and turns, motion of the links and modal velocities at the stages
        increments, turns, *motion, modal_velocities = self.links.advance(
            self._iterate, s.q, s.v, s.h, self._base, s.reference, self._projection
        )
        overstrains, _ = self._relaxation(motion[0])
        on_links, further = self._forces(motion, self._whole(motion), overstrains)
        modal = cs.diag(self._balance.modal_coefficients) @ modal_velocities
        corrections = self._solution(on_links, further[:, 1:], turns, modal)
        size = cs.norm_2(cs.vec(s.weights * corrections))
        return _function("stages", [*vars(s).values()], [corrections, increments, turns, size])

    @cached_property
    def finish(self) -> cs.Function:
        """(``_symbols``, a) -> coordinates at the stages (12, nodes), then at the end q, v and a (N, 3), error and z.

        The error is a norm, and z are the internal strains (m b, n).
        """
        s, a, model = self._symbols, cs.MX.sym("a", self.equations.free), self.equations.model
        base, base_rate, *_ = cs.vertsplit(self._base, NODE)
        increments, coordinates = self.links.update(self._iterate, s.q, base)
        *rates, deviation, deviation_rate = self.links.end(increments, s.v, a, s.h)
        end = [s.q + self.links.free(increments[-NODE:, :]), *map(self.links.free, rates)]
        e, e_t = (model.whole(x, b[:, -1]) for x, b in zip(end[:2], (base, base_rate), strict=True))
        error = self._error(e, e_t, deviation, deviation_rate)
        size = math.sqrt(STAGES) * cs.norm_2(cs.vec(s.weights[:NODE, :] * error))
        nodes = cs.horzcat(cs.vec(base), coordinates)
        pairs = (x for of_stage in cs.vertsplit(nodes, NODE) for x in (of_stage[:, :-1], of_stage[:, 1:]))
        _, internal = self._relaxation(cs.vertcat(*pairs))
        return _function("finish", [*vars(s).values(), a], [nodes, cs.horzcat(*end), size, internal])

    def _error(self, e: cs.MX, e_t: cs.MX, deviation: cs.MX, rate: cs.MX) -> cs.MX:
        """Return the estimated error (4, links), turned back, from the embedded deviation and its rate (4, links).

        It is filtered by the resistance to them at the end, where the motion of all nodes is e and e_t (4 n + 4,).
        """
        s, equations = self._symbols, self.equations
        balance, real, root = self._balance, RADAU.gamma / s.h, equations.model.root
        u, w = (cs.vertcat(cs.MX.zeros(NODE), cs.vec(x)) for x in (deviation, rate))
        columns = [self.links.pairs(x)[:, root:] for x in (e, e_t, u, w)]
        numbers = s.properties[:, ::STAGES], s.constants[:, ::STAGES]
        (force,) = map_elements(equations.element("resistance", 0), *columns, *numbers)
        further = cs.MX(*u.shape)
        if self._others:
            (by_element,) = equations.map_elements("resistance", balance, e, e_t, u, w, groups=self._others)
            further += equations.model.sum_at_nodes(by_element, self._others.values())
        # residuals of the real system alone, in the frame of the last stage
        at_stages = RADAU.transform[:, :1]
        forces = cs.sparsify(cs.DM(np.kron(at_stages, np.eye(LINK)))) @ (real * force)
        on_links = cs.horzcat(cs.MX(LINK * STAGES, root), forces) if root else forces
        on_nodes = self.links.node_by_node(real * further @ cs.DM(at_stages).T)[:, 1:]
        modal = cs.MX.zeros(self.links.modes, STAGES)
        return self._solution(on_links, on_nodes, self.links.last_turns(s.turns), modal)[:NODE, :]

    @cached_property
    def factors(self) -> cs.Function:
        """(Z, q, v, h, excitation of the middle stage, parameters, z) -> reference, outer and inner factors."""
        s, excitation = self._symbols, cs.MX.sym("excitation", EXCITATION)
        position, velocity, _, load = cs.vertsplit(excitation, NODE)
        model, middle = self.equations.model, slice(NODE * MIDDLE, NODE * (MIDDLE + 1))
        e = model.whole(s.q, position) + cs.vertcat(cs.MX(NODE, 1), cs.vec(s.increments[middle, :]))
        balance = self._balance
        k, d, m = balance.tangents(e, model.whole(s.v, velocity), load, balance.overstrains(e, s.internal))
        if self.equations.branches:
            products, (alpha, beta) = balance.strain_products(e), self._newton_weights
            k, d = k + alpha * products, d + beta * products
        rates = cs.vertcat(RADAU.gamma, RADAU.mu.real, RADAU.mu.imag) / s.h
        k, d, m = self.links.matrices(k, unit=1.0), self.links.matrices(d), self.links.matrices(m)
        outer, inner = self.links.factors(k, d, m, rates)
        inputs = [s.increments, s.q, s.v, s.h, excitation, s.parameters, s.internal]
        return _function("factors", inputs, [cs.reshape(e, NODE, -1), outer, inner])

    @cached_property
    def prediction(self) -> cs.Function:
        """(nodes, ratio, excitations) -> Z.

        ``nodes`` (16, nodes) are all coordinates at the start and the stages of the last step; ``ratio`` is the length
        of the new step relative to the last one.
        """
        s, ratio = self._symbols, cs.MX.sym("ratio")
        nodes = cs.MX.sym("nodes", NODE * (STAGES + 1), self.links.count + 1)
        instants = np.concatenate([[0.0], RADAU.nodes])
        x = cs.SX.sym("ratio")
        weights = [cs.vertcat(*_lagrange(instants, 1 + c * x)[1:]) for c in RADAU.nodes.tolist()]
        increments = self.links.extrapolate(
            nodes, cs.Function("weights", [x], [cs.horzcat(*weights)])(ratio), s.excitations[: 3 * NODE, :]
        )
        return _function("prediction", [nodes, ratio, s.excitations], [increments])

    def trial(self, excitation: cs.Function) -> cs.Function:
        """(t, h, ratio, nodes) -> the excitations (t) -> (16,) at the stages of a step, (16, 3), and Z."""
        t, h, ratio = (cs.MX.sym(name) for name in ("t", "h", "ratio"))
        nodes = cs.MX.sym("nodes", *self.prediction.size_in(0))
        excitations = cs.horzcat(*(excitation(t + c * h) for c in RADAU.nodes.tolist()))
        return cs.Function("trial", [t, h, ratio, nodes], [excitations, self.prediction(nodes, ratio, excitations)])

    def accelerations(self, q: Array, v: Array, excitation: Array, parameters: Array, internal: Array) -> Array:
        """Return the accelerations a in a state (q, v, internal strains) under an excitation (16,)."""
        forces = self.balance(q, v, 0 * q, excitation, parameters, internal).full().ravel()
        return np.asarray(scipy.sparse.linalg.spsolve(self.mass(parameters).sparse(), -forces))

    @cached_property
    def mass(self) -> cs.Function:
        """(parameters) -> mass matrix of the free coordinates."""
        return cs.Function("mass", [self._symbols.parameters], [self._balance.free_mass()])

    @cached_property
    def _text(self) -> str:
        """The forces as text, with the constants of the mesh, the supports and the law."""
        return str(self.balance.serialize())

    @cached_property
    def _others(self) -> dict[int, Group]:
        """The groups of elements besides those of the beam, by number: what is attached to it."""
        return dict(enumerate(self.equations.model.groups[1:], start=1))

    @property
    def _base(self) -> cs.MX:
        """Position, velocity and acceleration of the base at the stages, (12, 3)."""
        base: cs.MX = self._symbols.excitations[: 3 * NODE, :]
        return base

    @property
    def _iterate(self) -> Iterate:
        return self._symbols.corrections, self._symbols.turns, self._symbols.increments

    @property
    def _projection(self) -> Projection:
        return self._symbols.base_projection, self._symbols.projection

    @cached_property
    def _balance(self) -> Balance:
        """The terms of the equation of motion for the parameters of ``_symbols``."""
        return self.equations.balance(self._symbols.parameters)

    def _whole(self, motion: Sequence[cs.MX]) -> list[cs.MX]:
        """Return e, e_t and e_tt (4 n + 4, 3) at the stages from those of the links (24, links)."""
        base = cs.vertsplit(self._base, NODE)
        return [self.links.whole(node, of_links) for node, of_links in zip(base, motion, strict=True)]

    def relaxation(
        self, coordinates: cs.MX, columns: tuple[cs.MX, cs.MX], internal: cs.MX, h: cs.MX, balance: Balance
    ) -> tuple[cs.MX | None, cs.MX]:
        """Return the overstrains, (m b, 3 n), one column per element and stage, and the internal strains at the end.

        ``coordinates`` are those of links at the stages, (24, links), ``columns`` those of ``element_columns``, and
        ``internal`` (m b, n) the internal strains at the start.  Without Maxwell branches, there are no overstrains.
        """
        equations = self.equations
        if not equations.branches:
            return None, internal
        coordinates = cs.reshape(coordinates[:, equations.model.root :], LINK, -1)
        (strains,) = map_elements(equations.element("strains", 0), coordinates, *columns)
        strains = cs.reshape(strains, -1, equations.model.beam.elements)
        m, branches = strains.size1() // STAGES, []
        for first, (weights, *_) in zip(cs.vertsplit(internal, m), self.branch_weights(h, balance), strict=True):
            overstrains = cs.kron(weights, cs.DM.eye(m)) @ (strains - cs.repmat(first, STAGES, 1))
            branches.append(cs.reshape(overstrains, m, -1))
        of_all = cs.vertcat(*branches)
        return of_all, cs.repmat(strains[-m:, :], len(branches), 1) - of_all[:, STAGES - 1 :: STAGES]

    def branch_weights(self, h: cs.MX, balance: Balance) -> list[list[cs.MX]]:
        """Return the results of ``overstrain_weights`` of each branch."""
        _, times = self.equations.law.branches(balance.coefficients)
        return [overstrain_weights().call([tau / h]) for tau in cs.vertsplit(times)]

    def _relaxation(self, coordinates: cs.MX) -> tuple[cs.MX | None, cs.MX]:
        """Return the results of ``relaxation`` for the symbols of a step."""
        s = self._symbols
        return self.relaxation(coordinates, (s.properties, s.constants), s.internal, s.h, self._balance)

    @property
    def _newton_weights(self) -> tuple[cs.MX, cs.MX]:
        """The weights sum_b g_b alpha_b and sum_b g_b beta_b h of J^T D J in K and D."""
        moduli, _ = self.equations.law.branches(self._balance.coefficients)
        of_branches = self.branch_weights(self._symbols.h, self._balance)
        alpha, beta = zip(*(weights[1:] for weights in of_branches), strict=True)
        return cs.dot(moduli, cs.vertcat(*alpha)), cs.dot(moduli, cs.vertcat(*beta)) * self._symbols.h

    def _forces(
        self, motion: Sequence[cs.MX], all_nodes: Sequence[cs.MX], overstrains: cs.MX | None
    ) -> tuple[cs.MX, cs.MX]:
        """Return the outputs of ``forces`` for the symbols of a step, those on all nodes as columns (12, nodes)."""
        s = self._symbols
        columns = s.properties, s.constants
        on_links, further = self.forces(motion, all_nodes, s.excitations, self._balance, columns, overstrains)
        return on_links, self.links.node_by_node(further)

    def forces(
        self,
        motion: Sequence[cs.MX],
        all_nodes: Sequence[cs.MX],
        excitations: cs.MX,
        balance: Balance,
        columns: tuple[cs.MX, cs.MX],
        overstrains: cs.MX | None = None,
    ) -> tuple[cs.MX, cs.MX]:
        """Return the forces on both nodes of each link (24, links), and others on all nodes (4 n + 4, 3).

        Both are without the low-rank part of the damping.
        ``motion`` are e, e_t and e_tt of the links (24, links) at the stages, and ``all_nodes`` those of all nodes.
        """
        equations, model, root = self.equations, self.equations.model, self.equations.model.root
        load = excitations[3 * NODE :, :]
        coordinates = [cs.reshape(x[:, root:] if root else x, LINK, -1) for x in motion]
        of_branches = [] if overstrains is None else [overstrains]
        (forces,) = map_elements(equations.element("balance", 0), *coordinates, *of_branches, *columns)
        forces, further = cs.reshape(forces, LINK * STAGES, -1), cs.MX(model.size, STAGES)
        if place := equations.place:
            index, _ = model.place_at(place.place(model.beam))
            at_load = cs.reshape(motion[0][:, index + root], LINK, STAGES)
            forces[:, index] -= cs.vec(load_on_element(model, place, at_load, load))
        else:
            further -= load_force(model, None, all_nodes[0], load)
        if self._others:
            (by_element,) = equations.map_elements("balance", balance, *all_nodes, groups=self._others)
            further += model.sum_at_nodes(by_element, self._others.values())
        return cs.horzcat(cs.MX(LINK * STAGES, root), forces) if root else forces, further

    def _solution(self, on_links: cs.MX, further: cs.MX, turns: cs.MX, modal: cs.MX) -> cs.MX:
        """Return the solution dW for forces on the links, on their second nodes, and on the modes."""
        s, links = self._symbols, self.links
        reduced = links.reduce(on_links, further, turns, s.outer, modal, self._base, self._projection)
        return links.substitute(reduced, s.inner)

    @cached_property
    def _symbols(self) -> SimpleNamespace:
        """The inputs of ``stages``, in order, which the other Functions share."""
        free, model, links = self.equations.free, self.equations.model, self.links.count
        elements, constants = model.beam.elements, 2 + len(self.equations.law.parameters)
        return SimpleNamespace(
            increments=cs.MX.sym("Z", VALUES, links),
            corrections=cs.MX.sym("dW", VALUES, links),
            turns=cs.MX.sym("turns", VALUES, links),
            q=cs.MX.sym("q", free),
            v=cs.MX.sym("v", free),
            h=cs.MX.sym("h"),
            excitations=cs.MX.sym("excitations", EXCITATION, STAGES),
            reference=cs.MX.sym("reference", NODE, links + 1),
            parameters=cs.MX.sym("parameters", self.equations.parameters.size),
            properties=cs.MX.sym("properties", model.groups[0].element.elastic_force.size1_in(1), STAGES * elements),
            constants=cs.MX.sym("constants", constants, STAGES * elements),
            base_projection=cs.MX.sym("B_0", NODE * self.links.modes),
            projection=cs.MX.sym("B", NODE * self.links.modes, links),
            outer=cs.MX.sym("outer", 3 * BLOCK, links),
            inner=cs.MX.sym("inner", 6 * BLOCK, links),
            weights=cs.MX.sym("weights", VALUES, links),
            internal=cs.MX.sym("internal", *self.equations.internal_shape),
        )

    @cached_property
    def balance(self) -> cs.Function:
        """(q, v, a, excitation, parameters, internal strains) -> forces on the free coordinates."""
        q, v, a = (cs.MX.sym(name, self.equations.free) for name in "qva")
        s, excitation, model = self._symbols, cs.MX.sym("excitation", EXCITATION), self.equations.model
        *of_base, load = cs.vertsplit(excitation, NODE)
        e, e_t, e_tt = (model.whole(x, b) for x, b in zip((q, v, a), of_base, strict=True))
        overstrains = self._balance.overstrains(e, s.internal)
        forces = model.of_free(self._balance.forces(e, e_t, e_tt, load, overstrains))
        return cs.Function("balance", [q, v, a, excitation, s.parameters, s.internal], [forces])


@lru_cache(8)
def shared_form(equations: Equations) -> Collocation:
    """Return the Functions of a step, those of an earlier run under the same forces if there was one."""
    return first_equal(Collocation(equations))


@lru_cache(8)
def first_equal(form: Collocation) -> Collocation:
    """Return the same Functions of an earlier run, if there are any, which spares the time to derive them again."""
    return form


def _lagrange(nodes: Array, x: cs.SX) -> list[cs.SX]:
    """Return the Lagrange polynomials of some nodes at x."""
    factors = [[(x - other) / (node - other) for other in nodes if other != node] for node in nodes]
    return [math.prod(of_node, start=cs.SX(1)) for of_node in factors]


def _function(name: str, inputs: list[cs.MX], outputs: list[cs.MX]) -> cs.Function:
    return cs.Function(name, inputs, [cs.densify(x) for x in outputs], {"is_diff_in": [False] * len(inputs)})
