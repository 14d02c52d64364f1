"""The frames of a video file as grey pictures, with their times."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.video import decoder
from ancf_casadi.support.files import open_file

Picture = NDArray[np.uint8 | np.float32]  # grey levels, by row and column


@dataclass(frozen=True, eq=False)
class Video:
    """A video with its frames as they are decoded."""

    frame_rate: float  # as the file states it, 1/s
    count: int  # of frames, as the file states it
    frames: Iterator[tuple[float, Picture]]  # times, s, and pictures


@contextmanager
def open_video(path: str | Path) -> Iterator[Video]:
    """Open a video file and decode it in another process."""
    with open_file(path):
        pass
    command = [sys.executable, "-P", "-W", "ignore", decoder.__file__, os.path.abspath(path)]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as child:
        try:
            assert child.stdout
            line = child.stdout.readline()
            if not line.startswith(b"{"):
                raise InputError("is no video that can be read, or is damaged", str(path))
            header = json.loads(line)
            rows, columns = header["shape"]
            yield Video(header["rate"], header["count"], _frames(child.stdout, (rows, columns)))
        finally:
            child.kill()


def _frames(stream: IO[bytes], shape: tuple[int, int]) -> Iterator[tuple[float, Picture]]:
    while line := stream.readline():
        content = stream.read(shape[0] * shape[1])
        if len(content) < shape[0] * shape[1]:
            return
        yield float(line), np.frombuffer(content, np.uint8).reshape(shape)
