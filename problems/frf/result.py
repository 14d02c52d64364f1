"""The result of a fit of frequency response functions: modal parameters, their uncertainty, and warnings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, Fit
from ancf_casadi.estimation.intervals import profile_interval
from ancf_casadi.estimation.prediction import PredictedChannel, RecordPrediction
from ancf_casadi.estimation.result import Interval, LeastSquaresResult
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.inputs import check_instance, positive_array
from ancf_casadi.support.tables import Table, finite_or_none
from problems.frf.modal_sum import ModalSum, TrialFit, quick_fit
from problems.frf.record import FrfRecord
from problems.frf.refinement import (
    FRF_ADVICE,
    coefficient_covariance,
    correct_covariance,
    first_deviations,
    inflation,
    limitations,
    refine,
    stated_deviations,
)
from problems.matching.measured_modes import MeasuredModes

GREY = "#b0b0b0"
# Size of a second shape in the constants of a mode, relative to the first, and in standard errors.  At 0.5 and 0.01,
# test_two_modes_of_one_frequency_are_named_by_their_shapes fails, and at 1 standard error.
SECOND_SHAPE, SIGNIFICANT = 0.1, 4.0
MOST_DRAWN = 4  # functions in a figure; of more, those with the largest residuals


@dataclass(frozen=True, eq=False)
class FrfFit(LeastSquaresResult):
    """Modal parameters identified from frequency response functions, modes in ascending order.

    The estimates are ``frequency_1``, Hz, ``damping_ratio_1``, and so on.

    Parameters
    ----------
    record : FrfRecord
        The functions that were fitted, within the band.
    refinement : TrialFit
        The modes that were fitted, and all that follows from them.
    solution : Fit
        The fit before its covariance allows for the fitted coefficients and for noise that functions share.
    notes : tuple of str
        Limitations of what preceded the fit.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import FrfRecord, fit_frf
    >>> f, rng = np.linspace(1.0, 3.0, 401), np.random.default_rng(0)
    >>> values = 1.0 / (2.0**2 - f**2 + 0.04j * f) + rng.normal(0.0, 0.05, (2, 401)).T @ [1, 1j]
    >>> fit = fit_frf(FrfRecord(f, values, "receptance"), frequencies=[2.0])
    >>> [f"{end:.5f}" for end in fit.intervals()["damping_ratio_1"]]
    ['0.00996', '0.01005']
    """

    kind = "frequency response"
    _drawing = "problems.frf.result.frf_figure"

    record: FrfRecord
    refinement: TrialFit
    solution: Fit
    notes: tuple[str, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the functions of CasADi, which the other process derives again."""
        return refine_result, (self.record, self.refinement, self.notes, self.again)

    @property
    def frequencies(self) -> Array:
        """Undamped natural frequencies (m,), Hz."""
        return self.refinement.frequencies

    @property
    def damping_ratios(self) -> Array:
        """Damping ratios (m,)."""
        return self.refinement.ratios

    @cached_property
    def constants(self) -> ComplexArray:
        """Modal constants (m, outputs, inputs).

        The product of the mass-normalised shape at output and input, 1/kg for a record per force; real, if the mode is.
        """
        trial = self.refinement
        values = trial.model.constants(trial.frequencies, trial.ratios, trial.coefficients)
        return values.reshape(-1, self.record.outputs, self.record.inputs)

    @cached_property
    def constant_errors(self) -> ComplexArray:
        """Standard errors of the real parts of ``constants``, plus i times those of the imaginary parts."""
        count = self.refinement.values.shape[1]
        errors = np.array([_constant_errors(self.refinement, self.fit, function) for function in range(count)]).T
        return errors.reshape(self.constants.shape)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the estimates, one sentence each."""
        return (*self.notes, *self.fit.warnings, *limitations(self.refinement, self.fit), *self._shape_warnings)

    @property
    def _shape_warnings(self) -> list[str]:
        """Modes whose constants are not the products of one shape at outputs and inputs, as those of one mode are."""
        errors = np.abs(self.constant_errors).max(axis=(1, 2))
        return [
            f"the modal constants at {frequency:.4g} Hz are not those of one shape: two modes may lie there, of which "
            "the shape shows the stronger part"
            for frequency, sizes, error in zip(
                self.frequencies, np.linalg.svd(self.constants, compute_uv=False), errors, strict=True
            )
            if np.any(sizes[1:] > np.maximum(SECOND_SHAPE * sizes[0], SIGNIFICANT * error))
        ]

    @property
    def poles(self) -> ComplexArray:
        """Poles -zeta omega + i omega (1 - zeta^2)^1/2 (m,), rad/s."""
        ω, ζ = 2 * np.pi * self.frequencies, self.damping_ratios
        return np.asarray(ω * (-ζ + 1j * np.sqrt(1 - ζ**2)))

    @cached_property
    def shapes(self) -> ComplexArray:
        """Mode shapes at the outputs (m, outputs), complex; the largest component is 1."""
        left_vectors, _, _ = np.linalg.svd(self.constants)
        principal = left_vectors[:, :, 0]
        largest = np.take_along_axis(principal, np.abs(principal).argmax(axis=1)[:, None], axis=1)
        return np.asarray(principal / largest)

    def synthesised(self, frequencies: ArrayLike | None = None) -> ComplexArray:
        """Return the fitted functions, (outputs, inputs, k), at given frequencies, Hz, or those of the record."""
        f = self.record.frequencies if frequencies is None else positive_array(frequencies, "frequencies")
        values = self.refinement.at(np.atleast_1d(f))
        return values.T.reshape(self.record.outputs, self.record.inputs, -1)

    def measured_modes(self) -> MeasuredModes:
        """Return frequencies with their standard errors, and shapes at the points of the record, for a match.

        The shapes are the real parts; without points, or with one only, there are none.

        Examples
        --------
        >>> import numpy as np
        >>> from problems import FrfRecord, fit_frf
        >>> f, rng = np.linspace(1.0, 3.0, 401), np.random.default_rng(0)
        >>> row = 1.0 / (2.0**2 - f**2 + 0.04j * f)
        >>> values = np.array([0.4 * row, row]) + rng.normal(0.0, 0.05, (2, 2, 401)).T.swapaxes(0, 1) @ [1, 1j]
        >>> fit = fit_frf(FrfRecord(f, values, "receptance", points=[0.25, 0.5]), frequencies=[2.0])
        >>> [[round(value, 2) for value in shape] for shape in fit.measured_modes().shapes]
        [[0.4, 1.0]]
        """
        errors = list(self.standard_errors.values())[::2]
        std = tuple(errors) if np.isfinite(errors).all() and np.min(errors) > 0.0 else None
        points = self.record.points
        without_shapes = MeasuredModes(tuple(self.frequencies.tolist()), frequency_std=std)
        if points is None or len(points) < 2 or std is None:
            return without_shapes
        inputs = np.abs(self.constants).max(axis=1).argmax(axis=1)
        modes = np.arange(len(inputs))  # the input of each mode with the largest constant
        sizes = np.abs(self.constants[modes, :, inputs]).max(axis=1)
        shape_std = self.constant_errors[modes, :, inputs].real / sizes[:, None]
        return replace(
            without_shapes,
            points=tuple(points),
            shapes=tuple(map(tuple, self.shapes.real.tolist())),
            shape_std=tuple(map(tuple, shape_std.tolist())),
        )

    def _profiles(self, level: float) -> dict[str, Interval]:
        return {}  # the covariance allows for noise that functions share, and the likelihood does not

    def profile(self, name: str, level: float = CONFIDENCE_LEVEL) -> Interval:
        """Return the interval of an estimate by profile likelihood, allowing for noise that functions share.

        Raises
        ------
        InputError
            If there is no such estimate, the level is not between 0 and 1, or there is no scatter.
        FitError
            If a nonlinear program for an end does not converge.
        """
        self.check_name(name)
        ratio = self.standard_errors[name] / self.solution.standard_errors[name]
        return profile_interval(self.fit, name, level, inflation=float(np.nan_to_num(ratio, nan=1.0)) ** 2)

    def predict(self, record: FrfRecord) -> RecordPrediction:
        """Compute other functions of the same structure with the modes, and compare.

        The modal constants belong to the points of the record: they are fitted, as are the modes outside its band.

        Raises
        ------
        InputError
            If it is no record, or has fewer values than constants.
        """
        check_instance(record, "record", FrfRecord)
        values, trial = record.columns, self.refinement
        model = ModalSum.of(record.frequencies, record.kind, trial.model.powers, record.window)
        if 2 * len(values) < 2 * len(trial.frequencies) + len(model.powers):
            raise InputError(f"has too few frequencies, {len(values)}, for {len(trial.frequencies)} modes", "record")
        deviations = stated_deviations(record)
        prediction = TrialFit(model, values, 1 / deviations, trial.frequencies, trial.ratios)
        part_errors = self.fit.errors_of(prediction.jacobian).reshape(values.shape[1], 2, -1)
        errors = np.hypot(*np.nan_to_num(part_errors).swapaxes(0, 1)).T * deviations
        noise = np.sqrt(np.mean(first_deviations(values) ** 2, axis=0))
        columns = zip(record.names(), values.T, prediction.fitted.T, errors.T, noise.tolist(), strict=True)
        channels = tuple(
            PredictedChannel(name, record.unit, measured, fitted, error, record.frequencies, "frequency, Hz", std)
            for name, measured, fitted, error, std in columns
        )
        return RecordPrediction(self.kind, channels)

    def resampled(self, noise: Array) -> Array:
        """Return the estimates (p,) from a fit to the fitted functions plus noise of each residual (m,)."""
        trial = self.refinement
        real, imaginary = noise.reshape(trial.values.shape[1], 2, -1).swapaxes(0, 1)
        scaled = inflation(trial, self.fit) ** 0.5 * (real + 1j * imaginary).T / trial.weights
        fit = quick_fit(replace(trial, values=trial.fitted + scaled))
        if fit is None:
            raise FitError(f"the functions do not determine the modes; {FRF_ADVICE}")
        return np.column_stack([fit.frequencies, fit.ratios]).ravel()

    def table(self) -> Table:
        """Return frequencies and damping ratios of the modes."""
        return self.tables()[0]

    def tables(self) -> tuple[Table, Table]:
        """Return the table of frequencies and damping ratios, and that of modal constants."""
        rows, constants, intervals = [], [], self.intervals()
        for k, (f, ζ) in enumerate(zip(self.frequencies.tolist(), self.damping_ratios.tolist(), strict=True), start=1):
            error, ratio_error = (self.standard_errors[f"{name}_{k}"] for name in ("frequency", "damping_ratio"))
            percent = [finite_or_none(100 * x) for x in (ratio_error, *intervals[f"damping_ratio_{k}"])]
            rows.append((k, f, finite_or_none(error), 100 * ζ, *percent))
            values, errors = self.constants[k - 1].flat, self.constant_errors[k - 1].flat
            for name, c, e in zip(self.record.names(), values, errors, strict=True):
                constants.append((k, name, float(c.real), float(e.real), float(c.imag), float(e.imag)))
        f, functions = self.record.frequencies, self.record.outputs * self.record.inputs
        kind = self.record.kind.replace("-", " ") + (" functions" if functions > 1 else " function")
        title = f"Modes from {functions} {kind} at {len(f)} frequencies, {f[0]:.4g} to {f[-1]:.4g} Hz"
        columns = ("mode", "frequency_Hz", "stderr_Hz", "damping_%", "stderr_%", "lower_95_%", "upper_95_%")
        unit = "" if self.record.unit == "1" else ", 1/kg"
        constant_columns = ("mode", "function", "real", "stderr", "imaginary", "stderr")
        return (
            Table("modes", title, columns, rows, [self.fit.colour()]),
            Table("constants", f"Modal constants{unit}", constant_columns, constants),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values; modal constants in the order (outputs, inputs)."""
        modes, intervals = [], self.intervals()
        for k, (f, ζ) in enumerate(zip(self.frequencies.tolist(), self.damping_ratios.tolist(), strict=True), start=1):
            mode: dict[str, Any] = {"frequency_hz": f, "damping_ratio": ζ}
            for name, suffix in (("frequency", "_hz"), ("damping_ratio", "")):
                mode[f"{name}_stderr{suffix}"] = finite_or_none(self.standard_errors[f"{name}_{k}"])
                mode[f"{name}_interval{suffix}"] = [finite_or_none(end) for end in intervals[f"{name}_{k}"]]
            arrays = ("constants", self.constants), ("constants_stderr", self.constant_errors), ("shape", self.shapes)
            for name, values in arrays:
                mode[f"{name}_real"] = values[k - 1].real.tolist()
                mode[f"{name}_imaginary"] = values[k - 1].imag.tolist()
            modes.append(mode)
        return {
            **super().to_dict(),
            "functions": self.record.kind,
            "band_hz": [float(self.record.frequencies[0]), float(self.record.frequencies[-1])],
            "modes": modes,
            "points_m": None if self.record.points is None else list(self.record.points),
        }


