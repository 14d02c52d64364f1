"""The result of a matching: the beam, how well it fits, and how certain its properties are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.mechanics.beam import LUMPED, UNITS, Beam
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.tables import Cell, Table
from ancf_casadi.support.tables import known as finite
from problems.matching.identifiability import Identifiability
from problems.matching.response import Matching

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MET = 1e-5  # largest relative error that a preference leaves if the targets can be met
NOISE = 3.0  # error in standard deviations beyond which a target is out of reach
CLEAR_MAC = 0.9  # MAC below which two shapes differ visibly
HOLDING = 0.01  # least multiplier of a limiting bound, relative to the largest
MOST_NAMES = 6  # largest number of bounds that a warning names


@dataclass(frozen=True, eq=False)
class FrequencyMatch:
    """A beam matched to measured modes.

    Parameters
    ----------
    beam : Beam
        The matched beam.
    targets : tuple of float
        Measured frequencies, Hz.
    standard : tuple of float
        Frequencies of the given beam, Hz.
    frequencies : tuple of float
        Frequencies of the matched beam, Hz.
    active_bounds : tuple of str
        Properties at a bound, with their element from 1, such as ``thickness[3]``.
    iterations : int
        Iterations of IPOPT.
    build_seconds : float
        Time to build the nonlinear program, s.
    solve_seconds : float
        Time to solve it, s.
    matching : Matching
        The matching problem.
    unknowns : array (N,)
        The unknowns, in the order of ``matching.space.names``.
    modes : tuple of int
        Numbers, from 1, of the modes of the matched beam to which the targets are assigned.
    mac : array (m, c) or None
        MAC of the measured shapes with the lowest modes of the matched beam.
    residuals : array (R,)
        Residuals of frequencies and shapes in units of their standard deviations; relative errors if none are given.
    multipliers : array (N + r,)
        Decrease of the objective per unit by which a bound is widened, in the order of
        ``matching.space.bounded_names``.
    identifiability : Identifiability
        The information in the data about the unknowns.
    starts : int
        Number of starts.
    reached : int
        Number of starts that ended at this optimum.
    failed : int
        Number of starts that did not converge.

    Examples
    --------
    >>> from ancf_casadi import Beam
    >>> from problems import Global, match_frequencies
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> unknowns = [Global("thickness"), Global("density")]
    >>> match = match_frequencies(beam, targets=(1.85, 10.4), unknowns=unknowns)
    >>> [f"{100 * error:.2f} %" for error in match.relative_errors]
    ['-0.03 %', '0.02 %']
    """

    beam: Beam
    targets: tuple[float, ...]
    standard: tuple[float, ...]
    frequencies: tuple[float, ...]
    active_bounds: tuple[str, ...]
    iterations: int
    build_seconds: float
    solve_seconds: float
    matching: Matching
    unknowns: Array
    modes: tuple[int, ...]
    mac: Array | None
    residuals: Array
    multipliers: Array
    identifiability: Identifiability
    starts: int = 1
    reached: int = 1
    failed: int = 0

    @property
    def relative_errors(self) -> Array:
        """Relative differences between matched and measured frequencies, (m,)."""
        return np.asarray(np.array(self.frequencies) / np.array(self.targets) - 1)

    @property
    def max_relative_error(self) -> float:
        """Largest relative difference between matched and measured frequencies."""
        return float(np.abs(self.relative_errors).max())

    @property
    def out_of_reach(self) -> bool:
        """True if no beam within the bounds has the measured frequencies."""
        if not self.matching.noisy:
            return self.max_relative_error > MET
        return bool(np.abs(self.relative_errors / self.matching.measured.relative_std).max() > NOISE)

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each property that may change, SI units; nan if the data do not determine it."""
        known = self.identifiability
        return dict(zip(known.factor_names, (known.standard_errors * self._given).tolist(), strict=True))

    @property
    def holding(self) -> tuple[tuple[str, float], ...]:
        """Active bounds that keep the beam from fitting better, with their multipliers in descending order."""
        costs = dict(zip(self.matching.space.bounded_names, self.multipliers.tolist(), strict=True))
        active = sorted(((name, costs[name]) for name in self.active_bounds), key=lambda pair: -pair[1])
        return tuple((name, cost) for name, cost in active if cost > HOLDING * active[0][1])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the match, one sentence each."""
        notes = []
        if self.out_of_reach:
            names = [name for name, _ in self.holding]
            more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
            limit = (
                f"these bounds keep the beam from fitting better: {', '.join(names[:MOST_NAMES])}{more}; widen them if "
                "the beam may differ by more, or let other properties change"
                if names
                else "no bound limits the fit; let other properties change"
            )
            worst = f"a frequency error of {100 * self.max_relative_error:.3g} % remains"
            notes.append(f"the targets are out of reach of these unknowns: {worst}, and {limit}")
        if self.mac is None and any(mode != k for k, mode in enumerate(self.modes, start=1)):
            notes.append(
                f"the targets are matched to modes {', '.join(map(str, self.modes))}, which are not the lowest modes "
                "of the matched beam; give measured shapes to identify the modes"
            )
        notes += [*self._mode_warnings(), *self._shape_warnings()]
        if self.reached < self.starts:
            failed = f"; {self.failed} did not converge" if self.failed else ""
            notes.append(f"{self.reached} of {self.starts} starts ended at this optimum, the best found{failed}")
        return tuple(notes)

    def _mode_warnings(self) -> list[str]:
        before = (self.matching.numbers + 1).tolist()
        return [
            f"target {target} is mode {was} of the given beam, and mode {mode} of the matched one"
            for target, (mode, was) in enumerate(zip(self.modes, before, strict=True), start=1)
            if mode != was
        ]

    def _shape_warnings(self) -> list[str]:
        notes = []
        for k, row in enumerate([] if self.mac is None else self.mac):
            target, mode, best = k + 1, self.modes[k], int(row.argmax()) + 1
            own = row[mode - 1]
            if best != mode:
                notes.append(
                    f"the shape of target {target} is closer to mode {best} than to mode {mode}, which was followed "
                    f"(MAC {row.max():.2f} and {own:.2f})"
                )
            elif own < CLEAR_MAC:
                notes.append(f"the shape of target {target} differs from mode {mode}: their MAC is only {own:.2f}")
        return notes

    def tables(self) -> tuple[Table, Table]:
        """Return the table of frequencies, and that of properties with the ranges that the data leave open."""
        columns = ("mode", "target", "before", "matched", "error_%") + (("MAC",) if self.mac is not None else ())
        rows: list[tuple[Cell, ...]] = []
        errors = 100 * self.relative_errors
        for k, values in enumerate(zip(self.modes, self.targets, self.standard, self.frequencies, strict=True)):
            own = () if self.mac is None else (float(self.mac[k, self.modes[k] - 1]),)
            rows.append((*values, float(errors[k]), *own))
        worst = f"largest relative error {self.max_relative_error:.1e}"
        if self.matching.objective == "worst-error":
            worst += ", the smallest that the bounds allow"
        title = "Properties of the matched beam"
        return (
            Table("frequencies", "Natural frequencies, Hz", columns, rows, (worst,)),
            Table(
                "properties",
                title if self.out_of_reach else f"{title}; lowest and highest value of each that fits equally well",
                ("property", "unit", "value", "change_%", "lowest", "highest", "stderr"),
                [
                    (p["name"], p["unit"], p["value"], 100 * p["change"], p["lowest"], p["highest"], p["stderr"])
                    for p in self._properties
                ],
                (*self._statements, f"at a bound: {', '.join(self.active_bounds) or 'nothing'}"),
            ),
        )

    def report(self) -> str:
        """Return the result as text."""
        texts = [table.text() for table in self.tables()]
        notes = [f"note: {note}" for note in self.warnings]
        return "\n\n".join([*texts, *(["\n".join(notes)] if notes else [])])

    def figure(self) -> Figure:
        """Draw the changes of the properties along the beam, with the ranges that the data leave open."""
        from ancf_casadi.plot import properties_figure  # matplotlib is slow to import

        known, n = self.identifiability, self.beam.elements
        ends = np.column_stack([known.factors, known.factors]) if self.out_of_reach else known.spread
        ranges: dict[str, list[Array]] = {}
        for name, pair in zip(known.factor_names, ends - 1, strict=True):
            if name not in LUMPED:
                ranges.setdefault(name.partition("[")[0], []).append(pair)
        spread = {name: np.array(pairs * n if len(pairs) == 1 else pairs) for name, pairs in ranges.items()}
        return properties_figure(self.matching.space.beam, self.beam, spread)

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON: SI units, lists in the order of targets and elements, None for unknown values."""
        return {
            "target_hz": list(self.targets),
            "standard_hz": list(self.standard),
            "matched_hz": list(self.frequencies),
            "width_m": list(self.beam.width),
            "thickness_m": list(self.beam.thickness),
            "density": list(self.beam.density),
            "elastic_modulus": list(self.beam.elastic_modulus),
            "tip_mass": self.beam.tip_mass,
            "clamp_stiffness": self.beam.clamp_stiffness if math.isfinite(self.beam.clamp_stiffness) else None,
            "max_relative_error": self.max_relative_error,
            "at_bound": list(self.active_bounds),
            "holding": [{"name": name, "multiplier": cost} for name, cost in self.holding],
            "out_of_reach": self.out_of_reach,
            "objective": self.matching.objective,
            "modes": list(self.modes),
            "mac": None if self.mac is None else self.mac.tolist(),
            "unknowns": dict(zip(self.matching.space.names, self.unknowns.tolist(), strict=True)),
            "rank": self.identifiability.rank,
            "identified": list(self._statements),
            "properties": self._properties,
            "starts": {"number": self.starts, "reached": self.reached, "failed": self.failed},
            "iterations": self.iterations,
            "solve_seconds": self.solve_seconds,
            "warnings": list(self.warnings),
        }

    @property
    def _statements(self) -> tuple[str, ...]:
        if self.out_of_reach:
            return ("The targets are out of reach: no beam within the bounds fits, so no property has a range.",)
        return self.identifiability.statements()

    @cached_property
    def _given(self) -> Array:
        """Values in the given beam of the properties that may change, by ``identifiability.factor_names``."""
        found = []
        for name in self.identifiability.factor_names:
            kind, _, element = name.partition("[")
            value = np.atleast_1d(getattr(self.matching.space.beam, kind))
            found.append(value[int(element[:-1]) - 1] if element else value.mean())
        return np.array(found)

    @cached_property
    def _properties(self) -> list[dict[str, Any]]:
        """Value, standard error and, unless the targets are out of reach, range of each property that may change."""
        known = self.identifiability
        ranges = np.full((len(known.factors), 2), math.nan) if self.out_of_reach else known.spread
        columns = (known.factors, *ranges.T, known.standard_errors)
        return [
            {
                "name": name,
                "unit": UNITS[name.partition("[")[0]],
                "value": value,
                "change": factor - 1,
                "lowest": finite(low),
                "highest": finite(high),
                "stderr": finite(error),
            }
            for name, factor, value, low, high, error in zip(
                known.factor_names,
                known.factors.tolist(),
                *((column * self._given).tolist() for column in columns),
                strict=True,
            )
        ]
