"""Dense output: the motion at any instant, from the steps of the integrator.

The coordinates of a thin beam that turns cannot be interpolated one by one: errors far below the tolerance would
stretch the beam more than its axial forces do.  With the slopes at the two Gauss points of each element written as
complex numbers, r' = exp(lambda + i theta), a step of the length h from t_0 therefore interpolates

    lambda + i theta         by the polynomial of degree 5 through its values and two derivatives at both ends,
    in steps of Radau, lambda by the cubic through its values at the start and the three stages instead,

because the accelerations at the ends of Radau's steps contain axial vibrations that the steps do not resolve.  Its
first step takes the first polynomial, and so begins with the rates that are given.  The nodes follow from the slopes as
sums along the beam (``radau.links``), velocities and accelerations by differentiation.

The powers are integrated when an energy is asked for: those at the stages of Radau's steps by its quadrature, while
IDAS integrates them with the motion.

A beam on springs begins at a node of its own, whose position follows the polynomial of degree 5 and whose slope is
treated like the others.  At supports further along the beam, the nodes thus computed miss their places by less than the
tolerance; these gaps are closed by a displacement that is linear in the arc length.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, cast

import casadi as cs
import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.equations import Balance, Equations, shared_equations
from ancf_casadi.dynamics.excitation import ENERGIES, EXCITATION, SAME_TIME, Excitation, Segment, excitation_pieces
from ancf_casadi.dynamics.placed_load import LOAD_SIZE, TIP
from ancf_casadi.dynamics.radau.tableau import QUINTIC, RADAU, STAGES, overstrain_weights, powers
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.mechanics.strain import gauss, hermite_slope
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.compilation import compile_together

INSTANTS_TOGETHER = 1024  # whose polynomials are gathered at once; they stay in the processor's cache

# each row a cubic, by its coefficients of 1, x, ..., x^5, with one of its values at the start and the stages equal to 1
STAGE_CUBIC = np.hstack([np.linalg.inv(np.vander([0.0, *RADAU.nodes], increasing=True)).T, np.zeros((4, 2))])


@dataclass(frozen=True, eq=False)
class Slopes:
    """Slopes of a beam as complex numbers x + i y, from those of its nodes, and back.

    The s slopes are those at the Gauss points, element by element, behind that at the beginning of the beam if the base
    is a node of its own.  With the position and slope of the base, and then the position of this beginning, they
    determine all nodes.
    """

    model: Model

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the model without the factors."""
        return {"model": self.model}

    @cached_property
    def of_nodes(self) -> scipy.sparse.csr_array:
        """The matrix (s, 2 nodes) of the slopes from r_0, r'_0, r_1, r'_1, ... of the nodes."""
        model, lengths = self.model, self.model.beam.element_lengths
        shapes: Any = [hermite_slope(xi, cast(Any, lengths)) for xi in gauss(2)[0]]
        values = np.array([np.broadcast_arrays(*of_point) for of_point in shapes])  # (2, 4, n)
        rows = np.arange(2 * lengths.size).reshape(-1, 2).T[:, None, :] + model.root
        columns = 2 * (np.arange(lengths.size) + model.root) + np.arange(4)[:, None]
        entries = [entry.ravel() for entry in np.broadcast_arrays(values, rows, columns)]
        if model.root:
            # value, row and column of the slope at the beginning of the beam
            entries = [np.append(entry, of_root) for entry, of_root in zip(entries, (1.0, 0, 3), strict=True)]
        data, *places = entries
        shape = 2 * lengths.size + model.root, model.size // 2
        return scipy.sparse.csr_array((data, np.array(places, dtype=np.int64)), shape=shape)

    @cached_property
    def _factors(self) -> Any:
        """Factors of the matrix that takes the nodes to what is known of the base, and the slopes."""
        base_rows = scipy.sparse.eye_array(2 + self.model.root, self.model.size // 2)
        return scipy.sparse.linalg.splu(
            scipy.sparse.csc_array(scipy.sparse.vstack([base_rows, self.of_nodes]), dtype=complex)
        )

    def at(self, e: Array) -> Array:
        """Return the slopes (..., s) for coordinates, or their rates, (..., size)."""
        pairs = np.ascontiguousarray(e).view(complex)
        return np.asarray(
            (self.of_nodes @ pairs.reshape(-1, pairs.shape[-1]).T).T.reshape(*e.shape[:-1], self.of_nodes.shape[0])
        )

    def nodes(self, base: Array, slopes: Array) -> Array:
        """Return the coordinates (k, size) from those known of the base, (k, 2 or 3), and slopes (k, s)."""
        nodes = np.ascontiguousarray(self._factors.solve(np.hstack([base, slopes]).T).T)
        nodes[:, : base.shape[1]] = base  # without rounding
        return nodes.view(float)

    def weights(self, row: Array) -> tuple[Array, Array]:
        """Return the weights of what is known of the base, and of the slopes, in row . nodes."""
        weights = self._factors.solve(row.astype(complex), "T").real
        return weights[: 2 + self.model.root], weights[2 + self.model.root :]


@dataclass(frozen=True, eq=False)
class Steps:
    """Consecutive steps, m of them; the polynomials are those of the time x since the start of each over its length."""

    basis: Slopes
    instants: Array  # ends of the steps, and the beginning, (m + 1,), s
    ends: Array  # coordinates, velocities and accelerations there, (m + 1, 3, size)
    stages: Array | None = None  # coordinates at the stages of each step of Radau, (m, 3, size)
    work: Array | None = None  # energies that each step of IDAS adds, (m, 3), J
    first: bool = False  # whether the first step begins with given rates
    internal: Array | None = None  # internal strains at the ends of Radau's steps, (m + 1, n, m b)

    def slopes(self, owners: Index, x: Array, orders: int) -> Iterator[tuple[slice, Array, Array]]:
        """Yield slices of the instants, their slopes and time derivatives, (orders, k, s), and those of the beginning.

        The slices follow each other.  The polynomials are not kept, because they need as much memory as the steps.
        """
        begin = int(owners.min())
        used, owners = self._cut(begin, int(owners.max()) + 1), owners - begin
        lengths, logarithms, beginnings = np.diff(used.instants), used._logarithms(), used._beginnings()
        for start in range(0, owners.size, INSTANTS_TOGETHER):
            together = slice(start, start + INSTANTS_TOGETHER)
            steps = owners[together]
            h, of_slopes, of_beginning = lengths[steps, None], logarithms[steps], beginnings[steps]
            terms = np.array(powers(x[together], orders)).swapaxes(1, 2)
            terms /= h ** np.arange(orders)[:, None, None]
            z = np.empty((orders, steps.size, of_slopes.shape[2] // 2), complex)
            log_length, angle = np.split((terms[0][:, None] @ of_slopes)[:, 0], 2, axis=1)
            size = np.exp(log_length)
            z[0].real, z[0].imag = size * np.cos(angle), size * np.sin(angle)
            rates = [_complex((of_order[:, None] @ of_slopes)[:, 0]) for of_order in terms[1:]]
            if orders > 1:
                z[1] = z[0] * rates[0]
            if orders > 2:
                z[2] = z[0] * (rates[1] + rates[0] ** 2)
            yield together, z, np.array([(of_order[:, None] @ of_beginning)[:, 0] for of_order in terms])

    def _cut(self, begin: int, end: int) -> Steps:
        """Return some consecutive steps without what their energies need."""
        return Steps(
            self.basis,
            self.instants[begin : end + 1],
            self.ends[begin : end + 1],
            None if self.stages is None else self.stages[begin:end],
            first=self.first and begin == 0,
        )

    def _logarithms(self) -> Array:
        """Return the coefficients of 1, x, ..., x^5 in lambda, then theta, of the slopes, (m, 6, 2 s)."""
        z, z_t, z_tt = (self.basis.at(self.ends[:, order]) for order in range(3))
        log_z = np.log(z)
        log_z[1:].imag = log_z[:1].imag + np.cumsum(np.angle(z[1:] / z[:-1]), axis=0)  # does not jump by 2 pi
        coefficients = self._through_ends(log_z, z_t / z, z_tt / z - (z_t / z) ** 2)
        result = np.concatenate([coefficients.real, coefficients.imag], axis=2)
        if self.stages is not None:
            lengths = np.log(np.abs(self.basis.at(self.stages[self.first :])))
            start_and_stages = np.concatenate([log_z.real[self.first : -1, None], lengths], axis=1).swapaxes(0, 1)
            result[self.first :, :, : z.shape[1]] = _polynomials(STAGE_CUBIC, *start_and_stages)
        return result

    def _beginnings(self) -> Array:
        """Return the coefficients in the position of the beam's own beginning, complex, (m, 6, 0 or 1)."""
        positions = np.ascontiguousarray(self.ends[:, :, NODE : NODE + 2]).view(complex)
        return self._through_ends(*positions[:, :, : self.basis.model.root].swapaxes(0, 1))

    def _through_ends(self, values: Array, rates: Array, changes: Array) -> Array:
        """Return the coefficients (m, 6, s) through values and two time derivatives at the ends, (m + 1, s)."""
        h = np.diff(self.instants)[:, None]
        scaled = [derivative[side] for side in (slice(-1), slice(1, None)) for derivative in (values, rates, changes)]
        return _polynomials(QUINTIC, *(derivative * h ** (k % 3) for k, derivative in enumerate(scaled)))


@dataclass(frozen=True, eq=False)
class SegmentSolution:
    """The solution on a segment."""

    segment: Segment
    steps: Steps | None  # none if the last step of the segment before reaches beyond this one
    end: State  # the state at the end of the last step
    count: int  # of the steps of the integrator


def _complex(columns: Array) -> Array:
    """Return complex numbers (k, s) from real and imaginary columns side by side."""
    real, imaginary = np.split(columns, 2, axis=1)
    return np.asarray(real + 1j * imaginary)


def _polynomials(basis: Array, *values: Array) -> Array:
    """Return the coefficients (m, c, s) of the polynomials with values (m, s) of the functionals of a basis."""
    return np.asarray(np.einsum("ek,ems->mks", basis, np.array(values)))


class MotionSource(ABC):
    """Base class of the motions that a ``Trajectory`` reads: coordinates, forces and energies at given instants."""

    @abstractmethod
    def check(self, times: Array) -> None:
        """Raise an ``InputError`` if the motion is not known at some instants."""

    @abstractmethod
    def nodes(self, times: Array, orders: int = 1) -> Array:
        """Return nodal coordinates, and their rates and accelerations up to an order, (orders, k, size)."""

    @abstractmethod
    def base_force(self, times: Array) -> Array:
        """Return the generalized force of the base on the clamped node, (k, 4)."""

    @abstractmethod
    def tip_load(self, times: Array) -> Array:
        """Return force, N, and moment, N m, of the load, (k, 3)."""

    @abstractmethod
    def energies(self, times: Array) -> Array:
        """Return the energies lost to damping and supplied by base and load since the start, (k, 3), J."""

    @property
    def relaxes(self) -> bool:
        """True if the material relaxes, so that forces depend on the earlier motion."""
        return False

    def along(self, row: Array, times: Array, order: int = 0) -> Array:
        """Return weighted sums (k, 2) of the positions and slopes of the nodes, or of a time derivative of these."""
        return np.asarray(self.nodes(times, order + 1)[order] @ np.kron(row, np.eye(2)).T)


@dataclass(frozen=True, eq=False)
class MotionSamples(MotionSource):
    """A motion that is known at its k samples alone."""

    times: Array  # (k,), s
    motion: Array  # coordinates and velocities, (2, k, size)
    forces: Array  # of the base, (k, 4)
    loads: Array  # (k, 3)
    work: Array  # the energies, (k, 3)

    def check(self, times: Array) -> None:
        """Refuse instants that are no samples."""
        self._places(times)

    def nodes(self, times: Array, orders: int = 1) -> Array:
        """Return what is known, see ``MotionSource``."""
        return np.asarray(self.motion[:orders, self._places(times)])

    def base_force(self, times: Array) -> Array:
        """Return what is known, see ``MotionSource``."""
        return np.asarray(self.forces[self._places(times)])

    def tip_load(self, times: Array) -> Array:
        """Return what is known, see ``MotionSource``."""
        return np.asarray(self.loads[self._places(times)])

    def energies(self, times: Array) -> Array:
        """Return what is known, see ``MotionSource``."""
        return np.asarray(self.work[self._places(times)])

    def _places(self, times: Array) -> Index:
        places = np.minimum(np.searchsorted(self.times, times), max(self.times.size - 1, 0))
        if not np.array_equal(self.times[places] if self.times.size else self.times, times):
            raise InputError("the motion is known at its own samples alone", "times")
        return places


@dataclass(frozen=True, eq=False)
class DenseMotion(MotionSource):
    """A motion that is known at all instants, from its steps."""

    model: Model
    law: DampingLaw
    base: BaseMotion
    load: TipLoad | None
    steps: tuple[Steps, ...]  # each within a smooth piece of the excitation

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the fields without the Functions."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def instants(self) -> Array:
        """Beginning and ends of all steps, s."""
        return np.concatenate([segment.instants for segment in self.steps]) if self.steps else np.zeros(0)

    def check(self, times: Array) -> None:
        """Refuse instants outside the steps."""
        if not self.steps:
            if times.size:
                raise InputError("the motion has no steps", "times")
            return
        begin, end = self.instants[[0, -1]].tolist()
        slack = SAME_TIME * (end - begin)
        if times.size and not (begin - slack <= times.min() and times.max() <= end + slack):
            raise InputError(f"the motion lasts from {begin:g} to {end:g} s", "times")

    def nodes(self, times: Array, orders: int = 1) -> Array:
        """Return coordinates and so on at instants within the steps, see ``MotionSource``."""
        result = np.empty((orders, times.size, self.model.size))
        for chosen, base, slopes in self._parts(times, orders):
            for order in range(orders):
                result[order, chosen] = self._basis.nodes(base[order], slopes[order])
        return result if self.model.held_at_base_alone else self._close_supports(result, times)

    def along(self, row: Array, times: Array, order: int = 0) -> Array:
        """Return weighted sums of the nodes, see ``MotionSource``, from the slopes at once."""
        if not self.model.held_at_base_alone:
            return super().along(row, times, order)
        of_base, of_slopes = self._basis.weights(row)
        result = np.empty(times.size, dtype=complex)
        for chosen, base, slopes in self._parts(times, order + 1):
            # not by BLAS, whose threads change the last digits
            result[chosen] = np.einsum("kb,b", base[order], of_base) + np.einsum("ks,s", slopes[order], of_slopes)
        return result.view(float).reshape(-1, 2)

    @property
    def relaxes(self) -> bool:
        """True if the law has Maxwell branches; their internal strains are known only at the ends of the steps."""
        return bool(self._equations.branches)

    def base_force(self, times: Array) -> Array:
        """Return the generalized force of the base on the clamped node, (k, 4)."""
        result = np.empty((times.size, NODE))
        for start in range(0, times.size, INSTANTS_TOGETHER):
            together = times[start : start + INSTANTS_TOGETHER]
            loads = self._excitation(together, EXCITATION)[:, 3 * NODE :]
            motion = [nodes.T for nodes in self.nodes(together, 3)]
            result[start : start + INSTANTS_TOGETHER] = self._base_force(*motion, loads.T).full().T
        return result

    def tip_load(self, times: Array) -> Array:
        """Return the load, see ``MotionSource``."""
        return self._excitation(times, EXCITATION)[:, 3 * NODE : 3 * NODE + LOAD_SIZE]

    def energies(self, times: Array) -> Array:
        """Return the energies, see ``MotionSource``."""
        result = np.empty((times.size, ENERGIES))
        for k, chosen, owners, x in self._places(times):
            result[chosen] = ((x[:, None] ** np.arange(4))[:, None] @ self._energies[k][owners])[:, 0]
        return result

    @cached_property
    def _energies(self) -> list[Array]:
        """Coefficients of 1, x, x^2, x^3 in the energies since the start in each of ``steps``, (m, 4, 3), J."""
        mass = self.model.mass(self.model.properties).sparse()
        total, result, velocities = np.zeros(ENERGIES), [], None
        for steps in self.steps:
            if velocities is not None:  # the base supplies the energy of an impact, if its velocity jumps
                after = steps.ends[0, 1]
                total[1] += (after @ (mass @ after) - velocities @ (mass @ velocities)) / 2
            added = self._added_energies(steps)
            ends = total + np.cumsum(added.sum(axis=1), axis=0)
            result.append(np.concatenate([np.vstack([total, ends[:-1]])[:, None], added], axis=1))
            total, velocities = ends[-1], steps.ends[-1, 1]
        return result

    def _added_energies(self, steps: Steps) -> Array:
        """Return the coefficients of x, x^2, x^3 in the energies that each step adds, (m, 3, 3), J."""
        h = np.diff(steps.instants)
        if steps.stages is None:
            added = np.zeros((h.size, STAGES, ENERGIES))
            added[:, 0] = steps.work
            return added
        model, stages = self.model, steps.stages.reshape(-1, self.model.size).T
        times = (steps.instants[:-1, None] + h[:, None] * RADAU.nodes).ravel()
        excitation = self._excitation(times, EXCITATION).T
        q, v = (model.of_free(steps.ends[:-1, order].T)[:, :, None] for order in range(2))
        rates = (model.of_free(stages).reshape(-1, h.size, STAGES) - q) @ RADAU.inverse.T / h[:, None]
        changes = (rates - v) @ RADAU.inverse.T / h[:, None]
        e_t, e_tt = (
            model.whole(x.reshape(-1, times.size), excitation[NODE * k : NODE * (k + 1)])
            for k, x in enumerate((rates, changes), start=1)
        )
        motion = stages, e_t, e_tt, excitation[3 * NODE :], *self._overstrains(steps, stages)
        powers = self._powers(*motion).full().reshape(ENERGIES, h.size, STAGES)
        return np.asarray(np.einsum("ems,cs,m->mce", powers, RADAU.integral, h))

    def _overstrains(self, steps: Steps, stages: Array) -> list[Array]:
        """Return the overstrains at the stages of some steps of Radau, (m b n, 3 s); an empty list without branches."""
        equations = self._equations
        if not equations.branches or steps.internal is None:
            return []
        h, elements = np.diff(steps.instants), self.model.beam.elements
        strains = equations.relaxed(stages, equations.parameters).full()
        strains = strains.reshape(elements, equations.branches, -1, h.size, STAGES)
        internal = np.moveaxis(steps.internal[:-1], 0, -1).reshape(*strains.shape[:-1])
        _, times = self.law.branch_values
        weights = [overstrain_weights()(tau / h[None])[0].full() for tau in times]
        W = np.array(weights).reshape(equations.branches, STAGES, h.size, STAGES)
        return [np.einsum("bisj,ebmsj->ebmsi", W, strains - internal[..., None]).reshape(-1, stages.shape[1])]

    def _places(self, times: Array) -> Iterator[tuple[int, Index, Index, Array]]:
        """Yield the number of some steps, the indices of instants within them, their steps, and their places there."""
        if not times.size:
            return
        slack = SAME_TIME * (self.instants[-1] - self.instants[0])
        ends = [segment.instants[-1] for segment in self.steps]
        segments = np.minimum(np.searchsorted(ends, times - slack), len(ends) - 1)
        for k in np.unique(segments).tolist():
            steps, inside = self.steps[k], np.flatnonzero(segments == k)
            owners = np.searchsorted(steps.instants[1:-1], times[inside])
            yield k, inside, owners, (times[inside] - steps.instants[owners]) / np.diff(steps.instants)[owners]

    def _parts(self, times: Array, orders: int) -> Iterator[tuple[Index, Array, Array]]:
        """Yield the indices of some instants, what is known of the base, (orders, j, 2 or 3), and the slopes."""
        bases = self._base_nodes(times, orders)
        for k, inside, owners, x in self._places(times):
            for together, slopes, beginning in self.steps[k].slopes(owners, x, orders):
                chosen = inside[together]
                yield chosen, np.concatenate([bases[:, chosen], beginning], axis=2), slopes

    def _base_nodes(self, times: Array, orders: int) -> Array:
        """Return position and slope of the base and their time derivatives, complex, (orders, k, 2)."""
        return self._excitation(times, orders * NODE).view(complex).reshape(-1, orders, 2).swapaxes(0, 1)

    def _excitation(self, times: Array, rows: int) -> Array:
        """Return the first ``rows`` of the excitation at instants, (k, rows)."""
        result = np.empty((times.size, rows))
        for piece, chosen in self._pieces_at(times):
            function = piece.node if rows == NODE else piece.function
            result[chosen] = function(times[None, chosen])[:rows, :].full().T
        return result

    def _pieces_at(self, times: Array) -> Iterator[tuple[Excitation, Index]]:
        """Yield the smooth pieces of the excitation, and the indices of the instants in each."""
        if not times.size:
            return
        owners = np.searchsorted([piece.end for piece in self._pieces[:-1]], times - SAME_TIME * np.ptp(self.instants))
        for k in np.unique(owners).tolist():
            yield self._pieces[k], np.flatnonzero(owners == k)

    @cached_property
    def _pieces(self) -> Sequence[Excitation]:
        begin, end = self.instants[[0, -1]].tolist()
        return excitation_pieces(self.model, self.base, self.load, begin, end)

    @cached_property
    def _basis(self) -> Slopes:
        return Slopes(self.model)

    @cached_property
    def _base_force(self) -> cs.Function:
        """(e, e_t, e_tt, load) -> the generalized force of the base."""
        return self._function(Balance.on_base)

    @cached_property
    def _powers(self) -> cs.Function:
        """(e, e_t, e_tt, load, overstrains if any) -> the powers lost to damping and supplied by base and load."""
        return self._function(Balance.powers)

    def _function(self, term: Callable[..., cs.MX]) -> cs.Function:
        """Return a term of the balance of forces as a Function of motion and load."""
        equations = self._equations
        e, e_t, e_tt = (cs.MX.sym(name, self.model.size) for name in ("e", "e_t", "e_tt"))
        load, balance = cs.MX.sym("load", NODE), equations.balance(cs.MX(cs.DM(equations.parameters)))
        overstrains = [cs.MX.sym("y", equations.internal_size)] if equations.branches else []
        by_element = [cs.reshape(y, equations.internal_shape) for y in overstrains]
        values, inputs = cs.densify(term(balance, e, e_t, e_tt, load, *by_element)), [e, e_t, e_tt, load, *overstrains]
        return cs.Function(term.__name__, inputs, [values], {"is_diff_in": [False] * len(inputs)})

    @property
    def _equations(self) -> Equations:
        place = TIP if self.load is None else self.load.place
        return shared_equations(self.model, self.law, compile_together, place)

    def _close_supports(self, motion: Array, times: Array) -> Array:
        """Return coordinates and so on, (orders, k, size), whose nodes at the supports are in their places."""
        model, orders = self.model, len(motion)
        bases = np.ascontiguousarray(self._base_nodes(times, orders)).view(float)
        supported = np.flatnonzero((model.weights.reshape(-1, NODE)[:, :2] != 1.0).any(axis=1))
        supported = supported[supported >= model.root]
        places = np.concatenate([np.zeros(model.root), model.beam.node_points])
        spread = np.array([np.interp(places, places[supported], unit) for unit in np.eye(supported.size)])
        for order in range(orders):
            supported_motion = model.whole(model.of_free(motion[order].T), bases[order].T).T
            gaps = (supported_motion - motion[order]).reshape(times.size, -1, NODE)[:, supported, :2]
            if supported.size:
                moved = np.einsum("ksd,sn->knd", gaps, spread[:, model.root :])
                motion[order].reshape(times.size, -1, NODE)[:, model.root :, :2] += moved
            motion[order] = model.whole(model.of_free(motion[order].T), bases[order].T).T
        return motion
