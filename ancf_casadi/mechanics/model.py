"""The beam as one symbolic model: the forces and matrices of all elements.

The nodal coordinates e = (r_0, tau_0, r_1, tau_1, ...), four numbers per node in the laboratory frame, are shared by
neighbouring elements.  Forces and matrices add up over the elements,

    M e_tt + Q_damp(e, e_t) + Q_e(e) = Q_g,                  Eq. (6), with damping on the left.

The motion of the base and the free coordinates give all others (``nodes``).

The Functions of an element are mapped over the elements and never expanded here, so graphs stay small and all
derivatives stay sparse.  Springs, masses and dashpots are further elements, at their nodes.

The properties P are a matrix with one column (width, thickness, density, elastic modulus) per element.  Every Function
here is symbolic in P; ``Model.properties`` holds the values of the beam.

The curvature of a cubic element is accurate at its two Gauss points; elsewhere it is taken from the straight line
through these values.  Of the axial strain, only the mean over an element is accurate; elsewhere the straight line
through the means of two elements is used.

Another model has other values of its properties, as fits and matches find them.  A name stands for one lumped property,
as in ``Beam.lumped``, and ``spring_stiffness`` for all springs together.  The displacements and rotations of supports
refer to the beam without load: if its natural curvature changes, they change too, and the supports stay in place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.attachments import PointMass
from ancf_casadi.mechanics.beam import INITIAL, Beam
from ancf_casadi.mechanics.element import Element, Group, element
from ancf_casadi.mechanics.lumped import PROPERTIES, changed_properties, check_combinations, lumped_kind
from ancf_casadi.mechanics.nodes import NODE, Nodes
from ancf_casadi.mechanics.point_elements import (
    dashpot,
    point_mass,
    rotary_inertia,
    rotational_spring,
    slope_length,
    spring,
)
from ancf_casadi.mechanics.strain import StrainMeasures, axial_strain, curvature
from ancf_casadi.mechanics.supports import Clamp, Guide, Support
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.inputs import check_instance, number

POINT_INERTIAS = {"tip_mass": point_mass, "mass": point_mass, "rotary_inertia": rotary_inertia}
At = Callable[[Array], tuple[Any, Any]]  # multiplies an interpolation by coordinates, numbers or symbols: x and y


def _element_sum(text: str, name: str, *inputs: str, output: str = "Q", **shared: int) -> cached_property[cs.Function]:
    """Return the property of a model with the sum of an element Function, as of ``Model._summed``."""
    function = cached_property(lambda model: model._sum_elements(name, *inputs, output=output, **shared))
    function.__doc__ = text
    return function


@dataclass(frozen=True)
class Model(Nodes):
    """A beam as symbolic equations of motion.

    Each Function takes nodal coordinates e (4 n + 4, or 4 n + 8 unless a rigid clamp holds the beginning of the beam),
    velocities e_t, and properties P (4, n).

    Parameters
    ----------
    beam : Beam
        The beam.
    measures : StrainMeasures
        The strain measures of Eq. (8).

    Examples
    --------
    >>> from ancf_casadi import Beam, Model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model = Model(beam)
    >>> model.size
    20
    >>> model.interpolation(0.25) @ model.straight
    array([ 0.  , -0.25])
    """

    measures: StrainMeasures = field(default_factory=StrainMeasures)

    def __post_init__(self) -> None:
        """Validate."""
        check_instance(self.beam, "beam", Beam)
        check_instance(self.measures, "measures", StrainMeasures)

    def __reduce__(self) -> tuple[type[Model], tuple[Beam, StrainMeasures]]:
        """Pickle the model without its Functions, which the receiving process derives again."""
        return Model, (self.beam, self.measures)

    @cached_property
    def properties(self) -> Array:
        """The properties P of the beam, (4, n)."""
        return np.array([getattr(self.beam, name) for name in PROPERTIES])

    @property
    def lumped(self) -> dict[str, float]:
        """The lumped properties of the beam by name (``Beam.lumped``)."""
        return self.beam.lumped

    @property
    def has_short_elements(self) -> bool:
        """True if elements are about as short as the beam is thick, and therefore unstable where it bends."""
        beam = self.beam
        return self.measures.axial_points <= 2 and bool(beam.element_lengths.min() < 1.5 * max(beam.thickness))

    @cached_property
    def element(self) -> Element:
        """The Functions of one beam element."""
        curved, prestressed = bool(self.beam.natural_curvature), bool(self.beam.prestress)
        return element(self.measures, curved=curved, prestressed=prestressed, rotary=self.beam.rotary_sections)

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """The elements of the beam, and what is attached to it."""
        beam, n, coordinates = self.beam, self.beam.elements, np.arange(2 * NODE)
        constants, lumped = self._constants, {name: beam.lumped[name] for name in INITIAL if name in beam.lumped}
        places = NODE * (np.arange(n)[:, None] + self.root) + coordinates
        groups = [Group(self.element, places, slice(n), constants, lumped)]
        if self.root and not any(np.abs(self.whole_of_base[2 + NODE :: NODE]).sum(axis=1)):
            first = NODE + coordinates[None, :NODE]
            groups.append(Group(slope_length(), first, slice(1), constants[:3, :1], {}))
        return (*groups, *(self._attachment_group(name) for name in beam.lumped_places))

    @cached_property
    def groups_at_base(self) -> dict[int, Group]:
        """The elements that may act on the base, one at least, by the number of their group."""
        if not self.held_at_base_alone:
            return dict(enumerate(self.groups))
        counts = [int((group.coordinates < NODE).any(axis=1).sum()) for group in self.groups]
        return {k: self.groups[k].first(count) for k, count in enumerate(counts) if count} or {
            0: self.groups[0].first(1)
        }

    @cached_property
    def _constants(self) -> Array:
        """Length and axis of each element, and the ratios of its curvature and prestress, if any, to the largest."""
        beam = self.beam
        rows = [beam.element_lengths, *np.outer(beam.axis, np.ones(beam.elements))]
        if beam.natural_curvature:
            slopes = self.natural_nodes[1]
            middle = slopes[:-1] + slopes[1:]
            rows[1:] = (middle / np.linalg.norm(middle, axis=1)[:, None]).T
        rows += [np.array(getattr(beam, name)) / beam.lumped[name] for name in INITIAL if name in beam.lumped]
        return np.array(rows)

    def _attachment_group(self, name: str) -> Group:
        """Return the group of the element that a lumped property of a support or attachment stands for.

        The constants of a spring or dashpot are its position, or slope, at rest in the frame of the base, and its axis.
        """
        place = self.beam.lumped_places[name]
        kind, item = place.kind, getattr(self.beam, place.owner)[place.number]
        no_columns, node, lumped = slice(0), self.nodes_of(item.point), {name: self.beam.lumped[name]}
        if kind in POINT_INERTIAS:
            return Group(POINT_INERTIAS[kind](), node[None], no_columns, np.zeros((0, 1)), lumped)
        base_and_node = np.concatenate([np.arange(NODE), node])[None]
        position, slope = self.straight[node[:2]], self.straight[node[2:]]
        if kind in ("clamp_stiffness", "rotational_spring"):
            angle = getattr(item, "rotation", 0.0)  # of a clamp
            slope = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]) @ slope
            constants = np.array([*self._base_frame_matrix(slope)[:, 0], *self.beam.axis])
            return Group(rotational_spring(), base_and_node, no_columns, constants[:, None], lumped)
        constants = np.array([*self._base_frame_matrix(position)[:, 0], *np.eye(2)[place.component or 0]])
        element_of = spring if kind.startswith("spring") else dashpot
        return Group(element_of(), base_and_node, no_columns, constants[:, None], lumped)

    strain_energy = _element_sum("(e, P) -> U, J, Eq. (8).", "strain_energy", "e", output="U")
    elastic_force = _element_sum("(e, P) -> Q_e, Eq. (6).", "elastic_force", "e", output="Q_e")
    tangent_stiffness = _element_sum("(e, P) -> K = dQ_e/de, sparse.", "tangent_stiffness", "e", output="K")
    tangent_force = _element_sum(
        "(e, e_t, P) -> K e_t, the time derivative of the elastic force.", "tangent_force", "e", "e_t"
    )
    reference_force = _element_sum("(e_t, P) -> K e_t with K of the straight beam.", "reference_force", "e_t")
    strain_rate_force = _element_sum(
        "(e, e_t, P) -> Q_v, the objective Kelvin-Voigt force per unit time constant.", "strain_rate_force", "e", "e_t"
    )
    drag_force = _element_sum("``(e_t, P) -> int S^T mu |v| v dp``, the integral in Eq. (23).", "drag_force", "e_t")
    friction_force = _element_sum(
        "``(e_t, P, v0) -> int S^T mu v/(|v|^2 + v0^2)^(1/2) dp``, smoothed below the speed v0 (m/s).",
        "friction_force",
        "e_t",
        v0=1,
    )
    dashpot_force = _element_sum("(e_t, P) -> the force of the dashpots, which resists e_t.", "dashpot_force", "e_t")
    mass = _element_sum("P -> M, Eq. (7), sparse.", "mass", output="M")
    line_inertia_force = _element_sum(
        "(e_tt, P) -> int S^T mu r_tt dp, the part of M e_tt from mass along the beam; also for velocities.",
        "line_inertia_force",
        "e_tt",
    )
    inertia_force = _element_sum("(e_tt, P) -> M e_tt; also for velocities.", "inertia_force", "e_tt")
    gravity_force = _element_sum(
        "(P, g) -> Q_g, Eq. (7); g is the acceleration of gravity (2), m/s^2.", "gravity_force", output="Q_g", g=2
    )

    def sum_at_nodes(self, forces: Sequence[cs.MX], groups: Iterable[Group] | None = None) -> cs.MX:
        """Return the sums at all nodes, (4 n + 4, s), of the element forces of each group, (d, k s), in s states."""
        pairs = zip(self.groups if groups is None else groups, forces, strict=True)
        sums = [group.scatter(columns, self.size) for group, columns in pairs]
        return sum(sums[1:], sums[0])

    @cached_property
    def entries(self) -> tuple[Index, Index]:
        """Rows and columns of the entries of all element matrices, group by group, each matrix column by column."""
        rows, columns = [], []
        for group in self.groups:
            d = group.coordinates.shape[1]
            rows.append(np.tile(group.coordinates, d).ravel())
            columns.append(np.repeat(group.coordinates, d, axis=1).ravel())
        return np.concatenate(rows), np.concatenate(columns)

    @cached_property
    def free_entries(self) -> tuple[Index, Index, Index, Array]:
        """Places in ``entries`` of those that belong to free coordinates, the numbers of these, and N_ik N_jl."""
        rows, columns = (self.free_of[index] for index in self.entries)
        entry_indices = np.flatnonzero((rows >= 0) & (columns >= 0))
        products = np.prod([self.weights[index[entry_indices]] for index in self.entries], axis=0)
        return entry_indices, rows[entry_indices], columns[entry_indices], products

    def matrix(self, values: cs.MX) -> cs.MX:
        """Return the sparse sum of element matrices, ``values`` as in ``entries``."""
        rows, columns = self.entries
        return _sparse_sum(values, np.arange(rows.size), rows, columns, self.size, np.ones(rows.size))

    def free_matrix(self, values: cs.MX) -> cs.MX:
        """Return N^T A N, sparse, of the sum A of element matrices, ``values`` as in ``entries``."""
        entry_indices, rows, columns, products = self.free_entries
        return _sparse_sum(values, entry_indices, rows, columns, self.freedoms, products)

    def of_elements(
        self,
        name: str,
        p: cs.MX,
        *vectors: cs.MX,
        numbers: Sequence[cs.MX] = (),
        lumped: Mapping[str, cs.MX] | None = None,
    ) -> list[cs.MX]:
        """Evaluate an element Function for each group, from vectors at all nodes; its last inputs are ``numbers``."""
        results = []
        for group in self.groups:
            function: cs.Function = getattr(group.element, name)
            shared = [cs.repmat(symbol, 1, group.count) for symbol in numbers]
            results.append(function.map(group.count)(*map(group.gather, vectors), group.properties(p, lumped), *shared))
        return results

    def _sum_elements(self, name: str, *inputs: str, output: str, **shared: int) -> cs.Function:
        """Return the sum of an element Function: of vectors at all nodes, P, and shared numbers by size."""
        vectors = [cs.MX.sym(symbol, self.size) for symbol in inputs]
        shared_symbols = [cs.MX.sym(symbol, size) for symbol, size in shared.items()]
        p = cs.MX.sym("P", len(PROPERTIES), self.beam.elements)
        terms = self.of_elements(name, p, *vectors, numbers=shared_symbols)
        if output == "U":
            total = sum(map(cs.sum2, terms), cs.MX(0))
        elif output in ("K", "M"):
            total = self.matrix(cs.vertcat(*map(cs.vec, terms)))
        else:
            total = self.sum_at_nodes(terms)
        return cs.Function(name, [*vectors, p, *shared_symbols], [total], [*inputs, "P", *shared], [output])

    def _summary(self) -> str:
        measures = "" if self.measures == StrainMeasures() else f", {self.measures}"
        return f"{self.beam._summary()}{measures}"


def curvature_at(model: Model, s: float, at: At) -> Any:
    """Return the curvature at arc length ``s`` (m), 1/m, positive counterclockwise."""
    first, second = model.gauss_points(model.element_at(s))
    at_first, at_second = (
        curvature(at(model.slope_interpolation(x)), at(model.curvature_interpolation(x)), model.measures.curvature)
        for x in (first, second)
    )
    return at_first + (s - first) / (second - first) * (at_second - at_first)


def neighbouring_axial_strains(model: Model, s: float, at: At) -> list[tuple[float, int, Any]]:
    """Return the two elements whose mean axial strains give that at arc length ``s`` (m): weight, number and strain."""
    model.element_at(s)
    middles = (model.beam.node_points[:-1] + model.beam.node_points[1:]) / 2
    index = min(max(int(np.searchsorted(middles, s)) - 1, 0), model.beam.elements - 2)
    fraction = float((s - middles[index]) / (middles[index + 1] - middles[index]))
    strains = []
    for weight, k in ((1.0 - fraction, index), (fraction, index + 1)):
        slopes = [at(model.slope_interpolation(point)) for point in model.gauss_points(k)]
        strains.append((weight, k, sum(axial_strain(slope, model.measures.axial) for slope in slopes) / 2))
    return strains


def lumped_indices(beam: Beam, name: str) -> list[int]:
    """Return the indices in ``Beam.lumped`` of the properties that a name stands for; none if the beam has none."""
    names = {key for key in beam.lumped if key.startswith("spring_")} if name == "spring_stiffness" else {name}
    return [k for k, key in enumerate(beam.lumped) if key in names]


def property_rows(beam: Beam, name: str, elements: slice = slice(None)) -> Index:
    """Return the rows that a property of all or some elements changes: P row by row, then the lumped ones."""
    if lumped_kind(name):
        return len(PROPERTIES) * beam.elements + np.array(lumped_indices(beam, name), dtype=np.int64)
    indices = np.arange(beam.elements)[elements]
    return np.concatenate([PROPERTIES.index(row) * beam.elements + indices for row in changed_properties(name)])


def owners_of_rows(beam: Beam, names: Sequence[str], elements: Sequence[slice]) -> Index:
    """Return the unknown property with which each row of ``property_rows`` changes, (4 n + lumped,); -1 for none.

    The unknowns are properties of some elements.  An ``InputError`` says if the beam lacks one of them, or if two
    change the same row.
    """
    if "natural_curvature" in names:
        check_curvature(beam)
    owners = np.full(len(PROPERTIES) * beam.elements + len(beam.lumped), -1)
    for k, (name, changed) in enumerate(zip(names, elements, strict=True)):
        check_sections(beam, name, changed)
        rows = property_rows(beam, name, changed)
        if (owners[rows] >= 0).any():
            earlier = names[int(owners[rows].max())]
            raise InputError(f"{name} changes the same property as {earlier}; estimate one or the other", "unknowns")
        owners[rows] = k
    check_combinations(names)
    return owners


def lumped_value(beam: Beam, name: str) -> float:
    """Return a lumped property, the mean of several; 0 if the beam does not have it."""
    values, places = [*beam.lumped.values()], lumped_indices(beam, name)
    return sum(values[k] for k in places) / len(places) if places else 0.0


def model_with_properties(model: Model, properties: Array) -> Model:
    """Return the model with other properties (4 n + lumped,): P row by row, then the lumped ones."""
    rows: Any = properties[: model.properties.size].reshape(model.properties.shape).tolist()
    values = zip(model.lumped, properties[model.properties.size :].tolist(), strict=True)
    lumped = {name: number(value, name) for name, value in values}
    beam = model.beam.with_(**dict(zip(PROPERTIES, rows, strict=True))).with_lumped(lumped)
    if "natural_curvature" in lumped:
        new_model = Model(beam)
        beam = beam.with_(supports=[_move_support(support, model, new_model) for support in beam.supports])
    return Model(beam, model.measures)


def _move_support(support: Support, model: Model, new_model: Model) -> Support:
    """Return a support of a model, displaced so that it holds a new model in the same place."""
    node = int(np.abs(model.beam.node_points - support.point).argmin())
    (places, slopes), (new_places, new_slopes) = model.natural_nodes, new_model.natural_nodes
    place, slope, new_place, new_slope = places[node], slopes[node], new_places[node], new_slopes[node]
    changes: dict[str, Any] = {"displacement": tuple((support.displacement + place - new_place).tolist())}
    if isinstance(support, Clamp | Guide):
        sine, cosine = new_slope[0] * slope[1] - new_slope[1] * slope[0], new_slope @ slope
        changes["rotation"] = support.rotation + math.atan2(sine, cosine)
    return replace(support, **changes)


def check_curvature(beam: Beam) -> None:
    """Refuse to estimate the natural curvature of a beam with springs or dashpots away from its beginning."""
    for attachment in beam.attachments:
        if attachment.point and not isinstance(attachment, PointMass):
            raise InputError(
                f"cannot be estimated for a beam with a {type(attachment).__name__} at {attachment.point:g} m: it is "
                "free of force where the beam is without load, and would move with the curvature",
                "natural_curvature",
            )


def check_sections(beam: Beam, name: str, elements: slice) -> None:
    """Refuse to estimate a property that sections of all or some elements do not have."""
    kinds = {shape.kind for shape in beam.shapes[elements]}
    kind = name.partition("[")[0]
    if kind == "diameter" and kinds != {"round"}:
        instead = "bending_stiffness" if "stiffness" in kinds else "width or thickness"
        raise InputError(f"only circles and tubes have one; estimate {instead}", name)
    if "round" in kinds and kind in ("width", "thickness"):
        raise InputError("changes with the diameter of a circle or a tube; estimate its diameter", name)
    if "stiffness" in kinds and kind in PROPERTIES:
        instead = "mass_per_length" if kind == "density" else "bending_stiffness"
        raise InputError(f"is not a property of a section of given stiffness; estimate its {instead}", name)


def _sparse_sum(values: cs.MX, entry_indices: Index, rows: Index, columns: Index, size: int, factors: Array) -> cs.MX:
    """Return the sparse matrix (size, size) with the sums of entries of ``values``, each times its factor."""
    pairs, target = np.unique(np.column_stack([columns, rows]), axis=0, return_inverse=True)
    pattern = cs.Sparsity.triplet(size, size, pairs[:, 1].tolist(), pairs[:, 0].tolist())
    indices = target.ravel().tolist(), entry_indices.tolist()
    incidence = cs.DM.triplet(*indices, cs.DM(factors), len(pairs), values.numel())
    return cs.MX(pattern, incidence @ values)
