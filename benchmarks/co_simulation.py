"""Real-time factor and error of co-simulation FMUs over 10 s: half of it with a controlled base, half of free motion.

A strip of 20 elements and its reduced model of 8 modes, under each kind of damping, at a large and a small amplitude.
The controller chooses the accelerations of the base every 0.1 s; ``simulate`` then has the same accelerations.

    python -m benchmarks.co_simulation
"""

import argparse
import math
import tempfile
import time
from itertools import product
from pathlib import Path

import casadi as cs
import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Slave, fmi3LogMessageCallback

from ancf_casadi import (
    BaseMotion,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    natural_modes,
    reduce_model,
    simulate,
)
from ancf_casadi.dynamics.base_motion import Piece
from ancf_casadi.export import beam_functions, write_fmu
from benchmarks.beams import steel

STEP, HELD = 0.01, 10  # s; steps of communication
INPUTS = ("base_x_acceleration", "base_y_acceleration", "base_angle_acceleration")
KINDS = ("reduced", "full")
TRAVEL = 1e-4  # largest error


class Held(BaseMotion):
    """Accelerations that are constant for ``HELD`` steps, and zero later."""

    def __init__(self, accelerations):
        self.accelerations = accelerations

    def pieces(self):
        u, u_t, length, found = np.zeros(3), np.zeros(3), HELD * STEP, []
        for k, a in enumerate(self.accelerations):
            found.append(Piece((k + 1) * length, moved(k * length, u, u_t, a)))
            u, u_t = u + length * u_t + length**2 / 2 * a, u_t + length * a
        return *found, Piece(math.inf, moved(len(self.accelerations) * length, u, u_t, 0 * u))


def moved(begin, u, u_t, a):
    return lambda t, _: cs.DM(u) + cs.DM(u_t) * (t - begin) + cs.DM(a) * (t - begin) ** 2 / 2


def drive(path, folder, size, steps):
    """Return the accelerations that the controller chose, the positions of the tip, and the last message."""
    about, said = fmpy.read_model_description(path), []
    references = {variable.name: variable.valueReference for variable in about.modelVariables}
    unit = FMU3Slave(
        guid=about.instantiationToken, unzipDirectory=fmpy.extract(path, folder), modelIdentifier="beam",
        instanceName="beam",
    )  # fmt: skip
    unit.instantiate(loggingOn=True, logMessage=fmi3LogMessageCallback(lambda *given: said.append(given[-1].decode())))
    unit.enterInitializationMode()
    unit.exitInitializationMode()

    def get(*names):
        return np.array(unit.getFloat64([references[name] for name in names]))

    chosen, tips = [], [get("tip_x", "tip_y")]
    for k in range(steps):
        if k % HELD == 0 and k <= steps // 2:
            x, y = tips[-1] - tips[0]
            speed, turning = get("base_x_velocity", "base_angle_velocity")
            wanted = size * (1 if k // 100 % 2 else -1)
            a = (20 * (wanted - x) - 5 * speed, -10 * y, -8 * turning - 20 * y) if k < steps // 2 else (0.0, 0.0, 0.0)
            unit.setFloat64([references[name] for name in INPUTS], list(a))
            chosen.append(a)
        unit.doStep(k * STEP, STEP)
        tips.append(get("tip_x", "tip_y"))
    unit.terminate()
    unit.freeInstance()
    return np.array(chosen), np.array(tips), said[-1]


def main():
    model = Model(steel())
    laws = {
        "rayleigh": RayleighDamping(alpha=0.1, beta=1e-5),
        "quadratic": QuadraticDamping(eta1=0.2, eta2=0.5) + RayleighDamping(beta=1e-6),
        "modal": ModalDamping(natural_modes(model, count=5), (0.01,) * 5) + RayleighDamping(beta=1e-6),
    }
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laws", nargs="+", choices=laws, default=list(laws))
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, help="of the model")
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated time")
    options = parser.parse_args()
    steps = round(options.seconds / STEP)
    print("model    law        travel_mm  error/travel  simulate_s  message")
    for name, kind in product(options.laws, options.kinds):
        law = laws[name]
        functions = reduce_model(model, modes=8, damping=law) if kind == "reduced" else beam_functions(model, law)
        for size in (0.1, 0.01):
            with tempfile.TemporaryDirectory() as folder:
                path = str(Path(folder) / "beam.fmu")
                if size == 0.1:
                    write_fmu(functions, path, kind="co-simulation")
                    content = Path(path).read_bytes()
                Path(path).write_bytes(content)
                accelerations, tips, said = drive(path, folder, size, steps)
            began = time.process_time()
            run = simulate(model, damping=law, base=Held(accelerations), duration=steps * STEP,
                           sample_rate=1 / STEP, tolerance=1e-8)  # fmt: skip
            seconds = time.process_time() - began
            travel = np.ptp(run.tip - run.base[:, :2], axis=0).max()
            error = np.abs(tips - run.tip).max() / travel
            print(f"{kind:8} {name:10} {1e3 * travel:9.1f}  {error:12.1e}  {seconds:10.1f}  {said}", flush=True)
            assert error < TRAVEL


if __name__ == "__main__":
    main()
