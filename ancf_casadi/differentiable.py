"""The motion as a CasADi Function of its parameters.

``motion`` makes the motion that ``simulate(method="radau")`` finds a Function of the law's parameters theta, those of
the base motion b, the properties P of the elements and, if asked, of the load s it starts from.  It can stand in any
CasADi expression and be differentiated, forward (few parameters) and in reverse (few results); ``sensitivity`` says
how.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from types import NoneType
from typing import Any, TypeVar

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.equations import Equations
from ancf_casadi.equilibrium import Equilibrium
from ancf_casadi.exceptions import AncfError, InputError
from ancf_casadi.excitation import BaseMotion
from ancf_casadi.initial_state import Start, base_of, check_start, initial_state
from ancf_casadi.inputs import check_instance, flag, physical, positive
from ancf_casadi.model import Model
from ancf_casadi.sensitivity import Problem, Run
from ancf_casadi.simulate import clamped_nodes, sample_times, smooth_pieces
from ancf_casadi.tolerance import expected_travel, radau_tolerance
from ancf_casadi.trajectory import State

Array = NDArray[np.float64]


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
) -> Motion:
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
    )
    return _kept(Motion(problem))


class Motion(cs.Callback):
    """A motion as a CasADi Function (damping, base, properties, [start]) -> coordinates; made by ``motion``.

    Parameters
    ----------
    problem : Problem
        The motion.
    """

    def __init__(self, problem: Problem) -> None:
        cs.Callback.__init__(self)
        self.problem = problem
        self._last: Run | None = None
        self._slopes: tuple[Run, Array, Array] | None = None
        self.construct("motion", {})

    def get_n_in(self) -> int:
        """Return the number of inputs."""
        return 4 if self.problem.held else 3

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
        return self.shapes[i]

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        """Return the shape of an output."""
        return self.shapes[-1]

    @property
    def shapes(self) -> list[cs.Sparsity]:
        """Shapes of the inputs and of the output."""
        law, base, _, start = self.problem.sizes
        model = self.problem.equations.model
        shapes = [(law, 1), (base, 1), model.properties.shape, *[(start, 1)] * self.problem.held]
        shapes.append((model.size, self.problem.times.size))
        return [cs.Sparsity.dense(*shape) for shape in shapes]

    def run(self, inputs: Sequence[cs.DM]) -> Run:
        """Return the motion for some inputs, computed once for the same."""
        values = np.concatenate([part.full().ravel(order="F") for part in inputs])
        if self._last is None or not np.array_equal(self._last.values, values):
            self._last = self.problem.solve(values)
        return self._last

    def slopes(self, run: Run, directions: Array) -> Array:
        """Return the derivatives along some directions, computed once for the same."""
        last = self._slopes
        if last is None or last[0] is not run or not np.array_equal(last[1], directions):
            self._slopes = last = run, directions, self.problem.forward(run, directions)
        return last[2]

    def eval(self, arg: Sequence[cs.DM]) -> list[cs.DM]:
        """Return the coordinates; nan where there is no motion, with a warning that says why."""
        try:
            return [cs.DM(self.run(arg).coordinates.T)]
        except AncfError as error:
            warnings.warn(str(error), RuntimeWarning, stacklevel=2)
            return [cs.DM.nan(self.shapes[-1])]

    def has_forward(self, nfwd: int) -> bool:
        """Return True."""
        return True

    def get_forward(self, nfwd: int, name: str, inames: Any, onames: Any, opts: Any) -> cs.Function:
        """Return the derivatives along some directions."""
        return _kept(_Derivative(self, name, nfwd, forward=True))

    def has_reverse(self, nadj: int) -> bool:
        """Return True."""
        return True

    def get_reverse(self, nadj: int, name: str, inames: Any, onames: Any, opts: Any) -> cs.Function:
        """Return the derivatives of some weighted sums."""
        return _kept(_Derivative(self, name, nadj, forward=False))


class _Derivative(cs.Callback):
    """Derivatives of a motion, as CasADi asks for them: inputs and output, then seeds, give the derivatives."""

    def __init__(self, motion: Motion, name: str, count: int, *, forward: bool) -> None:
        cs.Callback.__init__(self)
        self._motion, self._count, self._forward = motion, count, forward
        *inputs, output = motion.shapes
        seeds, results = (inputs, [output]) if forward else ([output], inputs)
        self._shapes = [*inputs, output, *(cs.repmat(shape, 1, count) for shape in seeds)]
        self._results = [cs.repmat(shape, 1, count) for shape in results]
        self.construct(name, {})

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
        count, problem = self._count, self._motion.problem
        try:
            run = self._motion.run(arg[: self._motion.n_in()])
        except AncfError:
            return [cs.DM.nan(shape) for shape in self._results]
        seeds = [
            part.full().reshape(part.size1(), count, part.size2() // count).transpose(2, 0, 1)
            for part in arg[self._motion.n_in() + 1 :]
        ]
        if self._forward:
            directions = np.vstack([part.reshape(-1, count) for part in seeds])
            found = [self._motion.slopes(run, directions)]
        else:
            weights = problem.reverse(run, seeds[0])
            sizes = [(shape.size2(), shape.size1(), count) for shape in self._motion.shapes[:-1]]
            found = [part.reshape(size) for part, size in zip(problem.split(weights), sizes, strict=False)]
        return [cs.DM(part.transpose(1, 2, 0).reshape(part.shape[1], count * part.shape[0])) for part in found]


Kind = TypeVar("Kind", bound=cs.Callback)

_ALIVE: list[cs.Callback] = []  # CasADi keeps no reference to a Function that is written in Python


def _kept(function: Kind) -> Kind:
    _ALIVE.append(function)
    return function
