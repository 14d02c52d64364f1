"""Damping laws, and properties of the beam, from the measured large motion of points on it.

The measured positions y_ij of the points s_j at the times t_i of a record are matched by those of the nonlinear beam,

    minimise    1/2 sum (r(s_j, t_i; theta, P, b) - y_ij)^2        within bounds,

over any parameters theta of the damping law, factors common to all elements on the properties P, the amplitude b of
the base motion, and the load at the tip the beam is let go from, with its rate (``starts``).  The motion and its exact
derivatives are those of ``motion``; of its forward derivatives J come the gradient J' r and the Hessian J' J.  Records,
each with its own base motion and start, share all unknowns but amplitudes and loads.

A record that begins amid a swing has a velocity at its start: the rate of the load stands for it.

This takes the place of the closed form (27) where the motion is large: there it lacks the inertia along the beam, the
higher modes, and what the shape of the swing does to the drag.

The integration.  The fit selects its tolerance, checks what its error does to the estimates, and allows for a small
systematic error of the record (``transient_tolerance``).  The tolerance of the solver, in units of the scales
(``transient_unknowns``), stays above that of the integration, whose steps change with the unknowns.  A trial whose
motion takes ``PATIENCE`` times the steps of the guess is given up and stepped back from.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 3 and 4.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import NoneType
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.derivatives.release_load import START, held_start, start_jacobians
from ancf_casadi.dynamics.derivatives.runs import Runs
from ancf_casadi.dynamics.derivatives.sensitivity import Problem
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.estimation.fit import Fit, colour_warning
from ancf_casadi.estimation.nlp import Unknown, least_squares, residual_function
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, choices, flag, instances, positive, positive_or_infinite
from ancf_casadi.support.interrupts import delayed_interrupts
from problems.transient.marker_record import MarkerRecord
from problems.transient.tolerance import ALLOWED, CHECK, TIGHTEST, TRUST, first_tolerance, spread, tighter, travel
from problems.transient.unknowns import amplitude_name, load_name, loads, transient_unknowns

PATIENCE = 20.0  # of a run, in steps of the first
OPTIONS: Mapping[str, Any] = {
    "ipopt.tol": 1e-4,
    "ipopt.compl_inf_tol": 1e-7,
    "ipopt.max_iter": 50,
    "ipopt.accept_after_max_steps": 3,  # halvings; a step so short that no decrease shows is lost in the integration
    "ipopt.watchdog_shortened_iter_trigger": 1,  # and the next ones are whole, judged by the gradient
    "ipopt.mu_init": 1e-4,  # bounds count only near them: a guess is within a few steps of Gauss and Newton
    "ipopt.bound_mult_init_method": "mu-based",
}


@dataclass(frozen=True, eq=False)
class TransientProblem:
    """Measured motions, and the model they are held against.

    Parameters
    ----------
    model : Model
        The beam.
    records : tuple of MarkerRecord
        What was measured.
    damping : DampingLaw
        The law.
    starts : tuple of str
        What is unknown of the loads at the start.
    tolerance : float
        Tolerance of the integration.
    """

    model: Model
    records: tuple[MarkerRecord, ...]
    damping: DampingLaw
    starts: tuple[str, ...]
    tolerance: float

    def runs(self) -> list[Runs]:
        """Return the motions that the records are held against."""
        equations = Equations(self.model, self.damping)
        return [
            Runs(
                Problem(
                    equations=equations,
                    base=record.own_base,
                    start=record.start,
                    times=np.asarray(record.time),
                    tolerance=self.tolerance,
                    held=bool(self.starts),
                ),
                PATIENCE,
            )
            for record in self.records
        ]

    def residuals(self, motions: Sequence[cs.Function], given: Mapping[str, cs.MX]) -> cs.MX:
        """Return computed less measured positions, one coordinate after the other.

        Parameters
        ----------
        motions : sequence of Function
            The motions of the records, from ``runs``.
        given : mapping
            Unknowns by name.
        """
        theta = [given.get(own.name, cs.MX(own.value)) for own in self.damping.parameters]
        own_rows = zip(PROPERTIES, self.model.properties.tolist(), strict=True)
        rows = [given.get(name, cs.MX(1.0)) * cs.DM(row).T for name, row in own_rows]
        parts = []
        for k, (record, motion) in enumerate(zip(self.records, motions, strict=True)):
            b = [given.get(amplitude_name(k, own.name), cs.MX(own.value)) for own in record.own_base.parameters]
            inputs = [cs.vertcat(cs.MX(0, 1), *theta), cs.vertcat(cs.MX(0, 1), *b), cs.vertcat(*rows)]
            if self.starts:
                inputs.append(cs.vertcat(*(given.get(load_name(k, name), cs.MX(p)) for name, p in loads(record))))
            points = (self.model.beam.length,) if record.points is None else record.points
            matrix = np.vstack([self.model.interpolation(point) for point in points])
            parts.append(cs.vec((cs.DM(matrix) @ motion(*inputs) - cs.DM(record.columns)).T))
        return cs.vertcat(*parts)


@dataclass(frozen=True, eq=False)
class TransientFit:
    """What measured motions tell of a damping law and a beam.

    Parameters
    ----------
    law : DampingLaw
        The law with the estimated parameters.
    model : Model
        The beam with the estimated properties.
    fit : Fit
        All unknowns with their uncertainties.
    problem : TransientProblem
        What was fitted, and the tolerance of the integration.
    shifts : ndarray
        Shift of each estimate by the error of the integration, in standard errors (n,); nan if it is not known.
    """

    law: DampingLaw
    model: Model
    fit: Fit
    problem: TransientProblem
    shifts: Array

    @property
    def warnings(self) -> tuple[str, ...]:
        """Notes on what to know before using the estimates."""
        notes = [*self.fit.warnings(), colour_warning(self.fit.residuals, noise_free=self.fit.systematic)]
        tolerance, worst = self.problem.tolerance, float(np.abs(self.shifts).max())
        if math.isnan(worst):
            notes.append(f"the error of the integration at the tolerance {tolerance:.1e} could not be checked")
        elif worst > ALLOWED:
            name = self.fit.names[int(np.abs(self.shifts).argmax())]
            advice = "let the fit select the tolerance" if tolerance > TIGHTEST else "shorten the record"
            notes.append(
                f"the error of the integration at the tolerance {tolerance:.1e} shifts {name} by {worst:.2g} standard "
                f"errors; {advice}"
            )
        return tuple(note for note in notes if note)

    def start(self, record: int = 0) -> State:
        """Return the state that a record starts from, where its load was estimated.

        Raises
        ------
        InputError
            If no load was.
        """
        if not self.problem.starts:
            raise InputError("was not estimated", "start")
        found = dict(zip(self.fit.names, self.fit.values.tolist(), strict=True))
        load = [found.get(load_name(record, name), value) for name, value in loads(self.problem.records[record])]
        held = held_start(self.model, start_jacobians(self.model), np.array(load))
        return State(held.coordinates, held.velocities)

    def report(self) -> str:
        """Return the result as text."""
        table = self.fit.table()
        integration = (
            f"integrated at the tolerance {self.problem.tolerance:.1e}, whose error shifts no estimate by more than "
            f"{np.abs(self.shifts).max():.2g} standard errors"
        )
        trust = f"these allow for a systematic error of the record of {self.fit.systematic:.1e} m"
        notes = (*table.notes, integration, trust)
        return "\n".join([replace(table, notes=notes).text(), *(f"  note: {note}" for note in self.warnings)])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "law": repr(self.law),
            **self.fit.to_dict(),
            "tolerance": self.problem.tolerance,
            "integration_shifts": [float(shift) if math.isfinite(shift) else None for shift in self.shifts],
            "warnings": list(self.warnings),
        }

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel between processes without the motion, which is derived again there."""
        return _restored, (self.law, self.model, replace(self.fit, model=cs.Function()), self.problem, self.shifts)


