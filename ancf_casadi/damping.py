"""External damping laws: proportional, quadratic and generic, and their sums.

A law adds the force Q_damp(e, e_t) to the left of the equation of motion, M e_tt + Q_damp + Q_e = Q_g.  The rates e_t
are those of the laboratory frame, so that external damping is motion against the still air.

    proportional    Q = alpha M e_t + beta (stiffness-proportional part),          Eq. (14)
    quadratic       Q = int S^T (gamma1 v + gamma2 |v| v) dp,                       Eq. (19), (23)
    generic         Q = M Phi diag(2 zeta omega) Phi^T M e_t,                       Eq. (32)

A force is the sum of a local part, written with the element Functions and sparse, and of a part B diag(d) B^T e_t of
low rank, which an integrator can keep sparse by making B^T e_t its unknowns.  Both are symbolic in the properties of
the beam and in the parameters of the law.  A coefficient of exactly 0 is no parameter: its term is absent.

Each law tells the equivalent damping ratio it gives a mode that swings with a tip amplitude A: the viscous ratio with
the same loss of energy in a period.

References
----------
"Comparison of external damping models in a large deformation problem", Section 4; with Eq. (18), (31) and the units of
eta2 put right (damping on the left; Phi^-T = M Phi; 1/m).
"""

from __future__ import annotations

import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal, final, get_args

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ancf_casadi.exceptions import InputError
from ancf_casadi.inputs import number
from ancf_casadi.model import Model
from ancf_casadi.modes import Modes

Array = NDArray[np.float64]
ProportionalStiffness = Literal["strain-rate", "tangent", "reference"]

DRAG_CONSTANT = 1183 / 876  # gamma2 = eta2 mu 1183/876, Eq. (24)-(25) exact; the paper rounds 876/1183 to 0.74


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
    def local_force(self, model: Model, e: cs.MX, e_t: cs.MX, properties: cs.MX, parameters: cs.MX) -> cs.MX:
        """Return the part of the force that couples neighbouring nodes only, (4 n + 4,), N and N m."""

    def projection(self, model: Model) -> Array:
        """Return B (4 n + 4, m) of the part B diag(d) B^T e_t of the force; m is 0 where there is none."""
        return np.zeros((model.size, 0))

    def rates(self, parameters: cs.MX) -> cs.MX:
        """Return d (m,) of the part B diag(d) B^T e_t of the force, 1/s."""
        return cs.MX(0, 1)

    @abstractmethod
    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return the equivalent damping ratio of each mode at its tip amplitude (m), (m,)."""

    @final
    def force(self, model: Model, e: cs.MX, e_t: cs.MX) -> cs.MX:
        """Return the whole generalized force Q_damp, (4 n + 4,), N and N m, with the parameters' values."""
        values, properties = cs.MX(cs.DM([value for _, value in self.parameters])), cs.MX(cs.DM(model.properties))
        B = cs.DM(self.projection(model))
        return self.local_force(model, e, e_t, properties, values) + B @ (self.rates(values) * (B.T @ e_t))

    @final
    def __add__(self, other: DampingLaw) -> DampingLaw:
        """Return the law whose force is the sum of both."""
        return SumOfLaws((*_terms(self), *_terms(other)))


