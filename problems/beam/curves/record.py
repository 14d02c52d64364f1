"""Measured steady-state vibration: amplitude and phase of a sensor against the frequency of the excitation.

With the excitation level a sin(2 pi f t), a multiple a of a base motion or of a tip load, the fundamental of the
reading of a sensor is

    Y sin(2 pi f t + phi) = Im(Y exp(i phi) exp(2 pi i f t)),

with the amplitude Y and the phase phi by which the reading leads the base displacement, or the load.  A spectrum
analyser, a lock-in amplifier or a least-squares sine measures both; Y alone is enough.

A point of a response curve is the triple (a, Y, phi) at a frequency.  In a test with controlled excitation a is known
well and Y is measured, in one with controlled response it is the other way round.  Both are errors in the same three
numbers, so that standard deviations alone tell the tests apart:

    of Y      ``CURVE_ERROR`` of Y, and ``AMPLITUDE_FLOOR`` of the largest Y of the record
    of phi    ``CURVE_ERROR``, and the same floor over Y
    of a      ``CURVE_ERROR`` of a

and a tenth of ``CURVE_ERROR`` for the controlled number, a or Y, without a floor.  These defaults are proportions: the
scatter of the residuals sets the size of those that are measured (``response_block``).

Without a beam (``problems.mode``), the levels are amplitudes themselves, in the unit ``excitation_unit``: of a force,
of the voltage of a shaker, or of the displacement, velocity or acceleration of the base.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.dynamics.placed_load import TIP
from ancf_casadi.dynamics.tip_load import HarmonicLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.channel import Recording, unit_notes
from ancf_casadi.records.layout import NO_LAYOUT, TableLayout
from ancf_casadi.records.over_frequency import extract_functions, read_spectral, sine_amplitudes
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.records.units import known_unit
from ancf_casadi.response.harmonic_balance.system import beam_drive
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.inputs import array, check_instance, choice, complex_array, error_prefix, flag, positive_array
from ancf_casadi.support.tables import Displayed, plural, spread
from problems.beam.curves.reading import (
    ExcitationUnit,
    amplitude_reading,
    excitation_at_one,
    level_column,
    only_function,
    si_level_unit,
)

TIP_DISPLACEMENT = Sensor("displacement")

Sweep = Literal["up", "down"]
Control = Literal["excitation", "response"]

BASE_MOTIONS = ("m", "m/s", "m/s^2")  # of levels that are motions of the base
CURVE_ERROR = 0.01  # default standard deviation, relative; in rad for a phase
AMPLITUDE_FLOOR = 1e-3  # default standard deviation of an amplitude, relative to the largest of the record


@dataclass(frozen=True, eq=False)
class ResponseRecord(Displayed):
    """Steady-state readings of one sensor at several frequencies of a harmonic excitation.

    Parameters
    ----------
    frequencies : array_like (m,)
        Frequencies of the excitation, Hz, in the order of the measurement.
    values : array_like (m,)
        Amplitudes of the fundamental of the reading, in the unit of the sensor; or complex amplitudes Y exp(i phi).
    phases : array_like (m,), optional
        Phases phi by which the reading leads the displacement of the base, or the load, rad; for real ``values``.  Add
        pi to a phase relative to the acceleration of the base.
    sensor : Sensor
        The sensor; the horizontal displacement of the tip, in the laboratory and not relative to the base, if not
        given.  Without a beam, its quantity alone counts.
    base : HarmonicBase, optional
        The base motion at level 1: its amplitude and direction.  Its frequency and ramp have no effect.
    load : HarmonicLoad, optional
        The tip load at level 1, instead of a base motion.
    levels : array_like (m,), optional
        Level of the excitation at each point, a multiple of ``base`` or ``load``, or in the unit ``excitation_unit``;
        1 if not given.
    sweep : {"up", "down"}, optional
        Direction of the sweep; None for points that were approached in other ways.
    control : {"excitation", "response"}
        Quantity that was held: the level, or the amplitude of the reading.
    amplitude_std, phase_std, level_std : array_like, optional
        Standard deviations of the amplitudes (unit of the sensor), phases (rad) and levels, of one point or of each;
        if not given, about 1 %, and 0.1 % for the controlled quantity, and the fit finds the size of those measured.
    name : str
        Name in reports.
    model : Model, optional
        The beam in the configuration of the test; that of the fit if not given.
    excitation_unit : {"N", "V", "m", "m/s", "m/s^2"}, optional
        Unit of the levels, instead of ``base`` or ``load``, for a fit without a beam (``fit_mode``): a force, the
        voltage of a shaker, or displacement, velocity or acceleration of the base.
    relative : bool
        Whether the sensor moves with the base, and reads the motion relative to it; only with ``excitation_unit``.
    notes : tuple of str
        Decisions of the reader of a file, which a fit repeats.

    Raises
    ------
    InputError
        If sizes do not match, a frequency, amplitude, level or standard deviation is not positive and finite, the
        order contradicts the sweep, there is not one excitation, or the reading is relative to no base.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import HarmonicBase, Sensor
    >>> from problems import ResponseRecord
    >>> base = HarmonicBase(amplitude=1e-3, frequency=1.9)
    >>> record = ResponseRecord([1.80, 1.85, 1.90], [0.011, 0.052, 0.014], [-0.2, -1.4, -2.9], base=base, sweep="up")
    >>> record.complex_values.round(3)
    array([ 0.011-0.002j,  0.009-0.051j, -0.014-0.003j])
    """

    frequencies: ArrayLike
    values: ArrayLike
    phases: ArrayLike | None = None
    sensor: Sensor = TIP_DISPLACEMENT
    base: HarmonicBase | None = None
    load: HarmonicLoad | None = None
    levels: ArrayLike | None = None
    sweep: Sweep | None = None
    control: Control = "excitation"
    amplitude_std: ArrayLike | None = None
    phase_std: ArrayLike | None = None
    level_std: ArrayLike | None = None
    name: str = ""
    model: Model | None = None
    excitation_unit: ExcitationUnit = ""
    relative: bool = False
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Validate, and keep arrays; complex values become amplitudes and phases."""
        check_instance(self.sensor, "sensor", Sensor)
        check_instance(self.name, "name", str)
        check_instance(self.model, "model", Model, NoneType)
        self._check_excitation()
        choice(self.control, get_args(Control), "control")
        if self.sweep is not None:
            choice(self.sweep, get_args(Sweep), "sweep")
        self._store_arrays()
        self._check_order()

    @classmethod
    @np.errstate(all="ignore")  # a file may hold any numbers; those that are not finite are left out
    def from_file(
        cls,
        path: str | Path | Recording,
        column: str | int | None = None,
        *,
        frequency: str | int | None = None,
        level: str | int | None = None,
        phase: str | int | None = None,
        unit: str | None = None,
        level_unit: str | None = None,
        phase_unit: str | None = None,
        sensor: Sensor | None = None,
        base: HarmonicBase | None = None,
        load: HarmonicLoad | None = None,
        excitation_unit: ExcitationUnit | None = None,
        layout: TableLayout = NO_LAYOUT,
        progress: bool = False,
        **settings: Any,
    ) -> ResponseRecord:
        """Read a response curve from a file.

        Parameters
        ----------
        path : str, Path or Recording
            Text table, MATLAB, HDF5 or NPZ file: frequency, amplitude, and as far as there are such columns, phase and
            level; or the columns of such a file, as they were read.
        column, frequency, level, phase : str or int, optional
            Names or numbers (from 1) of the columns of amplitudes (or real parts), frequencies, levels and phases;
            needed only if the names in the file do not tell them.
        unit, level_unit, phase_unit : str, optional
            Units of amplitudes, levels and phases, such as ``mm``, ``g`` and ``deg``, in place of those in the file.
        sensor : Sensor, optional
            Quantity and place of the sensor; if not given, the unit tells the quantity.
        base, load : HarmonicBase, HarmonicLoad, optional
            The excitation, as in ``ResponseRecord``: its size holds where the file has no levels, and is the unit of
            levels without a unit.  Without either, levels in units of motion are those of a base that moves in x, and
            levels in N those of a horizontal force at the tip.
        excitation_unit : {"", "N", "V", "m", "m/s", "m/s^2"}, optional
            Unit of the levels for a fit without a beam; empty for that of the file.  A reading in volts is then
            a signal.
        layout : TableLayout
            Rows and columns of the file that the reader cannot tell by itself, such as the column ``imaginary``.
        progress : bool
            Whether to show a progress bar on a terminal if reading takes more than a second.
        **settings
            Other arguments of ``ResponseRecord``: ``sweep``, ``control``, ``model``, ``name``, standard deviations.

        Raises
        ------
        InputError
            If the file cannot be read, columns, units or excitation are not clear, or as in ``ResponseRecord``.

        Examples
        --------
        >>> from pathlib import Path
        >>> from problems import ResponseRecord
        >>> _ = Path("sweep.csv").write_text('''f (Hz),base (mm),tip (mm),phase (deg)
        ... 1.8,1.0,11.0,-12
        ... 1.9,1.1,52.0,-91
        ... ''')
        >>> record = ResponseRecord.from_file("sweep.csv", sweep="up")
        >>> record.base.amplitude * record.a
        array([0.001 , 0.0011])
        """
        check_instance(sensor, "sensor", Sensor, NoneType)
        stated_unit = None if unit is None else known_unit(unit, "unit")
        stated_level_unit = None if level_unit is None else known_unit(level_unit, "level_unit")
        contents = read_spectral(path, frequency, layout=layout, progress=progress)
        contents = contents.only("--level", ["level"], level).only("--phase", ["phase"], phase)
        contents = contents.only("--column", ["amplitude", "real", ""], column)
        levels_column = level_column(contents)
        if levels_column is not None:
            contents = contents.only("--level", ["level"], levels_column.number)
        function = only_function(extract_functions(contents, phase_unit), contents.path)
        with error_prefix(f"{contents.path}: column {function.channel.label}"):
            factor, sensor = amplitude_reading(function.channel, stated_unit, sensor, for_beam=excitation_unit is None)
        values = factor * function.values
        notes = [*contents.notes, *(() if stated_unit else unit_notes([function.channel]))]
        levels, level_quantity, present = None, "", np.isfinite(contents.frequencies) & np.isfinite(values)
        if levels_column is not None:
            levels = sine_amplitudes(levels_column)
            if levels_unit := stated_level_unit or levels_column.unit:
                levels, level_quantity = levels * levels_unit.factor, levels_unit.quantity
            else:
                notes += unit_notes([levels_column])
            present &= np.isfinite(levels)
            levels = levels[present]
        if not present.any():
            raise InputError("has no row with a frequency and an amplitude", contents.path)
        if not present.all():
            notes.append(f"{int((~present).sum())} rows with a gap are left out")
        frequencies = contents.frequencies[present]
        with error_prefix(contents.path):
            if excitation_unit is None:
                base, load, levels = excitation_at_one(frequencies, levels, level_quantity, base, load)
            else:
                excitation_unit = si_level_unit(level_quantity, excitation_unit)
        arguments: dict[str, Any] = {
            "frequencies": frequencies,
            "values": values[present],
            "sensor": sensor,
            "base": base,
            "load": load,
            "levels": levels,
            "name": Path(contents.path).name,
            "excitation_unit": excitation_unit or "",
            "notes": tuple(f"{Path(contents.path).name}: {note}" for note in notes),
        }
        with error_prefix(contents.path):
            return cls(**(arguments | settings))

    def _check_excitation(self) -> None:
        """Check that there is one excitation, and that a relative reading has a base."""
        choice(self.excitation_unit, get_args(ExcitationUnit), "excitation_unit")
        if self.excitation_unit:
            if self.base is not None or self.load is not None:
                raise InputError("is that of a base motion or a load; leave one of them out", "excitation_unit")
        elif self.base is None and self.load is None:
            raise InputError(
                "give the base motion (base) or the tip load (load) that excites the beam, or excitation_unit",
                "base",
            )
        else:
            beam_drive(self.base, self.load)  # refuses what cannot excite a steady vibration
            if self.load is not None and self.load.place != TIP:
                raise InputError("acts elsewhere than at the tip, which fits of response curves do not allow", "load")
        if flag(self.relative, "relative") and self.excitation_unit not in BASE_MOTIONS:
            raise InputError(
                f"needs a motion of the base: excitation_unit one of {', '.join(BASE_MOTIONS)}", "relative"
            )

    def _store_arrays(self) -> None:
        """Check and store frequencies, amplitudes, phases, levels and standard deviations as arrays (m,)."""
        frequencies = positive_array(self.frequencies, "frequencies")
        if frequencies.ndim != 1 or not frequencies.size:
            raise InputError("must be a sequence of frequencies", "frequencies")
        values, phases, complex_values = self.values, self.phases, complex_array(self.values, "values")
        if np.iscomplexobj(values):
            if phases is not None:
                raise InputError("belong to real values; complex values have their own", "phases")
            values, phases = np.abs(complex_values), np.angle(complex_values)
        arrays = {"frequencies": frequencies, "values": positive_array(values, "values")}
        if phases is not None:
            arrays["phases"] = array(phases, "phases")
        arrays["levels"] = positive_array(np.ones(frequencies.size) if self.levels is None else self.levels, "levels")
        for name, value in arrays.items():
            if value.shape != frequencies.shape:
                raise InputError(f"must be {frequencies.size} numbers, one per frequency, got {value.shape}", name)
            object.__setattr__(self, name, value)
        for name in ("amplitude_std", "phase_std", "level_std"):
            deviations = getattr(self, name)
            if deviations is not None:
                object.__setattr__(self, name, positive_array(deviations, name, frequencies.shape))

    def _check_order(self) -> None:
        """Check that the frequencies run in the direction of the sweep."""
        steps = np.diff(self.f)
        if self.sweep and not (steps > 0.0 if self.sweep == "up" else steps < 0.0).all():
            direction = "increase" if self.sweep == "up" else "decrease"
            raise InputError(
                f"must {direction} in a sweep {self.sweep}, in the order of the measurement", "frequencies"
            )

    @property
    def f(self) -> Array:
        """Frequencies, Hz, (m,)."""
        return np.asarray(self.frequencies)

    @property
    def amplitudes(self) -> Array:
        """Amplitudes Y of the reading, in the unit of the sensor, (m,)."""
        return np.asarray(self.values)

    @property
    def measured_phases(self) -> Array | None:
        """Phases phi, rad, (m,); None if they were not measured."""
        return None if self.phases is None else np.asarray(self.phases)

    @property
    def complex_values(self) -> ComplexArray:
        """Complex amplitudes Y exp(i phi), (m,); with the phase 0 where none was measured."""
        return np.asarray(self.amplitudes * np.exp(1j * (0.0 if self.phases is None else np.asarray(self.phases))))

    @property
    def a(self) -> Array:
        """Levels a of the excitation, (m,)."""
        return np.asarray(self.levels)

    @property
    def label(self) -> str:
        """Name of the record; sensor, level and sweep if it has none."""
        if self.name:
            return self.name
        size, unit = float(np.median(self.a)), str(self.excitation_unit)
        if not unit:
            drive = beam_drive(self.base, self.load)
            size, unit = drive.amplitude * size, drive.unit
        level = f"{1e3 * size:.3g} mm" if self.base else f"{size:.3g} {unit}"
        where = "" if self.excitation_unit else f" {self.sensor.label}"
        return ", ".join([f"{self.sensor.quantity}{where}", level, *([self.sweep] if self.sweep else [])])

    @cached_property
    def stds(self) -> Array:
        """Standard deviations of amplitudes, phases and levels, given or proportional, (3, m)."""
        controlled = 0.1 * CURVE_ERROR  # what is controlled is known ten times as well as what is measured
        floor = AMPLITUDE_FLOOR * self.amplitudes.max()
        amplitude = (
            np.hypot(CURVE_ERROR * self.amplitudes, floor)
            if self.control == "excitation"
            else controlled * self.amplitudes
        )
        level = (controlled if self.control == "excitation" else CURVE_ERROR) * self.a
        phase = np.hypot(CURVE_ERROR, floor / self.amplitudes)
        stated = self.amplitude_std, self.phase_std, self.level_std
        return np.array([
            usual if deviation is None else np.asarray(deviation)
            for deviation, usual in zip(stated, (amplitude, phase, level), strict=True)
        ])  # fmt: skip

    def _summary(self) -> str:
        name = f"{self.name!r}, " if self.name else ""
        points, range_ = plural(np.size(self.frequencies), "point"), spread(self.frequencies, "Hz")
        return f"{name}{points}, {range_}, {self.sensor.quantity}"
