"""The residuals between measured positions and the motion of the nonlinear beam, as functions of the unknowns.

The positions y_ij of the points s_j at the times t_i of a record give the residuals r(s_j, t_i; theta, P, b, F) - y_ij:
computed less measured position for the parameters theta of the damping law, the properties P of the elements, the
amplitude b of the base motion, and the load F, with its rate of change, that holds the beam until it is released.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.derivatives.runs import Runs
from ancf_casadi.dynamics.derivatives.sensitivity import Problem
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.interrupts import delayed_interrupts
from problems.transient.marker_record import MarkerRecord
from problems.transient.unknowns import amplitude_name, load_name, loads

PATIENCE = 20.0  # most steps of a run, relative to the first run
OPTIONS: Mapping[str, Any] = {
    "ipopt.tol": 1e-4,
    "ipopt.compl_inf_tol": 1e-7,
    "ipopt.max_iter": 50,
    "ipopt.accept_after_max_steps": 3,  # halvings; of shorter steps, the integration error hides the decrease
    "ipopt.watchdog_shortened_iter_trigger": 1,  # then take full steps, judged by the gradient
    "ipopt.mu_init": 1e-4,  # small, so that bounds do not push a good guess away
    "ipopt.bound_mult_init_method": "mu-based",
}


@dataclass(frozen=True, eq=False)
class TransientProblem:
    """Measured motions, and the model that is fitted to them.

    Parameters
    ----------
    model : Model
        The beam.
    records : tuple of MarkerRecord
        The measurements.
    damping : DampingLaw
        The law.
    load : tuple of str
        Unknown components of the tip load at the start.
    tolerance : float
        Tolerance of the integration.
    """

    model: Model
    records: tuple[MarkerRecord, ...]
    damping: DampingLaw
    load: tuple[str, ...]
    tolerance: float

    def runs(self) -> list[Runs]:
        """Return the motion of each record, differentiable by the unknowns."""
        equations = Equations(self.model, self.damping)
        return [
            Runs(
                Problem(
                    equations=equations,
                    base=record.own_base,
                    start=record.start,
                    times=np.asarray(record.time),
                    tolerance=self.tolerance,
                    held=bool(self.load),
                ),
                PATIENCE,
            )
            for record in self.records
        ]

    def residuals(self, motions: Sequence[cs.Function], given: Mapping[str, cs.MX]) -> cs.MX:
        """Return computed less measured positions, record by record and coordinate by coordinate.

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
            if self.load:
                inputs.append(cs.vertcat(*(given.get(load_name(k, name), cs.MX(p)) for name, p in loads(record))))
            matrix = np.vstack([self.model.interpolation(point) for point in record.points_on(self.model.beam)])
            parts.append(cs.vec((cs.DM(matrix) @ motion(*inputs) - cs.DM(record.columns)).T))
        return cs.vertcat(*parts)

    def residuals_at(self, values: Mapping[str, float]) -> Array:
        """Return the residuals for values of the unknowns by name, from one integration of each record, (m,)."""
        runs = self.runs()
        motions = [one.function() for one in runs]
        residuals = self.residuals(motions, {name: cs.MX(value) for name, value in values.items()})
        with delayed_interrupts():
            found = np.asarray(cs.evalf(residuals)).ravel()
        for one in runs:
            one.forget()
        return found
