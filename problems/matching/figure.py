"""Figure of a matched beam."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ancf_casadi.estimation.figures import saved_figure
from ancf_casadi.mechanics.beam import LUMPED
from ancf_casadi.plot import properties_figure
from ancf_casadi.support.arrays import Array
from problems.matching.result import FrequencyMatch


def match_figure(matches: Mapping[str, FrequencyMatch]) -> Figure:
    """Draw the changes of the properties along the beam, with the ranges that the data leave open.

    Of several matches the estimates are drawn.
    """
    if len(matches) > 1:
        return saved_figure(matches)
    (match,) = matches.values()
    known, n = match.identifiability, match.beam.elements
    ends = np.column_stack([known.factors, known.factors]) if match.out_of_reach else known.spread
    ranges: dict[str, list[Array]] = {}
    for name, pair in zip(known.factor_names, ends - 1, strict=True):
        if name not in LUMPED:
            ranges.setdefault(name.partition("[")[0], []).append(pair)
    spread = {name: np.array(pairs * n if len(pairs) == 1 else pairs) for name, pairs in ranges.items()}
    return properties_figure(match.matching.space.beam, match.beam, spread)
