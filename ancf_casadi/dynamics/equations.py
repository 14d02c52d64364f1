"""The equation of motion, Eq. (6) with damping, in the form that the integrators use.

The free coordinates q, their velocities v and accelerations a obey

    q_t = v,    v_t = a,    0 = N^T (M e_tt + Q_damp(e, e_t) + Q_e(e) - Q_g - Q_load(e, t)),    e = N q + G b.

Position, velocity and acceleration of the base b (``excitation``) are part of e, e_t and e_tt; G^T times the balance
gives the generalized force of the base on the beam.  Q_load is the generalized force of the load (``tip_load``).
The dashpots of the beam are part of the damping.

The damping force has a local part, as sparse as the mesh, and a low-rank part R B diag(d) B^T R^T e_t, which turns with
the clamp (``damping.law``).  Each integrator keeps its matrices sparse in its own way.

Gravity, the properties of the elements, the parameters of the law, B, the tip mass and the stiffness of the clamp are
inputs.  The forces of one element and their derivatives are compiled here: mapped over the elements, they serve all
beams, all meshes and all values of the parameters of a law.  With c = (acceleration of gravity, parameters of the law),
an element contributes

    Q = M e_tt + Q_damp(e, e_t) + Q_e(e) - Q_g,

in which Q_damp is the local part of the damping.  If the law has Maxwell branches (``damping.viscoelastic``), their
overstrains y, scaled by the square roots of the stiffnesses, are a further input of the elements of the beam, and
J^T sum_b g_b y_b belongs to Q_damp, with the Jacobian J of the scaled strains.

A call from CasADi's virtual machine costs about as much as the forces of an element.  Compiled Functions therefore take
``ELEMENTS_PER_CALL`` elements per call; the last call is padded with copies of the last element.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.damping.law import refuse_branches, rotate_pairs
from ancf_casadi.dynamics.placed_load import TIP, load_force, load_stiffness
from ancf_casadi.mechanics.element import Element, Group
from ancf_casadi.mechanics.loads import LineLoad, PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array, Layout
from ancf_casadi.support.last_calls import keep_last

ELEMENTS_PER_CALL = 10  # elements per call of a compiled Function
OF_A_STEP = ("balance", "tangents", "resistance")  # element Functions that each step needs, compiled in parallel
OF_BRANCHES = ("strains", "gradients")  # element Functions that a law with Maxwell branches needs besides
RELAXING = ("balance", "lost_power", "tangents")  # element Functions to which Maxwell branches contribute

Make = Callable[[Sequence[cs.Function]], list[cs.Function]]  # compiles Functions, or leaves them to the virtual machine


def element_function(name: str, element: Element, law: DampingLaw, compiled: bool, branches: int = 0) -> cs.Function:
    """Return a Function of one element under a damping law, for columns, one per element of a call.

    balance      (e, e_t, e_tt, p, c) -> Q (d,)
    lost_power   (e, e_t, p, c) -> e_t . Q_damp
    tangents     (e, e_t, p, c) -> K = dQ/de, D = dQ/de_t and M, (d, d)
    resistance   (e, e_t, u, w, p, c) -> D u + M w
    strains      (e, p, c) -> s (m,), scaled: their squares add up to twice the strain energy
    gradients    (e, p, c) -> J = ds/de (m, d) and J^T J

    With ``branches``, the first three have the overstrains y (m b,) as a further input before p.
    """
    d, k = element.elastic_force.size1_in(0), element.elastic_force.size1_in(1)
    e, e_t, e_tt, u = (cs.SX.sym(symbol, d) for symbol in ("e", "e_t", "e_tt", "u"))
    p, c = cs.SX.sym("p", k), cs.SX.sym("c", 2 + len(law.parameters))
    damping, overstrains = law.local_force(element, e, e_t, p, c[2:]) + element.dashpot_force(e_t, p), []
    if branches and name in RELAXING:
        strains, (moduli, _) = element.scaled_strains(e, p), law.branches(c[2:])
        overstrains = [cs.SX.sym("y", strains.numel() * branches)]
        damping += cs.jtimes(strains, e, cs.reshape(overstrains[0], -1, branches) @ moduli, True)
    if name == "balance":
        weight = element.gravity_force(p, c[:2])
        force = element.inertia_force(e_tt, p) + damping + element.elastic_force(e, p) - weight
        inputs, outputs = [e, e_t, e_tt, *overstrains, p, c], [force]
    elif name == "lost_power":
        inputs, outputs = [e, e_t, *overstrains, p, c], [cs.dot(e_t, damping)]
    elif name == "tangents":
        stiffness = element.tangent_stiffness(e, p) + cs.jacobian(damping, e)
        inputs, outputs = [e, e_t, *overstrains, p, c], [stiffness, cs.jacobian(damping, e_t), element.mass(p)]
    elif name == "strains":
        inputs, outputs = [e, p, c], [element.scaled_strains(e, p)]
    elif name == "gradients":
        J = cs.jacobian(element.scaled_strains(e, p), e)
        inputs, outputs = [e, p, c], [J, J.T @ J]
    else:
        force = cs.jtimes(damping, e_t, u) + element.inertia_force(e_tt, p)
        inputs, outputs = [e, e_t, u, e_tt, p, c], [force]
    fixed = name == "resistance" or (name in ("tangents", "lost_power") and compiled)
    options: Any = {"is_diff_in": [False] * len(inputs)} if fixed else {}
    of_element = cs.Function(name, inputs, [cs.densify(output) for output in outputs], {"cse": True, **options})
    return side_by_side(of_element, **options)


def side_by_side(function: cs.Function, **options: Any) -> cs.Function:
    """Return the Function of ``ELEMENTS_PER_CALL`` columns that evaluates a Function of one column for each."""
    columns = [cs.MX.sym(f"x{k}", function.size1_in(k), ELEMENTS_PER_CALL) for k in range(function.n_in())]
    return cs.Function(function.name(), columns, function.map(ELEMENTS_PER_CALL).call(columns), options)


def map_elements(function: cs.Function, *columns: cs.MX) -> list[cs.MX]:
    """Evaluate a Function from ``side_by_side`` for any number of columns."""
    count, together = columns[0].size2(), function.size2_in(0)
    padding = -count % together
    padded = [cs.horzcat(x, cs.repmat(x[:, -1], 1, padding)) if padding else x for x in columns]
    results = function.map((count + padding) // together).call(padded)
    widths = [function.size2_out(k) // together for k in range(function.n_out())]
    return [result[:, : count * width] for width, result in zip(widths, results, strict=True)]


def as_they_are(functions: Sequence[cs.Function]) -> list[cs.Function]:
    """Return Functions unchanged, for CasADi's virtual machine or for code that it generates."""
    return list(functions)


