"""Time and memory to read text files: limits 10 s for 3 million lines, and 1.5 GB for 10 million."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ancf_casadi.records.measurement import Measurement

MOST_MEGABYTES = 1500.0
LAYOUTS = {
    "plain": ("time_ms,x_mm,y_mm\n", lambda t, x: f"{t:.1f},{x:.6f},{-x:.6f}\n"),
    "decimal commas and gaps": (
        "Zeit (ms);x (mm);y (mm)\n",
        lambda t, x: f"{t:.1f};{x:.6f};{-x:.6f}\n".replace(".", ",") if t % 1 else f"{t:.0f};;\n",
    ),
    "ISO times": (
        "time,x_mm,y_mm\n",
        lambda t, x: f"2024-05-17T09:{int(t) // 60_000:02d}:{t / 1e3 % 60:07.4f},{x:.6f},{-x:.6f}\n",
    ),
}


def write(path: Path, layout: str, count: int) -> Path:
    head, row = LAYOUTS[layout]
    steps = np.arange(count)
    values = np.sin(steps / 300.0)
    with open(path, "w") as file:
        file.write(head)
        file.writelines(row(t, x) for t, x in zip((steps / 10.0).tolist(), values.tolist(), strict=True))
    return path


@pytest.mark.parametrize("lines", [1000, 3_000_000])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_reading(benchmark, tmp_path, layout, lines):
    path = write(tmp_path / "record.csv", layout, lines)
    record = benchmark.pedantic(Measurement.from_file, args=(path, 2), rounds=1)
    assert record.time[-1] == pytest.approx((lines - 1) / 1e4, abs=1e-6)


@pytest.mark.parametrize("lines", [1000, 10_000_000])
def test_memory(tmp_path, lines):
    path = write(tmp_path / "record.csv", "plain", lines)
    code = (
        "import resource, sys; from ancf_casadi.records.measurement import Measurement; "
        "record = Measurement.from_file(sys.argv[1], 2); assert len(record.time) == int(sys.argv[2]); "
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(path), str(lines)], capture_output=True, text=True, check=True
    )
    assert float(run.stdout) < MOST_MEGABYTES
