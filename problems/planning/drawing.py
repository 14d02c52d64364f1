"""The figure of a plan: expected errors of each candidate, against the duration and the place of the sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ancf_casadi.figures.symbols import draw_symbols
from ancf_casadi.support.figures import GRID, LEGEND, MEASURED, REFERENCE, SERIES, literal_text, plain_log_ticks
from ancf_casadi.vibration.statics import static_equilibrium
from problems.planning.comparison import PlannedComparison
from problems.planning.result import TOGETHER, Plan, column_headings

MOST_MOTIONS = 3  # largest number of motions whose errors are drawn against duration and place
LARGEST_DRAWN = 1e3  # largest relative standard error, %, that is drawn


@literal_text
def plan_figure(plans: Mapping[str, Plan]) -> Figure:
    """Draw the standard errors of each candidate, relative to the guesses, of one plan or of several by label.

    Errors above 1000 % are left out.  Below, for the first motions of the first plan: the errors if the record ended
    earlier; the errors with the sensors of one place; and the beam at rest with all places, of which the best one, and
    the best two, are marked.
    """
    first_plan = next(iter(plans.values()))
    expected = zip(first_plan.names, first_plan.expected, strict=True)
    motions = [name for name, record in expected if not np.isnan(record.times).any()][:MOST_MOTIONS]
    placed = [name for name in motions if len(first_plan.over_places(name)[0]) > 1]
    names = [*dict.fromkeys(name for plan in plans.values() for name in plan.names), TOGETHER]
    heights = [1.1 + 0.28 * len(names), *[2.8] * len(motions)]
    figure = Figure(figsize=(9.0, sum(heights)), layout="constrained")
    subfigures = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights).ravel()
    _draw_candidates(subfigures[0].subplots(), plans, names)
    for subfigure, name in zip(subfigures[1:], motions, strict=True):
        axes = subfigure.subplots(1, 3 if name in placed else 1, squeeze=False).ravel()
        subfigure.suptitle(name, fontsize="medium")
        _draw_lines(axes[0], first_plan, *first_plan.over_time(name))
        axes[0].set(xlabel="duration, s")
        if name in placed:
            points, errors = first_plan.over_places(name)
            _draw_lines(axes[1], first_plan, 1e3 * points, errors, marked=True)
            axes[1].set(xlabel="place of a single sensor, mm")
            _draw_places(axes[2], first_plan, name)
    return figure


@literal_text
def comparison_plan_figure(results: Mapping[str, PlannedComparison]) -> Figure:
    """Draw the probability of the right choice for each candidate, with a marker per pair of laws and result."""
    names = list(dict.fromkeys(name for result in results.values() for name in result.right))
    lines: dict[str, dict[int, float]] = {}
    for label, comparison in results.items():
        for (name, truth, rival), expectation in comparison.expected.items():
            pair = f"{label} {comparison.names[truth]}, not {comparison.names[rival]}".strip()
            lines.setdefault(pair, {})[names.index(name)] = 100 * expectation.right
    figure = Figure(figsize=(8.0, 1.4 + 0.3 * (len(names) + len(lines))), layout="constrained")
    axes = figure.subplots()
    for k, (pair, right) in enumerate(lines.items()):
        places = np.array(list(right)) + 0.6 * ((k + 0.5) / len(lines) - 0.5)
        colour, _, marker = SERIES[k % len(SERIES)]
        face = colour if k < len(SERIES) else "none"
        axes.plot(list(right.values()), places, marker, color=colour, mfc=face, label=pair, clip_on=False)
    axes.axvline(95.0, **REFERENCE)
    axes.set(xlabel="probability of the right choice, %", xlim=(0.0, 100.0), ylim=(len(names) - 0.5, -0.5))
    axes.set_yticks(range(len(names)), names)
    axes.grid(**GRID, axis="x")
    figure.legend(**LEGEND, loc="outside lower center")
    return figure


def _draw_candidates(axes: Axes, plans: Mapping[str, Plan], names: Sequence[str]) -> None:
    """Draw the errors from each candidate; plans after the first have open markers."""
    for place, (label, plan) in enumerate(plans.items()):
        errors_by_list = {name: plan.errors_of({name: 1}) for name in plan.names}
        errors_by_list[TOGETHER] = plan.errors_of(dict.fromkeys(plan.names, 1))
        y = np.array([names.index(name) for name in errors_by_list]) + 0.25 * place
        for k, (unknown, head) in enumerate(zip(plan.guess, column_headings(plan.unknowns), strict=True)):
            colour, _, marker = SERIES[k % len(SERIES)]
            values = np.array([plan.relative(errors)[unknown] for errors in errors_by_list.values()])
            axes.plot(values, y, marker, color=colour, ms=6, mfc="none" if place else colour,
                      label=f"{label}, {head}" if label else head)  # fmt: skip
    axes.set(xscale="log", xlabel="expected standard error from one record", ylim=(len(names) - 0.5, -0.5))
    axes.set_xlim(right=min(axes.get_xlim()[1], LARGEST_DRAWN))
    plain_log_ticks(axes, "x")
    axes.set_yticks(range(len(names)), names)
    axes.grid(**GRID, which="both")
    axes.legend(**LEGEND, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _draw_lines(
    axes: Axes, plan: Plan, x: np.ndarray, errors: Mapping[str, np.ndarray], *, marked: bool = False
) -> None:
    """Draw the error of each unknown against x, in per cent of its guess unless that is zero."""
    for k, values in enumerate(plan.relative(errors).values()):
        colour, dash, marker = SERIES[k % len(SERIES)]
        values = np.where(np.isfinite(values), values, np.nan)
        axes.plot(x, values, color=colour, ls=dash, lw=1.2, marker=marker if marked else None, ms=3)
    axes.set(yscale="log", ylabel="standard error, %" if all(plan.guess.values()) else "standard error")
    plain_log_ticks(axes, "y")
    axes.grid(**GRID, which="both")


def _draw_places(axes: Axes, plan: Plan, name: str) -> None:
    model = getattr(plan.records[plan.names.index(name)], "model", None) or plan.model
    equilibrium = static_equilibrium(model).coordinates

    def at(points: np.ndarray) -> np.ndarray:
        return 1e3 * np.array([model.interpolation(point) @ equilibrium for point in points]).T

    axes.plot(*at(np.linspace(0.0, model.beam.length, 60)), color=MEASURED, lw=1.2)
    draw_symbols(axes, model, equilibrium)
    points = plan.over_places(name)[0]
    axes.plot(*at(points), "o", ms=4, mfc="white", color=MEASURED, label="possible")
    for count, size, (colour, _, _) in zip((2, 1), (9, 5), (SERIES[1], SERIES[0]), strict=True):
        best = np.array(plan.places(name, count))
        label = "best two" if count == 2 else "best one"
        axes.plot(*at(best), "o", ms=size, color=colour, label=label)
    axes.set(xlabel="x, mm", ylabel="y, mm")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(**LEGEND)