def refine_result(record: FrfRecord, start: TrialFit, notes: tuple[str, ...], again: Callable[[Any], Any]) -> FrfFit:
    """Refine a start, and return the result of the fit."""
    trial, fit = refine(start)
    return FrfFit(correct_covariance(trial, fit, record.scatter), record, trial, fit, notes, again=again)


def _constant_errors(trial: TrialFit, fit: Fit, function: int) -> ComplexArray:
    """Return standard errors of real and imaginary parts of the modal constants of a function (m,)."""
    covariance, size = coefficient_covariance(trial, fit, function), 2 * len(trial.ratios)
    aa, ab, bb = (np.diag(covariance[i:size:2, j:size:2]) for i, j in ((0, 0), (0, 1), (1, 1)))  # of each mode
    ω, ζ = 2 * np.pi * trial.frequencies, trial.ratios
    return np.asarray(np.sqrt(aa - 2 * ζ * ω * ab + (ζ * ω) ** 2 * bb) + 1j * ω * np.sqrt((1 - ζ**2) * bb))


def frf_figure(fits: Mapping[str, FrfFit]) -> Figure:
    """Draw amplitude and phase of measured and fitted functions, and their difference.

    Of many functions, those with the largest relative misfit are drawn.
    """
    from ancf_casadi.figures.responses import Curve, bode_figure  # slow to import: matplotlib
    from ancf_casadi.support.figures import COMPUTED, MEASURED

    (fit,) = fits.values()
    record = fit.record
    measured = record.columns.T
    fitted = fit.synthesised().reshape(measured.shape)
    misfit = np.linalg.norm(fitted - measured, axis=1) / np.linalg.norm(measured, axis=1)
    drawn = np.sort(np.argsort(misfit)[::-1][:MOST_DRAWN]).tolist()
    curves_by_function = [
        [
            Curve("measured", record.frequencies, measured[k], MEASURED),
            Curve("fitted", record.frequencies, fitted[k], COMPUTED),
            Curve("difference", record.frequencies, fitted[k] - measured[k], GREY, phase=False),
        ]
        for k in drawn
    ]
    unit = "" if record.unit == "1" else f", {record.unit}"
    names = record.names()
    return bode_figure(
        curves_by_function, record.kind.replace("-", " ") + unit, [names[k] for k in drawn] if len(names) > 1 else []
    )
