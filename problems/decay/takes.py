"""Several free decays that were fitted at once: takes of one mode, each also alone, or the modes of one record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import casadi as cs
import numpy as np

from ancf_casadi.decay.rest_position import REST_TERMS
from ancf_casadi.estimation.agreement import Agreement
from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, Quantities
from ancf_casadi.estimation.prediction import RecordPrediction
from ancf_casadi.estimation.result import Interval, LeastSquaresResult
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.tables import Table
from problems.decay.laws import DECAY_QUANTITIES
from problems.decay.prediction import predict_decay
from problems.decay.result import DecayFit

RELEASE_QUANTITIES = ("amplitude", *REST_TERMS["creep"])  # of a release and a sensor, not of a mode


@dataclass(frozen=True, eq=False)
class DecayFits(LeastSquaresResult, Sequence[DecayFit]):
    """Fits of several free decays of one mode; a sequence of the results for each record.

    Of a quantity of the mode, the estimate is the mean of those from each record (``agreements``), and the standard
    error includes their scatter.  The others, whose names end with the number of the record, and those of one record
    alone are those of the fit to all records, as are all those of ``fits``.

    Parameters
    ----------
    fits : tuple of DecayFit
        Result for each record from the fit to all of them, with the same frequency and damping coefficients.
    alone : tuple of DecayFit
        Result for each record from a fit to this record alone.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import fit_decays
    >>> time, rng = np.linspace(0.0, 10.0, 1001), np.random.default_rng(0)
    >>> y = np.exp(-0.1 * time) * np.cos(12.0 * time)
    >>> takes = [Measurement(time, a * y + rng.normal(scale=1e-4, size=time.size)) for a in (0.02, 0.03)]
    >>> fits = fit_decays(takes)
    >>> len(fits), [one.name for one in fits.agreements]
    (2, ['frequency', 'damping_ratio'])
    """

    kind = "decays"
    _drawing = "problems.decay.law_curve.takes_figure"

    fits: tuple[DecayFit, ...]
    alone: tuple[DecayFit, ...] = ()

    @overload
    def __getitem__(self, index: int) -> DecayFit: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[DecayFit, ...]: ...
    def __getitem__(self, index: int | slice) -> DecayFit | tuple[DecayFit, ...]:
        """Return the result for a record from the fit to all of them."""
        return self.fits[index]

    def __len__(self) -> int:
        """Return the number of records."""
        return len(self.fits)

    @property
    def _shared(self) -> tuple[str, ...]:
        """Names of the quantities that all decays have in common."""
        model, excluded = self.fits[0].model, list(RELEASE_QUANTITIES)
        if model.law != "linear":  # what depends on the amplitude is stated at that of each record
            excluded.append("damping_ratio")
        if model.frequency_varies:
            excluded += ["frequency", "frequency_change"]
        return tuple(name for name in DECAY_QUANTITIES if name not in excluded)

    @cached_property
    def _smallest(self) -> DecayFit:
        """The fit of the record with the smallest amplitude, which all records have in common."""
        return min(self.fits, key=lambda fit: fit.amplitude)

    @cached_property
    def _positions(self) -> list[tuple[DecayFit, list[int]]]:
        """Each decay, and the positions of its quantities that are listed: the first decay lists the shared ones."""
        record_positions = [i for i, name in enumerate(DECAY_QUANTITIES) if name not in self._shared]
        return [(fit, record_positions if k else list(range(len(DECAY_QUANTITIES)))) for k, fit in enumerate(self.fits)]

    @cached_property
    def quantities(self) -> tuple[tuple[str, ...], tuple[str, ...], Quantities]:
        """Names and units of the quantities, and the function from the unknowns to them."""
        order, unnumbered = list(DECAY_QUANTITIES), DECAY_QUANTITIES if len(self) == 1 else self._shared
        listed = [(k, order[i]) for k, (_, positions) in enumerate(self._positions, start=1) for i in positions]
        names = tuple(name if name in unnumbered else f"{name}_{k}" for k, name in listed)
        return names, tuple(self.fits[0].model.unit(name) for _, name in listed), self._quantities

    def _quantities(self, *x: cs.MX) -> cs.MX:
        return cs.vertcat(*(fit.quantities[2](*x)[positions] for fit, positions in self._positions))

    def _ends(self, level: float) -> Array:
        """Return the intervals (q, 2) of all quantities within their bounds."""
        return np.concatenate([fit._ends(level)[positions] for fit, positions in self._positions])

    @cached_property
    def agreements(self) -> tuple[Agreement, ...]:
        """Agreement of the records on each quantity of the mode; empty for one record.

        What depends on the amplitude is compared at the smallest amplitude of a release.
        """
        if len(self.alone) < 2:
            return ()
        model = self.fits[0].model
        ratio = ("damping_ratio",) if model.law == "linear" else ()
        at_smallest = [fit.at_amplitude(self._smallest.amplitude) for fit in self.alone]
        agreements = []
        for name in ("frequency", *model.terms, *ratio):
            if name == "frequency_change" and model.frequency_law == "smooth":
                continue  # which refers to the smallest amplitude of each record
            values = np.array([quantities[name] for quantities, _ in at_smallest])
            errors = np.array([standard_errors[name] for _, standard_errors in at_smallest])
            if (errors > 0.0).all():
                agreements.append(Agreement(name, model.unit(name), values, errors, *model.bounds[name]))
        return tuple(agreements)

    @property
    def _shared_agreements(self) -> list[Agreement]:
        """Agreements on quantities that do not depend on the amplitude, whose mean is the estimate."""
        return [a for a in self.agreements if a.name in self._shared]

    @property
    def estimates(self) -> dict[str, float]:
        """Value of each estimated quantity by name."""
        return super().estimates | {a.name: a.mean for a in self._shared_agreements}

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each estimated quantity by name; nan at a bound."""
        return super().standard_errors | {a.name: a.error for a in self._shared_agreements}

    def intervals(self, level: float = CONFIDENCE_LEVEL) -> dict[str, Interval]:
        """Return the interval of each estimated quantity by name for a confidence level."""
        return super().intervals(level) | {a.name: a.ends(level) for a in self._shared_agreements}

    @property
    def covariance(self) -> Array:
        """Covariance (p, p) of the p estimates: the correlations of the fit to all, and the standard errors."""
        ratio = np.array([self.standard_errors[name] / error for name, error in super().standard_errors.items()])
        return super().covariance * np.outer(ratio, ratio)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Disagreements of the records, then the warnings of the fit to each record."""
        disagreements = [a.warning for a in self.agreements if a.warning]
        return (*disagreements, *_warnings([f"record {k}" for k in range(1, len(self) + 1)], self.fits))

    def predict(self, record: Measurement) -> RecordPrediction:
        """Compute another decay with the estimates, as ``DecayFit.predict``."""
        return self.fits[0].predict(record)

    @property
    def title(self) -> str:
        """The laws and the number of records."""
        return f"{self.fits[0].title}, {len(self)} records"

    def table(self) -> Table:
        """Return a row for each record alone and for the fit to all, then means and scatter of the records."""
        names = [a.name for a in self.agreements]
        if not self.agreements:
            return super().table()
        labels = [f"{a.name}, {a.unit}".removesuffix(", ") for a in self.agreements]
        columns = ("record", *(column for label in labels for column in (label, "stderr")), "residual_rms")
        fits = {**{str(k): fit for k, fit in enumerate(self.alone, start=1)}, "all at once": self.fits[0]}
        amplitude = self._smallest.amplitude
        rows: list[tuple[str | float | None, ...]] = []
        for label, fit in fits.items():
            values, errors = fit.at_amplitude(amplitude)
            rows.append(
                (label, *(number for name in names for number in (values[name], errors[name])), fit.residual_rms)
            )
        means = [number for agreement in self.agreements for number in (agreement.mean, agreement.error)]
        scatter = [number for agreement in self.agreements for number in (agreement.scatter, None)]
        rows += [("mean", *means, None), ("scatter", *scatter, None)]
        notes = [agreement.text() for agreement in self.agreements]
        if self.fits[0].model.frequency_varies:
            unit = self.fits[0].units["amplitude"]
            notes.append(f"the frequency is that at {amplitude:.4g} {unit}, the smallest amplitude of a release")
        return Table("takes", "The mode from each record, and from all at once", columns, rows, notes)

    def report(self) -> str:
        """Return the table and the fit to all records as text."""
        if not self.agreements:
            return self.fits[0].report()
        in_report = self.fits[0].warnings  # of the first record, which follows
        notes = [f"  note: {text}" for text in self.warnings if text.removeprefix("record 1: ") not in in_report]
        return "\n".join([self.table().text(), *notes, "", self.fits[0].report()])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        return {
            **super().to_dict(),
            "records": [fit.to_dict() for fit in self.fits],
            "alone": [fit.to_dict() for fit in self.alone],
        }


@dataclass(frozen=True, eq=False)
class DecayModes(DecayFits):
    """Modes of one record, in ascending order of frequency; a sequence of the results for each.

    The parameters are those of ``DecayFits``; no mode was fitted alone.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import fit_modes
    >>> time = np.linspace(0.0, 10.0, 2001)
    >>> y = 0.020 * np.exp(-0.1 * time) * np.cos(12.0 * time)
    >>> y += 0.005 * np.exp(-0.3 * time) * np.cos(60.0 * time)
    >>> modes = fit_modes(time, y + np.random.default_rng(0).normal(scale=1e-4, size=time.size), modes=2)
    >>> [f"{value:.2f} {modes.units[name]}" for name, value in modes.estimates.items() if "frequency" in name]
    ['1.91 Hz', '9.55 Hz']
    """

    kind = "decay modes"
    _drawing = "problems.decay.law_curve.modes_figure"

    @property
    def _shared(self) -> tuple[str, ...]:
        """Return no names: each mode has quantities of its own."""
        return ()

    def predict(self, record: Measurement) -> RecordPrediction:
        """Compute another decay with the estimates of all modes, as ``DecayFit.predict``."""
        return predict_decay(self.fit, self.fits[0].decay.modes, self.fits[0].residual_rms, record)

    @property
    def title(self) -> str:
        """The law."""
        return "Modes of the record under linear damping"

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the record, and those of single modes with the number and the frequency of the mode."""
        return _warnings([f"mode {k} ({fit.frequency:.4g} Hz)" for k, fit in enumerate(self.fits, start=1)], self.fits)

    def table(self) -> Table:
        """Return one row per mode with 95 % intervals, and the remarks that concern all."""
        first = self.fits[0]
        amplitude = "amplitude_m" if first.units["amplitude"] == "m" else "amplitude"
        columns = ("mode", "f_Hz", "f_low", "f_high", "damping_ratio", "low", "high", amplitude)
        rows = []
        for k, fit in enumerate(self, start=1):
            ends = fit.intervals()
            rows.append(
                (k, fit.frequency, *ends["frequency"], fit.damping_ratio, *ends["damping_ratio"], fit.amplitude)
            )
        notes = [
            "low and high are the ends of 95 % intervals",
            f"{first.samples} samples from {first.release_time:g} s on ({first.release_reason})",
            *([first.fitted_band] if first.fitted_band else []),
            f"the residuals have an rms of {first.residual_rms:.3g} {first.model.sensor.unit}".rstrip(),
        ]
        return Table("modes", self.title, columns, rows, notes)

    def report(self) -> str:
        """Return the table and the warnings as text."""
        return "\n".join([self.table().text(), *(f"  note: {text}" for text in self.warnings)])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        data = super().to_dict()
        del data["alone"]
        return {**data, "modes": data.pop("records")}


def _warnings(names: Sequence[str], fits: Sequence[DecayFit]) -> tuple[str, ...]:
    """Return the warnings of fits, those of all of them first, and the others with the name of the fit."""
    shared = [text for text in fits[0].warnings if all(text in fit.warnings for fit in fits)]
    pairs = [(name, text) for name, fit in zip(names, fits, strict=True) for text in fit.warnings]
    return (*shared, *(f"{name}: {text}" for name, text in pairs if text not in shared))
