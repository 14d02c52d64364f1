"""Run a C compiler and load the library that it writes, in a process of their own.

    python compiler_process.py LIBRARY COMPILER [ARGUMENT ...]

A compiler may hang, and a damaged library may end the process that loads it.  This process leads a process group of its
own, compiler included, and ends it as a whole once its standard input closes: when its parent stops waiting, or ends
for any reason.  The exit code is 0 if the library can be loaded; otherwise the output says why not.
"""

import ctypes
import os
import signal
import subprocess
import sys
import threading


def main() -> int:
    """Compile and load the library of the arguments, and return the exit code."""
    library, *call = sys.argv[1:]
    try:
        compiler = subprocess.Popen(call, stdin=subprocess.DEVNULL)
    except OSError as error:
        print(error)
        return 1
    threading.Thread(target=_end_with_parent, args=[compiler], daemon=True).start()
    if code := compiler.wait():
        return code
    try:
        ctypes.CDLL(library)
    except OSError as error:
        print(f"the library that it wrote cannot be loaded ({error})")
        return 1
    return 0


def _end_with_parent(compiler: "subprocess.Popen[bytes]") -> None:
    """Wait for the end of standard input, and end the process group."""
    os.read(0, 1)  # not through sys.stdin, whose lock Python takes when it ends
    if sys.platform != "win32":
        os.killpg(0, signal.SIGKILL)
    compiler.kill()
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
