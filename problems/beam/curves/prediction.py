"""Prediction of a response curve with the estimates of a fit to other records.

At the level of the excitation, the amplitude and phase of a point are those of a motion on the branch of the curve that
the measured amplitude is nearest to.  With the derivatives at fixed amplitude (``points``), and l' = dl/dY,

    dY/dx = -(dl/dx)/l',    dphi/dx = phi_x + phi' dY/dx        at fixed level.

With the covariance C of the estimates and the rows J of these derivatives, the standard errors of the prediction are
diag(J C J')^1/2, to first order.  Beyond a jump no motion has the level; the motion at the jump takes its place, and a
warning says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import LARGEST_PREDICTION_ERROR
from ancf_casadi.exceptions import FitError, NumericsError
from ancf_casadi.support.arrays import Array, Mask, root_mean_square
from ancf_casadi.support.tables import Displayed, Table, known
from problems.beam.curves.block import CurveBlock
from problems.beam.curves.record import ResponseRecord

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FREE_STD = 1e4  # factor on the standard deviations of amplitude and phase: the level decides


@dataclass(frozen=True, eq=False)
class ResponsePrediction(Displayed):
    """A measured response curve, and the amplitudes and phases that a fit to other records predicts for it.

    Parameters
    ----------
    record : ResponseRecord
        The measurements.
    amplitudes, phases : ndarray
        Predicted amplitudes, in the unit of the sensor, and phases, rad, (m,).
    amplitude_errors, phase_errors : ndarray
        Their standard errors due to the uncertainty of the estimates.
    beyond : ndarray of bool
        Points at whose level the predicted curve has no motion on this branch: the values are those at the jump.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, ModalDamping, Model, natural_modes
    >>> from problems import ResponseRecord, fit_beam
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model = Model(beam)
    >>> base, frequencies = HarmonicBase(amplitude=1e-3, frequency=1.0), [1.80, 1.84, 1.87, 1.90, 1.93]
    >>> amplitudes = [0.0186, 0.0358, 0.0737, 0.0487, 0.0263]
    >>> record = ResponseRecord(frequencies, amplitudes, base=base)
    >>> fit = fit_beam(model, record, ModalDamping(natural_modes(model, count=1), ratios=[0.02]))
    >>> prediction = fit.predict(ResponseRecord([1.7, 1.95], [0.0080, 0.0197], base=base))
    >>> prediction.relative_errors["amplitude"] < 0.03, prediction.beyond.any()
    (True, np.False_)
    """

    record: ResponseRecord
    amplitudes: Array
    phases: Array
    amplitude_errors: Array
    phase_errors: Array
    beyond: Mask

    @property
    def residuals(self) -> dict[str, Array]:
        """Predicted less measured amplitudes and, if they were measured, phases."""
        found = {"amplitude": self.amplitudes - self.record.amplitudes}
        if self.record.measured_phases is not None:
            rest = self.phases - self.record.measured_phases
            found["phase"] = np.arctan2(np.sin(rest), np.cos(rest))
        return found

    @property
    def rms_errors(self) -> dict[str, float]:
        """Root mean square of the residuals, in the unit of the sensor and in rad."""
        return {name: root_mean_square(rest) for name, rest in self.residuals.items()}

    @property
    def relative_errors(self) -> dict[str, float]:
        """Root mean square of the residuals of amplitudes over the measured ones, and of those of phases, rad."""
        found = self.residuals
        return {**self.rms_errors, "amplitude": root_mean_square(found["amplitude"] / self.record.amplitudes)}

    @property
    def standard_errors(self) -> Mapping[str, float]:
        """Root mean square of the standard errors of the predicted amplitudes and phases."""
        return {"amplitude": root_mean_square(self.amplitude_errors), "phase": root_mean_square(self.phase_errors)}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Points beyond a jump, and errors beyond noise and uncertainty."""
        notes = []
        if self.beyond.any():
            notes.append(
                f"{np.count_nonzero(self.beyond)} of {len(self.beyond)} points lie beyond a jump of the predicted "
                f"curve, the first at {self.record.f[self.beyond][0]:.5g} Hz; their predictions are those at the jump"
            )
        deviations = dict(zip(("amplitude", "phase"), self.record.stds, strict=False))
        for name, rest in self.residuals.items():
            own = self.amplitude_errors if name == "amplitude" else self.phase_errors
            ratio = root_mean_square(rest / np.hypot(own, deviations[name]))
            if ratio > LARGEST_PREDICTION_ERROR:
                notes.append(
                    f"{name}: the error is {ratio:.2g} times as large as noise and the uncertainty of the estimates "
                    "explain; the model does not hold for this record"
                )
        return tuple(notes)

    def report(self) -> str:
        """Return the result as text."""
        columns = ("quantity", "unit", "rms_error", "relative_error", "standard_error")
        units = {"amplitude": self.record.sensor.unit, "phase": "rad"}
        rows = [
            (name, units[name], error, self.relative_errors[name], self.standard_errors[name])
            for name, error in self.rms_errors.items()
        ]
        table = Table("prediction", "Predicted less measured response", columns, rows, [])
        return "\n".join([table.text(), *(f"  note: {note}" for note in self.warnings)])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "record": self.record.label,
            "frequencies": self.record.f.tolist(),
            "amplitudes": self.amplitudes.tolist(),
            "amplitude_errors": [known(error) for error in self.amplitude_errors.tolist()],
            "phases": self.phases.tolist(),
            "phase_errors": [known(error) for error in self.phase_errors.tolist()],
            "rms_errors": self.rms_errors,
            "relative_errors": self.relative_errors,
            "beyond": self.beyond.tolist(),
            "warnings": list(self.warnings),
        }

    def figure(self) -> Figure:
        """Draw measured and predicted amplitudes and phases against frequency."""
        from problems.beam.curves.figures import response_figure  # matplotlib is slow to import

        return response_figure([self.record], [self.amplitudes], [self.phases])