@final
@dataclass(frozen=True)
class RayleighDamping(DampingLaw):
    """Proportional damping C = alpha M + beta K, Eq. (14).

    Parameters
    ----------
    alpha : float
        Mass-proportional coefficient, 1/s.
    beta : float
        Stiffness-proportional coefficient, s.
    stiffness : {"strain-rate", "tangent", "reference"}
        What K means in large motion.  ``strain-rate``: a Kelvin-Voigt force on the rates of axial strain and
        curvature, objective, with the elastic K of the straight beam as its linearisation.  ``tangent``: the tangent
        stiffness where the beam is.  ``reference``: the constant K of the straight beam, the paper's letter; it is
        not objective, and in rotated elements its axial part resists the motion itself.

    Raises
    ------
    InputError
        If a coefficient is negative or not finite, or the name unknown.
    """

    alpha: float = 0.0
    beta: float = 0.0
    stiffness: ProportionalStiffness = "strain-rate"

    def __post_init__(self) -> None:
        """Validate."""
        _coefficients(self, "alpha", "beta")
        if self.stiffness not in get_args(ProportionalStiffness):
            known = ", ".join(get_args(ProportionalStiffness))
            raise InputError(f"must be one of {known}, got {self.stiffness!r}", "stiffness")
        if self.stiffness == "reference" and self.beta > 0.0:
            message = "damping proportional to the reference stiffness is not objective: it resists large rotations"
            warnings.warn(message, stacklevel=3)

    @property
    def parameters(self) -> tuple[tuple[str, float], ...]:
        """Alpha (1/s) and beta (s)."""
        return _nonzero(alpha=self.alpha, beta=self.beta)

    def with_parameters(self, values: Sequence[float] | Array) -> RayleighDamping:
        """Return the law with other coefficients."""
        return replace(self, **_named(self, values))

    def local_force(self, model: Model, e: cs.MX, e_t: cs.MX, properties: cs.MX, parameters: cs.MX) -> cs.MX:
        """Return alpha M e_t and the stiffness-proportional force, Eq. (11) with Eq. (14)."""
        forces = []
        if self.alpha:
            forces.append(model.inertia_force(e_t, properties))
        if self.beta and self.stiffness == "strain-rate":
            forces.append(model.strain_rate_force(e, e_t, properties))
        elif self.beta and self.stiffness == "tangent":
            forces.append(model.tangent_force(e, e_t, properties))
        elif self.beta:
            forces.append(model.tangent_stiffness(model.straight, properties) @ e_t)
        return cs.horzcat(cs.MX(model.size, 0), *forces) @ parameters

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return zeta = alpha/(2 omega) + beta phi^T K phi/(2 omega) at any amplitude.

        With the ``tangent`` stiffness phi^T K phi is omega^2, and this Eq. (16).  The other two lack the stiffness that
        gravity adds or takes: 4 % of the beta part in mode 2 of the paper's beam.
        """
        stiffness = modes.angular**2
        if self.stiffness != "tangent":
            model, p, rest = modes.model, modes.model.properties, modes.equilibrium.coordinates
            if self.stiffness == "strain-rate":
                forces = [model.strain_rate_force(rest, phi, p).full().ravel() for phi in modes.shapes.T]
            else:
                forces = list((model.tangent_stiffness(model.straight, p).sparse() @ modes.shapes).T)
            stiffness = np.array([phi @ force for phi, force in zip(modes.shapes.T, forces, strict=True)])
        return np.asarray((self.alpha + self.beta * stiffness) / (2 * modes.angular))


@final
@dataclass(frozen=True)
class QuadraticDamping(DampingLaw):
    """Air drag along the beam, linear and quadratic in the speed: gamma1 v + gamma2 |v| v, Eq. (19).

    gamma1 = eta1 mu and gamma2 = eta2 mu 1183/876, Eq. (25), so that Eq. (26) is what it becomes in the one-mode
    form of Eq. (21).

    Parameters
    ----------
    eta1 : float
        Linear coefficient, 1/s.
    eta2 : float
        Quadratic coefficient, 1/m.  The paper's tables are per mm.

    Raises
    ------
    InputError
        If a coefficient is negative or not finite.
    """

    eta1: float = 0.0
    eta2: float = 0.0

    def __post_init__(self) -> None:
        """Validate."""
        _coefficients(self, "eta1", "eta2")

    @property
    def parameters(self) -> tuple[tuple[str, float], ...]:
        """Eta1 (1/s) and eta2 (1/m)."""
        return _nonzero(eta1=self.eta1, eta2=self.eta2)

    def with_parameters(self, values: Sequence[float] | Array) -> QuadraticDamping:
        """Return the law with other coefficients."""
        return replace(self, **_named(self, values))

    def local_force(self, model: Model, e: cs.MX, e_t: cs.MX, properties: cs.MX, parameters: cs.MX) -> cs.MX:
        """Return eta1 int S^T mu v dp + eta2 1183/876 int S^T mu |v| v dp, Eq. (23)."""
        forces = []
        if self.eta1:
            forces.append(model.line_inertia_force(e_t, properties))
        if self.eta2:
            forces.append(DRAG_CONSTANT * model.drag_force(e_t, properties))
        return cs.horzcat(cs.MX(model.size, 0), *forces) @ parameters

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return zeta = b eta1/(2 omega) + 4 eta2 c A/(3 pi), with c = 1183/876 int mu |phi|^3 dp / phi^T M phi.

        The mode shape phi is 1 at the tip; c is 1 for the shape of Eq. (21), and less for the higher modes.
        b = int mu phi^2 dp / phi^T M phi is 1 unless the tip carries a mass.

        Raises
        ------
        InputError
            If there is not one amplitude a mode.
        """
        model = modes.model
        shapes = modes.shapes / modes.tip_amplitudes()
        mass = model.mass(model.properties).sparse()
        linear, quadratic = [], []
        for phi in shapes.T:
            forces = (
                function(phi, model.properties).full() for function in (model.line_inertia_force, model.drag_force)
            )
            shares = [float(phi @ force.ravel() / (phi @ (mass @ phi))) for force in forces]
            linear.append(self.eta1 * shares[0])
            quadratic.append(4 * self.eta2 * DRAG_CONSTANT * shares[1] / (3 * math.pi))
        if len(amplitudes) != modes.count:
            raise InputError(f"has {len(amplitudes)} values for {modes.count} modes", "amplitudes")
        return np.asarray(np.array(linear) / (2 * modes.angular) + np.array(quadratic) * np.abs(amplitudes))


