"""The motion of a beam as a CasADi Function of its parameters.

``motion`` returns the motion that ``simulate(method="radau")`` computes, as a Function of the parameters theta of the
law, the parameters b of the base motion, the properties P of the elements and, on request, the lumped properties and
the load s from which the beam is released.  The Function can stand in any CasADi expression.  Its derivatives are exact
(``sensitivity``), forward for few parameters and reverse for few results.
"""

from __future__ import annotations

import math

import casadi as cs

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.derivatives.runs import Runs
from ancf_casadi.dynamics.derivatives.sensitivity import MOST_KEPT_STEPS, SensitivityProblem
from ancf_casadi.dynamics.start import Start, set_up
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.dynamics.tolerance import radau_tolerance
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import flag, physical, positive, positive_or_infinite
from ancf_casadi.vibration.equilibrium import Equilibrium


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
        load that holds the beam until its release, and the rate of this load (``release_load.START_LOAD_NAMES``; N,
        N, N m, and the same per second).
    most_steps : int
        Largest number of steps.  The default is below that of ``simulate``, because all steps are kept in memory, 4 kB
        each at 20 elements.
    lumped : bool
        Whether the Function has a further input, ``lumped``, before ``start``: the mass at the tip (kg), if that of the
        beam is above 0, and the torsional stiffness of the clamp (N m/rad), if that of the beam is finite.

    Raises
    ------
    InputError
        If a number is not positive, ``start_load`` is set and ``start`` is not an equilibrium, or ``lumped`` is set and
        the beam has neither a tip mass nor an elastic clamp.

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
    start_load = flag(start_load, "start_load")
    if start_load and not (isinstance(start, Equilibrium) or start == "equilibrium"):
        raise InputError("has no load; with start_load it must be 'equilibrium' or an Equilibrium", "start")
    problem = SensitivityProblem(
        equations=setup.equations,
        base=setup.base,
        load=setup.load,
        start=start,
        times=setup.times,
        tolerance=radau_tolerance(setup.travel) if tolerance is None else physical(tolerance, "tolerance"),
        largest_step=positive_or_infinite(largest_step, "largest_step"),
        held=start_load,
        most_steps=round(positive(most_steps, "most_steps")),
        lumped=flag(lumped, "lumped"),
    )
    return Runs(problem).function()
