"""Run the beams that are written for other simulators, and compare their first modes with ours.

    python -m benchmarks.simulators [--programs mujoco,pyelastica,exudyn,newton] [--case NAME]

requires the programs, for instance by ``pip install -e '.[simulators]'`` and ``pip install newton``; those that are not
installed are left out.  Each program runs the written file with its segments and step.  Frequency and damping ratio of
mode 1 are those of ``fit_decay`` after a release in mode 1; the frequencies of modes 2 and 3 are those of ``fit_modes``
after a release in three modes (PyElastica, Newton), of one step (MuJoCo), or of the linear model (Exudyn).
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import io
import math
import runpy
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi import DampingLaw, ModalDamping, Model, QuadraticDamping, RayleighDamping, natural_modes
from ancf_casadi.export import ExportedBeam, write_exudyn, write_mujoco, write_newton, write_pyelastica
from ancf_casadi.export.simulators.segments import poles
from benchmarks.beams import steel
from problems import fit_decay, fit_modes
from problems.decay.laws import Law

CYCLES = 8  # of mode 1


def cases() -> dict[str, tuple[Model, DampingLaw, Law]]:
    """Return model, damping law and law of the decay by name."""
    hanging = Model(steel())
    bent = Model(steel(axis=(1.0, 0.0), natural_curvature=2.0, tip_mass=2e-3))
    modal = ModalDamping(natural_modes(hanging, count=3), (0.0100, 0.0028, 0.0028))
    return {
        "rayleigh": (hanging, RayleighDamping(alpha=0.15, beta=1e-4), "linear"),
        "bent": (bent, RayleighDamping(alpha=0.15, beta=1e-4), "linear"),
        "modal": (hanging, modal, "linear"),
        "drag": (hanging, QuadraticDamping(eta1=0.1, eta2=0.2), "quadratic"),
    }


def in_mujoco(path: Path, found: ExportedBeam) -> tuple[Any, Any, Any]:
    """Return time and displacement of the tip, and the frequencies of the linearised step."""
    import mujoco

    there = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(there)
    mujoco.mj_resetDataKeyframe(there, data, 0)
    mujoco.mj_forward(there, data)
    rest, step = data.sensor("tip").data.copy(), np.zeros((2 * there.nv, 2 * there.nv))
    mujoco.mjd_transitionFD(there, data, 1e-6, True, step, None, None, None)
    mujoco.mj_resetDataKeyframe(there, data, 1)
    samples = []
    for _ in range(round(CYCLES / found.frequencies[0] / found.step)):
        mujoco.mj_step(there, data)
        samples.append(data.sensor("tip").data - rest)
    return found.step * np.arange(len(samples)), np.array(samples), poles(step, found.step, 3)[0]


def in_script(path: Path, found: ExportedBeam) -> tuple[Any, Any, Any]:
    """Return the same of a script; its frequencies are fitted later, except in Exudyn."""
    there = runpy.run_path(str(path))
    every = max(1, round(2e-3 / found.step))
    duration, size = CYCLES / found.frequencies[0], found.amplitude
    if found.format == "exudyn":
        values = np.sort(np.abs(there["build"](0.0)[0].ComputeODE2Eigenvalues()[0]))[:3]
        rest, motion = there["run"](0.0 + 10 * found.step, 0.0)[0, 1:], there["run"](duration, every=every)
        return motion[:, 0], motion[:, 1:] - rest, np.sqrt(values) / (2 * math.pi)
    rest = there["run"](0.0, (0.0, 0.0, 0.0))[0, 1:]
    three = there["run"](duration / 2, (size, size / 4, size / 8), every=every)
    fits = fit_modes(three[:, 0], _along(three[:, 1:] - rest), modes=3).fits
    motion = there["run"](duration, every=every)
    return motion[:, 0], motion[:, 1:] - rest, np.array([fit.frequency for fit in fits])


PROGRAMS: dict[str, tuple[str, str, Callable[..., ExportedBeam], Callable[..., Any]]] = {
    "mujoco": ("mujoco", ".xml", write_mujoco, in_mujoco),
    "pyelastica": ("elastica", ".py", write_pyelastica, in_script),
    "exudyn": ("exudyn", ".py", write_exudyn, in_script),
    "newton": ("newton", ".py", write_newton, in_script),
}


def main() -> None:
    """Print one row per case and program."""
    parser = argparse.ArgumentParser(description="Run the beams that are written for other simulators.")
    parser.add_argument("--programs", default=",".join(PROGRAMS), help="separated by commas")
    parser.add_argument("--case", choices=tuple(cases()), help="all if not given")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    heads = ("case", "program", "segments", "step, ms", "f1", "f2", "f3", "ratio 1", "CPU s")
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for name, (model, law, decay) in cases().items():
        for program in options.programs.split(","):
            module, end, write, run = PROGRAMS[program]
            if importlib.util.find_spec(module) is None or options.case not in (None, name):
                continue
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / f"beam_{program}{end}"
                found = write(model, path, damping=law)
                began = time.process_time()
                with contextlib.redirect_stdout(io.StringIO()):
                    instants, motion, frequencies = run(path, found)
                seconds = time.process_time() - began
            _print(name, program, found, fit_decay(instants, _along(motion), law=decay), frequencies, law, seconds)


def _print(name: str, program: str, found: ExportedBeam, fit: Any, frequencies: Any, law: Any, seconds: float) -> None:
    """Print the relative errors of a run, per cent."""
    reached = np.array([fit.frequency, *frequencies[1:]])
    errors = [f"{error:+.2f} %" for error in 100 * (reached / found.frequencies - 1)]
    if isinstance(law, QuadraticDamping):
        size = 0.95 * found.amplitude
        own = law.eta1 / (4 * math.pi * fit.frequency) + 4 * law.eta2 * size / (3 * math.pi)
        eta1, eta2 = fit.estimates["eta1"], fit.estimates["eta2"]
        ratio = (eta1 / (4 * math.pi * fit.frequency) + 4 * eta2 * size / (3 * math.pi)) / own
    else:
        ratio = fit.damping_ratio / found.damping_ratios[0]
    row = [
        name,
        program,
        found.segments,
        f"{1e3 * found.step:g}",
        *errors,
        f"{100 * (ratio - 1):+.2f} %",
        f"{seconds:.1f}",
    ]
    print("| " + " | ".join(map(str, row)) + " |", flush=True)


def _along(motion: Any) -> Any:
    """Return the component of a motion of the tip in its own direction."""
    return motion @ np.linalg.svd(motion[:: max(1, len(motion) // 2000)], full_matrices=False)[2][0]


if __name__ == "__main__":
    main()