@final
@dataclass(frozen=True, eq=False)
class ModalDamping(DampingLaw):
    """Generic damping from measured modal parameters, C = M Phi diag(2 zeta omega) Phi^T M, Eq. (32).

    Modes beyond those given are undamped.

    Parameters
    ----------
    modes : Modes
        Natural modes of the beam, at least as many as there are ratios.
    ratios : sequence of float
        Damping ratio of each mode from the first, at least 0 and below 1.
    frequencies : sequence of float, optional
        Measured natural frequencies, Hz; those of ``modes`` if not given.

    Raises
    ------
    InputError
        If a ratio is negative, 1 or more, or the lengths do not fit.
    """

    modes: Modes
    ratios: Sequence[float]
    frequencies: Sequence[float] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Validate, and keep the numbers as tuples."""
        if not hasattr(self.ratios, "__len__"):
            raise InputError(f"must have one value a mode, got {self.ratios!r}", "ratios")
        object.__setattr__(self, "ratios", tuple(damping_ratio(zeta, "ratios") for zeta in self.ratios))
        if not 1 <= len(self.ratios) <= self.modes.count:
            raise InputError(f"has {len(self.ratios)} values for {self.modes.count} modes", "ratios")
        given = self.modes.frequencies[: len(self.ratios)] if self.frequencies is None else self.frequencies
        if len(given) != len(self.ratios):
            raise InputError(f"has {len(given)} values for {len(self.ratios)} ratios", "frequencies")
        frequencies = tuple(number(frequency, "frequencies") for frequency in given)
        if min(frequencies) <= 0.0:
            raise InputError("must be positive", "frequencies")
        object.__setattr__(self, "frequencies", frequencies)

    @property
    def parameters(self) -> tuple[tuple[str, float], ...]:
        """The damping ratios."""
        return tuple((f"ratio{k + 1}", zeta) for k, zeta in enumerate(self.ratios))

    def with_parameters(self, values: Sequence[float] | Array) -> ModalDamping:
        """Return the law with other ratios."""
        return replace(self, ratios=tuple(_named(self, values).values()))

    def local_force(self, model: Model, e: cs.MX, e_t: cs.MX, properties: cs.MX, parameters: cs.MX) -> cs.MX:
        """Return zero."""
        return cs.MX(model.size, 1)

    def projection(self, model: Model) -> Array:
        """Return B = M Phi, so that C = B diag(2 zeta omega) B^T.

        Raises
        ------
        InputError
            If the modes are those of a mesh with another number of elements.
        """
        if self.modes.model.size != model.size:
            raise InputError("belong to a beam with another number of elements", "modes")
        mass = self.modes.model.mass(self.modes.model.properties).sparse()
        return np.asarray(mass @ self.modes.shapes[:, : len(self.ratios)])

    def rates(self, parameters: cs.MX) -> cs.MX:
        """Return 2 zeta omega."""
        return 4 * math.pi * cs.DM(list(self.frequencies or ())) * parameters

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return phi^T C phi / (2 omega) for each mode, at any amplitude: the given ratios for the given modes."""
        rates = 4 * math.pi * np.array(self.ratios) * np.array(self.frequencies)
        return np.asarray(rates @ (self.projection(modes.model).T @ modes.shapes) ** 2 / (2 * modes.angular))


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

    def with_parameters(self, values: Sequence[float] | Array) -> SumOfLaws:
        """Return the sum with other values of the parameters of all terms."""
        own = iter(_numbers(self, values))
        return SumOfLaws(tuple(law.with_parameters([next(own) for _ in law.parameters]) for law in self.laws))

    def local_force(self, model: Model, e: cs.MX, e_t: cs.MX, properties: cs.MX, parameters: cs.MX) -> cs.MX:
        """Return the sum of the local forces."""
        terms = zip(self.laws, self._split(parameters), strict=True)
        return cs.sum2(cs.horzcat(*(law.local_force(model, e, e_t, properties, own) for law, own in terms)))

    def projection(self, model: Model) -> Array:
        """Return the projections side by side."""
        return np.hstack([law.projection(model) for law in self.laws])

    def rates(self, parameters: cs.MX) -> cs.MX:
        """Return the rates of all terms."""
        return cs.vertcat(*(law.rates(own) for law, own in zip(self.laws, self._split(parameters), strict=True)))

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return the sum of the equivalent ratios."""
        return np.asarray(np.sum([law.damping_ratios(modes, amplitudes) for law in self.laws], axis=0))

    def _split(self, parameters: cs.MX) -> list[cs.MX]:
        """Return each term's share of the parameters."""
        ends = np.cumsum([0, *(len(law.parameters) for law in self.laws)]).tolist()
        return [cs.reshape(parameters[begin:end], end - begin, 1) for begin, end in pairwise(ends)]


