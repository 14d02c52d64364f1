"""Functions compiled to machine code, where there is a C compiler.

A CasADi Function is evaluated by a virtual machine; as compiled C it runs several times faster.  The program depends on
the structure of the function, not on the numbers it is called with, so that the compiled file is kept and found again
by a hash of the function: in ``ANCF_CASADI_CACHE``, or ``~/.cache/ancf-casadi``.  Only what this module has put there
under its own name is loaded.

Set ``ANCF_CASADI_COMPILE=0`` to do without, and ``CC`` to choose the compiler.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray

FLAGS = ("-O3", "-fno-math-errno", "-fPIC", "-shared", "-ffp-contract=off")
SECONDS = 300  # for one compilation
FORMAT = "1"  # of the cache; to be raised when the same function is to be compiled anew


def interpreted(function: cs.Function) -> cs.Function:
    """Return a function for the virtual machine, as a straight line of scalar operations."""
    return function.expand(function.name(), _differentiability(function))


def compiled(function: cs.Function) -> cs.Function:
    """Return a function and its Jacobian as machine code, or as ``interpreted`` where that cannot be made.

    Functions mapped over the elements stay loops, so that a fine mesh compiles as fast as a coarse one.

    Parameters
    ----------
    function : Function
        What to compile; its name is that of the C function.
    """
    compiler = c_compiler()
    if compiler is None or os.environ.get("ANCF_CASADI_COMPILE") == "0":
        return interpreted(function)
    what = (FORMAT, cs.CasadiMeta.version(), compiler, *FLAGS, platform.machine(), function.serialize())
    key = hashlib.sha256("\0".join(what).encode()).hexdigest()
    library = cache_folder() / f"{function.name()}-{key[:32]}.so"
    if not library.exists():
        generator = cs.CodeGenerator(f"{function.name()}.c")
        generator.add(function)
        if any(function.is_diff_in(k) for k in range(function.n_in())):
            generator.add(function.jacobian())
        if not _compile(compiler, generator.dump(), library):
            return interpreted(function)
    return cs.external(function.name(), str(library), _differentiability(function))


def c_compiler() -> str | None:
    """Return the C compiler: the one in ``CC``, or ``cc`` or ``gcc``; None if there is none."""
    return os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")


def cache_folder() -> Path:
    """Return the folder of compiled functions."""
    given = os.environ.get("ANCF_CASADI_CACHE")
    return Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ancf-casadi"


def _differentiability(function: cs.Function) -> dict[str, list[bool]]:
    return {
        "is_diff_in": [function.is_diff_in(k) for k in range(function.n_in())],
        "is_diff_out": [function.is_diff_out(k) for k in range(function.n_out())],
    }


def _compile(compiler: str, source: str, library: Path) -> bool:
    """Compile a source to a library, which appears as a whole; tell whether it worked."""
    try:
        library.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=library.parent) as folder:
            text, draft = Path(folder) / "source.c", Path(folder) / library.name
            text.write_text(source)
            call = [compiler, *FLAGS, str(text), "-o", str(draft), "-lm"]
            drafts = os.environ | {"TMPDIR": folder}  # which a compiler that is stopped leaves behind
            subprocess.run(call, check=True, capture_output=True, timeout=SECONDS, env=drafts)
            os.replace(draft, library)
    except (OSError, subprocess.SubprocessError):
        return False
    return True


class Buffered:
    """A Function bound to arrays: called, it reads its inputs from them and writes to ``outputs``.

    A call costs half a microsecond besides the work itself.

    Parameters
    ----------
    function : Function
        What to call; its inputs and outputs are dense.
    inputs : array
        Its inputs, real or complex, contiguous, matrices by columns; what they hold when called is what counts.
    """

    def __init__(self, function: cs.Function, *inputs: NDArray[Any]) -> None:
        buffer: Any
        buffer, self._evaluate = function.buffer()
        self._kept = buffer, [array.reshape(-1).view(float) for array in inputs]
        self.outputs = [np.zeros(function.numel_out(k)) for k in range(function.n_out())]
        for k, array in enumerate(self._kept[1]):
            buffer.set_arg(k, array.data)
        for k, array in enumerate(self.outputs):
            buffer.set_res(k, array.data)

    def __call__(self) -> list[NDArray[np.float64]]:
        """Evaluate, and return ``outputs``, the same arrays each time."""
        self._evaluate()
        return self.outputs