def _restored(law: DampingLaw, model: Model, fit: Fit, problem: TransientProblem, shifts: Array) -> TransientFit:
    motions = [runs.function() for runs in problem.runs()]

    def residuals(*values: cs.MX) -> cs.MX:
        return problem.residuals(motions, dict(zip(fit.names, values, strict=True)))

    return TransientFit(law, model, replace(fit, model=residual_function(residuals, fit.scale)), problem, shifts)


def fit_transient(
    model: Model,
    records: MarkerRecord | Sequence[MarkerRecord],
    damping: DampingLaw,
    *,
    properties: Sequence[str] = (),
    base_amplitude: bool = False,
    start: Sequence[str] = (),
    fixed: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    robust: float = math.inf,
    tolerance: float | None = None,
) -> TransientFit:
    """Estimate a damping law, and properties of the beam, from measured motions of the nonlinear beam.

    Parameters
    ----------
    model : Model
        The beam; its properties are guesses where they are unknown.
    records : MarkerRecord or sequence of them
        What was measured.
    damping : DampingLaw
        The law; its parameters (``damping.parameters``) are the guesses.
    properties : sequence of {"width", "thickness", "density", "elastic_modulus"}
        Properties to estimate too, each by a factor common to all elements.
    base_amplitude : bool
        Whether to estimate the amplitude of each record's base motion.
    start : sequence of {"force_x", "force_y", "moment", "force_x_rate", "force_y_rate", "moment_rate"}
        What to estimate of the load at the tip (N, N m) that each record starts from, and of its rate of change (a
        second); the others are those of the record's ``start``, an equilibrium, and its rates zero.
    fixed : sequence of str
        Parameters of the law to keep.
    bounds : mapping, optional
        Bounds by name of the unknown.  If not given: 0 and none for parameters of the law (1 for ratios), 10 % on
        either side of the guess for the others.
    robust : float
        Deviation, m, beyond which the loss grows linearly; least squares without it.
    tolerance : float, optional
        Tolerance of the integration.  If not given, one at which its error shifts no estimate by more than a tenth of
        its standard error; in any case ``shifts`` of the result has the shifts, and ``warnings`` those too large.

    Raises
    ------
    InputError
        If a name is unknown, a point is not on the beam, nothing is to be estimated, a guess is not within its bounds,
        or a record whose load is to be estimated does not start from an equilibrium.
    FitError
        If the fit does not converge, or the records do not determine the unknowns.
    """
    check_instance(model, "model", Model)
    records = instances([records] if isinstance(records, MarkerRecord) else records, "records", MarkerRecord)
    check_instance(damping, "damping", DampingLaw)
    check_instance(bounds, "bounds", Mapping, NoneType)
    start = choices(start, START, "start")
    base_amplitude, robust = flag(base_amplitude, "base_amplitude"), positive_or_infinite(robust, "robust")
    if model.beam.length < robust < math.inf:
        raise InputError(f"{robust:g} m is longer than the beam; leave it out for least squares", "robust")
    unknowns = transient_unknowns(model, records, damping, properties, base_amplitude, start, fixed, bounds or {})
    chosen = first_tolerance(records, model.beam.length) if tolerance is None else positive(tolerance, "tolerance")
    while True:
        problem = TransientProblem(model, records, damping, tuple(start), chosen)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # a trial without a motion is stepped back from
            fit = _fit(problem, unknowns, robust)
            shifts = fit.shifts(_integration_error(problem, fit))
        shift = float(np.abs(shifts).max())
        if tolerance is not None or not shift > ALLOWED or chosen <= TIGHTEST:
            break
        chosen = tighter(chosen, shift)
        unknowns = [replace(unknown, guess=value) for unknown, value in zip(unknowns, fit.values.tolist(), strict=True)]
    found = dict(zip(fit.names, fit.values.tolist(), strict=True))
    law = damping.with_parameters([found.get(own.name, own.value) for own in damping.parameters])
    factors = {name: found.get(name, 1.0) for name in PROPERTIES}
    rows = zip(PROPERTIES, model.properties, strict=True)
    beam = model.beam.with_(**{name: (factors[name] * row).tolist() for name, row in rows})
    return TransientFit(law, Model(beam, model.measures), fit, problem, shifts)


