"""The small interface to a vibrating system: a second-order equation of motion with an excitation.

    0 = R(q, v, a, u, p)

for n coordinates q, their velocities v and accelerations a, the excitation u (e,) and parameters p.  R is linear in a.
Harmonic balance needs R, its derivatives

    K = dR/dq,    D = dR/dv,    M = dR/da,    U = dR/du,

and for the balance of energy the power lost to damping and the power supplied by the excitation.  The full beam, the
reduced beam and systems of users are such systems.  All of them are evaluated at the N samples of a period at once.

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
from ancf_casadi.support.tables import Displayed, counted

if TYPE_CHECKING:
    from ancf_casadi.response.harmonic_balance.beams import Turning

BEAM_EXCITATION = 12
KEPT_FUNCTIONS = 64  # sets of Functions, each of a system and a number of samples, that are kept


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

    parts: Array  # u_0, u_1 and u_2, (3, e)
    amplitude: float  # A; of a beam, m, N or N m
    omega: float  # rad/s
    unit: str = ""  # of the amplitude
    direction: tuple[float, float] = (0.0, 0.0)  # of the base motion or the force; zero for a moment alone

    @property
    def moves_base(self) -> bool:
        """True if the excitation is a motion of the base."""
        return bool(self.parts[1].any())

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
        return np.asarray(self.parts[:, :, None] * factors[:, None, :])


def no_drive(components: int) -> Drive:
    """Return a drive without any excitation."""
    return Drive(np.zeros((3, components)), 0.0, 1.0)


def beam_drive(base: BaseMotion | None, load: TipLoad | None) -> Drive:
    """Return the excitation of a beam by its base or a load, at its full amplitude."""
    if (base is None) == (load is None):
        raise InputError("give either a HarmonicBase or a HarmonicLoad", "base" if base is not None else "load")
    parts = np.zeros((3, BEAM_EXCITATION))
    if base is not None:
        check_instance(base, "base", HarmonicBase)
        assert isinstance(base, HarmonicBase)
        _check_endless(base.stop, "base")
        for order in range(3):
            parts[order, 3 * order : 3 * order + 2] = base.direction
        return Drive(parts, base.amplitude, 2 * math.pi * base.frequency, "m", base.direction)
    check_instance(load, "load", HarmonicLoad)
    assert isinstance(load, HarmonicLoad)
    _check_endless(load.stop, "load")
    if load.follower:
        raise InputError("follows the beam, which needs simulate or motion", "load")
    force = math.hypot(*load.force)
    amplitude, unit = (force, "N") if force else (abs(load.moment), "N m")
    if not amplitude:
        raise InputError("is zero", "load")
    parts[0, 9:] = np.array([*load.force, load.moment]) / amplitude
    direction = (load.force[0] / force, load.force[1] / force) if force else (0.0, 0.0)
    return Drive(parts, amplitude, 2 * math.pi * load.frequency, unit, direction)


def force_drive(force: HarmonicForce | None, components: int) -> Drive:
    """Return the excitation of a system by a harmonic force."""
    check_instance(force, "force", HarmonicForce)
    assert force is not None
    if len(force.direction) != components:
        raise InputError(f"has {len(force.direction)} entries for {components} of the excitation", "direction")
    parts = np.zeros((3, components))
    parts[0] = force.direction
    return Drive(parts, force.amplitude, 2 * math.pi * force.frequency)


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
        cls, symbols: Sequence[Any], residual: Any, tangents: Sequence[Any], powers: Sequence[Any], plain: Any = None
    ) -> SampledFunctions:
        """Return the Functions of expressions in q, v, a, u, p, u_1 and u_2, all SX or all MX; ``plain`` is R again."""

        def function(name: str, results: Sequence[Any], outputs: list[str], inputs: str = "q v a u p") -> cs.Function:
            names, dense = inputs.split(), [cs.densify(part) for part in results]
            return cs.Function(name, list(symbols[: len(names)]), dense, names, outputs, {"cse": True})

        balance = function("balance", [residual], ["R"])
        matrices = function("tangents", tangents, ["K", "D", "M", "R_1", "R_2"], "q v a u p u_1 u_2")
        given = function("powers", powers, ["lost", "supplied"])
        return cls(balance, matrices, given, balance if plain is None else function("balance", [plain], ["R"]))


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
    corrections : Turning, optional
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
    corrections: Turning | None = None

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
            If the numbers of entries disagree, or the expressions contain other symbols.
        """
        needed = {"q": q, "v": v, "a": a, "u": u, "conservative": conservative}
        for name, given in {**needed, "p": p, "damping": damping, "excitation": excitation}.items():
            check_instance(given, name, cs.SX, *(() if name in needed else (NoneType,)))
        n = q.numel()
        none = cs.SX.zeros(n)
        p = cs.SX(0, 1) if p is None else p
        own = instances(parameters, "parameters", Parameter, least=0)
        if p.numel() != len(own):
            raise InputError(f"has {len(own)} entries for {p.numel()} symbols", "parameters")
        damping, excitation = (none if part is None else part for part in (damping, excitation))
        for name, part in (("v", v), ("a", a), ("conservative", conservative), ("damping", damping),
                           ("excitation", excitation)):  # fmt: skip
            if part.numel() != n:
                raise InputError(f"has {part.numel()} entries for {n} coordinates", name)
        symbols = [q, v, a, u, p]
        strange = [
            symbol.name()
            for symbol in cs.symvar(cs.vertcat(conservative, damping, excitation))
            if not any(cs.depends_on(given, symbol) for given in symbols)
        ]
        if strange:
            raise InputError(f"contains the unknown symbols {', '.join(strange)}; make them entries of p", "system")
        residual, directions = conservative + damping - excitation, [cs.SX.sym("u", u.numel()) for _ in range(2)]
        matrices = [cs.vec(cs.jacobian(residual, own)) for own in (q, v, a)]
        driven = [cs.jtimes(residual, u, direction) for direction in directions]
        powers = [cs.dot(v, damping), cs.dot(v, excitation)]
        one = SampledFunctions.of([*symbols, *directions], residual, [*matrices, *driven], powers)
        return cls(
            functions=partial(several, one),
            entries=dense_entries(n),
            parameters=own,
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
        return np.array([own.value for own in self.parameters], dtype=float)

    def matrix(self, values: Array) -> Array:
        """Return the matrices (..., n, n) of entries (..., k) of K, D or M."""
        rows, columns = self.entries
        result = np.zeros((*values.shape[:-1], self.size, self.size))
        result[..., rows, columns] = values
        return result

    def with_values(self, values: Sequence[float] | Array) -> SecondOrderSystem:
        """Return the system with other values of its parameters, in their order."""
        given = array(values, "values")
        if given.shape != (len(self.parameters),):
            raise InputError(f"has {given.size} entries for {len(self.parameters)} parameters", "values")
        own = zip(self.parameters, given.tolist(), strict=True)
        return replace(self, parameters=tuple(replace(one, value=value) for one, value in own))

    def _summary(self) -> str:
        values = ", ".join(f"{own.name}={own.value:.6g}" for own in self.parameters)
        return f"{counted(self.size, 'coordinate')}{values and f', {values}'}"


def dense_entries(size: int) -> tuple[Index, Index]:
    """Return rows and columns of all entries of a square matrix, column by column."""
    columns, rows = np.divmod(np.arange(size * size), size)
    return rows, columns


@lru_cache(maxsize=KEPT_FUNCTIONS)
def several(ones: SampledFunctions, samples: int) -> SampledFunctions:
    """Return the Functions of N samples that evaluate those of one, with the same parameters."""

    def side_by_side(one: cs.Function) -> cs.Function:
        names = one.name_in()
        symbols = [cs.MX.sym(name, one.numel_in(k), 1 if name == "p" else samples) for k, name in enumerate(names)]
        results = one.map(samples).call([cs.repmat(x, 1, samples // x.size2()) for x in symbols])
        return cs.Function(one.name(), symbols, results, names, one.name_out())

    return SampledFunctions(*map(side_by_side, ones))


def _vector(given: Array | Sequence[float] | None, size: int, default: float, where: str) -> Array:
    """Return a vector of the given size, filled with the default if it is not given."""
    if given is None:
        return np.full(size, default)
    values = np.atleast_1d(array(given, where))
    if values.shape != (size,):
        raise InputError(f"has {values.size} entries for {size} coordinates", where)
    return values
