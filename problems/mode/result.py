"""The result of a fit of one mode: its laws, modal constants and uncertainties."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.decay.envelope import LawCurve
from ancf_casadi.estimation.agreement import Agreement
from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, Quantities
from ancf_casadi.estimation.intervals import derived_intervals
from ancf_casadi.estimation.prediction import RecordPrediction
from ancf_casadi.estimation.result import BlocksResult
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance
from ancf_casadi.support.tables import Table
from problems.beam.curves.checks import orient
from problems.beam.curves.record import BASE_MOTIONS, ResponseRecord
from problems.decay.free_decay import DecayMode
from problems.decay.law_curve import check_amplitudes, curve_with_bands
from problems.decay.laws import DECAY_QUANTITIES, DecayModel
from problems.decay.prediction import predict_decay
from problems.decay.takes import RELEASE_QUANTITIES
from problems.mode.curve_block import ModeCurveBlock, mode_curve_block
from problems.mode.oscillator import reading_factor

MODE_QUANTITIES = tuple(name for name in DECAY_QUANTITIES if name not in RELEASE_QUANTITIES)
USUAL_PARTICIPATION = (0.05, 20.0)  # range of the participation of a mode; beyond, check the unit of the levels


@dataclass(frozen=True, eq=False)
class ModeFit(BlocksResult):
    """A mode identified from free decays and response curves.

    The estimates are those of ``DecayFit``, with frequency and damping ratio at ``max_amplitude`` if they depend on the
    amplitude, and ``modal_constant``: force per mass and unit level.  If levels have several units, its names are
    numbered, one for each unit, in the order of the records.

    Parameters
    ----------
    solution : FitSolution
        Blocks of the records with their weights.
    model : DecayModel
        Laws of the mode.
    given : DecayModel
        Laws and equilibrium as they were requested.
    law_names : tuple of str
        Unknowns of the laws.
    min_amplitude, max_amplitude : float
        Smallest and largest amplitude of the records, in the unit of the motion.
    notes : tuple of str
        Corrections of phases, and doubts about levels.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import ResponseRecord, fit_mode
    >>> f, rng = np.linspace(9.5, 10.5, 41), np.random.default_rng(0)
    >>> y = 1e-4 / (10.0**2 - f**2 + 0.2j * f) * (1 + 0.01 * rng.standard_normal((2, 41)).T @ [1, 1j])
    >>> fit = fit_mode(ResponseRecord(f, y, excitation_unit="V"))
    >>> low, high = fit.intervals()["damping_ratio"]
    >>> bool(low < 0.01 < high)
    True
    """

    kind = "mode"
    _drawing = "problems.mode.drawing.mode_figure"

    model: DecayModel
    given: DecayModel
    law_names: tuple[str, ...]
    min_amplitude: float
    max_amplitude: float
    notes: tuple[str, ...] = ()

    @cached_property
    def _law_positions(self) -> tuple[int, ...]:
        """Positions of the unknowns of the laws."""
        return tuple(self.fit.names.index(name) for name in self.law_names)

    @cached_property
    def quantities(self) -> tuple[tuple[str, ...], tuple[str, ...], Quantities]:
        """Names and units of the quantities, and the function from the unknowns to them."""
        further = [k for k in range(len(self.fit.names)) if k not in self._law_positions]
        names = (*MODE_QUANTITIES, *(_report_name(self.fit.names[k]) for k in further))
        units = (*map(self.model.unit, MODE_QUANTITIES), *(self.fit.units[k] for k in further))
        positions = [list(DECAY_QUANTITIES).index(name) for name in MODE_QUANTITIES]
        model = replace(self.model, lowest=self.min_amplitude)

        def quantities(*x: cs.MX) -> cs.MX:
            law = [x[k] for k in self._law_positions]
            decay_quantities = model.quantities(*law, cs.MX(self.max_amplitude), cs.MX(0))
            return cs.vertcat(decay_quantities[positions], *(x[k] for k in further))

        return names, units, quantities

    @property
    def frequency(self) -> float:
        """Natural frequency, Hz, at the amplitude ``max_amplitude`` if it depends on the amplitude."""
        return self.estimates["frequency"]

    @property
    def damping_ratio(self) -> float:
        """Damping ratio, at the amplitude ``max_amplitude`` if it depends on the amplitude."""
        return self.estimates["damping_ratio"]

    def _ends(self, level: float) -> Array:
        """Return the intervals (q, 2) of all quantities within their bounds."""
        names, bounds = self.quantities[0], self.model.bounds
        unknowns = dict(
            zip((_report_name(unknown.name) for unknown in self.fit.unknowns), self.fit.unknowns, strict=True)
        )
        limits = [bounds[name] if name in bounds else (unknowns[name].lower, unknowns[name].upper) for name in names]
        lower, upper = np.array(limits).T[:, :, None]
        return np.clip(derived_intervals(self.fit, self.quantities[2], level), lower, upper)

    def law_curve(self, amplitudes: ArrayLike | None = None, *, level: float = CONFIDENCE_LEVEL) -> LawCurve:
        """Return damping ratio and frequency against amplitude (k,), with the bands of their intervals.

        Amplitudes are in the unit of the motion; those between the smallest and the largest measured one if not given.

        Raises
        ------
        InputError
            If an amplitude is not positive, or the level is not between 0 and 1.
        """
        if amplitudes is None:
            amplitudes = np.geomspace(self.min_amplitude, self.max_amplitude, 60)
        amplitudes = check_amplitudes(amplitudes)

        def laws(*x: cs.MX) -> tuple[cs.MX, cs.MX]:
            return self.model.against_amplitude(amplitudes, *(x[k] for k in self._law_positions), cs.MX(1), cs.MX(0))

        return curve_with_bands(self.fit, laws, amplitudes, level, self.model.unit("amplitude"))

    @cached_property
    def agreements(self) -> tuple[Agreement, ...]:
        """Agreement of the records, to first order, on each unknown that several determine; empty for one record."""
        return tuple(self._convert_agreement(agreement) for agreement in super().agreements)

    def _convert_agreement(self, agreement: Agreement) -> Agreement:
        """Convert an agreement on an unknown to the quantity that reports print in its place."""
        name, unit, factor = self.fit.unknowns[self.fit.names.index(agreement.name)].report
        return replace(
            agreement, name=name, unit=unit, values=agreement.values * factor, errors=agreement.errors * factor
        )

    @cached_property
    def curve_block(self) -> ModeCurveBlock | None:
        """The response curves; None without any."""
        return next((block for block in self.solution.problem.blocks if isinstance(block, ModeCurveBlock)), None)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Corrections of the records, and limitations of the estimates, one sentence each."""
        notes = [*self.notes, *super().warnings]
        low, high = USUAL_PARTICIPATION
        block = self.curve_block
        if block is None or self.model.unit("amplitude") != "m":
            return tuple(notes)
        constants = {**block.given_constants, **self.fit.estimates}
        for record, name in zip(block.records, block.constants, strict=True):
            value = constants[name]
            if record.excitation_unit in BASE_MOTIONS and not low < value < high:
                notes.append(
                    f"{name} is {value:.3g}; that of a mode driven by its base is of the order of 1: check the units "
                    "of the levels and of the sensor"
                )
        return tuple(dict.fromkeys(notes))

    def predict(self, record: Any) -> RecordPrediction:
        """Compute another record of the mode with its estimates, and compare.

        The release and the equilibrium of a decay are fitted.  A point of a response curve is predicted on the branch
        that its amplitude is nearest to; its levels have a unit that the fit has.

        Raises
        ------
        InputError
            If the record is not usable, or the fit does not have its kind of levels.
        FitError
            If its values cannot be computed.
        """
        check_instance(record, "record", Measurement, ResponseRecord)
        if isinstance(record, Measurement):
            model = replace(self.given, reference=self.model.reference, sensor=record.sensor)
            noise = [float(np.mean(channel.noise)) for channel in self.channels if channel.unit == record.sensor.unit]
            return predict_decay(self.fit, [DecayMode(model, self.law_names)], noise[0] if noise else math.nan, record)
        block = self.curve_block
        pairs = zip(block.records, block.constants, strict=True) if block else ()
        names = {str(curve.excitation_unit): name for curve, name in pairs}
        if block is None or record.excitation_unit not in names:
            has = f"levels in {', '.join(names)}" if names else "no levels"
            raise InputError(
                f"has levels in {record.excitation_unit or 'parts of a load'}; the fit has {has}", "record"
            )
        oriented_record, note = orient(record, float(np.angle(reading_factor(record)[0])))
        given_constant = block.given_constants.get(names[record.excitation_unit])
        prediction_block = mode_curve_block(self.model, [oriented_record], block.law_names, names, given_constant)
        prediction = prediction_block.predict_record(self.fit, self.kind)
        return replace(prediction, notes=(*prediction.notes, *([note] if note else [])))

    @property
    def title(self) -> str:
        """The laws."""
        return f"mode with {self.model.law} damping, {self.model.frequency_law} frequency"

    def table(self) -> Table:
        """Return the estimates; notes say what each record shows, and the laws at the ends of the amplitudes."""
        table = super().table()
        if not self.model.depends_on_amplitude:
            return table
        return replace(table, notes=[*table.notes, *self.law_curve([self.min_amplitude, self.max_amplitude]).lines()])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON: SI units, None for unknown values."""
        return {
            **super().to_dict(),
            "law": self.model.law,
            "frequency_law": self.model.frequency_law,
            "smallest_amplitude": self.min_amplitude,
            "largest_amplitude": self.max_amplitude,
            "against_amplitude": self.law_curve().to_dict(),
        }


def _report_name(name: str) -> str:
    """Return the name of an unknown in reports: the amplitude of a release in place of e0."""
    return name.replace("e0_", "amplitude_") if name.startswith("e0_") else name
