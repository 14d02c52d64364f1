"""The result of a fit to response curves: law, beam, uncertainties, and the effects of truncation and of the levels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.estimation.agreement import Agreement, agreement_of_parts
from ancf_casadi.estimation.fit import Fit, colour_warning
from ancf_casadi.estimation.least_squares import residual_function
from ancf_casadi.estimation.resampling import refit
from ancf_casadi.estimation.result import known
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from problems.properties.observation import FACTORS
from problems.properties.response import changed
from problems.response.joint import ALLOWED, NEGLIGIBLE, OPTIONS, JointProblem
from problems.response.points import Motion
from problems.response.prediction import ResponsePrediction, predicted
from problems.response.record import ResponseRecord
from problems.response.residuals import Responses
from problems.transient.result import law_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BEYOND = 5.0  # standard deviations of a level beyond which the level of a point has no motion


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A damping law, and natural frequencies or properties of a beam, estimated from response curves.

    Parameters
    ----------
    problem : JointProblem
        The measurements and the fitted model.
    fit : Fit
        All unknowns with their uncertainties.
    shifts : ndarray
        Shift of each estimate by one mode and two harmonics more, in standard errors (n,); nan if unknown.
    level_shifts : ndarray
        Shift of each estimate if all levels of the excitation are 1 % larger, in standard errors (n,).
    responses : Responses
        The fitted motions.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, ModalDamping, Model, natural_modes
    >>> from problems import ResponseRecord, fit_response
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model = Model(beam)
    >>> base, frequencies = HarmonicBase(amplitude=1e-3, frequency=1.0), [1.80, 1.84, 1.87, 1.90, 1.93]
    >>> amplitudes = [0.0186, 0.0358, 0.0737, 0.0487, 0.0263]
    >>> record = ResponseRecord(frequencies, amplitudes, base=base)
    >>> fit = fit_response(model, record, ModalDamping(natural_modes(model, count=1), ratios=[0.02]))
    >>> list(fit.estimates), fit.units
    (['ratio1', 'frequency_1'], {'ratio1': '', 'frequency_1': ''})
    >>> [values.shape for values in fit.amplitudes]
    [(5,)]
    """

    problem: JointProblem
    fit: Fit
    shifts: Array
    level_shifts: Array
    responses: Responses

    @property
    def law(self) -> DampingLaw:
        """The law with the estimated parameters."""
        law, found = self.problem.curves.law, self.estimates
        return law.with_parameters([found.get(own.name, own.value) for own in law.parameters])

    @property
    def model(self) -> Model:
        """The beam with the estimated properties."""
        factors = np.array([self.estimates.get(name, 1.0) for name in FACTORS])
        return changed(self.problem.curves.model, factors)

    @property
    def records(self) -> tuple[ResponseRecord, ...]:
        """The fitted response curves."""
        return self.problem.curves.records

    @property
    def estimates(self) -> dict[str, float]:
        """Estimated unknowns by name."""
        return dict(zip(self.fit.names, self.fit.values.tolist(), strict=True))

    @property
    def units(self) -> dict[str, str]:
        """Unit of each unknown."""
        return dict(zip(self.fit.names, self.fit.units, strict=True))

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each unknown by name; nan at a bound."""
        return self.fit.standard_errors

    @cached_property
    def motions(self) -> list[list[Motion]]:
        """The motion closest to each measured point, record by record."""
        return self.responses.motions(self.estimates)

    @property
    def amplitudes(self) -> list[Array]:
        """Amplitudes of the motions closest to the measured points, record by record, in the unit of the sensor."""
        return [np.array([one.values[0] for one in own]) for own in self.motions]

    @property
    def phases(self) -> list[Array]:
        """Phases of these motions, rad."""
        return [np.array([one.values[1] for one in own]) for own in self.motions]

    @property
    def levels(self) -> list[Array]:
        """Levels of these motions, in the scale of the records."""
        return [np.array([one.values[2] for one in own]) for own in self.motions]

    @cached_property
    def agreements(self) -> tuple[Agreement, ...]:
        """Agreement of the records, to first order, on each unknown that several determine; empty for one record."""
        return agreement_of_parts(self.fit, self.problem.rows)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the estimates, one sentence each."""
        notes = [*self.fit.warnings, colour_warning(self.fit), *(one.warning for one in self.agreements)]
        notes += [*self._of_levels, *self._of_truncation, *self._of_branches]
        return tuple(note for note in notes if note)

    @property
    def _of_levels(self) -> list[str]:
        """Warning about the effect of an error of the levels, if they count as exact."""
        worst = int(np.nanargmax(np.abs(self.level_shifts)))
        if self.problem.curves.excitation != "known" or not abs(self.level_shifts[worst]) > 1.0:
            return []
        return [
            f"the levels of the excitation count as exact: if all of them are 1 % too small, {self.fit.names[worst]} "
            f"shifts by {self.level_shifts[worst]:+.2g} standard errors; if they are not that certain, give "
            "excitation='common' and excitation_deviation"
        ]

    @property
    def _of_truncation(self) -> list[str]:
        """Warning about the effect of more modes and harmonics."""
        own = np.abs(self.shifts)
        own[own * self.fit.errors <= NEGLIGIBLE * np.abs(self.fit.values)] = 0.0
        worst = float(own.max())
        if worst <= ALLOWED:
            return []
        name = self.fit.names[int(own.argmax())]
        return [
            f"one mode and two harmonics more shift {name} by {worst:.2g} standard errors; give more (modes, harmonics)"
        ]

    @property
    def _of_branches(self) -> list[str]:
        """Warnings about points without a stable motion at their level."""
        notes, values = [], self.estimates
        for record, motions, points in zip(
            self.records, self.motions, self.problem.curves.measured(values), strict=True
        ):
            if record.control == "response":
                continue
            away = [abs(p.distance(m.values)[2]) > BEYOND for m, p in zip(motions, points, strict=True)]
            between = [m.slopes[2] < 0.0 and not far for m, far in zip(motions, away, strict=True)]
            if any(away):
                notes.append(
                    f"{record.label}: {sum(away)} of {len(away)} points lie beyond a jump of the fitted curve, the "
                    f"first at {record.f[away.index(True)]:.5g} Hz; the law, or the level, does not hold there"
                )
            if any(between):
                notes.append(
                    f"{record.label}: {sum(between)} of {len(between)} points lie between the jumps of the fitted "
                    f"curve, the first at {record.f[between.index(True)]:.5g} Hz, where no motion is stable if the "
                    "level is controlled; if the response was controlled, give control='response'"
                )
        return notes

    def predict(self, record: ResponseRecord) -> ResponsePrediction:
        """Compute another record of the same beam with the estimates, without fitting, and compare.

        Parameters
        ----------
        record : ResponseRecord
            The measurements.  Each point is predicted on the branch of the curve that its amplitude is nearest to.

        Raises
        ------
        InputError
            If the sensor is not on the beam.
        FitError
            If the response at a point cannot be computed.

        Examples
        --------
        >>> from ancf_casadi import Beam, HarmonicBase, ModalDamping, Model, natural_modes
        >>> from problems import ResponseRecord, fit_response
        >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
        ...                     density=8000.0, elastic_modulus=210e9, elements=4)
        >>> model = Model(beam)
        >>> base, frequencies = HarmonicBase(amplitude=1e-3, frequency=1.0), [1.80, 1.84, 1.87, 1.90, 1.93]
        >>> amplitudes = [0.0186, 0.0358, 0.0737, 0.0487, 0.0263]
        >>> record = ResponseRecord(frequencies, amplitudes, base=base)
        >>> fit = fit_response(model, record, ModalDamping(natural_modes(model, count=1), ratios=[0.02]))
        >>> other = ResponseRecord([1.7, 1.95], [0.0080, 0.0197], base=base)
        >>> fit.predict(other).amplitudes.round(4)
        array([0.0081, 0.0195])
        """
        return predicted(self.problem.curves, self.fit, record)

    def refit(self, noise: Array) -> Array:
        """Return the unknowns from a fit to the fitted curves plus noise, weighted as ``fit.residuals``."""
        return refit(self.fit, noise, gauss_newton=True, forward=True, options=OPTIONS)

    def report(self) -> str:
        """Return the result as text."""
        table, curves = self.fit.table(), self.problem.curves
        truncation = (
            f"{curves.modes} modes with {curves.harmonics} harmonics; one mode and two harmonics more shift no "
            f"estimate by more than {np.abs(self.shifts).max():.2g} standard errors"
        )
        rows = [
            f"{record.label}: {record.f.size} points, {record.f.min():.5g} to {record.f.max():.5g} Hz, "
            f"root mean square error of the amplitude {100 * error:.2g} %"
            for record, error in zip(self.records, self.relative_errors, strict=True)
        ]
        notes = (*table.notes, *rows, truncation, *(one.text() for one in self.agreements))
        text = replace(table, notes=notes).text()
        return "\n".join([text, *(f"  note: {note}" for note in self.warnings)])

    @property
    def relative_errors(self) -> list[float]:
        """Root mean square of the relative errors of the amplitudes, of each record."""
        pairs = zip(self.records, self.amplitudes, strict=True)
        return [float(np.sqrt(np.mean((found / record.amplitudes - 1) ** 2))) for record, found in pairs]

    def figure(self) -> Figure:
        """Draw measured and fitted amplitudes and phases against frequency."""
        from problems.response.figures import response_figure  # matplotlib is slow to import

        return response_figure(self.records, self.amplitudes, self.phases)

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "law": law_name(self.law),
            **self.fit.to_dict(),
            "records": [
                {"record": record.label, "points": record.f.size, "relative_error": error}
                for record, error in zip(self.records, self.relative_errors, strict=True)
            ],
            "modes": self.problem.curves.modes,
            "harmonics": self.problem.curves.harmonics,
            "agreements": [one.to_dict() for one in self.agreements],
            "truncation_shifts": [known(shift) for shift in self.shifts],
            "level_shifts": [known(shift) for shift in self.level_shifts],
            "warnings": list(self.warnings),
        }

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the motions, which the other process computes again."""
        return _restored, (self.problem, replace(self.fit, model=cs.Function()), self.shifts, self.level_shifts)


def _restored(problem: JointProblem, fit: Fit, shifts: Array, level_shifts: Array) -> ResponseFit:
    motions = [runs.function() for runs in problem.motions.runs()] if problem.motions else []
    responses = Responses(problem.curves, fit.names)

    def residuals(*values: cs.MX) -> cs.MX:
        return problem.residuals(responses, motions, dict(zip(fit.names, values, strict=True)))

    restored = replace(fit, model=residual_function(residuals, fit.scale))
    return ResponseFit(problem, restored, shifts, level_shifts, responses)
