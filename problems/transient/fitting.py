"""Damping laws, and properties of the beam, estimated from its measured large motion, by sensors of any kind.

The readings y_ci of the sensors c at their times t_i are fitted by those in the motion of the nonlinear beam,

    minimise    1/2 sum ((h_c(t_i; theta, P, b, F) - y_ci)/s_c)^2        within bounds,

over parameters theta of the damping law, factors common to all elements on the properties P, the amplitude b of the
base motion, the tip load F from which the beam is released, with its rate of change, and unknowns of the sensors
(``problem``).  The standard deviations s_c weight channels of different units (``weights``).  The forward sensitivities
J of the integrated motion (``problem``) give the gradient J' r and the Gauss-Newton Hessian J' J.  Several records,
each with its own base motion and start, share all unknowns except amplitudes, loads and those of their sensors.  If a
record begins within a swing, the rate of change of the load gives the velocity at the start.

Motions alone do not fix the scale of mass and stiffness: ``determination`` names the combinations that they determine.

For large motion, this replaces the fit of the closed form (27), which has no inertia along the beam, no higher modes,
and no effect of the deflected shape on the drag.

Robust fits replace the squares by the pseudo-Huber loss (``ancf_casadi.estimation.loss``).  In a first fit, the noise
of the samples sets weights and threshold; in a second fit, from the estimates of the first, the median residuals do.

The fit selects the tolerance of the integration, checks the effect of the integration error on the estimates, and
allows for a small systematic error of the record (``tolerance``).  The tolerance of IPOPT, in units of the scales
(``unknowns``), is larger than that of the integration, whose steps change with the unknowns.  A trial that takes
``PATIENCE`` times the steps of the first run is abandoned, and IPOPT steps back.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 3 and 4.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import NoneType

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.derivatives.release_load import START
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.least_squares import Unknown, least_squares, restarted
from ancf_casadi.estimation.loss import HUBER
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import check_instance, choices, flag, instances, positive
from problems.transient.determination import ZERO, check_determined
from problems.transient.marker_record import Record, motion_records
from problems.transient.problem import OPTIONS, TransientProblem
from problems.transient.result import TransientFit
from problems.transient.tolerance import ALLOWED, CHECK, TIGHTEST, first_tolerance, tighter
from problems.transient.unknowns import Evidence, transient_unknowns
from problems.transient.weights import first_weights


def fit_transient(
    model: Model,
    records: Record | Sequence[Record],
    damping: DampingLaw,
    *,
    properties: Sequence[str] = (),
    base_amplitude: bool = False,
    load: Sequence[str] = (),
    fixed: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    robust: bool = False,
    tolerance: float | None = None,
    evidence: Sequence[Evidence] = (),
) -> TransientFit:
    """Estimate a damping law, and properties of the beam, from measured motions of the nonlinear beam.

    Parameters
    ----------
    model : Model
        The beam; its properties are the guesses of those to be estimated.
    records : MotionRecord, MarkerRecord, Measurement, or sequence of them
        The measurements.  A Measurement is a record of one channel, released from rest on a fixed base at time 0.
    damping : DampingLaw
        The law; its parameters (``damping.parameters``) are the guesses.
    properties : sequence of {"width", "thickness", "density", "elastic_modulus"}
        Properties to estimate, each by a factor common to all elements.
    base_amplitude : bool
        Whether to estimate the amplitude of each record's base motion.
    load : sequence of {"force_x", "force_y", "moment", "force_x_rate", "force_y_rate", "moment_rate"}
        Components to estimate of the tip load (N, N m) that holds the beam at the start of each record, and of its rate
        of change (per second).  The other components are those of ``start``, an equilibrium; their rates are zero.
    fixed : sequence of str
        Parameters of the law to keep at their guesses.
    bounds : mapping, optional
        Bounds (lower, upper) by name of the unknown.  By default parameters of the law are at least 0 (and ratios at
        most 1), properties and amplitudes within 10 % of the guess, and loads unbounded.
    robust : bool
        Whether to use the pseudo-Huber loss, which limits the influence of outliers.
    tolerance : float, optional
        Tolerance of the integration.  If not given, the fit selects one whose error shifts no estimate by more than a
        tenth of its standard error.  The result states the ``shifts``, and has a warning if one is too large.
    evidence : sequence of Evidence
        Further measurements of the same beam, such as a ``StaticRecord`` with standard deviations.  Its properties are
        those of its own model, times the factors that are estimated here.

    Raises
    ------
    InputError
        If a name is unknown, a point is not on the beam, nothing is to be estimated, a guess is not within its bounds,
        a record whose load is to be estimated does not start from an equilibrium, or evidence has no weight.
    FitError
        If the fit does not converge, or the records determine combinations of the unknowns only, which the message
        names.

    Examples
    --------
    Recover a damping coefficient from a motion of the tip; ``simulate`` stands in for the measurement here:

    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, simulate
    >>> from problems import MarkerRecord, fit_transient
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model, base = Model(beam), HarmonicBase(amplitude=5e-3, frequency=1.9)
    >>> true, guess = RayleighDamping(alpha=0.5), RayleighDamping(alpha=0.2)
    >>> run = simulate(model, damping=true, base=base, duration=0.25, sample_rate=50.0)
    >>> fit = fit_transient(model, MarkerRecord(run.time, run.tip, base=base), guess)
    >>> print(f"{fit.estimates['alpha']:.3f} {fit.units['alpha']}")
    0.500 1/s
    """
    check_instance(model, "model", Model)
    motions = motion_records(records)
    check_instance(damping, "damping", DampingLaw)
    check_instance(bounds, "bounds", Mapping, NoneType)
    load = choices(load, START, "load")
    base_amplitude, robust = flag(base_amplitude, "base_amplitude"), flag(robust, "robust")
    unknowns = transient_unknowns(model, motions, damping, properties, base_amplitude, load, fixed, bounds or {})
    evidence = instances(evidence, "evidence", Evidence, least=0)
    if any(one.deviations is None for one in evidence):
        raise InputError("needs a standard deviation for each value, to be weighed against the motions", "evidence")
    weights = first_weights(motions, robust=robust)
    chosen = first_tolerance(motions, weights, model.beam.length) if tolerance is None else tolerance
    problem = TransientProblem(model, motions, damping, load, positive(chosen, "tolerance"), weights, evidence)
    improve = robust or weights.improvable
    while True:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # IPOPT steps back from a trial that cannot be integrated
            fit, problem = _fit(problem, unknowns, robust=robust, improve=improve)
            tight = replace(problem, tolerance=problem.tolerance / CHECK)
            found = dict(zip(fit.names, fit.values.tolist(), strict=True))
            shifts = fit.shifts(tight.residuals_at(found) - fit.residuals)
        shift = float(np.abs(shifts).max())
        if tolerance is not None or not shift > ALLOWED or problem.tolerance <= TIGHTEST:
            break
        problem = replace(problem, tolerance=tighter(problem.tolerance, shift))
        unknowns, improve = restarted(unknowns, fit), False
    law = damping.with_parameters([found.get(own.name, own.value) for own in damping.parameters])
    factors = {name: found.get(name, 1.0) for name in PROPERTIES}
    rows = zip(PROPERTIES, model.properties, strict=True)
    beam = model.beam.with_(**{name: (factors[name] * row).tolist() for name, row in rows})
    return TransientFit(law, Model(beam, model.measures), fit, problem, shifts)


def _fit(
    problem: TransientProblem, unknowns: Sequence[Unknown], *, robust: bool, improve: bool
) -> tuple[Fit, TransientProblem]:
    """Return the estimates at the tolerance of a problem, and the problem with the weights that were used.

    With ``improve``, a second fit from the estimates of the first uses the weights that its residuals give.
    """
    runs = problem.runs()
    motions = [one.function() for one in runs]
    names = [unknown.name for unknown in unknowns]

    def fitted(problem: TransientProblem, unknowns: Sequence[Unknown], *, first: bool) -> Fit:
        weights = problem.weights

        def residuals(*values: cs.MX) -> cs.MX:
            return problem.residuals(motions, dict(zip(names, values, strict=True)))

        if first:
            check_determined(residuals, unknowns, ZERO * problem.tolerance * weights.travel)
        return least_squares(
            residuals,
            unknowns,
            huber=HUBER * weights.scale if robust else math.inf,
            gauss_newton=True,
            forward=True,
            series=problem.series,
            times=problem.times,
            noise=weights.spread,
            systematic=weights.systematic,
            options=OPTIONS,
            advice="start from other guesses, set bounds, or fix some unknowns",
        )

    try:
        fit = fitted(problem, unknowns, first=True)
        if improve:
            problem = replace(problem, weights=problem.weights.improved(fit.residuals, robust=robust))
            fit = fitted(problem, restarted(unknowns, fit), first=False)
        return fit, problem
    except FitError as error:
        reasons = [f"; the last motion tried: {one.failure}" for one in runs if one.failure]
        raise FitError("".join([str(error), *reasons[:1]]), error.stats) from None
    finally:
        for one in runs:
            one.forget()
