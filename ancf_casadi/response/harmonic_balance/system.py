"""The small interface to a vibrating system: a second-order equation of motion with an excitation.

    0 = R(q, v, a, u, p)

for n coordinates q, their velocities v and accelerations a, the excitation u (e,) and parameters p.  R is linear in a.
Harmonic balance needs R, its derivatives

    K = dR/dq,    D = dR/dv,    M = dR/da,    U = dR/du,

and for the energy balance the power dissipated by damping and the power supplied by the excitation.  The full beam, the
reduced beam and users' systems are such systems.  All of them are evaluated at the N samples of a period at once.

A harmonic excitation at the phase tau = omega t is

    u = A (u_0 sin tau + omega u_1 cos tau - omega^2 u_2 sin tau)

with constant vectors u_0, u_1, u_2.  A motion of the clamp, A sin tau along a direction, has its displacement in u_0,
its velocity in u_1 and its acceleration in u_2.  A force has only u_0.

The excitation of a beam has 12 components: displacement (x, y) and rotation of the clamp, their velocities, their
accelerations, and force (x, y) and moment of the load.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from types import NoneType
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as cs
import numpy as np

from ancf_casadi.damping import Parameter
from ancf_casadi.dynamics.base_motion import BaseMotion, HarmonicBase
from ancf_casadi.dynamics.tip_load import HarmonicLoad, TipLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.inputs import array, check_instance, instances, physical
from ancf_casadi.support.tables import Displayed, plural

if TYPE_CHECKING:
    from ancf_casadi.response.harmonic_balance.beams import SlopeCorrections

BEAM_EXCITATION = 12
CACHED_FUNCTIONS = 64  # sets of Functions, each for a system and a number of samples


@dataclass(frozen=True)
class HarmonicForce(Displayed):
    """Excitation u = amplitude direction sin(2 pi frequency t) of a ``SecondOrderSystem``.

    Parameters
    ----------
    amplitude : float
        Amplitude, positive.
    frequency : float
        Frequency, Hz, positive.
    direction : sequence of float
        Value of each component of u at unit amplitude.

    Raises
    ------
    InputError
        If a value is not a number in its range.

    Examples
    --------
    >>> from ancf_casadi import HarmonicForce
    >>> HarmonicForce(amplitude=0.1, frequency=2.0).direction
    (1.0,)
    """

    amplitude: float
    frequency: float
    direction: Sequence[float] = (1.0,)

    def __post_init__(self) -> None:
        """Validate."""
        physical(self.amplitude, "amplitude")
        physical(self.frequency, "frequency")
        direction = array(self.direction, "direction")
        if direction.ndim != 1 or not direction.any():
            raise InputError("must be a sequence of numbers that are not all zero", "direction")
        object.__setattr__(self, "direction", tuple(direction.tolist()))


@dataclass(frozen=True, eq=False)
class Drive:
    """A harmonic excitation of a system."""

    vectors: Array  # u_0, u_1 and u_2, (3, e)
    amplitude: float  # A; of a beam, m, N or N m
    omega: float  # rad/s
    unit: str = ""  # of the amplitude
    direction: tuple[float, float] = (0.0, 0.0)  # of the base motion or the force; zero for a moment alone

    @property
    def moves_base(self) -> bool:
        """True if the excitation is a motion of the base."""
        return bool(self.vectors[1].any())

    def expression(self, phases: Array, omega: cs.MX, amplitude: cs.MX) -> cs.MX:
        """Return u at phases (k,) as an expression, (e, k)."""
        constant, linear, square = map(cs.DM, self._powers(phases))
        return amplitude * (constant + omega * linear + omega**2 * square)

    def samples(self, phases: Array, omega: float, amplitude: float) -> tuple[Array, Array, Array]:
        """Return u and its derivatives with respect to omega and A at phases (k,), each (e, k)."""
        constant, linear, square = self._powers(phases)
        shape = constant + omega * linear + omega**2 * square
        return amplitude * shape, amplitude * (linear + 2 * omega * square), shape

    def _powers(self, phases: Array) -> Array:
        """Return the coefficients of 1, omega and omega^2 in u/A, (3, e, k)."""
        factors = np.array([np.sin(phases), np.cos(phases), -np.sin(phases)])
        return np.asarray(self.vectors[:, :, None] * factors[:, None, :])


def no_drive(components: int) -> Drive:
    """Return a drive without any excitation."""
    return Drive(np.zeros((3, components)), 0.0, 1.0)


def beam_drive(base: BaseMotion | None, load: TipLoad | None) -> Drive:
    """Return the excitation of a beam by its base or a load, at its full amplitude."""
    if (base is None) == (load is None):
        raise InputError("give either a HarmonicBase or a HarmonicLoad", "base" if base is not None else "load")
    vectors = np.zeros((3, BEAM_EXCITATION))
    if base is not None:
        check_instance(base, "base", HarmonicBase)
        assert isinstance(base, HarmonicBase)
        _check_endless(base.stop, "base")
        for order in range(3):
            vectors[order, 3 * order : 3 * order + 2] = base.direction
        return Drive(vectors, base.amplitude, 2 * math.pi * base.frequency, "m", base.direction)
    check_instance(load, "load", HarmonicLoad)
    assert isinstance(load, HarmonicLoad)
    _check_endless(load.stop, "load")
    if load.follower:
        raise InputError("follows the beam, which needs simulate or motion", "load")
    force = math.hypot(*load.force)
    amplitude, unit = (force, "N") if force else (abs(load.moment), "N m")
    if not amplitude:
        raise InputError("is zero", "load")
    vectors[0, 9:] = np.array([*load.force, load.moment]) / amplitude
    direction = (load.force[0] / force, load.force[1] / force) if force else (0.0, 0.0)
    return Drive(vectors, amplitude, 2 * math.pi * load.frequency, unit, direction)


def force_drive(force: HarmonicForce | None, components: int) -> Drive:
    """Return the excitation of a system by a harmonic force."""
    check_instance(force, "force", HarmonicForce)
    assert force is not None
    if len(force.direction) != components:
        raise InputError(f"has {len(force.direction)} entries for {components} of the excitation", "direction")
    vectors = np.zeros((3, components))
    vectors[0] = force.direction
    return Drive(vectors, force.amplitude, 2 * math.pi * force.frequency)


def _check_endless(stop: float, where: str) -> None:
    if stop != math.inf:
        raise InputError("stops; a steady vibration needs an excitation without a stop", where)


class SampledFunctions(NamedTuple):
    """A system at N samples, as Functions of q, v, a (n, N), u (e, N) and p."""

    balance: cs.Function  # -> R (n, N)
    tangents: cs.Function  # also of u_1, u_2 (e, N) -> the entries of K, D and M (k, N); U u_1 and U u_2 (n, N)
    powers: cs.Function  # -> powers lost to damping and supplied by the excitation, each (1, N), W
    differentiable: cs.Function  # -> R, like ``balance``, which may be machine code without derivatives

    @classmethod
    def of(
        cls,
        symbols: Sequence[Any],
        residual: Any,
        tangents: Sequence[Any],
        powers: Sequence[Any],
        differentiable: Any = None,
    ) -> SampledFunctions:
        """Return the Functions of expressions in q, v, a, u, p, u_1 and u_2, all SX or all MX.

        ``differentiable`` is R without machine code; ``residual`` serves if it is None.
        """

        def function(name: str, results: Sequence[Any], outputs: list[str], inputs: str = "q v a u p") -> cs.Function:
            names, dense = inputs.split(), [cs.densify(expression) for expression in results]
            return cs.Function(name, list(symbols[: len(names)]), dense, names, outputs, {"cse": True})

        balance = function("balance", [residual], ["R"])
        matrices = function("tangents", tangents, ["K", "D", "M", "R_1", "R_2"], "q v a u p u_1 u_2")
        balance_of_powers = function("powers", powers, ["lost", "supplied"])
        differentiable_balance = balance if differentiable is None else function("balance", [differentiable], ["R"])
        return cls(balance, matrices, balance_of_powers, differentiable_balance)


@dataclass(frozen=True, eq=False)
class SecondOrderSystem(Displayed):
    """A system of second-order equations of motion.

    Parameters
    ----------
    functions : callable
        Returns the Functions for a number of samples.
    entries : (array, array)
        Rows and columns (k,) of the entries of K, D and M, each place once.
    parameters : tuple of Parameter
        The parameters p, with their values.
    excitation : int
        Number e of components of the excitation.
    rest : array (n,)
        Coordinates near those at rest without excitation.
    scale : array (n,)
        Typical size of each coordinate.
    mirror : array (n,)
        Signs P of a mirror symmetry, R(P q, P v, P a, -u) = P R(q, v, a, u); ones if there is none.
    corrections : SlopeCorrections, optional
        Turns corrections of the coordinates with a beam; they are added if there is none.

    Examples
    --------
    An oscillator with a cubic stiffness:

    >>> import casadi as cs
    >>> from ancf_casadi import Parameter, SecondOrderSystem
    >>> q, v, a, u, mu = (cs.SX.sym(name) for name in ("q", "v", "a", "u", "mu"))
    >>> duffing = SecondOrderSystem.of(
    ...     q, v, a, u, mu, conservative=a + q + mu * q**3, damping=0.02 * v, excitation=u,
    ...     parameters=[Parameter("mu", 0.5, "1/m^2", "cubic stiffness")])
    >>> duffing.size
    1
    """

    functions: Callable[[int], SampledFunctions]
    entries: tuple[Index, Index]
    parameters: tuple[Parameter, ...]
    excitation: int
    rest: Array
    scale: Array
    mirror: Array
    corrections: SlopeCorrections | None = None

    @classmethod
    def of(
        cls,
        q: cs.SX,
        v: cs.SX,
        a: cs.SX,
        u: cs.SX,
        p: cs.SX | None = None,
        *,
        conservative: cs.SX,
        damping: cs.SX | None = None,
        excitation: cs.SX | None = None,
        parameters: Sequence[Parameter] = (),
        rest: Array | Sequence[float] | None = None,
        scale: Array | Sequence[float] | None = None,
    ) -> SecondOrderSystem:
        """Return the system ``conservative + damping = excitation`` of CasADi expressions.

        Parameters
        ----------
        q, v, a : SX
            Symbols of coordinates, velocities and accelerations, (n,).
        u : SX
            Symbol of the excitation, (e,).
        p : SX, optional
            Symbol of the parameters.
        conservative : SX
            Forces of inertia and stiffness, (n,); linear in ``a``.
        damping : SX, optional
            Damping forces, (n,).  A force with a kink, such as friction, needs many samples; replace sign(v) by
            v/sqrt(v^2 + v0^2) with a small velocity v0.
        excitation : SX, optional
            Exciting forces, (n,), which may depend on all symbols.
        parameters : sequence of Parameter
            Names and values of ``p``.
        rest : array_like (n,), optional
            Coordinates at rest, from which an equilibrium is sought; zero if not given.
        scale : array_like (n,), optional
            Typical size of each coordinate; 1 if not given.

        Raises
        ------
        InputError
            If the numbers of entries disagree, expressions contain other symbols, or inertia is not linear in ``a``.
        """
        required = {"q": q, "v": v, "a": a, "u": u, "conservative": conservative}
        for name, value in {**required, "p": p, "damping": damping, "excitation": excitation}.items():
            check_instance(value, name, cs.SX, *(() if name in required else (NoneType,)))
        n = q.numel()
        no_force = cs.SX.zeros(n)
        p = cs.SX(0, 1) if p is None else p
        parameters = instances(parameters, "parameters", Parameter, minimum=0)
        if p.numel() != len(parameters):
            raise InputError(f"has {len(parameters)} entries for {p.numel()} symbols", "parameters")
        damping, excitation = (no_force if force is None else force for force in (damping, excitation))
        for name, force in (("v", v), ("a", a), ("conservative", conservative), ("damping", damping),
                           ("excitation", excitation)):  # fmt: skip
            if force.numel() != n:
                raise InputError(f"has {force.numel()} entries for {n} coordinates", name)
        symbols = [q, v, a, u, p]
        unknown = [
            symbol.name()
            for symbol in cs.symvar(cs.vertcat(conservative, damping, excitation))
            if not any(cs.depends_on(argument, symbol) for argument in symbols)
        ]
        if unknown:
            raise InputError(f"contains the unknown symbols {', '.join(unknown)}; make them entries of p", "system")
        if cs.depends_on(cs.jacobian(conservative, a), a):
            raise InputError("must be linear in the accelerations a", "conservative")
        residual, directions = conservative + damping - excitation, [cs.SX.sym("u", u.numel()) for _ in range(2)]
        matrices = [cs.vec(cs.jacobian(residual, variable)) for variable in (q, v, a)]
        excitation_forces = [cs.jtimes(residual, u, direction) for direction in directions]
        powers = [cs.dot(v, damping), cs.dot(v, excitation)]
        one_sample = SampledFunctions.of([*symbols, *directions], residual, [*matrices, *excitation_forces], powers)
        return cls(
            functions=partial(map_samples, one_sample),
            entries=dense_entries(n),
            parameters=parameters,
            excitation=u.numel(),
            rest=_vector(rest, n, 0.0, "rest"),
            scale=_vector(scale, n, 1.0, "scale"),
            mirror=np.ones(n),
        )

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return len(self.rest)

    @cached_property
    def values(self) -> Array:
        """The values of p."""
        return np.array([parameter.value for parameter in self.parameters], dtype=float)

    def matrix(self, values: Array) -> Array:
        """Return the matrices (..., n, n) of entries (..., k) of K, D or M."""
        rows, columns = self.entries
        result = np.zeros((*values.shape[:-1], self.size, self.size))
        result[..., rows, columns] = values
        return result

    def with_values(self, values: Sequence[float] | Array) -> SecondOrderSystem:
        """Return the system with other values of its parameters, in their order."""
        new_values = array(values, "values")
        if new_values.shape != (len(self.parameters),):
            raise InputError(f"has {new_values.size} entries for {len(self.parameters)} parameters", "values")
        pairs = zip(self.parameters, new_values.tolist(), strict=True)
        return replace(self, parameters=tuple(replace(parameter, value=value) for parameter, value in pairs))

    def _summary(self) -> str:
        values = ", ".join(f"{parameter.name}={parameter.value:.6g}" for parameter in self.parameters)
        return f"{plural(self.size, 'coordinate')}{values and f', {values}'}"


def dense_entries(size: int) -> tuple[Index, Index]:
    """Return rows and columns of all entries of a square matrix, column by column."""
    columns, rows = np.divmod(np.arange(size * size), size)
    return rows, columns


@lru_cache(maxsize=CACHED_FUNCTIONS)
def map_samples(one_sample: SampledFunctions, samples: int) -> SampledFunctions:
    """Return the Functions of one sample, mapped over N samples with common parameters."""

    def map_function(function: cs.Function) -> cs.Function:
        names = function.name_in()
        symbols = [cs.MX.sym(name, function.numel_in(k), 1 if name == "p" else samples) for k, name in enumerate(names)]
        results = function.map(samples).call([cs.repmat(x, 1, samples // x.size2()) for x in symbols])
        return cs.Function(function.name(), symbols, results, names, function.name_out())

    return SampledFunctions(*map(map_function, one_sample))


def _vector(value: Array | Sequence[float] | None, size: int, default: float, where: str) -> Array:
    """Return a vector of the size; None stands for entries with the default."""
    if value is None:
        return np.full(size, default)
    values = np.atleast_1d(array(value, where))
    if values.shape != (size,):
        raise InputError(f"has {values.size} entries for {size} coordinates", where)
    return values
