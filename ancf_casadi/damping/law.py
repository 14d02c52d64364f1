"""Base class of the damping laws, their parameters, and the sum of several laws.

The matrix B = M Phi of the modal law belongs to a beam whose axis at the clamp is a, |a| = 1.  If the clamped node has
the slope tau, |tau| = 1, the clamp has turned the beam and its modes by the angle from a to tau, with the rotation

    R = [[c, -s], [s, c]],    c = a . tau,    s = a x tau.

R acts on the pairs (x, y) of the positions and of the slopes, which are rows of B, and the damping force is

    Q = R B diag(d) B^T R^T e_t.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self, TypeVar, cast, final

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.loads import LineLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.strain import gauss
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.inputs import check_instance, numbers
from ancf_casadi.support.tables import Displayed
from ancf_casadi.vibration.modes import Modes

S = TypeVar("S", cs.SX, cs.MX)
V = TypeVar("V", cs.MX, cs.DM)
Direction = tuple[float, float] | cs.MX


@dataclass(frozen=True)
class Parameter(Displayed):
    """A parameter of a damping law, a base motion or a system.

    Parameters
    ----------
    name : str
        Name, a C identifier.
    value : float
        Value.
    unit : str
        SI unit, in ASCII; ``1`` for a dimensionless parameter.
    description : str
        Meaning.
    lower, upper : float
        Usual bounds of an estimate.

    Examples
    --------
    >>> from ancf_casadi import Parameter
    >>> Parameter("stiffness", 2.0, "N/m", "stiffness of the spring").upper
    inf
    """

    name: str
    value: float
    unit: str
    description: str
    lower: float = 0.0
    upper: float = math.inf


class Forces(Protocol):
    """Forces that a damping law combines: those of a beam, of one of its elements, or of a reduced model.

    The Functions are those of ``Element``; their inputs are coordinates, velocities and properties of the body.
    """

    @property
    def unit_velocities(self) -> Array:
        """Rates of the coordinates at a unit velocity along x and along y, (d, 2)."""

    @property
    def inertia_force(self) -> Callable[..., Any]:
        """(e_t, p) -> M e_t."""

    @property
    def line_inertia_force(self) -> Callable[..., Any]:
        """(e_t, p) -> the contribution of the mass along the beam to M e_t."""

    @property
    def strain_rate_force(self) -> Callable[..., Any]:
        """(e, e_t, p) -> Q_v."""

    @property
    def tangent_force(self) -> Callable[..., Any]:
        """(e, e_t, p) -> K e_t."""

    @property
    def reference_force(self) -> Callable[..., Any]:
        """(e_t, p) -> K e_t, with K of the undeformed body."""

    @property
    def drag_force(self) -> Callable[..., Any]:
        """(e_t, p) -> int S^T mu |v| v dp."""

    @property
    def friction_force(self) -> Callable[..., Any]:
        """(e_t, p, v0) -> int S^T mu v/(|v|^2 + v0^2)^(1/2) dp."""


class DampingLaw(Displayed, ABC):
    """Base class of the damping laws; ``+`` adds the forces of two laws.

    Examples
    --------
    Laws add up:

    >>> from ancf_casadi import QuadraticDamping, RayleighDamping
    >>> law = RayleighDamping(alpha=0.2) + QuadraticDamping(eta2=0.1)
    >>> for parameter in law.parameters:
    ...     print(parameter.name, parameter.value, parameter.unit)
    alpha 0.2 1/s
    eta2 0.1 1/m
    >>> stronger = law.with_parameters([0.3, 0.1])
    """

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of the law."""

    def with_parameters(self, values: Sequence[float] | Array) -> Self:
        """Return the law with other values of its parameters, in order; one out of range raises an ``InputError``."""
        names, law = (parameter.name for parameter in self.parameters), cast(Any, self)
        return cast(Self, replace(law, **dict(zip(names, check_values(self, values), strict=True))))

    @abstractmethod
    def local_force(self, body: Forces, e: S, e_t: S, properties: S, parameters: S) -> S:
        """Return the local part of the force, a sum over the elements, (d,), N and N m.

        Parameters
        ----------
        body : Forces
            A beam or one of its elements.
        e, e_t, properties : SX or MX
            Coordinates (d,), velocities and properties of the body.
        parameters : SX or MX
            The parameters of the law.
        """

    @property
    def dissipative(self) -> bool:
        """True if the force never adds energy to a motion, apart from the energy of a flow."""
        return True

    def loads(self, beam: Beam) -> tuple[LineLoad, ...]:
        """Return the forces of a flow on a beam at rest, one for each part of constant mass per length."""
        return ()

    def projection(self, model: Model) -> Array:
        """Return B (4 n + 4, m) of the low-rank part R B diag(d) B^T R^T e_t of the force; m is 0 if there is none."""
        return np.zeros((model.size, 0))

    def modal_coefficients(self, parameters: cs.MX) -> cs.MX:
        """Return d (m,), 1/s, of the low-rank part R B diag(d) B^T R^T e_t of the force."""
        return cs.MX(0, 1)

    def branches(self, parameters: S) -> tuple[S, S]:
        """Return the moduli relative to that of the beam and the relaxation times, s, of the Maxwell branches, (b,)."""
        no_branches = type(parameters)(0, 1)
        return no_branches, no_branches

    @abstractmethod
    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return the equivalent damping ratio of each mode at its tip amplitude (m), (m,)."""

    @final
    @property
    def branch_values(self) -> tuple[Array, Array]:
        """The results of ``branches`` for the values of the parameters."""
        columns = self.branches(cs.MX(cs.DM([parameter.value for parameter in self.parameters])))
        moduli, times = (cs.evalf(column).full().ravel() for column in columns)
        return moduli, times

    @final
    def relaxation(self, s: ArrayLike) -> ComplexArray:
        """Return phi(s) = sum_b g_b tau_b s/(1 + tau_b s) of the Maxwell branches: E (1 + phi) is the modulus at s."""
        moduli, times = self.branch_values
        tau_s = np.multiply.outer(np.asarray(s), times)
        return np.asarray((moduli * tau_s / (1 + tau_s)).sum(axis=-1))

    @final
    def force(self, model: Model, e: cs.MX, e_t: cs.MX) -> cs.MX:
        """Return the whole generalized force Q_damp, (4 n + 4,), N and N m, for the values of the parameters."""
        refuse_branches(self)
        values = cs.MX(cs.DM([parameter.value for parameter in self.parameters]))
        local = self.local_force(model, e, e_t, cs.MX(cs.DM(model.properties)), values)
        B = rotate_pairs(cs.MX(cs.DM(self.projection(model))), model.beam.axis, e[2:NODE])
        return local + B @ (self.modal_coefficients(values) * (B.T @ e_t))

    @final
    def __add__(self, other: DampingLaw) -> DampingLaw:
        """Return the law whose force is the sum of both forces."""
        check_instance(other, "damping", DampingLaw)
        return SumOfLaws((*law_terms(self), *law_terms(other)))


@final
@dataclass(frozen=True)
class SumOfLaws(DampingLaw):
    """Several laws that act together, made by adding laws; one of none has no force."""

    laws: tuple[DampingLaw, ...]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of all terms in order; a name that occurs again is numbered, as in ``alpha_2``."""
        numbered: dict[str, Parameter] = {}
        for parameter in (parameter for term in law_terms(self) for parameter in term.parameters):
            name, count = parameter.name, 1
            while name in numbered:
                count += 1
                name = f"{parameter.name}_{count}"
            numbered[name] = replace(parameter, name=name)
        return tuple(numbered.values())

    @property
    def dissipative(self) -> bool:
        """True if no term ever adds energy to a motion, apart from the energy of a flow."""
        return all(law.dissipative for law in self.laws)

    def loads(self, beam: Beam) -> tuple[LineLoad, ...]:
        """Return the forces of the flows of all terms on a beam at rest."""
        return tuple(load for law in self.laws for load in law.loads(beam))

    def with_parameters(self, values: Sequence[float] | Array) -> SumOfLaws:
        """Return the sum with other values of the parameters of all terms."""
        values_left = iter(check_values(self, values))
        return SumOfLaws(tuple(law.with_parameters([next(values_left) for _ in law.parameters]) for law in self.laws))

    def local_force(self, body: Forces, e: S, e_t: S, properties: S, parameters: S) -> S:
        """Return the sum of the local forces."""
        terms = zip(self.laws, self._split(parameters), strict=True)
        return sum((law.local_force(body, e, e_t, properties, values) for law, values in terms), 0 * e_t)

    def projection(self, model: Model) -> Array:
        """Return the projections of all terms side by side."""
        return np.hstack([np.zeros((model.size, 0)), *(law.projection(model) for law in self.laws)])

    def modal_coefficients(self, parameters: cs.MX) -> cs.MX:
        """Return the modal damping coefficients of all terms."""
        terms = zip(self.laws, self._split(parameters), strict=True)
        return cs.vertcat(cs.MX(0, 1), *(law.modal_coefficients(law_parameters) for law, law_parameters in terms))

    def branches(self, parameters: S) -> tuple[S, S]:
        """Return the branches of all terms."""
        terms = zip(self.laws, self._split(parameters), strict=True)
        of_terms = [law.branches(law_parameters) for law, law_parameters in terms]
        moduli, times = zip(super().branches(parameters), *of_terms, strict=True)
        return cs.vertcat(*moduli), cs.vertcat(*times)

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return the sum of the equivalent damping ratios."""
        return np.asarray(np.sum([law.damping_ratios(modes, amplitudes) for law in self.laws], axis=0))

    def _split(self, parameters: S) -> list[S]:
        """Return the parameters of each term."""
        ends = np.cumsum([0, *(len(law.parameters) for law in self.laws)]).tolist()
        return cs.vertsplit(parameters, ends) if self.laws else []


def weighted_sum(forces: Sequence[Any], parameters: S, e_t: S) -> S:
    """Return the sum of the forces, each multiplied by its parameter; without forces, zeros of the size of ``e_t``."""
    total = 0 * e_t
    for weight, force in zip(cs.vertsplit(parameters) if forces else [], forces, strict=True):
        total += weight * force
    return total


def nonzero(*parameters: Parameter) -> tuple[Parameter, ...]:
    """Return the parameters whose value is not 0."""
    return tuple(parameter for parameter in parameters if parameter.value)


def check_values(law: DampingLaw, values: Sequence[float] | Array) -> tuple[float, ...]:
    """Return one finite value per parameter of a law."""
    checked = numbers(values, "values")
    if len(checked) != len(law.parameters):
        raise InputError(f"has {len(checked)} values for {len(law.parameters)} parameters", "values")
    return checked


def at_tip_amplitudes(modes: Modes, amplitudes: Sequence[float] | Array) -> tuple[Array, Array, Array]:
    """Return the tip amplitudes (m,), m, the shapes (4 n + 4, m) that are 1 at the tip, and their modal masses (m,)."""
    check_instance(modes, "modes", Modes)
    tip = numbers(amplitudes, "amplitudes")
    if len(tip) != modes.count:
        raise InputError(f"has {len(tip)} values for {modes.count} modes", "amplitudes")
    shapes, model = modes.shapes / modes.tip_amplitudes(), modes.model
    return np.abs(tip), shapes, (shapes * (model.mass(model.properties).sparse() @ shapes)).sum(axis=0)


def ratios_over_a_period(
    modes: Modes, amplitudes: Sequence[float] | Array, force: Callable[[Array], Any], least_speed: float
) -> Array:
    """Return the equivalent damping ratios (m,) under a force, a function of velocities (4 n + 4, k).

    They are exact in the energy per period.  The speed of the tip is at least ``least_speed``, m/s.
    """
    tip, shapes, modal_mass = at_tip_amplitudes(modes, amplitudes)
    speed = np.maximum(modes.angular_frequencies * tip, least_speed)
    points, weights = gauss(48)  # Gauss points in a quarter of a period, which resolve the turn of the motion
    phase = np.cos(math.pi / 2 * points)
    velocities = (shapes * speed)[:, :, None] * phase
    columns = velocities.reshape(len(shapes), -1)
    forces = (force(columns).full() - force(-columns).full()) / 2  # of both directions of the motion
    powers = np.einsum("ij,ijk->jk", shapes, forces.reshape(velocities.shape))  # per unit speed of the tip
    return np.asarray(powers @ (weights * phase) / (modes.angular_frequencies * speed * modal_mass))


def law_terms(law: DampingLaw) -> tuple[DampingLaw, ...]:
    """Return the terms of a law, including those of nested sums."""
    return tuple(term for summand in law.laws for term in law_terms(summand)) if isinstance(law, SumOfLaws) else (law,)


def refuse_branches(law: DampingLaw) -> None:
    """Raise an ``InputError`` for a law with Maxwell branches, where the history of the motion is unknown."""
    if law.branch_values[0].size:
        raise InputError(
            "has a material that relaxes, which is not modelled here; use a law without, such as RayleighDamping",
            "damping",
        )


def rotate_pairs(vectors: V, start: Direction, end: Direction) -> V:
    """Return the columns of ``vectors``, with their pairs (x, y) turned by the angle between two unit vectors.

    From a to tau, this multiplies by R; from tau to a, by R^T.
    """
    cosine, sine = start[0] * end[0] + start[1] * end[1], start[0] * end[1] - start[1] * end[0]
    rotation: Any = cs.blockcat([[cosine, -sine], [sine, cosine]])
    rotated: V = cs.reshape(rotation @ cs.reshape(vectors, 2, -1), *vectors.shape)
    return rotated
