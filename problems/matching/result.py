"""A beam matched to measured modes: what it is, how well it fits, and how sure that is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.mechanics.beam import LUMPED, Beam
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.tables import Cell, Table
from problems.matching.identifiability import Identifiability
from problems.matching.response import Matching

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MET = 1e-5  # relative error that a preference leaves where the targets can be met
NOISE = 3.0  # standard deviations beyond which a frequency is missed
ALIKE = 0.9  # MAC below which two shapes differ visibly
HOLDING = 0.01  # share of the largest multiplier; lesser bounds hold little
UNITS = {"width": "m", "thickness": "m", "density": "kg/m^3", "elastic_modulus": "Pa",
         "tip_mass": "kg", "clamp_stiffness": "N m/rad"}  # fmt: skip


@dataclass(frozen=True, eq=False)
class FrequencyMatch:
    """A beam matched to measured modes.

    Parameters
    ----------
    beam : Beam
        The matched beam.
    targets, standard, frequencies : tuple of float
        Measured frequencies, those of the given beam, and those of the matched beam, Hz.
    active_bounds : tuple of str
        Properties at a bound, with their element from 1, such as ``thickness[3]``.
    iterations : int
        Iterations of IPOPT.
    build_seconds, solve_seconds : float
        Time to state the problem, and to solve it, s.
    matching : Matching
        What was matched to what.
    unknowns : array (N,)
        The unknowns, in the order of ``matching.space.names``.
    modes : tuple of int
        Numbers, from 1, of the modes of the matched beam that the targets belong to.
    mac : array (m, c) or None
        MAC of the measured shapes with the lowest modes of the matched beam.
    residuals : array (R,)
        Differences of frequencies and shapes in units of their deviations; relative ones where none are given.
    multipliers : array (N + r,)
        What each bound costs: how far the objective would fall, to first order, were it wider by 1.
    identifiability : Identifiability
        What the data tell of the unknowns.
    starts, reached, failed : int
        How many starts there were, how many of them ended at this answer, and how many nowhere.
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
        """Whether no beam within the bounds has the measured frequencies."""
        if self.matching.measured.frequency_std is None:
            return self.max_relative_error > MET
        return bool(np.abs(self.relative_errors / self.matching.measured.relative_std).max() > NOISE)

    @property
    def holding(self) -> tuple[tuple[str, float], ...]:
        """Bounds that hold the answer, and what each costs (``multipliers``), the dearest first."""
        space = self.matching.space
        costs = dict(zip(space.names + space.row_names, self.multipliers.tolist(), strict=True))
        dear = sorted(((name, costs[name]) for name in self.active_bounds), key=lambda pair: -pair[1])
        return tuple((name, cost) for name, cost in dear if cost > HOLDING * dear[0][1])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before using the answer."""
        notes = []
        if self.out_of_reach:
            names = [name for name, _ in self.holding]
            more = f" and {len(names) - 6} more" if len(names) > 6 else ""
            held = f"held by {', '.join(names[:6])}{more}" if names else "whatever the bounds"
            notes.append(
                f"the targets are out of reach of these unknowns, by {100 * self.max_relative_error:.3g} % at worst; "
                f"{held}"
            )
        before = (self.matching.numbers + 1).tolist()
        for target, (mode, was) in enumerate(zip(self.modes, before, strict=True), start=1):
            if mode != was:
                notes.append(f"target {target} is mode {was} of the given beam, and mode {mode} of the matched one")
        if self.mac is None and any(mode != k for k, mode in enumerate(self.modes, start=1)):
            notes.append("the modes followed are not the lowest of the matched beam; shapes would tell which is which")
        if self.mac is not None:
            for target, (row, mode) in enumerate(zip(self.mac, self.modes, strict=True), start=1):
                if row.argmax() != mode - 1:
                    notes.append(
                        f"target {target} looks more like mode {row.argmax() + 1} than like mode {mode}, the one "
                        f"followed (MAC {row.max():.2f}, {row[mode - 1]:.2f})"
                    )
                elif row[mode - 1] < ALIKE:
                    notes.append(f"the shape of target {target} is that of mode {mode} to a MAC of {row[mode - 1]:.2f}")
        if self.reached < self.starts:
            failed = f", {self.failed} nowhere" if self.failed else ""
            notes.append(f"{self.reached} of {self.starts} starts ended at this answer, the best{failed}")
        return tuple(notes)

    def tables(self) -> tuple[Table, Table]:
        """Return the frequencies, and the properties with what the data leave open."""
        shapes = self.mac is not None
        columns = ("mode", "target", "before", "matched", "error_%") + (("MAC",) if shapes else ())
        rows: list[tuple[Cell, ...]] = []
        errors = 100 * self.relative_errors
        for k, values in enumerate(zip(self.modes, self.targets, self.standard, self.frequencies, strict=True)):
            own = () if self.mac is None else (float(self.mac[k, self.modes[k] - 1]),)
            rows.append((*values, float(errors[k]), *own))
        worst = f"largest relative error {self.max_relative_error:.1e}"
        if self.matching.objective == "worst-error":
            worst += ", the smallest that the bounds allow"
        return (
            Table("frequencies", "Natural frequencies, Hz", columns, rows, (worst,)),
            Table(
                "properties",
                "Properties of the matched beam; lowest and highest that fit as well, one at a time",
                ("property", "unit", "value", "change_%", "lowest", "highest", "stderr"),
                [
                    (p["name"], p["unit"], p["value"], 100 * p["change"], p["lowest"], p["highest"], p["stderr"])
                    for p in self._properties()
                ],
                (*self.identifiability.words(), f"at a bound: {', '.join(self.active_bounds) or 'nothing'}"),
            ),
        )

    def report(self) -> str:
        """Return the result as text."""
        texts = [table.text() for table in self.tables()]
        notes = [f"note: {note}" for note in self.warnings]
        return "\n\n".join([*texts, *(["\n".join(notes)] if notes else [])])

    def figure(self) -> Figure:
        """Draw the changes of the properties along the beam, with what the data leave open."""
        from ancf_casadi.plot import properties_figure  # matplotlib is slow to import

        names, changes, n = self.identifiability.quantities[0], self.identifiability.spread - 1, self.beam.elements
        ranges: dict[str, list[Array]] = {}
        for name, ends in zip(names, changes, strict=True):
            if name in LUMPED:
                continue
            ranges.setdefault(name.partition("[")[0], []).append(ends)
        spread = {name: np.array(ends * n if len(ends) == 1 else ends) for name, ends in ranges.items()}
        return properties_figure(self.matching.space.beam, self.beam, spread)

    def to_dict(self) -> dict[str, Any]:
        """Return data for JSON: SI units, lists in the order of targets and elements, None for what is not known."""
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
            "identified": list(self.identifiability.words()),
            "properties": self._properties(),
            "starts": {"number": self.starts, "reached": self.reached, "failed": self.failed},
            "iterations": self.iterations,
            "solve_seconds": self.solve_seconds,
            "warnings": list(self.warnings),
        }

    def _properties(self) -> list[dict[str, Any]]:
        known = self.identifiability
        names = known.quantities[0]
        found = []
        for name, factor, ends, error in zip(names, known.factors, known.spread, known.standard_errors, strict=True):
            kind, _, element = name.partition("[")
            given = getattr(self.matching.space.beam, kind)
            if element:
                given = (given[int(element[:-1]) - 1],)
            standard = float(np.mean(given))
            found.append({
                "name": name,
                "unit": UNITS[kind],
                "value": float(factor) * standard,
                "change": float(factor) - 1,
                "lowest": float(ends[0]) * standard,
                "highest": float(ends[1]) * standard,
                "stderr": float(error) * standard if np.isfinite(error) else None,
            })  # fmt: skip
        return found
