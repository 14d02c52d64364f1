"""The computed motions behind a differentiable motion, and its CasADi Function.

CasADi asks for values and derivatives separately and in any order.  ``Runs`` keeps the last run, so that one
integration serves the value and all derivatives at a point.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.derivatives.run import MotionRun
from ancf_casadi.dynamics.derivatives.sensitivity import SensitivityProblem
from ancf_casadi.exceptions import AncfError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.callbacks import kept
from ancf_casadi.support.interrupts import interrupted
from ancf_casadi.support.progress import step

FEW_STEPS = 2000  # a motion of at most so many steps is never given up, however few the first run took
OPTIONAL = ("lumped", "start", "shifts")  # inputs of a motion that has such values


class Runs:
    """The runs of a motion, of which the last one is kept.

    Parameters
    ----------
    problem : SensitivityProblem
        The motion.
    patience : float
        A run is given up after this many times the steps of the first run, but not before ``FEW_STEPS``.
    """

    def __init__(self, problem: SensitivityProblem, patience: float = math.inf) -> None:
        self.problem = problem
        self._patience, self._most_steps = patience, problem.most_steps
        self._last: tuple[Array, MotionRun | AncfError] | None = None
        self._last_forward: tuple[MotionRun, Array, Array] | None = None

    def function(self) -> cs.Function:
        """Return the motion as a Function (damping, base, properties, *OPTIONAL) -> samples (orders N, k)."""
        return kept(_Motion(self), "motion")

    @property
    def shapes(self) -> list[cs.Sparsity]:
        """Shapes of the inputs and of the output."""
        sizes, model = dict(self.problem.layout.sizes), self.problem.equations.model
        shapes = [(sizes["damping"], 1), (sizes["base"], 1), model.properties.shape]
        shapes += [(sizes[name], 1) for name in OPTIONAL if sizes[name]]
        shapes.append((self.problem.orders * model.size, self.problem.times.size))
        return [cs.Sparsity.dense(*shape) for shape in shapes]

    def run(self, inputs: Sequence[cs.DM]) -> MotionRun:
        """Return the run for some inputs; if they equal the last inputs up to rounding, the run that is kept.

        Raises
        ------
        AncfError
            If there is no motion.
        """
        values = np.concatenate([part.full().ravel(order="F") for part in inputs])
        # relative difference that a solver may cause by rounding; such inputs are the same
        if self._last is None or not np.allclose(self._last[0], values, rtol=1e-14, atol=0.0):
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

    def forward(self, run: MotionRun, directions: Array) -> Array:
        """Return the derivatives along some directions; if these equal the last ones, the derivatives that are kept."""
        last = self._last_forward
        if last is None or last[0] is not run or not np.array_equal(last[1], directions):
            self._last_forward = last = run, directions, self.problem.forward(run, directions)
        return last[2]

    def forget(self) -> None:
        """Drop the last run and its steps."""
        self._last = self._last_forward = None

    def _solve(self, values: Array) -> MotionRun | AncfError:
        self.forget()
        try:
            run = self.problem.solve(values, self._most_steps)
        except AncfError as error:
            return error.with_traceback(None)
        finally:
            step()
        if math.isfinite(self._patience):
            self._most_steps = min(self._most_steps, max(FEW_STEPS, round(self._patience * run.steps)))
            self._patience = math.inf
        return run


class _Callback(cs.Callback):
    """A Function written in Python, with the shapes of its inputs and outputs."""

    def __init__(self, runs: Runs, name: str, inputs: Sequence[cs.Sparsity], outputs: Sequence[cs.Sparsity]) -> None:
        cs.Callback.__init__(self)
        self.runs, self.inputs, self.outputs = runs, inputs, outputs
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Return the number of inputs."""
        return len(self.inputs)

    def get_n_out(self) -> int:
        """Return the number of outputs."""
        return len(self.outputs)

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        """Return the shape of an input."""
        return self.inputs[i]

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        """Return the shape of an output."""
        return self.outputs[i]


