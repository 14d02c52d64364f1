"""``ancf-casadi fit-modes``: several modes from one measured decay."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import located
from ancf_casadi.support.tables import Table
from problems.command.output import (
    Output,
    add_plot,
    figure_writer,
    json_text,
    new_files,
    positive_count,
)
from problems.command.record_options import add_part_options, add_record_options, read_record, releases
from problems.decay.mode_separation import MOST_MODES, fit_modes
from problems.decay.result import DecayFit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def add_fit_modes(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.set_defaults(run=_run)
    parser.add_argument("file", metavar="FILE", help="the record; inspect FILE shows its columns and units")
    parser.add_argument(
        "--count",
        type=positive_count,
        metavar="N",
        help=f"largest number of modes (default: as many as the record supports, up to {MOST_MODES})",
    )
    add_plot(parser, "draw the record, the sum of the modes, and what remains")
    add_record_options(parser)
    add_part_options(parser)


def _run(options: argparse.Namespace) -> Output:
    new_files([options.file], options.plot)
    (release,) = releases(options, 1)
    record = read_record(options.file, options)
    return modes_output(options.file, record, options.count, release, options.plot, options.json)


def modes_output(
    file: str, record: Measurement, count: int | None, release: float | None, plot: Path | None, as_json: bool
) -> Output:
    """Return the output of a fit of up to ``count`` modes to the record of a file."""
    with located(file):
        fits = fit_modes(record, count=count, release_time=release)
    files = [] if plot is None else [figure_writer(plot, lambda: _figure(record, fits))]
    if as_json:
        return Output(json_text({"modes": [fit.to_dict() for fit in fits]}), files)
    return Output(_table(fits).text(), files)


def _table(fits: Sequence[DecayFit]) -> Table:
    """Return one row per mode with 95 % intervals, and the remarks that concern all."""
    first = fits[0]
    amplitude = "amplitude_m" if first.units["amplitude"] == "m" else "amplitude"
    columns = ("mode", "f_Hz", "f_low", "f_high", "damping_ratio", "low", "high", amplitude)
    rows = []
    for k, fit in enumerate(fits, start=1):
        frequency, ratio = fit.intervals["frequency"], fit.intervals["damping_ratio"]
        rows.append((k, fit.frequency, *frequency, fit.damping_ratio, *ratio, fit.amplitude))
    notes = [
        "low and high are the ends of 95 % intervals",
        f"{first.samples} samples from {first.release_time:g} s on ({first.release_reason})",
        f"the residuals have an rms of {first.residual_rms:.3g} {first.model.sensor.unit}".rstrip(),
    ]
    notes += [f"note: {text}" for text in dict.fromkeys(text for fit in fits for text in fit.warnings)]
    return Table("modes", "Modes of the record under linear damping", columns, rows, notes)


def _figure(record: Measurement, fits: Sequence[DecayFit]) -> Figure:
    from ancf_casadi.plot import fit_figure  # matplotlib is slow to import

    first = fits[0]
    fitted = np.sum([fit.displacement(first.time) for fit in fits], axis=0)
    return fit_figure(first.time, record.values[-first.samples :], fitted, first.model.sensor.unit)
