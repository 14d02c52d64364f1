"""The motion of a beam as a CasADi Function of its parameters.

``motion`` returns the motion that ``simulate(method="radau")`` computes, as a Function of the parameters theta of the
law, the parameters b of the base motion, the properties P of the elements and, on request, the lumped properties and
the load s from which the beam is released.  The Function can stand in any CasADi expression.  Its derivatives are exact
(``sensitivity``), forward for few parameters and reverse for few results.

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

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.derivatives.sensitivity import MOST_KEPT_STEPS, SensitivityProblem
from ancf_casadi.dynamics.derivatives.tangent import MotionRun
from ancf_casadi.dynamics.motion_setup import set_up
from ancf_casadi.dynamics.start import Start
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.dynamics.tolerance import default_tolerance
from ancf_casadi.exceptions import AncfError, InputError
from ancf_casadi.mechanics.mesh_limits import warn_of_overbent_elements
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.callbacks import callback_function
from ancf_casadi.support.inputs import flag, physical, positive_or_infinite, whole
from ancf_casadi.support.interrupts import has_interrupt
from ancf_casadi.support.progress import count_step
from ancf_casadi.vibration.equilibrium import Equilibrium

FEW_STEPS = 2000  # a motion of at most so many steps is never given up, however few the first run took
OPTIONAL = ("lumped", "start", "shifts")  # inputs of a motion that has such values


def motion(
    model: Model,
    *,
    duration: float,
    damping: DampingLaw | None = None,
    base: BaseMotion | None = None,
    load: TipLoad | None = None,
    sample_rate: float = 1000.0,
    start: Start | Equilibrium | State = "equilibrium",
    tolerance: float | None = None,
    largest_step: float = math.inf,
    start_load: bool = False,
    most_steps: int = MOST_KEPT_STEPS,
    lumped: bool = False,
) -> cs.Function:
    """Return the motion as a differentiable CasADi Function.

    Its inputs are ``damping``, the parameters of the law (``law.parameters``); ``base``, those of the base motion
    (``base.parameters``); and ``properties``, width (m), thickness (m), density (kg/m^3) and elastic modulus (Pa) of
    each element, (4, n).  Its output ``coordinates`` (4 n + 4, k) holds the nodal coordinates at the samples;
    ``model.interpolation(s) @ coordinates`` is the position of a material point.

    Parameters
    ----------
    model, duration, damping, base, load, sample_rate, start, tolerance, largest_step
        As in ``simulate``, with the same defaults; the load is no input of the Function.  The start ``equilibrium`` or
        ``impact``, or an ``Equilibrium``, changes with the properties; a ``State`` does not.
    start_load : bool
        Whether the Function has a further input, ``start``, which replaces the load of the argument ``start``: the tip
        load that holds the beam until its release, and the rate of this load (``dynamics.start.START_LOAD_NAMES``; N,
        N, N m, and the same per second).
    most_steps : int
        Largest number of steps.  The default is below that of ``simulate``, because all steps are kept in memory, 4 kB
        each at 20 elements.
    lumped : bool
        Whether the Function has a further input, ``lumped``, before ``start``: the lumped properties of the beam, SI
        units, in the order of ``Model.lumped``.

    Raises
    ------
    InputError
        If a number is not positive, ``start_load`` is set and ``start`` is not an equilibrium, or ``lumped`` is set and
        the beam has no lumped property, or a natural curvature beside springs.

    Examples
    --------
    Derivative of the last tip position by a damping coefficient:

    >>> import casadi as cs
    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, motion
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model, law = Model(beam), RayleighDamping(alpha=0.2)
    >>> base = HarmonicBase(amplitude=5e-3, frequency=2.0)
    >>> swing = motion(model, damping=law, base=base, duration=0.5, sample_rate=10.0)
    >>> alpha = cs.MX.sym("alpha")
    >>> tip = (model.interpolation(beam.length) @ swing(alpha, 5e-3, model.properties))[0, -1]
    >>> derivative = cs.Function("derivative", [alpha], [cs.jacobian(tip, alpha)])
    >>> print(f"{float(derivative(0.2)):.1e} m s")
    3.6e-03 m s
    """
    setup = set_up(
        model, duration=duration, damping=damping, base=base, load=load, sample_rate=sample_rate, start=start
    )
    warn_of_overbent_elements(model, setup.start.coordinates)
    start_load = flag(start_load, "start_load")
    if start_load and not (isinstance(start, Equilibrium) or start == "equilibrium"):
        raise InputError("has no load; with start_load it must be 'equilibrium' or an Equilibrium", "start")
    problem = SensitivityProblem(
        equations=setup.equations,
        base=setup.base,
        load=setup.load,
        start=start,
        times=setup.times,
        tolerance=default_tolerance("radau", setup.travel) if tolerance is None else physical(tolerance, "tolerance"),
        largest_step=positive_or_infinite(largest_step, "largest_step"),
        held=start_load,
        most_steps=whole(most_steps, "most_steps", 1),
        lumped=flag(lumped, "lumped"),
    )
    return Runs(problem).function()


class Runs:
    """The runs of a motion, of which the last one is kept."""

    def __init__(self, problem: SensitivityProblem, patience: float = math.inf) -> None:
        self.problem = problem
        self._patience, self._most_steps = patience, problem.most_steps
        self._last: tuple[Array, MotionRun | AncfError] | None = None
        self._last_forward: tuple[MotionRun, Array, Array] | None = None

    def function(self) -> cs.Function:
        """Return the motion as a Function (damping, base, properties, *OPTIONAL) -> samples (orders rows, k)."""
        problem = self.problem
        sizes, model = dict(problem.layout.sizes), problem.equations.model
        names = ["damping", "base", "properties", *(name for name in OPTIONAL if sizes[name])]
        shapes = {"properties": model.properties.shape}
        inputs = [cs.MX.sym(name, *shapes.get(name, (sizes[name], 1))) for name in names]
        rows, columns = problem.orders * len(problem.maps[0]), problem.times.size
        run = callback_function(_Motion(self, problem.layout.size, rows * columns), "run")
        samples = cs.reshape(run(cs.vertcat(*map(cs.vec, inputs))), rows, columns)
        return cs.Function("motion", inputs, [samples], names, ["coordinates"], {"never_inline": True})

    def run(self, values: Array) -> MotionRun:
        """Return the run for some values; if they equal the last ones up to rounding, the run that is kept."""
        # relative difference that a solver may cause by rounding; such values are the same
        if self._last is None or not np.allclose(self._last[0], values, rtol=1e-14, atol=0.0):
            self._last = values, self._solve(values)
        run = self._last[1]
        if isinstance(run, AncfError):
            raise run
        return run

    @property
    def failure(self) -> AncfError | None:
        """Error of the last run, if it failed."""
        run = self._last[1] if self._last else None
        return run if isinstance(run, AncfError) else None

    @property
    def last(self) -> MotionRun | None:
        """The last run; None if it failed, or there is none."""
        run = self._last[1] if self._last else None
        return None if isinstance(run, AncfError) else run

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
            count_step()
        if math.isfinite(self._patience):
            self._most_steps = min(self._most_steps, max(FEW_STEPS, round(self._patience * run.steps)))
            self._patience = math.inf
        return run


class _Motion(cs.Callback):
    """Samples of a motion, one after the other, or their derivatives: (values, samples, seeds) -> derivatives.

    With some directions, seeds and derivatives are those of each direction side by side: ``forward`` along directions
    of the values, else of weighted sums of the samples; without directions, this is (values) -> samples.
    """

    def __init__(self, runs: Runs, values: int, samples: int, directions: int = 0, *, forward: bool = True) -> None:
        cs.Callback.__init__(self)
        self._runs, self._sizes, self._count, self._forward = runs, (values, samples), directions, forward
        self.construct("sensitivity" if directions else "integration", {})

    def get_n_in(self) -> int:
        return 3 if self._count else 1

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        values, samples = self._sizes
        seeds = values if self._forward else samples
        return cs.Sparsity.dense((values, samples, seeds)[i], self._count if i == 2 else 1)

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        return cs.Sparsity.dense(self._sizes[self._forward], self._count or 1)

    def eval(self, arg: Sequence[cs.DM]) -> list[cs.DM]:
        """Return the samples or their derivatives; if there is no motion, nan, and samples with a warning."""
        try:
            run = self._runs.run(arg[0].full().ravel())
            if not self._count:
                return [cs.DM(run.samples.ravel())]
            seeds = arg[2].full()
            if self._forward:
                return [cs.DM(self._runs.forward(run, seeds).reshape(-1, self._count))]
            return [cs.DM(self._runs.problem.reverse(run, seeds.reshape(*run.samples.shape, self._count)))]
        except AncfError as error:
            if not (self._count or has_interrupt()):
                warnings.warn(str(error), RuntimeWarning, stacklevel=2)
            return [cs.DM.nan(self.sparsity_out(0))]

    def has_forward(self, nfwd: int) -> bool:
        return not self._count

    def get_forward(self, nfwd: int, name: str, inames: Any, onames: Any, opts: Any) -> cs.Function:
        return callback_function(_Motion(self._runs, *self._sizes, nfwd), name)

    def has_reverse(self, nadj: int) -> bool:
        return not self._count

    def get_reverse(self, nadj: int, name: str, inames: Any, onames: Any, opts: Any) -> cs.Function:
        return callback_function(_Motion(self._runs, *self._sizes, nadj, forward=False), name)