def scaled_matrix(matrix: cs.MX, left: cs.MX | cs.DM, right: cs.MX | cs.DM) -> cs.MX:
    """Return diag(left) A diag(right) for a sparse matrix A."""
    rows, columns = matrix.sparsity().get_triplet()
    factors = cs.vec(cs.MX(left)[rows]) * cs.vec(cs.MX(right)[columns])
    return cs.MX(matrix.sparsity(), cs.vec(matrix.nz[:]) * factors)


@dataclass(frozen=True, eq=False)
class Equations:
    """The equation of motion of a beam under a damping law."""

    model: Model
    law: DampingLaw
    make: Make = as_they_are
    place: PointLoad | None = TIP  # where the load acts; None if it travels

    @cached_property
    def _element_functions(self) -> dict[tuple[str, int], cs.Function]:
        """The Functions of ``element``, as far as used."""
        return {}

    def element(self, name: str, group: int) -> cs.Function:
        """Return a Function of the elements of a group (``element_function``); that of a single one is not compiled."""
        if (name, group) not in self._element_functions:
            elements = self.model.groups[group]
            make, branches = self.make if elements.count > 1 else as_they_are, 0 if group else self.branches
            together = (*OF_A_STEP, *OF_BRANCHES) if branches else OF_A_STEP
            names, compiled = together if name in together else (name,), make is not as_they_are
            functions = make([element_function(key, elements.element, self.law, compiled, branches) for key in names])
            self._element_functions.update(
                ((key, group), function) for key, function in zip(names, functions, strict=True)
            )
        return self._element_functions[name, group]

    @cached_property
    def flow(self) -> tuple[LineLoad, ...]:
        """The loads of a flow on the beam at rest, if the law has one."""
        return self.law.loads(self.model.beam)

    @property
    def free(self) -> int:
        """Number N of free coordinates."""
        return self.model.freedoms

    @cached_property
    def branches(self) -> int:
        """Number b of Maxwell branches of the law."""
        return self.law.branch_values[0].size

    @cached_property
    def internal_shape(self) -> tuple[int, int]:
        """Numbers m b of internal strains in an element, and n of elements."""
        return self.model.groups[0].element.scaled_strains.size1_out(0) * self.branches, self.model.beam.elements

    @property
    def internal_size(self) -> int:
        """Number m b n of internal strains."""
        return math.prod(self.internal_shape)

    @cached_property
    def relaxed(self) -> cs.Function:
        """(e, parameters) -> the internal strains of a beam that has relaxed, (m b n,)."""
        e, parameters = cs.MX.sym("e", self.model.size), cs.MX.sym("parameters", self.layout.size)
        relaxed = cs.vec(cs.repmat(self.balance(parameters).strains(e), self.branches, 1))
        return cs.Function("relaxed", [e, parameters], [cs.densify(relaxed)])

    def internal(self, state: State, parameters: Array) -> Array:
        """Return the internal strains of a state, (m b n,)."""
        if not self.branches:
            return np.zeros(0)
        return self.relaxed(state.coordinates, parameters).full().ravel() if state.internal is None else state.internal

    @cached_property
    def projection(self) -> Array:
        """B of the damping law, (4 n + 4, m)."""
        return self.law.projection(self.model)

    @cached_property
    def _parts(self) -> dict[str, Array]:
        """All inputs of the forces besides the motion, by name."""
        values_by_name = {
            "gravity": self.model.beam.gravity,
            "properties": self.model.properties.T.ravel(),
            "law": [parameter.value for parameter in self.law.parameters],
            "projection": self.projection.T.ravel(),
            "lumped": [*self.model.lumped.values()],
        }
        return {name: np.asarray(values, dtype=float) for name, values in values_by_name.items()}

    @cached_property
    def parameters(self) -> Array:
        """Gravity, properties, parameters of the law, B and lumped properties, one after the other."""
        return np.concatenate([*self._parts.values()])

    @cached_property
    def layout(self) -> Layout:
        """Layout of ``parameters``."""
        return Layout.of(**{name: values.size for name, values in self._parts.items()})

    def parameters_with(self, **replacements: cs.MX) -> cs.MX:
        """Return ``parameters`` with others in place of those of the model, by their names in ``layout``."""
        return cs.vertcat(
            *({name: cs.MX(cs.DM(values)) for name, values in self._parts.items()} | replacements).values()
        )

    def balance_for(self, p: cs.MX) -> Balance:
        """Return the terms of the equation of motion for p: gravity, properties and parameters of the law."""
        return self.balance(cs.vertcat(p, cs.DM(self.parameters[p.numel() :])))

    def balance(self, parameters: cs.MX) -> Balance:
        """Return the terms of the equation of motion for (symbolic) parameters in the order of ``parameters``."""
        model = self.model
        gravity, properties, coefficients, projection, lumped = cs.vertsplit(parameters, self.layout.offsets)
        return Balance(
            equations=self,
            gravity=gravity,
            properties=cs.reshape(properties, *model.properties.shape),
            coefficients=coefficients,
            projection=cs.reshape(projection, *self.projection.shape),
            lumped=dict(zip(model.lumped, cs.vertsplit(lumped), strict=True)),
        )

    def map_elements(
        self,
        name: str,
        balance: Balance,
        *vectors: cs.MX,
        groups: Mapping[int, Group] | None = None,
        overstrains: cs.MX | None = None,
    ) -> list[list[cs.MX]]:
        """Evaluate an element Function for all elements, from coordinates and so on at all nodes, (4 n + 4, s) each.

        Each of the s columns is a state of the beam.  For each output of the Function, a list has the values for the
        elements of each group, side by side, state by state.  Some ``groups`` may be given, by their numbers.  Under a
        law with Maxwell branches, the Functions in ``RELAXING`` need the overstrains, (m b, n s).
        """
        states, c = vectors[0].size2(), cs.vertcat(balance.gravity, balance.coefficients)
        results = []
        for k, group in (dict(enumerate(self.model.groups)) if groups is None else groups).items():
            count = states * group.count
            p = cs.repmat(group.properties(balance.properties, balance.lumped), 1, states)
            columns = [*map(group.gather, vectors)]
            if overstrains is None and name in RELAXING and k == 0:
                refuse_branches(self.law)
            elif overstrains is not None and k == 0:
                places = self.model.beam.elements * np.arange(states)[:, None] + np.arange(group.count)
                columns.append(overstrains[:, places.ravel().tolist()])
            results.append(map_elements(self.element(name, k), *columns, p, cs.repmat(c, 1, count)))
        return [list(outputs) for outputs in zip(*results, strict=True)]

    @cached_property
    def turned_projections(self) -> Array:
        """Rows of R B of the free coordinates for a clamp along x and along y, (2, N, m); R is linear in its slope."""
        B, axis = cs.DM(self.projection), self.model.beam.axis
        return np.array([self.model.of_free(rotate_pairs(B, axis, along).full()) for along in ((1.0, 0.0), (0.0, 1.0))])


