"""The result of a fit of one mode: its laws, modal constants, and what decays and response curves say of them."""

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
from ancf_casadi.estimation.intervals import CONFIDENCE_LEVEL, Quantities
from ancf_casadi.estimation.prediction import RecordPrediction
from ancf_casadi.estimation.result import BlocksResult
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance
from ancf_casadi.support.tables import Table
from problems.beam.curves.checks import oriented
from problems.beam.curves.record import BASE_MOTIONS, ResponseRecord
from problems.decay.law_curve import check_amplitudes, curve_with_bands
from problems.decay.laws import DECAY_QUANTITIES, DecayModel
from problems.decay.prediction import predict_decay
from problems.decay.takes import RELEASE_QUANTITIES
from problems.mode.decays import ModeCurveBlock, curves_of_mode
from problems.mode.oscillator import reading_factor

OF_MODE = tuple(name for name in DECAY_QUANTITIES if name not in RELEASE_QUANTITIES)
USUAL_PARTICIPATION = (0.05, 20.0)  # of a mode that its base drives; beyond, the unit of the levels is in doubt


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
    def _laws(self) -> tuple[int, ...]:
        """Positions of the unknowns of the laws."""
        return tuple(self.fit.names.index(name) for name in self.law_names)

    @cached_property
    def quantities(self) -> tuple[tuple[str, ...], tuple[str, ...], Quantities]:
        """Names and units of the quantities, and the function from the unknowns to them."""
        others = [k for k in range(len(self.fit.names)) if k not in self._laws]
        names = (*OF_MODE, *(_renamed(self.fit.names[k]) for k in others))
        units = (*map(self.model.unit, OF_MODE), *(self.fit.units[k] for k in others))
        order = list(DECAY_QUANTITIES)
        kept = [order.index(name) for name in OF_MODE]

        model = replace(self.model, lowest=self.min_amplitude)

        def of(*x: cs.MX) -> cs.MX:
            law = [x[k] for k in self._laws]
            every = model.quantities(*law, cs.MX(self.max_amplitude), cs.MX(0))
            return cs.vertcat(every[kept], *(x[k] for k in others))

        return names, units, of

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
        own = dict(zip((_renamed(one.name) for one in self.fit.unknowns), self.fit.unknowns, strict=True))
        limits = [bounds[n] if n in bounds else (own[n].lower, own[n].upper) for n in names]
        lower, upper = np.array(limits).T[:, :, None]
        return np.clip(self.fit.derived_intervals(self.quantities[2], level), lower, upper)

    def law_curve(self, amplitudes: ArrayLike | None = None, *, level: float = CONFIDENCE_LEVEL) -> LawCurve:
        """Return damping ratio and frequency against amplitude (k,), with the bands of their intervals.

        Amplitudes are in the unit of the motion; those between the smallest and the largest measured one if not given.

        Raises
        ------
        InputError
            If an amplitude is not positive, or the level is not between 0 and 1.
        """
        given = np.geomspace(self.min_amplitude, self.max_amplitude, 60) if amplitudes is None else amplitudes
        chosen = check_amplitudes(given)

        def against(*x: cs.MX) -> tuple[cs.MX, cs.MX]:
            return self.model.against_amplitude(chosen, *(x[k] for k in self._laws), cs.MX(1), cs.MX(0))

        return curve_with_bands(self.fit, against, chosen, level, self.model.unit("amplitude"))

    @cached_property
    def agreements(self) -> tuple[Agreement, ...]:
        """Agreement of the records, to first order, on each unknown that several determine; empty for one record."""
        return tuple(self._reported(one) for one in super().agreements)

    def _reported(self, one: Agreement) -> Agreement:
        """Return an agreement on an unknown as one on the quantity that reports print in its place."""
        name, unit, factor = self.fit.unknowns[self.fit.names.index(one.name)].report
        return replace(one, name=name, unit=unit, values=one.values * factor, errors=one.errors * factor)

    @cached_property
    def curve_block(self) -> ModeCurveBlock | None:
        """The response curves; None without any."""
        found = [block for block in self.solution.problem.blocks if isinstance(block, ModeCurveBlock)]
        return found[0] if found else None

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Corrections of the records, and limitations of the estimates, one sentence each."""
        notes = [*self.notes, *super().warnings]
        low, high = USUAL_PARTICIPATION
        block = self.curve_block
        for record, name in zip(block.records, block.constants, strict=True) if block else ():
            value = self.fit.estimates.get(name, block.known.get(name, 1.0) if block else 1.0)
            if (
                record.excitation_unit in BASE_MOTIONS
                and self.model.unit("amplitude") == "m"
                and not low < value < high
            ):
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
            noise = [float(np.mean(one.noise)) for one in self.channels if one.unit == record.sensor.unit]
            return predict_decay(self.fit, [(model, self._laws)], noise[0] if noise else math.nan, record)
        block = self.curve_block
        pairs = zip(block.records, block.constants, strict=True) if block else ()
        names = {str(one.excitation_unit): name for one, name in pairs}
        if block is None or record.excitation_unit not in names:
            has = f"levels in {', '.join(names)}" if names else "no levels"
            raise InputError(
                f"has levels in {record.excitation_unit or 'parts of a load'}; the fit has {has}", "record"
            )
        turned, note = oriented(record, float(np.angle(reading_factor(record)[0])))
        own = curves_of_mode(self.model, [turned], block.law_names, names, None)
        own = replace(own, known=block.known, names=tuple(name for name in own.names if name in self.fit.names))
        found = own.predicted(self.fit, self.kind)
        return replace(found, notes=(*found.notes, *([note] if note else [])))

    @property
    def title(self) -> str:
        """The laws."""
        return f"mode with {self.model.law} damping, {self.model.frequency_law} frequency"

    def table(self) -> Table:
        """Return the estimates; notes say what each record shows, and the laws at the ends of the amplitudes."""
        own = super().table()
        return replace(own, notes=[*own.notes, *self._law_lines()])

    def _law_lines(self) -> list[str]:
        """Return frequency and damping ratio at the smallest and the largest measured amplitude, if they differ."""
        if not self.model.depends_on_amplitude:
            return []
        return self.law_curve([self.min_amplitude, self.max_amplitude]).lines()

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


def _renamed(name: str) -> str:
    """Return the name of a quantity of a release in reports."""
    return name.replace("e0_", "amplitude_") if name.startswith("e0_") else name
