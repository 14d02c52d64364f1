"""Measurements that determine properties of a beam, load-deflection tables and natural frequencies, and their block.

A record holds the configuration in which it was measured, as a model: free length, orientation, gravity, supports,
attachments.  Its residuals, each a series of its own, are

    (computed - measured)/standard deviation,    or    computed/measured - 1

if no standard deviation is given.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, Self

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.estimation.block import Account, Block, Computed, Fitted
from ancf_casadi.estimation.prediction import PredictedChannel
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.loads import PointLoad
from ancf_casadi.mechanics.mesh_limits import bends_allowed, largest_bend
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.sensor import SENSOR_UNITS, Sensor
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.callbacks import Differentiable
from ancf_casadi.support.inputs import (
    array,
    check_instance,
    error_prefix,
    flag,
    instances,
    is_sequence,
    physical,
    positive_array,
    shown,
    whole,
)
from ancf_casadi.support.tables import Displayed
from ancf_casadi.vibration.modes import natural_modes, rigid_modes, unit_warning
from ancf_casadi.vibration.statics import stable_position
from problems.beam.mesh import split_model
from problems.beam.properties import property_owners, scaled_model
from problems.beam.values.response import Respond, modal_response, place, readings, static_response

ACCURACY = 1e-6  # relative accuracy of computed values; in standard deviations if these are given


class PropertyRecord(Displayed, ABC):
    """Measured values that depend on the properties of a beam at rest or in small vibration."""

    axis: ClassVar[str]  # of a figure

    model: Model
    name: str
    std: Any

    @property
    @abstractmethod
    def _all(self) -> Array:
        """All values, SI units, nan where one is not measured."""

    @property
    @abstractmethod
    def _described(self) -> list[tuple[str, str, float]]:
        """Description, quantity, and place on the axis of a figure, of each measured value."""

    @cached_property
    def present(self) -> Index:
        """Indices of the measured values among all values, (m,)."""
        return np.flatnonzero(np.isfinite(self._all))

    @cached_property
    def measured(self) -> Array:
        """The measured values, SI units, (m,)."""
        return np.asarray(self._all[self.present])

    @cached_property
    def stds(self) -> Array | None:
        """Standard deviations of the values, (m,); None if none are given."""
        return None if self.std is None else np.asarray(np.ravel(self.std)[self.present])

    @property
    def labels(self) -> tuple[str, ...]:
        """Description of each value, (m,)."""
        return tuple(label for label, _, _ in self._described)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Quantity of each value, (m,)."""
        return tuple(quantity for _, quantity, _ in self._described)

    @property
    def places(self) -> Array:
        """Place of each value on the axis of a figure, (m,)."""
        return np.array([place for _, _, place in self._described])

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of each value, (m,)."""
        units: Mapping[Any, str] = SENSOR_UNITS
        return tuple(units.get(quantity, "Hz") for quantity in self.quantities)

    @abstractmethod
    def response(self, owners: Index) -> Respond:
        """Return the function from factors on the properties to the computed values (m,) and their Jacobian (m, p)."""

    @property
    def cases(self) -> tuple[tuple[PointLoad, ...], ...]:
        """Loads of each equilibrium that was measured; without loads if it is the beam at rest."""
        return ((),)

    @property
    def doubt(self) -> str:
        """Reason to doubt the measured values beside those of the model; empty if there is none."""
        return ""

    def with_model(self, model: Model) -> Self:
        """Return the record with another model."""
        return replace(self, model=model)  # type: ignore[type-var]

    @property
    def scatter(self) -> Array:
        """Divisors of the residuals: the standard deviations, or the measured values if none are given, (m,)."""
        return np.abs(self.measured) if self.stds is None else self.stds


@dataclass(frozen=True, eq=False)
class StaticRecord(PropertyRecord):
    """Readings of sensors on a beam at rest under loads.

    Parameters
    ----------
    model : Model
        The beam in the configuration of the test; its gravity acts.
    loads : sequence of PointLoad, or of sequences of PointLoad
        The load, or loads, of each of c cases; an empty sequence for none.
    values : array_like (c,) or (c, k)
        Readings in each case of one sensor, or of k; nan if not measured.  A displacement is the change from rest
        without the loads.
    sensors : Sensor or sequence of Sensor
        The sensors, in the order of the columns.  At rest they read position, displacement, slope, strain, force or
        moment.
    std : float or array_like, optional
        Standard deviation of the readings: one for all, one per sensor (k,), or one for each value.
    tared : bool
        Whether all sensors, not only those of displacement, read zero without the loads.
    name : str
        Name in reports.

    Raises
    ------
    InputError
        If sizes do not match, a value is infinite, none is measured, a standard deviation is not positive, a value is
        zero although no standard deviation is given, or a load or a sensor is not on the beam.

    Examples
    --------
    Tip deflections of a level strip under weights, and the modulus that explains them:

    >>> from ancf_casadi import Beam, Model, PointLoad, Sensor
    >>> from problems import StaticRecord, fit_beam
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> weights = [PointLoad.hung(mass, point=0.4) for mass in (1e-3, 2e-3, 4e-3)]  # kg
    >>> down = Sensor("displacement", direction=(0.0, -1.0))
    >>> level = Model(beam.with_(axis=(1.0, 0.0)))
    >>> record = StaticRecord(level, weights, [0.0210, 0.0405, 0.0753], down)
    >>> fit = fit_beam(level, record, unknowns=["elastic_modulus"])
    >>> print(f"{fit.estimates['elastic_modulus'] / 1e9:.0f} GPa")
    215 GPa
    """

    axis = "load, N"

    model: Model
    loads: Sequence[PointLoad | Sequence[PointLoad]]
    values: ArrayLike
    sensors: Sensor | Sequence[Sensor]
    std: ArrayLike | None = None
    tared: bool = False
    name: str = "static test"

    def __post_init__(self) -> None:
        """Validate, and keep arrays."""
        check_instance(self.model, "model", Model)
        check_instance(self.name, "name", str)
        flag(self.tared, "tared")
        sensors = (self.sensors,) if isinstance(self.sensors, Sensor) else instances(self.sensors, "sensors", Sensor)
        readings(self.model, sensors)
        loads = _cases(self.loads, self.model)
        values = array(self.values, "values", finite=False)
        deviation = _deviations(self.std, values)
        if values.ndim == 1:
            values, deviation = values[:, None], None if deviation is None else deviation[:, None]
        if values.shape != (len(loads), len(sensors)):
            raise InputError(
                f"must have the shape {(len(loads), len(sensors))}, one row per load case and one column per sensor, "
                f"got {values.shape}",
                "values",
            )
        for name, value in {"sensors": sensors, "loads": loads, "values": values}.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "std", deviation)

    @property
    def cases(self) -> tuple[tuple[PointLoad, ...], ...]:
        """The loads of each case."""
        return self.loads  # type: ignore[return-value]

    @property
    def columns(self) -> tuple[Sensor, ...]:
        """The sensor of each column of the values."""
        return self.sensors  # type: ignore[return-value]

    @property
    def _all(self) -> Array:
        return np.ravel(self.values)

    @property
    def _described(self) -> list[tuple[str, str, float]]:
        described: list[tuple[str, str, float]] = []  # the place is the size of the total force, N
        for number, case in enumerate(self.cases, start=1):
            size = float(np.hypot(*np.sum([(0.0, 0.0), *(load.force for load in case)], axis=0)))
            for sensor in self.columns:
                label = f"case {number}: {sensor.quantity} at {place(self.model, sensor):g} m"
                described.append((label, sensor.quantity, size))
        return [described[k] for k in self.present.tolist()]

    def response(self, owners: Index) -> Respond:
        """Return the function from factors on the properties to the computed values (m,) and their Jacobian (m, p)."""
        return static_response(self.model, self.cases, self.columns, self.tared, owners, self.present)


@dataclass(frozen=True, eq=False)
class FrequencyRecord(PropertyRecord):
    """Natural frequencies of a beam in one configuration.

    Parameters
    ----------
    model : Model
        The beam in the configuration of the test, with the masses and supports that it had; its gravity acts.
    frequencies : array_like (m,)
        Natural frequencies, Hz.
    std : float or array_like (m,), optional
        Standard deviation of the frequencies, Hz.
    modes : sequence of int, optional
        Numbers of the modes, from 1, ascending; if not given, the lowest that are no rigid motions.
    name : str
        Name in reports.

    Raises
    ------
    InputError
        If a frequency is not positive, the modes are not ascending or not as many as the frequencies, or a standard
        deviation is not positive.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model
    >>> from problems import FrequencyRecord
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> record = FrequencyRecord(Model(beam), [1.85, 10.4], std=[0.01, 0.05])
    >>> record.labels
    ('mode 1', 'mode 2')
    """

    axis = "mode"

    model: Model
    frequencies: ArrayLike
    std: ArrayLike | None = None
    modes: Sequence[int] | None = None
    name: str = "frequencies"

    def __post_init__(self) -> None:
        """Validate, and keep arrays."""
        check_instance(self.model, "model", Model)
        check_instance(self.name, "name", str)
        frequencies = array(self.frequencies, "frequencies")
        if frequencies.ndim != 1 or not frequencies.size:
            raise InputError("must be a sequence of frequencies", "frequencies")
        for value in frequencies.tolist():
            physical(value, "frequencies")
        mode_numbers = (
            rigid_modes(self.model) + np.arange(1, frequencies.size + 1) if self.modes is None else self.modes
        )
        if not is_sequence(mode_numbers):
            raise InputError(f"must be numbers of modes, got {shown(mode_numbers)}", "modes")
        modes = tuple(whole(k, "modes", 1, self.model.freedoms) for k in mode_numbers)
        if len(modes) != frequencies.size or any(b <= a for a, b in pairwise(modes)):
            raise InputError(f"must be {frequencies.size} ascending numbers, one per frequency, got {modes}", "modes")
        deviation = _deviations(self.std, frequencies)
        for name, value in {"frequencies": frequencies, "modes": modes, "std": deviation}.items():
            object.__setattr__(self, name, value)

    @property
    def _all(self) -> Array:
        return np.asarray(self.frequencies)

    @property
    def _described(self) -> list[tuple[str, str, float]]:
        return [(f"mode {k}", "frequency", float(k)) for k in self.modes or ()]

    def response(self, owners: Index) -> Respond:
        """Return the function from factors on the properties to the computed values (m,) and their Jacobian (m, p)."""
        return modal_response(self.model, np.array(self.modes) - 1, owners)

    @cached_property
    def doubt(self) -> str:
        """Doubt about the unit; empty if there is none."""
        numbers = np.array(self.modes)[self.present]
        with bends_allowed():
            modes = natural_modes(self.model, count=int(numbers.max()))
        return unit_warning(self.measured, modes.frequencies[numbers - 1])


def _cases(loads: object, model: Model) -> tuple[tuple[PointLoad, ...], ...]:
    """Return the loads of each case."""
    if not is_sequence(loads) or not len(loads):  # type: ignore[arg-type]
        raise InputError("must be a sequence with the load, or the loads, of each case", "loads")
    cases = []
    for case in loads:  # type: ignore[attr-defined]
        case_loads = (case,) if isinstance(case, PointLoad) else tuple(case) if is_sequence(case) else (case,)
        for load in case_loads:
            check_instance(load, "loads", PointLoad)
            with error_prefix("loads"):
                load.place(model.beam)
        cases.append(case_loads)
    return tuple(cases)


def _deviations(std: ArrayLike | None, values: Array) -> Array | None:
    """Return a standard deviation for each value; None if none is given."""
    present = np.isfinite(values)
    if not present.any() or np.isinf(values).any():
        raise InputError("must be finite, or nan if not measured, with at least one measured", "values")
    if std is None:
        if (values[present] == 0.0).any():
            raise InputError("is needed, because a value of 0 has no relative error", "std")
        return None
    return positive_array(std, "std", values.shape)


@dataclass(frozen=True, eq=False)
class ValueBlock(Block):
    """Measured values of a beam at rest or in small vibration."""

    record: PropertyRecord  # with the beam in the configuration of the test
    first: Mapping[str, float]  # first values of the unknown properties by name, SI units
    number: str = ""  # that tells the record apart from others of its name

    @property
    def title(self) -> str:
        """Name of the record, with the number and the length of the beam if others have this name."""
        return self.record.name + (f" {self.number}, {self.record.model.beam.length:g} m" if self.number else "")

    systematic = ACCURACY

    @property
    def lengths(self) -> list[list[int]]:
        """Single values of one record."""
        return [[1] * len(self.record.measured)]

    @property
    def stated(self) -> bool:
        """True if the values have standard deviations."""
        return self.record.stds is not None

    @property
    def negligible(self) -> float:
        """Norm of a small relative change of all values."""
        # relative change of all values that counts as none; the stretching of a beam causes less
        return 3e-6 * float(np.linalg.norm(self.record.measured / self.record.scatter))

    @property
    def failure(self) -> str:
        """Reason why the values could not be computed, or contradict the model; empty if there is none."""
        return self._computed.failure or self.record.doubt

    def residuals(self, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return computed less measured values over their standard deviations, or relative errors, (m,)."""
        factors = cs.vertcat(cs.MX(0, 1), *(unknowns[name] / first for name, first in self.first.items()))
        return (self._computed(factors) - cs.DM(self.record.measured)) / cs.DM(self.record.scatter)

    @cached_property
    def _computed(self) -> Differentiable:
        """The values as a differentiable function of the factors on the unknown properties."""
        return Differentiable(self.record.response(self._owners), len(self.record.measured), len(self.first))

    @property
    def _owners(self) -> Index:
        return property_owners(self.record.model.beam, tuple(self.first))

    def largest_bend(self, values: Mapping[str, float]) -> float:
        """Return the largest bend of an element in the equilibria of the record, rad."""
        factors = np.array([values[name] / first for name, first in self.first.items()])
        beam = scaled_model(self.record.model, self._owners, factors)
        return max(largest_bend(beam, stable_position(beam, loads, side=1).coordinates) for loads in self.record.cases)

    def split(self) -> Self:
        """Return the same values with each element in two halves."""
        return replace(self, record=self.record.with_model(split_model(self.record.model)))

    def channels(self, fitted: Fitted | Computed) -> list[PredictedChannel]:
        """Return measured and computed values, a channel for each quantity."""
        record, residuals = self.record, fitted.residuals * self.record.scatter
        errors, labels = fitted.errors * record.scatter, np.array(record.labels)
        kinds, channels = np.array(record.quantities), []
        for quantity, unit in dict(zip(record.quantities, record.units, strict=True)).items():
            selected = kinds == quantity
            measured = record.measured[selected]
            name = self.title if selected.all() else f"{self.title}, {quantity}"
            channels.append(
                PredictedChannel(
                    name,
                    unit,
                    measured,
                    measured + residuals[selected],
                    errors[selected],
                    record.places[selected],
                    record.axis,
                    math.nan,
                    np.abs(measured),
                    tuple(labels[selected].tolist()),
                    quantity,
                )
            )
        return channels

    def account(self, fitted: Fitted) -> Account:
        """Return measured and computed values."""
        record = self.record
        values = record.measured + fitted.residuals * record.scatter
        rows = zip(record.labels, record.units, record.measured.tolist(), values.tolist(), strict=True)
        lines = [
            f"{self.title}, {label}: measured {measured:.6g}, computed {computed:.6g} {unit}".rstrip()
            for label, unit, measured, computed in rows
        ]
        data = {"kind": "values", "name": self.title, "labels": list(record.labels), "units": list(record.units)}
        doubts = (f"{self.title}: {record.doubt}",) if record.doubt else ()
        return Account(lines, doubts, {**data, "measured": record.measured.tolist(), "computed": values.tolist()})
