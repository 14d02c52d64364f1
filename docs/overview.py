"""Draw the figure of the README: a large motion of the paper's beam, and Table 11.

Usage: python docs/overview.py RESULTS_DIR, with the folder that ``ancf-casadi reproduce`` wrote.
"""

import json
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ancf_casadi import HarmonicBase, ModalDamping, Model, natural_modes, simulate
from ancf_casadi.figures.files import figure_bytes
from ancf_casadi.support.figures import MEASURED, plain_log_ticks
from problems.paper.inputs import STANDARD_BEAM
from problems.study.drawing import series

LAWS = {"generic": "modal (generic)", "proportional": "Rayleigh (proportional)", "quadratic": "quadratic"}
SWING = HarmonicBase(amplitude=5e-3, frequency=1.876, stop=10.0)


def overview(results: dict) -> Figure:
    """Return the figure."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    shapes, ratios = figure.subplots(1, 2, width_ratios=(1, 1.3))
    model = Model(STANDARD_BEAM)
    law = ModalDamping(natural_modes(model), (0.0100, 0.0028, 0.0028, 0.0023, 0.0030))
    run = simulate(model, damping=law, base=SWING, duration=10.5, sample_rate=200.0)
    arc = np.linspace(0.0, model.beam.length, 80)
    rows = np.arange(len(run.time) - 55, len(run.time), 3)
    for row in rows:
        x, y = 1e3 * np.array([model.interpolation(float(s)) @ run.coordinates[row] for s in arc]).T
        shapes.plot(x, y, color=series(0)["color"], lw=1, alpha=0.25 + 0.75 * (row - rows[0]) / (rows[-1] - rows[0]))
    shapes.set(aspect="equal", xlabel="x, mm", ylabel="y, mm")
    shapes.set_title("A steel strip, 500 × 5 × 0.5 mm, driven 5 mm", fontsize=10)

    modes = np.arange(1, 6)
    comparison = results["damping_comparison"]
    measured = 100 * np.array(comparison["experiment"])
    ratios.semilogy(modes, measured, "s", ms=11, mfc="none", color=MEASURED, label="identified")
    for k, (law, name) in enumerate(LAWS.items()):
        ratios.semilogy(modes, 100 * np.array(comparison[law]), **series(k), label=name)
    ratios.set(xlabel="mode", ylabel="damping ratio, %", xticks=modes, ylim=(0.012, 1.4))
    ratios.set_title("Five modes, one beam, three damping laws", fontsize=10)
    plain_log_ticks(ratios, "y")
    ratios.legend(frameon=False)
    for axes in (shapes, ratios):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
    return figure


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    (Path(__file__).parent / "overview.png").write_bytes(
        figure_bytes(overview(json.loads((folder / "results.json").read_text())))
    )
