"""Time of the reduced model in C (target: 10 ms for 1 s of mode 5); run like ``test_speed.py``, ``-s`` shows errors."""

import ctypes
import shutil
import subprocess
from functools import cache

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import ModalDamping, Model, QuadraticDamping, natural_modes, reduce_model, simulate
from ancf_casadi.reduction.forces import BASE_SIZE
from ancf_casadi.reduction.stepping import project
from benchmarks.beams import DAMPING_RATIOS, steel
from docs.accuracy import bent

SAMPLES = 500  # of 1 s
PROGRAM = """
#include <string.h>
typedef long long int casadi_int;
int reduced_step(const double** arg, double** res, casadi_int* iw, double* w, int mem);
void run(double* x, const double* p, double h, int steps, int every, double* path) {
  static double w[WORK], base[27];
  static casadi_int iw[WORK];
  const double* arg[WORK];
  double* res[WORK];
  double next[2 * M];
  int k;
  for (k = 1; k <= steps; ++k) {
    arg[0] = x; arg[1] = x + M; arg[2] = base; arg[3] = p; arg[4] = &h;
    res[0] = next; res[1] = next + M;
    reduced_step(arg, res, iw, w, 0);
    memcpy(x, next, sizeof(next));
    if (k % every == 0) memcpy(path + (k / every - 1) * 2 * M, x, sizeof(next));
  }
}
"""


@cache
def full(law_name):
    """1 s of the full beam, released from a load that bends it like mode 5 with a tip deflection of 0.5 mm."""
    model = Model(steel())
    modes = natural_modes(model)
    modal = ModalDamping(modes, DAMPING_RATIOS)
    law = {"undamped": None, "modal": modal, "drag": modal + QuadraticDamping(eta2=0.11)}[law_name]
    start = bent(modes, 4, 0.5e-3)
    return law, simulate(
        model, damping=law, start=start, duration=1.0, sample_rate=SAMPLES, method="radau", tolerance=1e-9
    )


@pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
@pytest.mark.parametrize("flags", [("-O2",), ("-O3", "-march=native", "-fno-math-errno")], ids=" ".join)
@pytest.mark.parametrize("law", ["undamped", "modal", "drag"])
@pytest.mark.parametrize("modes", [5, 8])
def test_one_second_of_mode_5(benchmark, tmp_path, modes, law, flags):
    damping, full_run = full(law)
    reduced = reduce_model(full_run.model, modes=modes, damping=damping)
    generator = cs.CodeGenerator("reduced.c")
    generator.add(reduced.step)
    generator.generate(f"{tmp_path}/")
    work = max(reduced.step.sz_w(), reduced.step.sz_iw(), reduced.step.sz_arg(), reduced.step.sz_res()) + 1
    (tmp_path / "run.c").write_text(f"#define M {modes}\n#define WORK {work}\n{PROGRAM}")
    sources = [str(tmp_path / name) for name in ("reduced.c", "run.c")]
    subprocess.run(["gcc", *flags, "-fPIC", "-shared", *sources, "-o", str(tmp_path / "run.so"), "-lm"], check=True)
    library = ctypes.CDLL(str(tmp_path / "run.so"))
    steps = SAMPLES * int(np.ceil(10 * reduced.modes.frequencies[4] / SAMPLES))  # at least 10 per period of mode 5
    x0, p, path = (
        project(reduced, full_run.state(0), np.zeros(BASE_SIZE)),
        reduced.values,
        np.zeros((SAMPLES, 2 * modes)),
    )

    def run():
        x = x0.copy()
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (x, p, path)]
        library.run(*pointers[:2], ctypes.c_double(1 / steps), steps, steps // SAMPLES, pointers[2])

    benchmark(run)
    tip = reduced.tip(path[:, :modes].T, np.zeros((BASE_SIZE, SAMPLES))).full().T
    error = np.linalg.norm(tip - full_run.tip[1:], axis=1)
    text = ", ".join(f"{error[: round(t * SAMPLES)].max() / 0.5e-3:.1e} in {t:g} s" for t in (0.1, 1.0))
    least = f"{1e3 * benchmark.stats['min']:.1f} ms, " if benchmark.stats else ""
    print(f"\n{modes} modes, {law}, {' '.join(flags)}: {least}{steps} steps, error of the amplitude {text}")
    assert error.max() < 0.2 * 0.5e-3
