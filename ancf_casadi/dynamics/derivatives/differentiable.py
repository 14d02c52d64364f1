"""The motion as a CasADi Function of its parameters.

``motion`` makes the motion that ``simulate(method="radau")`` finds a Function of the law's parameters theta, those of
the base motion b, the properties P of the elements and, if asked, of the load s it starts from.  It can stand in any
CasADi expression and be differentiated, forward (few parameters) and in reverse (few results); ``sensitivity`` says
how.

Lifetime.  CasADi does not keep a Function that is written in Python (a callback) for the expressions that use it.  The
callback is therefore called by a Function of CasADi's own, which these expressions do keep, and lives as long as that:
``_ALIVE`` has a weak reference to the one beside the other, and callbacks that nothing can call any more are dropped
when the next one is made.  A motion keeps its last run for the derivatives, no other.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from types import NoneType
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.derivatives.run import Run
from ancf_casadi.dynamics.derivatives.sensitivity import MOST_KEPT_STEPS, Problem
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.simulation import clamped_nodes, sample_times, smooth_pieces
from ancf_casadi.dynamics.start import Start, base_of, check_start, initial_state
from ancf_casadi.dynamics.tolerance import expected_travel, radau_tolerance
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import AncfError, InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, flag, physical, positive
from ancf_casadi.support.interrupts import interrupted
from ancf_casadi.vibration.equilibrium import Equilibrium

FEW_STEPS = 2000  # no motion of so few is said to crawl
ROUNDING = 1e-14  # relative difference of inputs that a solver makes by rounding, in which they are the same


def motion(
    model: Model,
    *,
    duration: float,
    damping: DampingLaw | None = None,
    base: BaseMotion | None = None,
    sample_rate: float = 1000.0,
    start: Start | Equilibrium | State = "equilibrium",
    tolerance: float | None = None,
    start_load: bool = False,
    most_steps: int = MOST_KEPT_STEPS,
) -> cs.Function:
    """Return the motion as a differentiable CasADi Function.

    Its inputs are ``damping``, the parameters of the law (``law.parameters``); ``base``, those of the base motion
    (``base.parameters``); and ``properties``, width (m), thickness (m), density (kg/m^3) and elastic modulus (Pa) of
    each element, (4, n).  Its output ``coordinates`` (4 n + 4, k) are the nodal coordinates at the samples;
    ``model.interpolation(s) @ coordinates`` are the positions of a material point.

    Parameters
    ----------
    model, duration, damping, base, sample_rate, start, tolerance
        As of ``simulate``.  A start ``equilibrium`` or ``impact``, or an ``Equilibrium``, changes with the properties;
        a ``State`` does not.
    start_load : bool
        Whether the function has a fourth input, ``start``: the tip load that holds the beam until it is let go, and its
        rate (``starts.START``; N, N, N m, and a second), instead of that of ``start``.
    most_steps : int
        Steps after which a motion is given up.

    Raises
    ------
    InputError
        If a number is not positive, or the load of a start is asked for that is no equilibrium.
    """
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    check_instance(base, "base", BaseMotion, NoneType)
    check_instance(start, "start", str, Equilibrium, State)
    start_load = flag(start_load, "start_load")
    if start_load and not (isinstance(start, Equilibrium) or start == "equilibrium"):
        raise InputError("has no load; it must be 'equilibrium' or an Equilibrium", "start")
    duration, sample_rate = physical(duration, "duration"), physical(sample_rate, "sample_rate")
    check_start(model, start)
    base, equations = base_of(model, base, start), Equations(model, RayleighDamping() if damping is None else damping)
    times = sample_times(duration, sample_rate, start.time if isinstance(start, State) else 0.0)
    pieces = smooth_pieces(equations, base, float(times[0]), float(times[-1]))
    nodes, state = clamped_nodes(pieces), initial_state(model, pieces[0].clamp, start)
    if tolerance is None:
        tolerance = radau_tolerance(expected_travel(model, nodes, state))
    problem = Problem(
        equations=equations,
        base=base,
        start=start,
        times=times,
        tolerance=positive(tolerance, "tolerance"),
        held=start_load,
        most_steps=round(positive(most_steps, "most_steps")),
    )
    return Runs(problem).function()


class Runs:
    """The runs of a motion, of which the last one is kept, and the Functions that use them.

    Parameters
    ----------
    problem : Problem
        The motion.
    patience : float
        A run is given up if it takes this many times the steps of the first one (and more than ``FEW_STEPS``).
    """

    def __init__(self, problem: Problem, patience: float = math.inf) -> None:
        self.problem = problem
        self._patience, self._most = patience, problem.most_steps
        self._last: tuple[Array, Run | AncfError] | None = None
        self._slopes: tuple[Run, Array, Array] | None = None

    def function(self) -> cs.Function:
        """Return the motion as a Function (damping, base, properties, [start]) -> coordinates."""
        return _kept(_Motion(self), "motion")

    @property
    def shapes(self) -> list[cs.Sparsity]:
        """Shapes of the inputs and of the output."""
        (_, law), (_, base), _, (_, start) = self.problem.layout.sizes
        model = self.problem.equations.model
        shapes = [(law, 1), (base, 1), model.properties.shape, *[(start, 1)] * self.problem.held]
        shapes.append((model.size, self.problem.times.size))
        return [cs.Sparsity.dense(*shape) for shape in shapes]

    def run(self, inputs: Sequence[cs.DM]) -> Run:
        """Return the run for some inputs, computed once for the same up to rounding.

        Raises
        ------
        AncfError
            If there is no motion.
        """
        values = np.concatenate([part.full().ravel(order="F") for part in inputs])
        if self._last is None or not np.allclose(self._last[0], values, rtol=ROUNDING, atol=0.0):
            self._last = values, self._solve(values)
        found = self._last[1]
        if isinstance(found, AncfError):
            raise found
        return found

    @property
    def failure(self) -> AncfError | None:
        """Error of the last run, if it failed."""
        found = self._last[1] if self._last else None
        return found if isinstance(found, AncfError) else None

    def slopes(self, run: Run, directions: Array) -> Array:
        """Return the derivatives along some directions, computed once for the same."""
        last = self._slopes
        if last is None or last[0] is not run or not np.array_equal(last[1], directions):
            self._slopes = last = run, directions, self.problem.forward(run, directions)
        return last[2]

    def forget(self) -> None:
        """Drop the last run, and its steps."""
        self._last = self._slopes = None

    def _solve(self, values: Array) -> Run | AncfError:
        self.forget()
        try:
            run = self.problem.solve(values, self._most)
        except AncfError as error:
            return error.with_traceback(None)
        if math.isfinite(self._patience):
            self._most = min(self._most, max(FEW_STEPS, round(self._patience * run.steps)))
            self._patience = math.inf
        return run


class _Motion(cs.Callback):
    """A motion, as CasADi evaluates it."""

    def __init__(self, runs: Runs) -> None:
        cs.Callback.__init__(self)
        self._runs, self._shapes = runs, runs.shapes
        self.construct("integration", {})

    def get_n_in(self) -> int:
        """Return the number of inputs."""
        return len(self._shapes) - 1

    def get_n_out(self) -> int:
        """Return the number of outputs."""
        return 1

    def get_name_in(self, i: int) -> str:
        """Return the name of an input."""
        return ("damping", "base", "properties", "start")[i]

    def get_name_out(self, i: int) -> str:
        """Return the name of an output."""
        return "coordinates"

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        """Return the shape of an input."""
        return self._shapes[i]

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        """Return the shape of an output."""
        return self._shapes[-1]

    def eval(self, arg: Sequence[cs.DM]) -> list[cs.DM]:
        """Return the coordinates; nan where there is no motion, with a warning that says why."""
        try:
            return [cs.DM(self._runs.run(arg).coordinates.T)]
        except AncfError as error:
            if not interrupted():
                warnings.warn(str(error), RuntimeWarning, stacklevel=2)
            return [cs.DM.nan(self._shapes[-1])]

    def has_forward(self, nfwd: int) -> bool:
        """Return True."""
        return True

    def get_forward(self, nfwd: int, name: str, inames: Any, onames: Any, opts: Any) -> cs.Function:
        """Return the derivatives along some directions."""
        return _kept(_Derivative(self._runs, nfwd, forward=True), name)

    def has_reverse(self, nadj: int) -> bool:
        """Return True."""
        return True

    def get_reverse(self, nadj: int, name: str, inames: Any, onames: Any, opts: Any) -> cs.Function:
        """Return the derivatives of some weighted sums."""
        return _kept(_Derivative(self._runs, nadj, forward=False), name)


class _Derivative(cs.Callback):
    """Derivatives of a motion, as CasADi asks for them: inputs and output, then seeds, give the derivatives."""

    def __init__(self, runs: Runs, count: int, *, forward: bool) -> None:
        cs.Callback.__init__(self)
        self._runs, self._count, self._forward = runs, count, forward
        *self._inputs, output = runs.shapes
        seeds, results = (self._inputs, [output]) if forward else ([output], self._inputs)
        self._shapes = [*self._inputs, output, *(cs.repmat(shape, 1, count) for shape in seeds)]
        self._results = [cs.repmat(shape, 1, count) for shape in results]
        self.construct("integration_slopes", {})

    def get_n_in(self) -> int:
        """Return the number of inputs."""
        return len(self._shapes)

    def get_n_out(self) -> int:
        """Return the number of outputs."""
        return len(self._results)

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        """Return the shape of an input."""
        return self._shapes[i]

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        """Return the shape of an output."""
        return self._results[i]

    def eval(self, arg: Sequence[cs.DM]) -> list[cs.DM]:
        """Return the derivatives; nan where there is no motion."""
        count, inputs = self._count, len(self._inputs)
        seeds = [
            part.full().reshape(part.size1(), count, part.size2() // count).transpose(2, 0, 1)
            for part in arg[inputs + 1 :]
        ]
        try:
            run = self._runs.run(arg[:inputs])
            found = self._along(run, seeds) if self._forward else self._of_sums(run, seeds[0])
        except AncfError:
            return [cs.DM.nan(shape) for shape in self._results]
        return [cs.DM(part.transpose(1, 2, 0).reshape(part.shape[1], count * part.shape[0])) for part in found]

    def _along(self, run: Run, seeds: Sequence[Array]) -> list[Array]:
        """Return the derivatives of the coordinates along directions of the inputs."""
        directions = np.vstack([part.reshape(-1, self._count) for part in seeds])
        return [self._runs.slopes(run, directions)]

    def _of_sums(self, run: Run, weights: Array) -> list[Array]:
        """Return the derivatives by the inputs of weighted sums of the coordinates."""
        problem = self._runs.problem
        parts = problem.layout.split(problem.reverse(run, weights))
        sizes = [(shape.size2(), shape.size1(), self._count) for shape in self._inputs]
        return [part.reshape(size) for part, size in zip(parts, sizes, strict=False)]


_ALIVE: list[tuple[cs.WeakRef, cs.Callback]] = []  # Functions that call a callback, and the callbacks


def _kept(callback: cs.Callback, name: str) -> cs.Function:
    """Return a Function that calls a callback, which lives as long as it."""
    inputs = callback.mx_in()
    names = callback.name_in(), callback.name_out()
    function: cs.Function = cs.Function(name, inputs, callback.call(inputs), *names, {"never_inline": True})
    _ALIVE[:] = [pair for pair in _ALIVE if pair[0].alive()]
    _ALIVE.append((cs.WeakRef(function), callback))
    return function
