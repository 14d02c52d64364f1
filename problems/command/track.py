"""``ancf-casadi track``: the positions of markers in a video, as a file for ``inspect`` and the fits."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from ancf_casadi.records.channel import Recording
from ancf_casadi.records.video.recording import marker_table, track_video
from ancf_casadi.support.arrays import root_mean_square
from ancf_casadi.support.tables import Table
from problems.command.output import (
    Output,
    add_options,
    comma_numbers,
    file_writers,
    finite,
    new_files,
    option_values,
    positive_count,
)

ADVICE = """\
places in the picture are columns and rows in pixels, from the first pixel at 0,0;
look at --preview first, and at 'inspect FILE.csv' then
"""


OPTIONS = {  # of ``track_video``
    "region": (comma_numbers, "X1,Y1,X2,Y2", "left, top, right and bottom of where markers are sought"),
    "ruler": (
        comma_numbers,
        "X1,Y1,X2,Y2,LENGTH",
        "two points at a known distance (m); without it, positions are in pixels",
    ),
    "clamp": (comma_numbers, "X,Y", "place of the origin (default: the first pixel)"),
    "vertical": (comma_numbers, "X1,Y1,X2,Y2", "two points on a vertical line (default: a column)"),
    "lens": (comma_numbers, "FX,FY,CX,CY,K1,K2,P1,P2", "camera matrix and distortion, as in OpenCV"),
    "radius": (positive_count, "PX", "radius of what belongs to a marker (default: of its dot, or 10)"),
    "sample_rate": (finite, "HZ", "frames per second of the recording, if the video plays in slow motion"),
    "begin": (finite, "S", "leave out what is before this time (s)"),
    "end": (finite, "S", "leave out what is after this time (s)"),
}


def add_track(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = ADVICE
    parser.set_defaults(begin=0.0, end=math.inf)
    parser.add_argument("file", metavar="VIDEO", help="video of a beam with dots, checker patches or other texture")
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="write the positions and their std over time")
    parser.add_argument("--preview", type=Path, metavar="FILE.png", help="draw the first frame with numbered markers")
    about = "place of a marker in the first frame; may be repeated (default: all dots, or else some corners)"
    parser.add_argument("--marker", type=comma_numbers, action="append", metavar="X,Y", help=about)
    add_options(parser, **OPTIONS)


def run_track(options: argparse.Namespace) -> Output:
    """Track the markers."""
    new_files([options.file], options.out, options.preview)
    recording = track_video(
        options.file,
        markers=options.marker,
        preview=options.preview,
        **option_values(options, OPTIONS),
    )
    columns = {channel.name: channel.values for channel in recording.channels}
    data = {"file": options.file, "time_s": recording.time, **columns, "notes": recording.notes}
    files = file_writers(options.out, lambda: marker_table(recording).csv())
    closing = f"\nNext: ancf-casadi inspect {options.out}" if options.out else ""
    return Output(lambda: data, lambda: _table(recording).text(), files, closing)


def _table(recording: Recording) -> Table:
    """Return one row per marker."""
    rows = []
    for k in range(0, len(recording.channels), 3):
        x, y, std = (channel.values for channel in recording.channels[k : k + 3])
        tracked = np.isfinite(x)
        x, y = x[tracked], y[tracked]
        rows.append((k // 3 + 1, x[0], y[0], np.ptp(x), np.ptp(y), root_mean_square(std), len(x)))
    measured = ("first x", "first y", "range of x", "range of y", "std")
    heads = ("marker", *(f"{name}, {recording.channels[0].symbol}" for name in measured), "frames")
    title = f"{recording.name}: {len(recording.time)} frames, {recording.time[0]:g} to {recording.time[-1]:.6g} s"
    return Table("markers", title, heads, rows, recording.notes)