def _fit(problem: TransientProblem, unknowns: Sequence[Unknown], robust: float) -> Fit:
    """Return the estimates at a tolerance."""
    runs = problem.runs()
    motions = [one.function() for one in runs]
    names = [unknown.name for unknown in unknowns]
    try:
        return least_squares(
            lambda *values: problem.residuals(motions, dict(zip(names, values, strict=True))),
            unknowns,
            huber=robust,
            gauss_newton=True,
            forward=True,
            series=[record.columns.shape[1] for record in problem.records for _ in record.columns],
            noise=spread(problem.records),
            systematic=TRUST * travel(problem.records),
            options=OPTIONS,
        )
    except FitError as error:
        reasons = [f"; the last motion tried: {one.failure}" for one in runs if one.failure]
        raise FitError("".join([str(error), *reasons[:1]]), error.stats) from None
    finally:
        for one in runs:
            one.forget()


def _integration_error(problem: TransientProblem, fit: Fit) -> Array:
    """Return the change of the residuals (m,) that a tighter integration makes at the estimate."""
    tight = replace(problem, tolerance=problem.tolerance / CHECK)
    runs = tight.runs()
    motions = [one.function() for one in runs]
    found = tight.residuals(motions, {name: cs.MX(value) for name, value in zip(fit.names, fit.values, strict=True)})
    with delayed_interrupts():
        error = np.asarray(cs.evalf(found)).ravel() - fit.residuals
    for one in runs:
        one.forget()
    return error