class _Motion(_Callback):
    """A motion as CasADi evaluates it."""

    def __init__(self, runs: Runs) -> None:
        *inputs, output = runs.shapes
        super().__init__(runs, "integration", inputs, [output])

    def get_name_in(self, i: int) -> str:
        """Return the name of an input."""
        sizes = dict(self.runs.problem.layout.sizes)
        return ["damping", "base", "properties", *(name for name in OPTIONAL if sizes[name])][i]

    def get_name_out(self, i: int) -> str:
        """Return the name of an output."""
        return "coordinates"

    def eval(self, arg: Sequence[cs.DM]) -> list[cs.DM]:
        """Return the samples; if there is no motion, nan with a warning that says why."""
        try:
            samples = self.runs.run(arg).samples
            return [cs.DM(samples.reshape(len(samples), -1).T)]
        except AncfError as error:
            if not interrupted():
                warnings.warn(str(error), RuntimeWarning, stacklevel=2)
            return [cs.DM.nan(self.outputs[0])]

    def has_forward(self, nfwd: int) -> bool:
        """Return True."""
        return True

    def get_forward(self, nfwd: int, name: str, inames: Any, onames: Any, opts: Any) -> cs.Function:
        """Return the derivatives along some directions."""
        return kept(_Derivative(self.runs, nfwd, forward=True), name)

    def has_reverse(self, nadj: int) -> bool:
        """Return True."""
        return True

    def get_reverse(self, nadj: int, name: str, inames: Any, onames: Any, opts: Any) -> cs.Function:
        """Return the derivatives of some weighted sums."""
        return kept(_Derivative(self.runs, nadj, forward=False), name)


class _Derivative(_Callback):
    """Derivatives of a motion as CasADi asks for them: (inputs, output, seeds) -> derivatives.

    With d directions, seeds and derivatives are those of each direction side by side.
    """

    def __init__(self, runs: Runs, count: int, *, forward: bool) -> None:
        *inputs, output = runs.shapes
        seeds, results = (inputs, [output]) if forward else ([output], inputs)
        stacked = [[cs.repmat(shape, 1, count) for shape in shapes] for shapes in (seeds, results)]
        super().__init__(runs, "sensitivity", [*inputs, output, *stacked[0]], stacked[1])
        self._count, self._forward, self._parts = count, forward, inputs

    def eval(self, arg: Sequence[cs.DM]) -> list[cs.DM]:
        """Return the derivatives; nan if there is no motion."""
        inputs = len(self._parts)
        seeds = [self._unstacked(part) for part in arg[inputs + 1 :]]
        try:
            run = self.runs.run(arg[:inputs])
            found = self._along(run, seeds) if self._forward else self._of_sums(run, seeds[0])
        except AncfError:
            return [cs.DM.nan(shape) for shape in self.outputs]
        return [self._stacked(part) for part in found]

    def _along(self, run: MotionRun, seeds: Sequence[Array]) -> list[Array]:
        """Return the derivatives of the samples along directions of the inputs."""
        directions = np.vstack([part.reshape(-1, self._count) for part in seeds])
        return [self.runs.forward(run, directions).reshape(len(run.samples), -1, self._count)]

    def _of_sums(self, run: MotionRun, weights: Array) -> list[Array]:
        """Return the derivatives of weighted sums of the samples with respect to the inputs."""
        problem = self.runs.problem
        found = problem.reverse(run, weights.reshape(*run.samples.shape, self._count))
        parts = problem.layout.split(found)
        parts = parts[:3] + [part for part in parts[3:] if len(part)]
        sizes = [(shape.size2(), shape.size1(), self._count) for shape in self._parts]
        return [part.reshape(size) for part, size in zip(parts, sizes, strict=True)]

    def _unstacked(self, matrix: cs.DM) -> Array:
        """Return d matrices (r, c) side by side, (r, d c), as an array (c, r, d)."""
        rows, columns = matrix.shape
        return np.asarray(matrix.full().reshape(rows, self._count, columns // self._count).transpose(2, 0, 1))

    def _stacked(self, array: Array) -> cs.DM:
        """Return an array (c, r, d) as d matrices (r, c) side by side, (r, d c)."""
        columns, rows, count = array.shape
        return cs.DM(array.transpose(1, 2, 0).reshape(rows, count * columns))
