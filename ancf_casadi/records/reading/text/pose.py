"""Tracks of body parts or markers in videos, with the likelihood of each point (DeepLabCut, SLEAP and others).

DeepLabCut writes the rows ``scorer``, ``individuals`` (if there are several), ``bodyparts`` and ``coords`` above the
numbers; coordinates are in pixels, and the first column counts the frames.  In any table, a column such as
``tip_likelihood`` or ``tip.score`` belongs to the columns ``tip_x`` and ``tip_y``.  A point whose likelihood is below
``LEAST_LIKELIHOOD`` is a gap.

References
----------
A. Mathis et al., DeepLabCut: markerless pose estimation of user-defined body parts with deep learning, Nature
Neuroscience 21 (2018); the limit 0.6 is its default.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ancf_casadi.records.channel import Contents, RecordedChannel

LEAST_LIKELIHOOD = 0.6  # likelihood of a point that counts
LIKELIHOOD = re.compile(r"(.*[^\s_.])[ _.]+(?:likelihood|score|confidence|conf)", re.IGNORECASE | re.DOTALL)
COORDINATE = re.compile(r"(.*[^\s_.])[ _.]+[xyz](?:[ _(\[].*)?", re.IGNORECASE | re.DOTALL)


def pose_names(rows: Sequence[Sequence[str]]) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Return names and units of the columns below a DeepLabCut header; None if the rows are none."""
    if len(rows) < 2 or rows[-1][0].casefold() != "coords":
        return None
    parts = [row for row in rows if row[0].casefold() in ("individuals", "bodyparts", "coords")]
    names = ["frame", *(" ".join(cells) for cells in zip(*(row[1:] for row in parts), strict=True))]
    return tuple(names), tuple("px" if COORDINATE.fullmatch(name) else "" for name in names)


def without_unlikely(contents: Contents) -> Contents:
    """Return the columns with gaps where the likelihood of a point is low, and without the likelihoods."""
    likelihoods = {}
    for channel in contents.channels:
        match = LIKELIHOOD.fullmatch(channel.name)
        if match and not channel.fault:
            likelihoods[match[1].casefold()] = channel
    tracks = {match[1].casefold() for channel in contents.channels if (match := COORDINATE.fullmatch(channel.name))}
    likelihoods = {stem: channel for stem, channel in likelihoods.items() if stem in tracks}
    if not likelihoods:
        return contents
    masked: list[RecordedChannel] = []
    points = 0
    for channel in contents.channels:
        match = COORDINATE.fullmatch(channel.name)
        likelihood = likelihoods.get(match[1].casefold()) if match else None
        if likelihood and not channel.fault:
            doubtful = ~(likelihood.values >= LEAST_LIKELIHOOD)
            points += int(np.sum(doubtful & ~np.isnan(channel.values)))
            channel = replace(channel, values=np.where(doubtful, np.nan, channel.values))
        if channel not in likelihoods.values():
            masked.append(channel)
    note = f"{points} coordinates with a likelihood below {LEAST_LIKELIHOOD:g} are gaps"
    return Contents(tuple(masked), (*contents.notes, note), contents.lines)
