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

The tolerance of the solver, in units of the scales (``transient_unknowns``), stays above that of the integration, whose
steps change with the unknowns.

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
from numpy.typing import NDArray

from ancf_casadi.beam import PROPERTIES
from ancf_casadi.damping import DampingLaw
from ancf_casadi.differentiable import Motion, motion
from ancf_casadi.exceptions import InputError
from ancf_casadi.fit import Fit
from ancf_casadi.inputs import check_instance, choices, flag, instances, positive_or_infinite
from ancf_casadi.model import Model
from ancf_casadi.nlp import least_squares, residual_function
from ancf_casadi.starts import START, held_start, start_slopes
from ancf_casadi.trajectory import State
from problems.marker_record import MarkerRecord
from problems.transient_unknowns import amplitude_name, load_name, loads, named_parameters, transient_unknowns

Array = NDArray[np.float64]

TOLERANCE = 1e-6  # of the integration
OPTIONS: Mapping[str, Any] = {
    "ipopt.tol": 1e-5,
    "ipopt.compl_inf_tol": 1e-7,
    "ipopt.max_iter": 50,
    "ipopt.accept_after_max_steps": 8,  # halvings; a step so short that no decrease shows is lost in the integration
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

    def residuals(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return computed less measured positions for some unknowns by name, one coordinate after the other."""
        theta = [given.get(name, cs.MX(value)) for name, value in named_parameters(self.damping)]
        own_rows = zip(PROPERTIES, self.model.properties.tolist(), strict=True)
        rows = [given.get(name, cs.MX(1.0)) * cs.DM(row).T for name, row in own_rows]
        parts = []
        for k, record in enumerate(self.records):
            b = [given.get(amplitude_name(k, name), cs.MX(value)) for name, value in record.own_base.parameters]
            inputs = [cs.vertcat(cs.MX(0, 1), *theta), cs.vertcat(cs.MX(0, 1), *b), cs.vertcat(*rows)]
            if self.starts:
                inputs.append(cs.vertcat(*(given.get(load_name(k, name), cs.MX(p)) for name, p in loads(record))))
            coordinates = self._motion(record)(*inputs)
            points = (self.model.beam.length,) if record.points is None else record.points
            matrix = np.vstack([self.model.interpolation(point) for point in points])
            parts.append(cs.vec((cs.DM(matrix) @ coordinates - cs.DM(record.columns)).T))
        return cs.vertcat(*parts)

    def _motion(self, record: MarkerRecord) -> Motion:
        """Return the motion a record is held against."""
        return motion(
            self.model,
            duration=record.duration,
            damping=self.damping,
            base=record.base,
            sample_rate=record.sample_rate,
            start=record.start,
            tolerance=self.tolerance,
            start_load=bool(self.starts),
        )


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
        What was fitted.
    """

    law: DampingLaw
    model: Model
    fit: Fit
    problem: TransientProblem

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
        held = held_start(self.model, start_slopes(self.model), np.array(load))
        return State(held.coordinates, held.velocities)

    def report(self) -> str:
        """Return the result as text."""
        return self.fit.report()

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {"law": repr(self.law), **self.fit.to_dict()}

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel between processes without the motion, which is derived again there."""
        return _restored, (self.law, self.model, replace(self.fit, model=cs.Function()), self.problem)


def _restored(law: DampingLaw, model: Model, fit: Fit, problem: TransientProblem) -> TransientFit:
    def residuals(*values: cs.MX) -> cs.MX:
        return problem.residuals(dict(zip(fit.names, values, strict=True)))

    return TransientFit(law, model, replace(fit, model=residual_function(residuals, fit.scale)), problem)


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
    tolerance: float = TOLERANCE,
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
    tolerance : float
        Tolerance of the integration.

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
    problem = TransientProblem(model, records, damping, tuple(start), tolerance)
    names = [unknown.name for unknown in unknowns]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a trial without a motion is stepped back from
        fit = least_squares(
            lambda *values: problem.residuals(dict(zip(names, values, strict=True))),
            unknowns,
            huber=robust,
            gauss_newton=True,
            forward=True,
            series=[record.columns.shape[1] for record in problem.records for _ in record.columns],
            options=OPTIONS,
        )
    found = dict(zip(names, fit.values.tolist(), strict=True))
    law = damping.with_parameters([found.get(name, value) for name, value in named_parameters(damping)])
    factors = {name: found.get(name, 1.0) for name in PROPERTIES}
    rows = zip(PROPERTIES, model.properties, strict=True)
    beam = model.beam.with_(**{name: (factors[name] * row).tolist() for name, row in rows})
    return TransientFit(law, Model(beam, model.measures), fit, problem)
