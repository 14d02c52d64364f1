"""What every damping law can do, and the sum of several laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol, TypeVar, final

import casadi as cs
import numpy as np

from ancf_casadi.damping.turning import turned
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, number
from ancf_casadi.support.inputs import numbers as finite_numbers
from ancf_casadi.vibration.modes import Modes

S = TypeVar("S", cs.SX, cs.MX)


class Forces(Protocol):
    """Forces that a damping law combines: those of a beam, of one of its elements, or of a reduced model.

    Its Functions are those of ``Element``, of coordinates or rates and properties.
    """

    @property
    def inertia_force(self) -> Callable[..., Any]:
        """(e_t, p) -> M e_t."""

    @property
    def line_inertia_force(self) -> Callable[..., Any]:
        """(e_t, p) -> the share of a mass along the beam in M e_t."""

    @property
    def strain_rate_force(self) -> Callable[..., Any]:
        """(e, e_t, p) -> Q_v."""

    @property
    def tangent_force(self) -> Callable[..., Any]:
        """(e, e_t, p) -> K e_t."""

    @property
    def reference_force(self) -> Callable[..., Any]:
        """(e_t, p) -> K e_t with K of the undeformed body."""

    @property
    def drag_force(self) -> Callable[..., Any]:
        """(e_t, p) -> int S^T mu |v| v dp."""


class DampingLaw(ABC):
    """What every damping law can do."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[tuple[str, float], ...]:
        """Name and value of each parameter."""

    @abstractmethod
    def with_parameters(self, values: Sequence[float] | Array) -> DampingLaw:
        """Return the law with other values of its parameters, in their order.

        Raises
        ------
        InputError
            If a value is out of its range.
        """

    @abstractmethod
    def local_force(self, body: Forces, e: S, e_t: S, properties: S, parameters: S) -> S:
        """Return the part of the force that is a sum over the elements, (d,), N and N m.

        Parameters
        ----------
        body : Forces
            A whole beam or one element of it: the force of the beam is the sum of those of its elements.
        e, e_t, properties : SX or MX
            Coordinates (d,), rates and properties of the body.
        parameters : SX or MX
            The parameters of the law.
        """

    @property
    def dissipative(self) -> bool:
        """True if the force adds energy to no motion."""
        return True

    def projection(self, model: Model) -> Array:
        """Return B (4 n + 4, m) of the part R B diag(d) B^T R^T e_t of the force; m is 0 where there is none."""
        return np.zeros((model.size, 0))

    def rates(self, parameters: cs.MX) -> cs.MX:
        """Return d (m,) of the part R B diag(d) B^T R^T e_t of the force, 1/s."""
        return cs.MX(0, 1)

    @abstractmethod
    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return the equivalent damping ratio of each mode at its tip amplitude (m), (m,)."""

    @final
    def force(self, model: Model, e: cs.MX, e_t: cs.MX) -> cs.MX:
        """Return the whole generalized force Q_damp, (4 n + 4,), N and N m, with the parameters' values."""
        values, properties = cs.MX(cs.DM([value for _, value in self.parameters])), cs.MX(cs.DM(model.properties))
        B = turned(cs.MX(cs.DM(self.projection(model))), model.beam.axis, e[2:NODE])
        return self.local_force(model, e, e_t, properties, values) + B @ (self.rates(values) * (B.T @ e_t))

    @final
    def __add__(self, other: DampingLaw) -> DampingLaw:
        """Return the law whose force is the sum of both."""
        check_instance(other, "damping", DampingLaw)
        return SumOfLaws((*_terms(self), *_terms(other)))


@final
@dataclass(frozen=True)
class SumOfLaws(DampingLaw):
    """Several laws acting together; made by adding them.

    Parameters
    ----------
    laws : tuple of DampingLaw
        The terms.
    """

    laws: tuple[DampingLaw, ...]

    @property
    def parameters(self) -> tuple[tuple[str, float], ...]:
        """The parameters of all terms, in their order."""
        return tuple(parameter for law in self.laws for parameter in law.parameters)

    @property
    def dissipative(self) -> bool:
        """True if every term adds energy to no motion."""
        return all(law.dissipative for law in self.laws)

    def with_parameters(self, values: Sequence[float] | Array) -> SumOfLaws:
        """Return the sum with other values of the parameters of all terms."""
        own = iter(numbers(self, values))
        return SumOfLaws(tuple(law.with_parameters([next(own) for _ in law.parameters]) for law in self.laws))

    def local_force(self, body: Forces, e: S, e_t: S, properties: S, parameters: S) -> S:
        """Return the sum of the local forces."""
        terms = zip(self.laws, self._split(parameters), strict=True)
        return sum((law.local_force(body, e, e_t, properties, own) for law, own in terms), 0 * e_t)

    def projection(self, model: Model) -> Array:
        """Return the projections side by side."""
        return np.hstack([law.projection(model) for law in self.laws])

    def rates(self, parameters: cs.MX) -> cs.MX:
        """Return the rates of all terms."""
        return cs.vertcat(*(law.rates(own) for law, own in zip(self.laws, self._split(parameters), strict=True)))

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return the sum of the equivalent ratios."""
        return np.asarray(np.sum([law.damping_ratios(modes, amplitudes) for law in self.laws], axis=0))

    def _split(self, parameters: S) -> list[S]:
        """Return each term's share of the parameters."""
        ends = np.cumsum([0, *(len(law.parameters) for law in self.laws)]).tolist()
        return [cs.reshape(parameters[begin:end], end - begin, 1) for begin, end in pairwise(ends)]


def weighted(forces: Sequence[Any], parameters: S, rates: S) -> S:
    """Return the sum of forces times the parameters, as many; zeros of the size of ``rates`` if there are none."""
    total = 0 * rates
    for weight, force in zip(cs.vertsplit(parameters) if forces else [], forces, strict=True):
        total += weight * force
    return total


def nonzero(**coefficients: float) -> tuple[tuple[str, float], ...]:
    """Return the coefficients that are parameters, with their names."""
    return tuple((name, value) for name, value in coefficients.items() if value)


def numbers(law: DampingLaw, values: Sequence[float] | Array) -> list[float]:
    """Return one value a parameter of the law."""
    found = finite_numbers(values, "values")
    if len(found) != len(law.parameters):
        raise InputError(f"has {len(found)} for {len(law.parameters)} parameters", "values")
    return [*found]


def named(law: DampingLaw, values: Sequence[float] | Array) -> dict[str, Any]:
    """Return the values with the names of the law's parameters."""
    return {name: value for (name, _), value in zip(law.parameters, numbers(law, values), strict=True)}


def coefficients(law: DampingLaw, *names: str) -> None:
    """Check the coefficients of a law and keep them as floats.

    Raises
    ------
    InputError
        If one is negative or not finite.
    """
    for name in names:
        value = number(getattr(law, name), name)
        if value < 0.0:
            raise InputError(f"must not be negative, got {value:g}", name)
        object.__setattr__(law, name, value)


def _terms(law: DampingLaw) -> tuple[DampingLaw, ...]:
    return law.laws if isinstance(law, SumOfLaws) else (law,)