def damping_ratio(value: Any, where: str) -> float:
    """Return a damping ratio as a float.

    Raises
    ------
    InputError
        If it is not a number from 0 to below 1.
    """
    zeta = number(value, where)
    if not 0.0 <= zeta < 1.0:
        raise InputError(f"a damping ratio must be at least 0 and below 1, got {zeta:g}", where)
    return zeta


def _nonzero(**coefficients: float) -> tuple[tuple[str, float], ...]:
    return tuple((name, value) for name, value in coefficients.items() if value)


def _numbers(law: DampingLaw, values: Sequence[float] | Array) -> list[float]:
    """Return one value a parameter of the law."""
    if len(values) != len(law.parameters):
        raise InputError(f"has {len(values)} for {len(law.parameters)} parameters", "values")
    return [float(value) for value in values]


def _named(law: DampingLaw, values: Sequence[float] | Array) -> dict[str, Any]:
    """Return the values with the names of the law's parameters."""
    return {name: value for (name, _), value in zip(law.parameters, _numbers(law, values), strict=True)}


def _coefficients(law: DampingLaw, *names: str) -> None:
    for name in names:
        value = number(getattr(law, name), name)
        if value < 0.0:
            raise InputError(f"must not be negative, got {value:g}", name)
        object.__setattr__(law, name, value)


def _terms(law: DampingLaw) -> tuple[DampingLaw, ...]:
    return law.laws if isinstance(law, SumOfLaws) else (law,)
