"""The result of a fit to large motion: law, beam, uncertainties, and the effect of the integration error.

``TransientFit.predict`` computes another record with the estimates, without fitting.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.damping.law import SumOfLaws
from ancf_casadi.dynamics.derivatives.release_load import held_start, start_jacobians
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.estimation.agreement import Agreement, agreement_of_parts
from ancf_casadi.estimation.fit import Fit, colour_warning
from ancf_casadi.estimation.least_squares import residual_function
from ancf_casadi.estimation.resampling import refit
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from problems.transient.marker_record import motion_record
from problems.transient.prediction import MotionPrediction, labels_of, predicted, root_mean_square
from problems.transient.problem import OPTIONS, TransientProblem
from problems.transient.tolerance import ALLOWED, TIGHTEST
from problems.transient.unknowns import load_name, loads
from problems.transient.weights import TRUST

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INTEGRATED = 3.0  # systematic errors of a record, up to which residuals may be integration errors


@dataclass(frozen=True, eq=False)
class TransientFit:
    """A damping law, and properties of a beam, estimated from measured motions.

    Parameters
    ----------
    law : DampingLaw
        The law with the estimated parameters.
    model : Model
        The beam with the estimated properties.
    fit : Fit
        All unknowns with their uncertainties.
    problem : TransientProblem
        The measurements and the fitted model, with the tolerance of the integration.
    shifts : ndarray
        Shift of each estimate by the integration error, in standard errors (n,); nan if unknown.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, simulate
    >>> from problems import MarkerRecord, fit_transient
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model, base = Model(beam), HarmonicBase(amplitude=5e-3, frequency=1.9)
    >>> true, guess = RayleighDamping(alpha=0.5), RayleighDamping(alpha=0.2)
    >>> run = simulate(model, damping=true, base=base, duration=0.25, sample_rate=50.0)
    >>> fit = fit_transient(model, MarkerRecord(run.time, run.tip, base=base), guess)
    >>> type(fit.law).__name__, round(fit.law.alpha, 2), fit.units
    ('RayleighDamping', 0.5, {'alpha': '1/s'})
    >>> [channel.size for channel in fit.residuals]  # x and y of the tip
    [13, 13]
    """

    law: DampingLaw
    model: Model
    fit: Fit
    problem: TransientProblem
    shifts: Array

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the estimates, one sentence each."""
        coloured = colour_warning(self.fit, noise_free=INTEGRATED * self.fit.systematic)
        notes = [*self.fit.warnings, coloured, *(one.warning for one in self.agreements)]
        tolerance, worst = self.problem.tolerance, float(np.abs(self.shifts).max())
        if math.isnan(worst):
            notes.append(
                f"the integration error at the tolerance {tolerance:.1e} could not be checked: its effect on the "
                "estimates is unknown"
            )
        elif worst > ALLOWED:
            name = self.fit.names[int(np.abs(self.shifts).argmax())]
            advice = "let the fit select the tolerance" if tolerance > TIGHTEST else "shorten the record"
            notes.append(
                f"the integration error at the tolerance {tolerance:.1e} shifts {name} by {worst:.2g} standard errors; "
                f"{advice}"
            )
        return tuple(note for note in notes if note)

    @cached_property
    def agreements(self) -> tuple[Agreement, ...]:
        """Agreement of the records, to first order, on each unknown that several determine; empty for one record."""
        return agreement_of_parts(self.fit, self.problem.rows)

    @property
    def estimates(self) -> dict[str, float]:
        """Estimated unknowns by name."""
        return dict(zip(self.fit.names, self.fit.values.tolist(), strict=True))

    @property
    def residuals(self) -> list[Array]:
        """Computed less measured readings of each channel, record by record, in the unit of the sensor."""
        return self.problem.weights.split(self.fit.residuals)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each unknown."""
        return dict(zip(self.fit.names, self.fit.units, strict=True))

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each unknown by name; nan at a bound."""
        return self.fit.standard_errors

    def refit(self, noise: Array) -> Array:
        """Return the unknowns from a fit to the fitted motion plus noise, weighted as ``fit.residuals``."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # IPOPT steps back from a trial that cannot be integrated
            return refit(self.fit, noise, gauss_newton=True, forward=True, options=OPTIONS)

    def start(self, record: int = 0) -> State:
        """Return the estimated state at the start of a record.

        Raises
        ------
        InputError
            If no load was estimated.
        """
        if not self.problem.load:
            raise InputError("was not estimated; name the components to estimate in fit_transient(load=...)", "load")
        found = self.estimates
        load = [found.get(load_name(record, name), value) for name, value in loads(self.problem.records[record])]
        held = held_start(self.model, start_jacobians(self.model), np.array(load))
        return State(held.coordinates, held.velocities)

    def predict(self, record: Any, *, tip_mass: float | None = None) -> MotionPrediction:
        """Compute another record of the same beam with the estimates, without fitting, and compare.

        The base motion, the start and the sensors are those of the record.  Release, offsets and the view of a camera
        that are unknown have the middle of their bounds.  The origin of a displacement makes its mean error zero.

        Parameters
        ----------
        record : MotionRecord, MarkerRecord or Measurement
            The measurements.
        tip_mass : float, optional
            Mass at the tip in this record, kg; that of the fitted beam if not given.

        Raises
        ------
        InputError
            If a sensor is not on the beam, or the mass is not usable.
        FitError
            If the motion cannot be computed.

        Examples
        --------
        >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, simulate
        >>> from problems import MarkerRecord, fit_transient
        >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
        ...                     density=8000.0, elastic_modulus=210e9, elements=4)
        >>> model, true, records = Model(beam), RayleighDamping(alpha=0.5), []
        >>> for amplitude in (5e-3, 8e-3):
        ...     base = HarmonicBase(amplitude=amplitude, frequency=1.9)
        ...     run = simulate(model, damping=true, base=base, duration=0.25, sample_rate=50.0)
        ...     records.append(MarkerRecord(run.time, run.tip, base=base))
        >>> prediction = fit_transient(model, records[0], RayleighDamping(alpha=0.2)).predict(records[1])
        >>> max(prediction.relative_errors.values()) < 1e-3
        True
        """
        return predicted(self.problem, self.fit, motion_record(record), tip_mass)

    def report(self) -> str:
        """Return the result as text."""
        table = self.fit.table()
        integration = (
            f"integrated at the tolerance {self.problem.tolerance:.1e}; the integration error shifts no estimate by "
            f"more than {np.abs(self.shifts).max():.2g} standard errors"
        )
        notes = (*table.notes, integration, *self._noise, *(one.text() for one in self.agreements))
        return "\n".join([replace(table, notes=notes).text(), *(f"  note: {note}" for note in self.warnings)])

    def figure(self) -> Figure:
        """Draw the measured readings and the fitted motion over time, and the residuals below."""
        from problems.transient.figures import motion_figure  # matplotlib is slow to import

        return motion_figure(self.problem.records, self.residuals)

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "law": law_name(self.law),
            **self.fit.to_dict(),
            "channels": [
                {"channel": label, "unit": unit, "noise": noise, "rms_error": rms}
                for label, unit, noise, rms in self._channels
            ],
            "agreements": [one.to_dict() for one in self.agreements],
            "tolerance": self.problem.tolerance,
            "integration_shifts": [float(shift) if math.isfinite(shift) else None for shift in self.shifts],
            "warnings": list(self.warnings),
        }

    @property
    def _channels(self) -> list[tuple[str, str, float, float]]:
        """Label, unit, standard deviation in the weights and root mean square residual of each channel."""
        channels, deviations = self.problem.channels, self.problem.weights.deviations.tolist()
        labels = labels_of(self.problem.records)
        rows = zip(labels, channels, deviations, self.residuals, strict=True)
        return [(label, one.sensor.unit, noise, root_mean_square(rest)) for label, one, noise, rest in rows]

    @property
    def _noise(self) -> list[str]:
        """Residuals and systematic error as notes of the report."""
        systematic = f"the standard errors allow for a systematic error of {TRUST:.0e} of the travel of each channel"
        if len(self.problem.weights.groups) == 1:
            return [systematic]
        rows = [
            f"{label}: root mean square residual {rms:.3g} {unit}".rstrip() + f", weighted by 1/{noise:.3g}"
            for label, unit, noise, rms in self._channels
        ]
        return [*rows, systematic]

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the motion, which the other process builds again."""
        return _restored, (self.law, self.model, replace(self.fit, model=cs.Function()), self.problem, self.shifts)


def _restored(law: DampingLaw, model: Model, fit: Fit, problem: TransientProblem, shifts: Array) -> TransientFit:
    motions = [runs.function() for runs in problem.runs()]

    def residuals(*values: cs.MX) -> cs.MX:
        return problem.residuals(motions, dict(zip(fit.names, values, strict=True)))

    return TransientFit(law, model, replace(fit, model=residual_function(residuals, fit.scale)), problem, shifts)


def law_name(law: DampingLaw) -> str:
    """Return the name of a law with those of its parameters."""
    terms = law.laws if isinstance(law, SumOfLaws) else (law,)
    return " + ".join(f"{type(term).__name__}({', '.join(own.name for own in term.parameters)})" for term in terms)
