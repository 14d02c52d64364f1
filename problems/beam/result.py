"""The result of a fit of a beam: law, beam, uncertainties, and what each block of measurements says of them."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw, ModalDamping
from ancf_casadi.damping.law import law_terms
from ancf_casadi.dynamics.derivatives.sensitivity import flowing, held_start, start_jacobians
from ancf_casadi.estimation.block import MESH_ORDER, Block
from ancf_casadi.estimation.determination import certainty
from ancf_casadi.estimation.prediction import RecordPrediction
from ancf_casadi.estimation.result import BlocksResult
from ancf_casadi.exceptions import AncfError, InputError
from ancf_casadi.mechanics.lumped import PROPERTY_POWERS, changed_properties, property_unit
from ancf_casadi.mechanics.mesh_limits import bend_advice, bends_allowed
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance
from ancf_casadi.support.tables import Table, finite_or_none
from ancf_casadi.vibration.modes import natural_modes
from problems.beam.curves.block import CurveBlock, curve_block
from problems.beam.curves.record import ResponseRecord
from problems.beam.motions.block import MotionBlock, motion_block, sensor_noise
from problems.beam.motions.marker_record import motion_record
from problems.beam.motions.weights import ACCURATE
from problems.beam.properties import (
    CLAMP_STIFFNESS,
    SAME_PROPERTY,
    property_owners,
    property_value,
    scaled_model,
    with_clamp_stiffness,
)
from problems.beam.unknowns import frequency_name, load_name, loads
from problems.beam.values.records import PropertyRecord, ValueBlock

MOST_MESH_SHIFT = 0.3  # of an estimate, in standard errors: a 95 % interval then covers the truth in 94 %


@dataclass(frozen=True, eq=False)
class BeamFit(BlocksResult):
    """A damping law, and properties of a beam, estimated from any mix of measurements.

    Parameters
    ----------
    solution : FitSolution
        The blocks of measurements, the estimates, and what the fit found out about them.
    given : Model
        The beam with the first values of its properties.
    guess : DampingLaw
        The law with the first values of its parameters; a sum of no laws if there is none.
    first : mapping
        First values of the unknown properties by name, SI units.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, simulate
    >>> from problems import MarkerRecord, fit_beam
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model, base = Model(beam), HarmonicBase(amplitude=5e-3, frequency=1.9)
    >>> true, guess = RayleighDamping(alpha=0.5), RayleighDamping(alpha=0.2)
    >>> run = simulate(model, damping=true, base=base, duration=0.25, sample_rate=50.0)
    >>> fit = fit_beam(model, MarkerRecord(run.time, run.tip, base=base), guess)
    >>> type(fit.law).__name__, round(fit.law.alpha, 2), fit.units
    ('RayleighDamping', 0.5, {'alpha': '1/s'})
    >>> [channel.size for channel in fit.residuals]  # x and y of the tip
    [13, 13]
    """

    kind = "beam"
    _drawing = "ancf_casadi.figures.fits.channels_figure"

    given: Model
    guess: DampingLaw
    first: Mapping[str, float]

    @property
    def law(self) -> DampingLaw:
        """The law with the estimated parameters."""
        return self.guess.with_parameters(
            [self.estimates.get(parameter.name, parameter.value) for parameter in self.guess.parameters]
        )

    @cached_property
    def model(self) -> Model:
        """The beam with the estimated properties."""
        return self.configured(self.given)

    def configured(self, model: Model) -> Model:
        """Return the beam in another configuration with the estimated properties.

        Raises
        ------
        InputError
            If ``model`` is not a model, or is of another beam.
        """
        check_instance(model, "model", Model)
        started_model = self._start_model(model)
        return scaled_model(started_model, property_owners(started_model.beam, tuple(self.first)), self._factors)

    @property
    def _factors(self) -> Array:
        """Estimated over first values of the unknown properties."""
        return np.array([self.estimates[name] / value for name, value in self.first.items()])

    def _start_model(self, model: Model) -> Model:
        """Return a model with the first stiffness of the clamp, if that is unknown and the clamp of the model rigid.

        Refuse a model in which an unknown property has another value than at the start of the fit.
        """
        if CLAMP_STIFFNESS in self.first:
            model = with_clamp_stiffness(model, self.first[CLAMP_STIFFNESS])
        for name, first in self.first.items():
            value = property_value(model.beam, name)
            if value and abs(value - first) > SAME_PROPERTY * abs(first):
                raise InputError(
                    f"is {value:g} {property_unit(name)} in this model; it is an unknown of the fit, which began at "
                    f"{first:g}",
                    name,
                )
        return model

    @property
    def combinations(self) -> dict[str, tuple[float, float]]:
        """Bending stiffness and mass per length with their standard errors, if an unknown changes them."""
        combinations = {}
        for name, powers in PROPERTY_POWERS.items():
            exponents = {
                unknown: sum(powers[changed] for changed in changed_properties(unknown))
                for unknown in self.first
                if set(changed_properties(unknown)) <= set(powers)
            }
            if name in self.first or not exponents or any("[" in unknown for unknown in exponents):
                continue

            def ratio(*x: cs.MX, exponents: Mapping[str, int] = exponents) -> cs.MX:
                values = dict(zip(self.fit.names, x, strict=True))
                factors = [(values[unknown] / self.first[unknown]) ** power for unknown, power in exponents.items()]
                return cs.vertcat(cs.mtimes([cs.MX(1.0), *factors]))

            value, error = (float(output[0]) for output in self.fit.derived(ratio))
            first = property_value(self.given.beam, name)
            combinations[name] = first * value, first * error
        return combinations

    def _ends(self, level: float) -> Array:
        """Return the intervals, over all optima that fit, and over the estimate without the error of the mesh."""
        fit, shifts = self.fit, self.solution.mesh_shifts
        moved = []
        if np.nanmax([*np.abs(shifts), 0.0]) > MOST_MESH_SHIFT:
            change = np.nan_to_num(shifts * fit.errors)
            moved = [replace(fit, values=np.clip(fit.values + change, fit.lower, fit.upper))]
        ends = np.array([fit.intervals(level) for fit in (self.fit, *self.solution.other_optima, *moved)])
        return np.stack([np.fmin.reduce(ends[:, :, 0]), np.fmax.reduce(ends[:, :, 1])], axis=1)

    @property
    def residuals(self) -> list[Array]:
        """Computed less measured readings of each channel of the motions, in the unit of the sensor."""
        fitted_blocks = self.solution.fitted_blocks
        motions = [(block, fitted) for block, fitted in fitted_blocks if isinstance(block, MotionBlock)]
        return [residuals for block, fitted in motions for residuals in block.weights.split(fitted.residuals)]

    @property
    def shifts(self) -> Array:
        """Largest shift (n,) of each estimate by the error of a discretisation, in standard errors; nan if unknown."""
        return np.asarray(np.abs(self.solution.shifts).max(axis=0))

    @cached_property
    def mesh_shifts(self) -> dict[str, float]:
        """Shift of each estimate by a mesh without error, by name, in standard errors; nan if unknown."""
        shifts = self.solution.mesh_shifts * np.sign(self.fit.coordinates.slopes(self.fit.values))
        return dict(zip(self.fit.names, shifts.tolist(), strict=True))

    @cached_property
    def _mesh_warnings(self) -> list[str]:
        """Limitations by the mesh: elements that bend too far, and estimates that depend on the size of elements."""
        bend = 0.0
        for block in self.solution.problem.blocks:
            with bends_allowed(), contextlib.suppress(AncfError):  # none is found again from the straight beam
                bend = np.fmax(bend, block.largest_bend(self.estimates))
        self.solution.problem.close()
        notes = [bend_advice(self.given, float(bend))]
        name, shift = max(self.mesh_shifts.items(), key=lambda pair: np.nan_to_num(abs(pair[1])))
        if abs(shift) > MOST_MESH_SHIFT:
            elements = self.given.beam.elements
            needed = math.ceil(elements * (abs(shift) / MOST_MESH_SHIFT) ** (1 / MESH_ORDER))
            notes.append(
                f"the mesh of {elements} elements shifts {name} by {-shift:+.2g} standard errors, and the intervals "
                f"cover this; use {needed} elements or more"
            )
        return [*filter(None, notes)]

    @cached_property
    def _ratio_warnings(self) -> list[str]:
        """Modal damping ratios that the modes of the fitted beam do not have, because their frequencies differ."""
        notes: list[str] = []
        for law in [term for term in law_terms(self.law) if isinstance(term, ModalDamping)]:
            # the beam may be unstable under gravity alone; that its modes differ from those of the law is said here
            with contextlib.suppress(AncfError), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                modes = natural_modes(self.model, count=len(law.ratios))
                factors = np.array([self.estimates.get(frequency_name(k), 1.0) for k in range(modes.count)])
                ratios = law.damping_ratios(modes, np.zeros(modes.count)) / factors
                of_modes = zip(law.parameters, law.frequencies or (), modes.frequencies * factors, ratios, strict=True)
                notes += [
                    f"{parameter.name} refers to {stated:.4g} Hz, the frequency in the law; in the fitted beam the "
                    f"mode has {frequency:.4g} Hz and the damping ratio {ratio:.4g}"
                    for parameter, stated, frequency, ratio in of_modes
                    if abs(ratio - parameter.value) > self.standard_errors.get(parameter.name, math.inf)
                ]
        return notes

    @property
    def scatter(self) -> float:
        """Standard deviation of the residuals: in standard deviations, or relative for values that have none."""
        residuals, freedom = self.fit.residuals / self.solution.problem.scale, self.fit.degrees_of_freedom
        return math.sqrt(float(np.sum(residuals**2)) / freedom) if freedom else math.nan

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the estimates, one sentence each."""
        fit, notes = self.fit, [self._rigid(note) for note in super().warnings]
        notes += self._mesh_warnings + self._ratio_warnings
        blocks = [block for block in self.solution.problem.blocks if isinstance(block, MotionBlock | CurveBlock)]
        notes += dict.fromkeys(note for block in blocks for _, record in block.numbered for note in record.notes)
        for optimum in self.solution.other_optima:
            named = [
                f"{name} {value:.4g} {unit}"
                for (name, value), unit in zip(optimum.estimates.items(), fit.units, strict=True)
            ]
            notes.append(
                f"{', '.join(named)} fits as well; the intervals cover both optima. Fix one of the unknowns, or add a "
                "record that separates them"
            )
        if not fit.noise.freedom or not fit.degrees_of_freedom:
            notes.append(
                "there are no more values than unknowns, so the residuals cannot show the uncertainty; measure more"
            )
        notes += [
            f"the records do not determine {name}: the relative standard error of this product of powers is {error:.2g}"
            for name, error in self._products
            if error > 1.0  # relative standard error from which the data leave a product of properties open
        ]
        return tuple(notes)

    def _rigid(self, note: str) -> str:
        """Return a note; another one if it says that the clamp is as stiff as its upper bound."""
        if not note.startswith(f"{CLAMP_STIFFNESS} is at its bound") or math.isnan(
            self.intervals()[CLAMP_STIFFNESS][0]
        ):
            return note
        k = self.fit.names.index(CLAMP_STIFFNESS)
        if self.fit.values[k] != self.fit.lower[k]:
            return note
        return (
            "the records show no compliance of the clamp: its stiffness is above "
            f"{self.intervals()[CLAMP_STIFFNESS][0]:.3g} N m/rad (95 %), and the other standard errors take it as rigid"
        )

    @cached_property
    def _products(self) -> list[tuple[str, float]]:
        """Products of powers of the unknown properties and their relative standard errors."""
        return certainty(self.fit, tuple(self.first)) if len(self.first) > 1 else []

    def start(self, record: int = 0) -> State:
        """Return the estimated state at the start of a motion, ``record`` from 0 among those of the fit.

        Raises
        ------
        InputError
            If no load of this record was estimated.
        """
        blocks = [block for block in self.solution.problem.blocks if isinstance(block, MotionBlock) and block.load]
        motions = [(block, motion) for block in blocks for number, motion in block.numbered if number == record + 1]
        if not motions:
            raise InputError("was not estimated; name components, as start_force_x, among the unknowns", "start")
        ((block, motion),) = motions
        estimates = self.estimates
        load = [estimates.get(load_name(name, record + 1), value) for name, value in loads(motion)]
        model = self.configured(block.model)
        law = flowing(self.law, model, motion.start)
        return held_start(model, start_jacobians(model, law=law), np.array(load), law=law)[0]

    def predict(self, record: Any) -> RecordPrediction:
        """Compute another record of the same beam with the estimates, without fitting, and compare.

        Base motion, start, sensors and configuration (``model``) are those of the record.  Release, offsets and the
        view of a camera that are unknown have the middle of their bounds; the origin of a displacement makes its mean
        error zero.  A point of a response curve is predicted on the branch that its amplitude is nearest to.

        Parameters
        ----------
        record : record
            The measurements, of any kind that ``fit_beam`` takes.

        Raises
        ------
        InputError
            If it is of another kind, or a sensor is not on the beam.
        EquilibriumError, FitError
            If its values cannot be computed.

        Examples
        --------
        >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, simulate
        >>> from problems import MarkerRecord, fit_beam
        >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
        ...                     density=8000.0, elastic_modulus=210e9, elements=4)
        >>> model, true, records = Model(beam), RayleighDamping(alpha=0.5), []
        >>> for amplitude in (5e-3, 8e-3):
        ...     base = HarmonicBase(amplitude=amplitude, frequency=1.9)
        ...     run = simulate(model, damping=true, base=base, duration=0.25, sample_rate=50.0)
        ...     records.append(MarkerRecord(run.time, run.tip, base=base))
        >>> prediction = fit_beam(model, records[0], RayleighDamping(alpha=0.2)).predict(records[1])
        >>> max(prediction.relative_errors.values()) < 1e-3
        True
        """
        return self._record_block(record).predict_record(self.fit, self.kind)

    def _record_block(self, record: Any) -> Block:
        """Return another record as a block; none of the unknowns belongs to it alone."""
        blocks, none = self.solution.problem.blocks, 0
        if isinstance(record, PropertyRecord):
            return ValueBlock(record.with_model(self._start_model(record.model)), self.first)
        other_record = record if isinstance(record, ResponseRecord) else motion_record(record)
        model = self._start_model(other_record.model or self.given)
        if isinstance(other_record, ResponseRecord):
            curves = [block for block in blocks if isinstance(block, CurveBlock)]
            modes, harmonics = max(((block.modes, block.harmonics) for block in curves), default=(3, 5))
            names, law = self.fit.names, self.guess
            return curve_block(model, [(none, other_record)], law, names, self.first, modes=modes, harmonics=harmonics)
        motions = [block for block in blocks if isinstance(block, MotionBlock)]
        tolerance = min([ACCURATE, *(block.tolerance for block in motions)])
        block = motion_block(model, [(none, other_record)], self.guess, self.first, tolerance=tolerance)
        # the noise of the same sensor in the fit is more certain than that from a few samples
        noise, pairs = sensor_noise(blocks), zip(block.sensors, block.weights.deviations.tolist(), strict=True)
        deviations = [channel.std or noise.get(channel.sensor, deviation) for channel, deviation in pairs]
        return replace(block, weights=replace(block.weights, deviations=np.array(deviations)))

    def table(self) -> Table:
        """Return the estimates with units, standard errors and 95 % intervals; notes say what each record shows."""
        table = super().table()
        notes = [
            *table.notes,
            *(
                f"{name} {value:.5g} {property_unit(name)}, standard error {error:.2g}"
                for name, (value, error) in self.combinations.items()
            ),
            *(f"{name}: relative standard error {error:.2g}" for name, error in self._products),
            self._mesh_line,
        ]
        return replace(table, notes=notes)

    @property
    def _mesh_line(self) -> str:
        """The effect of the mesh on the estimates."""
        elements, worst = self.given.beam.elements, float(np.fmax.reduce(np.abs([*self.mesh_shifts.values()])))
        if math.isnan(worst):
            return (
                f"the effect of the mesh of {elements} elements on the estimates is unknown: a finer one has no "
                "solution, or explains the records worse, as if they were simulated on this mesh"
            )
        return f"the mesh of {elements} elements shifts no estimate by more than {worst:.2g} standard errors"

    @property
    def title(self) -> str:
        """The law and the beam."""
        return law_name(self.guess) if self.guess.parameters else "beam"

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON: SI units, None for unknown values."""
        return {
            **super().to_dict(),
            "law": law_name(self.guess),
            "first": {name: {"value": value, "unit": property_unit(name)} for name, value in self.first.items()},
            "combinations": {
                name: {"value": value, "unit": property_unit(name), "standard_error": finite_or_none(error)}
                for name, (value, error) in self.combinations.items()
            },
            "products": [{"product": name, "relative_error": finite_or_none(error)} for name, error in self._products],
            "scatter": finite_or_none(self.scatter),
            "mesh_shifts": {name: finite_or_none(shift) for name, shift in self.mesh_shifts.items()},
        }


def law_name(law: DampingLaw) -> str:
    """Return the name of a law with those of its parameters."""
    return " + ".join(
        f"{type(term).__name__}({', '.join(parameter.name for parameter in term.parameters)})"
        for term in law_terms(law)
    )
