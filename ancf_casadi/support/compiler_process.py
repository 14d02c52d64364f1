"""Run C compilers side by side and load the libraries that they write, in a process of their own.

    python compiler_process.py COMMANDS

The argument is a JSON object with the command of a compiler for each library.  A compiler may hang, and a damaged
library may end the process that loads it.  This process leads a process group of its own, compilers included, and ends
it as a whole once its standard input closes: when its parent stops waiting, or ends for any reason.  The exit code is 0
if all libraries can be loaded; otherwise the output says why not.
"""

import ctypes
import json
import os
import signal
import subprocess
import sys
import threading


def main() -> int:
    """Compile and load the libraries of the argument, and return the exit code."""
    commands: dict[str, list[str]] = json.loads(sys.argv[1])
    compilers: list[subprocess.Popen[bytes]] = []
    threading.Thread(target=_end_with_parent, args=[compilers], daemon=True).start()
    try:
        for command in commands.values():
            compilers.append(subprocess.Popen(command, stdin=subprocess.DEVNULL))
    except OSError as error:
        print(error)
        for compiler in compilers:
            compiler.kill()
        return 1
    for code in [compiler.wait() for compiler in compilers]:
        if code:
            return code
    for library in commands:
        try:
            ctypes.CDLL(library)
        except OSError as error:
            print(f"the library that it wrote cannot be loaded ({error})")
            return 1
    return 0


def _end_with_parent(compilers: "list[subprocess.Popen[bytes]]") -> None:
    """Wait for the end of standard input, and end the process group."""
    os.read(0, 1)  # not through sys.stdin, whose lock Python takes when it ends
    if sys.platform != "win32":
        os.killpg(0, signal.SIGKILL)
    for compiler in compilers:
        compiler.kill()
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
