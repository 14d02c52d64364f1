"""Measured frequency response functions, and how files give them: kind, values in SI units, order.

The unit of the values tells the kind, and the factor to SI units: displacement, velocity or acceleration per force, or
a quotient of equal quantities for a transmissibility.  Universal files name the input of each function; the functions
of all other files count as outputs of one input.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import NoneType
from typing import Any, get_args

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import unit_notes
from ancf_casadi.records.layout import NO_LAYOUT, TableLayout
from ancf_casadi.records.over_frequency import SpectralFunction, extract_functions, read_spectral
from ancf_casadi.records.units import known_unit
from ancf_casadi.response.linear_frf import FRF_UNITS, FrfKind
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.inputs import (
    array,
    check_instance,
    choice,
    complex_array,
    error_prefix,
    instances,
    numbers,
    shown,
)
from ancf_casadi.support.tables import Displayed, plural, spread
from problems.frf.blocks import Take
from problems.frf.window import BlockWindow

LEAST_LINES = 8
SCATTER_LINES = 12  # lines on either side over which the scatter of repeated measurements is averaged
KINDS: dict[str, FrfKind] = {  # by the quantity of a response to a force, or that of its unit
    "displacement": "receptance",
    "position": "receptance",
    "length": "receptance",
    "velocity": "mobility",
    "acceleration": "accelerance",
}
LEAST_STD = 1e-6  # relative to the median of a function
QUOTIENT = ("transmissibility", "relative-transmissibility")


@dataclass(frozen=True, eq=False)
class BlockScatter:
    """Deviations of blocks from the mean functions, (blocks, functions, k), and the number of independent blocks.

    The takes, and the places of the blocks in them (``Blocks``), allow a fit to remove leakage.
    """

    deviations: ComplexArray
    averages: float
    takes: tuple[Take, ...] = ()
    places: tuple[tuple[int, int], ...] = ()

    @property
    def variance(self) -> Array:
        """Variances of the mean functions (functions, k)."""
        return np.asarray(np.mean(np.abs(self.deviations) ** 2, axis=0) / (self.averages - 1))

    def map(self, change: Callable[[ComplexArray], ComplexArray]) -> BlockScatter:
        """Return the scatter of functions that a linear change gives."""
        return replace(self, deviations=change(self.deviations))


@dataclass(frozen=True, eq=False)
class FrfRecord(Displayed):
    """Measured frequency response functions: one or several outputs, one or several inputs.

    Parameters
    ----------
    frequencies : array_like (k,)
        Frequencies, Hz, positive and increasing.
    values : array_like (outputs, inputs, k), (outputs, k) or (k,)
        Complex values in SI units.
    kind : {"receptance", "mobility", "accelerance", "transmissibility", "relative-transmissibility"}
        Displacement, velocity or acceleration per force; or absolute or relative motion per motion of the base.
    coherence : array_like, optional
        Ordinary coherence, 0 to 1, in the shape of the values; it gives the weights.
    std : array_like, optional
        Standard deviations of the complex values, in the shape of the values, positive; they give the weights, also
        beside a coherence.
    points : sequence of float, optional
        Arc lengths of the outputs from the clamp, m.
    notes : tuple of str
        Decisions of the reader of a file, which a fit repeats.
    window : BlockWindow, optional
        Window of the blocks of time from which ``frf_of`` estimated the functions; a fit allows for it.
    scatter : BlockScatter, optional
        Scatter of these blocks, from which the standard errors of a fit follow.

    Raises
    ------
    InputError
        If there are fewer than eight frequencies, a value is not finite, the shapes differ, or coherence or std is out
        of range.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import FrfRecord
    >>> f = np.linspace(1.0, 3.0, 201)
    >>> record = FrfRecord(f, 1.0 / (2.0**2 - f**2 + 0.04j * f), "receptance")
    >>> record.outputs, record.inputs, record.values.shape
    (1, 1, (1, 1, 201))
    """

    frequencies: Array
    values: ComplexArray
    kind: FrfKind
    coherence: Array | None = None
    std: Array | None = None
    points: Sequence[float] | None = None
    notes: tuple[str, ...] = ()
    window: BlockWindow | None = None
    scatter: BlockScatter | None = None

    def __post_init__(self) -> None:
        """Validate, and keep arrays."""
        choice(self.kind, get_args(FrfKind), "kind")
        check_instance(self.window, "window", BlockWindow, NoneType)
        check_instance(self.scatter, "scatter", BlockScatter, NoneType)
        f = array(self.frequencies, "frequencies")
        if f.ndim != 1 or len(f) < LEAST_LINES:
            raise InputError(f"needs at least {LEAST_LINES} frequencies", "frequencies")
        if (np.diff(f) <= 0.0).any() or f[0] <= 0.0:
            raise InputError("must be positive and increase; leave out the line at 0 Hz", "frequencies")
        values = _with_inputs(complex_array(self.values, "values"))
        if values.ndim != 3 or not values.size or values.shape[2] != len(f):
            raise InputError(
                f"must have the shape (outputs, inputs, {len(f)}), got {np.shape(self.values)}; the frequencies come "
                "last",
                "values",
            )
        for name, axes in (("outputs", (1, 2)), ("inputs", (0, 2))):
            if not values.any(axis=axes).all():
                raise InputError(f"are all zero in one of the {name}; leave it out", "values")
        object.__setattr__(self, "frequencies", f)
        object.__setattr__(self, "values", values)
        self._check_quality()
        if self.points is not None:
            object.__setattr__(self, "points", numbers(self.points, "points"))
            if len(self.points) != self.outputs:
                raise InputError(f"has {len(self.points)} values for {self.outputs} outputs", "points")

    def _check_quality(self) -> None:
        """Check coherence and standard deviations."""
        for name in ("coherence", "std"):
            if getattr(self, name) is None:
                continue
            quality = _with_inputs(array(getattr(self, name), name))
            if quality.shape != self.values.shape:
                raise InputError(f"must have the shape of the values, {self.values.shape}, got {quality.shape}", name)
            if name == "std" and not (quality > 0.0).all():
                raise InputError("must be positive", name)
            if name == "coherence" and not ((quality >= 0.0) & (quality <= 1.0)).all():
                raise InputError("must be between 0 and 1", name)
            object.__setattr__(self, name, quality)

    @classmethod
    @np.errstate(all="ignore")  # a file may hold any numbers; those that are not finite are refused
    def from_file(
        cls,
        path: str | Path,
        kind: FrfKind | None = None,
        *,
        column: str | int | None = None,
        frequency: str | int | None = None,
        phase: str | int | None = None,
        unit: str | None = None,
        phase_unit: str | None = None,
        points: Sequence[float] | None = None,
        layout: TableLayout = NO_LAYOUT,
        progress: bool = False,
    ) -> FrfRecord:
        """Read functions from a universal file (data set 58), or a MATLAB, HDF5, NPZ or text file.

        Parameters
        ----------
        path : str or Path
            File with complex values, real and imaginary parts, or amplitudes and phases over frequency.
        kind : str, optional
            Kind of the functions, if their unit does not tell it.
        column, frequency, phase : str or int, optional
            Names or numbers (from 1) of the columns with the amplitudes or real parts of one function, with the
            frequencies and with the phases, if their names do not tell them; all functions without ``column``.
        unit, phase_unit : str, optional
            Unit of the values, such as ``mm/N``, and of the phases, in place of those in the file.
        points : sequence of float, optional
            Arc lengths of the outputs from the clamp, m.
        layout : TableLayout
            Rows and columns of the file that the reader cannot tell by itself, such as the column ``imaginary``.
        progress : bool
            Whether to show a progress bar on a terminal if reading takes more than a second.

        Raises
        ------
        InputError
            If the file cannot be read, columns, units or kind are not clear, or as in ``FrfRecord``.

        Examples
        --------
        >>> import numpy as np
        >>> from problems import FrfRecord
        >>> f = np.linspace(1.0, 3.0, 201)
        >>> h = 1.0 / (2.0**2 - f**2 + 0.04j * f)  # mm/N
        >>> table = np.column_stack([f, np.abs(h), np.degrees(np.angle(h))])
        >>> np.savetxt("tip.csv", table, delimiter=",", header="f (Hz),tip (mm/N),phase (deg)", comments="")
        >>> FrfRecord.from_file("tip.csv")
        FrfRecord(receptance, 1 output, 1 input, 201 frequencies, 1 to 3 Hz)
        """
        check_instance(unit, "unit", str, NoneType)
        if kind is not None:
            choice(kind, get_args(FrfKind), "kind")
        contents = read_spectral(path, frequency, layout=layout, progress=progress)
        columns = tuple(("" if quantity == "level" else quantity, channel) for quantity, channel in contents.columns)
        contents = (
            replace(contents, columns=columns)
            .only("--column", ["amplitude", "real", ""], column)
            .only("--phase", ["phase"], phase)
        )
        functions = extract_functions(contents, phase_unit)
        if not functions:
            raise InputError("has no columns with the values of functions", str(path))
        amplitudes_only = [function.channel for function in functions if not np.iscomplexobj(function.values)]
        functions = [function for function in functions if np.iscomplexobj(function.values)]
        if not functions:
            raise InputError(
                "has amplitudes only; a function needs its phase (--phase), or real and imaginary part (--imaginary)",
                f"{path}: column {amplitudes_only[0].label}",
            )
        found_kind, values = convert_to_si(functions, kind, unit, str(path))
        notes = [*contents.notes, *(f"column {c.label} has no phase, and is left out" for c in amplitudes_only)]
        notes += () if unit else unit_notes([function.channel for function in functions])
        shape, order = function_grid(functions, str(path))
        f = contents.frequencies
        coherences = [function.coherence for function in functions]
        coherence = None
        if not any(c is None for c in coherences):
            coherence, coherence_notes = _limit_coherence(np.array(coherences, dtype=float))
            notes += coherence_notes
        elif bare := [function.channel.label for function in functions if function.coherence is None]:
            if len(bare) < len(functions):
                notes.append(f"coherence: left out, because column {bare[0]} has none")
        is_usable = np.isfinite(f) & np.isfinite(values).all(axis=0) & (f != 0.0)
        if not is_usable.all():
            notes.append(f"{int((~is_usable).sum())} lines at 0 Hz or with a gap are left out")
        with error_prefix(str(path)):
            return cls(
                f[is_usable],
                values[order][:, is_usable].reshape(*shape, -1),
                found_kind,
                None if coherence is None else coherence[order][:, is_usable].reshape(*shape, -1),
                points=points,
                notes=tuple(f"{Path(path).name}: {note}" for note in notes),
            )

    @classmethod
    def mean_of(cls, records: Sequence[FrfRecord]) -> FrfRecord:
        """Return the mean of repeated measurements, with standard deviations from their scatter.

        The scatter is averaged over neighbouring frequencies, because a few repetitions determine it badly at each.

        Raises
        ------
        InputError
            If there are fewer than two records, or they differ in frequencies, kind, window, shape or points.

        Examples
        --------
        >>> import numpy as np
        >>> from problems import FrfRecord
        >>> f, rng = np.linspace(1.0, 3.0, 201), np.random.default_rng(0)
        >>> true = 1.0 / (2.0**2 - f**2 + 0.04j * f)
        >>> runs = [true + rng.normal(0.0, 1e-3, (2, 201)).T @ [1, 1j] for _ in range(4)]
        >>> record = FrfRecord.mean_of([FrfRecord(f, run, "receptance") for run in runs])
        >>> round(float(np.median(record.std)), 5)
        0.00071
        """
        runs: tuple[FrfRecord, ...] = instances(records, "records", FrfRecord)
        first = runs[0]
        if len(runs) < 2:
            raise InputError("needs at least two", "records")
        _check_alike(runs, slice(None), "shape")
        if any(run.points != first.points for run in runs):
            raise InputError("differ in their points", "records")
        values = np.array([run.values for run in runs])
        variance = (np.abs(values - values.mean(axis=0)) ** 2).sum(axis=0) / (len(runs) - 1) / len(runs)
        smooth = moving_mean(variance, SCATTER_LINES)
        if not (smooth > 0.0).all():
            raise InputError("are equal, so their scatter is zero; give one of them", "records")
        mean: dict[str, Any] = {"values": values.mean(axis=0), "std": np.sqrt(smooth), "notes": _notes(runs)}
        return replace(first, coherence=None, scatter=None, **mean)

    @classmethod
    def stacked(cls, records: Sequence[FrfRecord]) -> FrfRecord:
        """Return the outputs of several records over the same frequencies, such as one file per point, as one record.

        Raises
        ------
        InputError
            If the records differ in frequencies, kind, window or inputs, or some state standard deviations, and the
            others coherences alone.

        Examples
        --------
        >>> import numpy as np
        >>> from problems import FrfRecord
        >>> f = np.linspace(1.0, 3.0, 201)
        >>> record = FrfRecord(f, 1.0 / (2.0**2 - f**2 + 0.04j * f), "receptance")
        >>> FrfRecord.stacked([record, record]).outputs
        2
        """
        stack: tuple[FrfRecord, ...] = instances(records, "records", FrfRecord)
        first = stack[0]
        _check_alike(stack, slice(1, None), "inputs")
        stacked: dict[str, Any] = {}
        notes = [*_notes(stack)]
        for name in ("values", "coherence", "std", "points"):
            arrays = [getattr(record, name) for record in stack]
            bare = [k for k, values in enumerate(arrays, start=1) if values is None]
            stacked[name] = None if bare else np.concatenate(arrays)
            if 0 < len(bare) < len(stack):
                notes.append(f"{name}: left out, because record {bare[0]} of {len(stack)} has none")
        has_weights = [record.std is not None or record.coherence is not None for record in stack]
        if stacked["std"] is None and stacked["coherence"] is None and all(has_weights):
            raise InputError(
                "some have standard deviations, the others only coherences, which give relative weights; give std for "
                "all, or leave both out: dataclasses.replace(record, coherence=None, std=None)",
                "records",
            )
        return replace(first, scatter=None, notes=tuple(notes), **stacked)

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return FRF_UNITS[self.kind]

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return int(self.values.shape[0])

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return int(self.values.shape[1])

    @property
    def columns(self) -> ComplexArray:
        """The values, one column per function, (k, outputs inputs)."""
        return self.values.reshape(-1, len(self.frequencies)).T

    def between(self, low: float, high: float) -> FrfRecord:
        """Return the record within a band of frequencies, Hz; fewer than eight of them raise an ``InputError``."""
        inside = (self.frequencies >= low) & (self.frequencies <= high)
        if np.count_nonzero(inside) < LEAST_LINES:
            raise InputError(f"has fewer than {LEAST_LINES} frequencies of the record", "band")
        lines: dict[str, Any] = {"frequencies": self.frequencies[inside]}
        for name in ("values", "coherence", "std"):
            if getattr(self, name) is not None:
                lines[name] = getattr(self, name)[:, :, inside]
        scatter = self.scatter and self.scatter.map(lambda deviations: deviations[:, :, inside])
        return replace(self, scatter=scatter, **lines)

    def names(self) -> list[str]:
        """Return a name of each function, output after output."""
        outputs = [f"output {k}" for k in range(1, self.outputs + 1)]
        if self.points is not None:
            outputs = [f"{s:.4g} m" for s in self.points]
        if self.inputs == 1:
            return outputs
        return [f"{name}, input {k}" for name in outputs for k in range(1, self.inputs + 1)]

    def _summary(self) -> str:
        shape = f"{plural(self.outputs, 'output')}, {plural(self.inputs, 'input')}"
        return f"{self.kind}, {shape}, {len(self.frequencies)} frequencies, {spread(self.frequencies, 'Hz')}"


def _with_inputs(values: Any) -> Any:
    """Return values of one function, (k,), or of one input, (outputs, k), in the shape (outputs, inputs, k)."""
    return values[None, None] if values.ndim == 1 else values[:, None] if values.ndim == 2 else values


def _notes(records: Sequence[FrfRecord]) -> tuple[str, ...]:
    """Return the notes of all records, equal ones once."""
    return tuple(dict.fromkeys(note for record in records for note in record.notes))


def _limit_coherence(coherence: Array) -> tuple[Array, list[str]]:
    """Convert coherences in percent, clip them to 0 and 1, and return them with notes of these changes."""
    notes = []
    if np.nanmedian(coherence) > 1.5 and np.nanmax(coherence) < 101.0:
        coherence = coherence / 100.0
        notes.append("the coherence is taken in percent")
    beyond = (coherence < 0.0) | (coherence > 1.0 + 1e-6)  # more than rounding
    if beyond.any():
        notes.append(f"{int(beyond.sum())} coherences beyond 0 and 1 count as these limits")
    if np.isnan(coherence).any():
        notes.append(f"{int(np.isnan(coherence).sum())} coherences that are missing count as 0")
    return np.clip(np.nan_to_num(coherence), 0.0, 1.0), notes


def least_std(values: Array | ComplexArray, axis: int = -1) -> Array:
    """Return the least standard deviation to assume for each function; the axis of the lines has the length 1."""
    return np.asarray(LEAST_STD * np.median(np.abs(values), axis=axis, keepdims=True))


def moving_mean(values: Array, half: int) -> Array:
    """Return the means over the neighbours on either side along the last axis, fewer at the ends."""
    window, inside = np.ones(2 * half + 1), slice(half, half + values.shape[-1])
    sums = np.apply_along_axis(np.convolve, -1, values, window)[..., inside]
    return np.asarray(sums / np.convolve(np.ones(values.shape[-1]), window)[inside])


def convert_to_si(
    functions: Sequence[SpectralFunction], kind: FrfKind | None, unit: str | None, path: str
) -> tuple[FrfKind, ComplexArray]:
    """Return the kind of the functions and their values in SI units, (functions, k)."""
    values, kinds = [], {kind} if kind else set()
    for function in functions:
        text = unit or function.channel.symbol
        own_kind, factor = frf_unit(text, f"{path}: column {function.channel.label}") if text else (kind, 1.0)
        if own_kind and not (own_kind in QUOTIENT and kind in QUOTIENT):
            kinds.add(own_kind)
        values.append(factor * function.values)
    if len(kinds) != 1:
        problem = f"are in units of {' and '.join(sorted(kinds))}" if kinds else "have no unit"
        raise InputError(f"the values {problem}; give the kind (--kind), and their unit (--unit)", path)
    return kinds.pop(), np.array(values)


def _check_alike(records: Sequence[FrfRecord], axes: slice, sizes: str) -> None:
    """Refuse records that differ in frequencies, kind, window, or the sizes of some axes of their values."""
    first = records[0]
    for record in records[1:]:
        descriptions = {(each.kind, each.window, each.values.shape[axes]) for each in (record, first)}
        if len(descriptions) > 1 or not np.array_equal(record.frequencies, first.frequencies):
            raise InputError(f"differ in frequencies, kind, window or {sizes}", "records")


def frf_unit(text: str, where: str) -> tuple[FrfKind, float]:
    """Return the kind of functions with a unit such as ``(mm/s)/N`` or ``g/g``, and the factor to SI units."""
    if text.strip() in ("1", "-"):
        return "transmissibility", 1.0
    for place in [k for k, letter in enumerate(text) if letter == "/"]:
        try:
            above, below = (known_unit(side.strip().strip("()[]"), "") for side in (text[:place], text[place + 1 :]))
        except InputError:
            continue
        kind = KINDS.get(above.quantity) if below.quantity == "force" else None
        if kind or above.quantity == below.quantity:
            return kind or "transmissibility", above.factor / below.factor
    raise InputError(f"the unit {shown(text)} is none of such a function; give it with --unit, as mm/N or g/N", where)


def function_grid(functions: Sequence[SpectralFunction], path: str) -> tuple[tuple[int, int], list[int]]:
    """Return the numbers of outputs and inputs, and the order of the functions, output after output."""
    outputs = list(dict.fromkeys(function.name for function in functions))
    inputs = list(dict.fromkeys(function.channel.reference for function in functions))
    if len(inputs) == 1:
        return (len(functions), 1), list(range(len(functions)))
    places = {(function.name, function.channel.reference): k for k, function in enumerate(functions)}
    pairs = [(output, source) for output in outputs for source in inputs]
    missing = next((pair for pair in pairs if pair not in places), None)
    if missing or len(places) != len(functions):
        problem = f"has no function of {missing[0]} for the input {missing[1]}" if missing else "has a function twice"
        raise InputError(f"{problem}; keep the functions of one input, or all of a full matrix", path)
    return (len(outputs), len(inputs)), [places[pair] for pair in pairs]