@keep_last(8)
def shared_equations(model: Model, law: DampingLaw, make: Make, place: PointLoad | None) -> Equations:
    """Return the equations of motion, those of an earlier call for an equal beam if there was one."""
    return Equations(model, law, make, place)


@dataclass(frozen=True, eq=False)
class Balance:
    """The terms of the equation of motion, as functions of the motion of all nodes.

    The terms that are assembled here, ``local``, ``tangents`` and ``free_mass``, depend on all parameters.
    Those of the Functions of the model, ``local_damping``, ``damping``, ``inertia`` and ``conservative``, have the
    lumped properties of the model, like all that is exported.
    """

    equations: Equations
    gravity: cs.MX  # acceleration (2,), m/s^2
    properties: cs.MX  # P (4, n)
    coefficients: cs.MX  # parameters of the law
    projection: cs.MX  # B (4 n + 4, m) along the axis of the beam
    lumped: dict[str, cs.MX]  # the lumped properties that the model has, by name (``Model.lumped``)

    @property
    def modal_coefficients(self) -> cs.MX:
        """Coefficients d of the low-rank part R B diag(d) B^T R^T e_t of the damping force, 1/s."""
        return self.equations.law.modal_coefficients(self.coefficients)

    def strains(self, e: cs.MX) -> cs.MX:
        """Return the scaled strains of the elements of the beam, (m, n s)."""
        ((strains,),) = self.equations.map_elements("strains", self, e, groups={0: self.equations.model.groups[0]})
        return strains

    def strain_products(self, e: cs.MX) -> cs.MX:
        """Return the entries of V = J^T D J of all elements, in the order of ``Model.entries``."""
        model = self.equations.model
        _, (products,) = self.equations.map_elements("gradients", self, e, groups={0: model.groups[0]})
        return cs.vertcat(cs.vec(products), cs.MX.zeros(model.entries[0].size - products.numel()))

    def overstrains(self, e: cs.MX, internal: cs.MX) -> cs.MX | None:
        """Return the overstrains of a state, (m b, n), from internal strains; None without branches."""
        if not (branches := self.equations.branches):
            return None
        return cs.repmat(self.strains(e), branches, 1) - cs.reshape(internal, self.equations.internal_shape)

    def local_damping(self, e: cs.MX, e_t: cs.MX) -> cs.MX:
        """Return the local part of the damping force."""
        refuse_branches(self.equations.law)
        model = self.equations.model
        force = self.equations.law.local_force(model, e, e_t, self.properties, self.coefficients)
        damped = any(name.startswith("dashpot") for name in self.lumped)
        return force + model.dashpot_force(e_t, self.properties) if damped else force

    def turned_projection(self, e: cs.MX) -> cs.MX:
        """Return R B, turned with the clamp from the axis of the beam."""
        return rotate_pairs(self.projection, self.equations.model.beam.axis, e[2:NODE])

    def modal_velocities(self, slope: cs.MX, e_t: cs.MX) -> cs.MX:
        """Return B^T R^T e_t, (m, s), for the slope (2, s) of the clamp."""
        return self.projection.T @ self._rotate(e_t, slope, -1.0)

    def modal_damping(self, slope: cs.MX, modal_velocities: cs.MX) -> cs.MX:
        """Return R B diag(d) w, the low-rank part of the damping force, (4 n + 4, s), for the modal velocities w."""
        return self._rotate(self.projection @ (cs.diag(self.modal_coefficients) @ modal_velocities), slope, 1.0)

    def of_low_rank(self, slope: cs.MX, e_t: cs.MX) -> cs.MX:
        """Return the low-rank part R B diag(d) B^T R^T e_t of the damping force, (4 n + 4, s)."""
        return self.modal_damping(slope, self.modal_velocities(slope, e_t))

    def _rotate(self, vectors: cs.MX, slope: cs.MX, sign: float) -> cs.MX:
        """Return R v, or R^T v if the sign is negative, for vectors (4 n + 4, s) and the slope (2, s) of the clamp."""
        (x, y), (along, across) = self.equations.model.beam.axis, cs.vertsplit(slope)
        cosine, sine = cs.diag(x * along + y * across), cs.diag(sign * (x * across - y * along))
        return vectors @ cosine + rotate_pairs(vectors, (1.0, 0.0), (0.0, 1.0)) @ sine

    def damping(self, e: cs.MX, e_t: cs.MX) -> cs.MX:
        """Return the damping force."""
        return self.local_damping(e, e_t) + self.of_low_rank(e[2:NODE, :], e_t)

    def free_mass(self) -> cs.MX:
        """Return N^T M N, sparse."""
        model = self.equations.model
        return model.free_matrix(
            cs.vertcat(*map(cs.vec, model.of_elements("mass", self.properties, lumped=self.lumped)))
        )

    def inertia(self, e_tt: cs.MX) -> cs.MX:
        """Return M e_tt."""
        return self.equations.model.inertia_force(e_tt, self.properties)

    def conservative(self, e: cs.MX) -> cs.MX:
        """Return Q_e - Q_g."""
        model = self.equations.model
        return model.elastic_force(e, self.properties) - model.gravity_force(self.properties, self.gravity)

    def at_rest(self, e: cs.MX) -> cs.MX:
        """Return the forces on a beam at rest, Q_e - Q_g, and those of a flow."""
        force = self.conservative(e)
        return force + self.local_damping(e, cs.MX.zeros(e.shape)) if self.equations.flow else force

    def local(self, e: cs.MX, e_t: cs.MX, e_tt: cs.MX, load: cs.MX, overstrains: cs.MX | None = None) -> cs.MX:
        """Return all forces but the low-rank damping at all nodes, (4 n + 4, s), for loads (3 or 4, s)."""
        equations = self.equations
        (forces,) = equations.map_elements("balance", self, e, e_t, e_tt, overstrains=overstrains)
        return equations.model.sum_at_nodes(forces) - load_force(equations.model, equations.place, e, load)

    def forces(self, e: cs.MX, e_t: cs.MX, e_tt: cs.MX, load: cs.MX, overstrains: cs.MX | None = None) -> cs.MX:
        """Return the forces at all nodes, (4 n + 4, s), from the same as ``local``."""
        return self.local(e, e_t, e_tt, load, overstrains) + self.of_low_rank(e[2:NODE, :], e_t)

    def powers(self, e: cs.MX, e_t: cs.MX, e_tt: cs.MX, load: cs.MX, overstrains: cs.MX | None = None) -> cs.MX:
        """Return the powers lost to damping, supplied by the base and supplied by the load, (3, s), as ``local``.

        The energy stored in Maxwell branches counts as lost until they return it.
        """
        equations = self.equations
        (by_group,) = equations.map_elements("lost_power", self, e, e_t, overstrains=overstrains)
        lost = sum(cs.sum1(cs.reshape(by_element, -1, e.size2())) for by_element in by_group)
        lost += self.modal_coefficients.T @ self.modal_velocities(e[2:NODE, :], e_t) ** 2
        by_base = cs.sum1(e_t[:NODE, :] * self.on_base(e, e_t, e_tt, load, overstrains))
        return cs.vertcat(lost, by_base, cs.sum1(e_t * load_force(equations.model, equations.place, e, load)))

    def on_base(self, e: cs.MX, e_t: cs.MX, e_tt: cs.MX, load: cs.MX, overstrains: cs.MX | None = None) -> cs.MX:
        """Return the generalized force of the base on the beam, (4, s), from the same as ``local``."""
        equations, groups = self.equations, self.equations.model.groups_at_base
        (by_element,) = equations.map_elements("balance", self, e, e_t, e_tt, groups=groups, overstrains=overstrains)
        forces = equations.model.sum_at_nodes(by_element, groups.values()) + self.of_low_rank(e[2:NODE, :], e_t)
        return equations.model.of_base(forces - load_force(equations.model, equations.place, e, load))

    def tangents(
        self, e: cs.MX, e_t: cs.MX, load: cs.MX, overstrains: cs.MX | None = None
    ) -> tuple[cs.MX, cs.MX, cs.MX]:
        """Return the entries of K = d(Q_damp + Q_e - Q_load)/de, D = dQ_damp/de_t and M of all elements, (entries, s).

        The entries are in the order of ``Model.entries`` and omit the low-rank part of the damping force.  The
        overstrains are held constant.
        """
        k, d, m = self.equations.map_elements("tangents", self, e, e_t, overstrains=overstrains)
        columns = [cs.vertcat(*(cs.reshape(block, -1, e.size2()) for block in blocks)) for blocks in (k, d, m)]
        if (place := self.equations.place) is not None:
            places, stiffness = load_stiffness(self.equations.model, place, e, load)
            columns[0][places, :] -= stiffness
        return columns[0], columns[1], columns[2]