def predicted(block: CurveBlock, fit: Fit) -> ResponsePrediction:
    """Return the prediction of a record with the estimates of a fit.

    Parameters
    ----------
    block : CurveBlock
        The record alone.
    fit : Fit
        The estimates.

    Raises
    ------
    InputError
        If the sensor is not on the beam.
    FitError
        If the response at a point cannot be computed.
    """
    (record,), values = block.records, fit.estimates
    amplitude_std, phase_std, level_std = record.stds * np.array([FREE_STD, FREE_STD, 1.0])[:, None]
    loose = replace(record, amplitude_std=amplitude_std, phase_std=phase_std, level_std=level_std)
    responses = replace(block, weights=replace(block.weights, records=(loose,))).evaluation()
    try:
        motions, changes = responses.motions(values)[0], responses.sensitivities(values)[0]
    except NumericsError as error:
        raise FitError(f"the response cannot be predicted: {error}") from None
    found = np.array([one.values for one in motions])
    places = [fit.names.index(name) for name in block.names]
    slopes, errors = fit.coordinates.slopes(fit.values)[places], []
    for motion, change in zip(motions, changes, strict=True):
        slope = motion.slopes
        by_amplitude = -change[2] / slope[2]
        jacobian = np.zeros((2, len(fit.names)))
        jacobian[:, places] = slopes * np.array([by_amplitude, change[1] + slope[1] * by_amplitude])
        errors.append(np.nan_to_num(fit.errors_of(jacobian)))
    levels = record.a * values.get(block.excitation(block.numbered[0][0]) or "", 1.0)
    beyond = np.abs(found[:, 2] / levels - 1) > 1e-4  # relative difference of levels that are the same
    amplitude_errors, phase_errors = np.array(errors).T
    return ResponsePrediction(
        record, found[:, 0], found[:, 1], np.where(beyond, math.nan, amplitude_errors),
        np.where(beyond, math.nan, phase_errors), beyond,
    )  # fmt: skip
