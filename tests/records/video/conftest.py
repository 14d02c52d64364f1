"""Rendered videos, whose truth is known."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

RATE = 240.0  # frames per second


@pytest.fixture(scope="session")
def render():
    pytest.importorskip("cv2", reason="needs opencv-python-headless")
    path = Path(__file__).parents[3] / "examples" / "render_strip.py"
    spec = importlib.util.spec_from_file_location("render_strip", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def strip(render, tmp_path):
    """Write a video of a strip that bends as an arc, by default in a small picture; return path and true places."""

    def make(
        frames,
        *,
        name="strip.avi",
        codec="MJPG",
        rate=RATE,
        marks=(18, 32, 46, 60),
        small=True,
        largest=1.05,
        **changes,
    ):
        time = np.arange(frames) / rate
        length, clamp = (200.0, (160.0, 12.0)) if small else (380.0, (320.0, 40.0))
        shapes = render.bending_strip(time, 2.0, largest, length, clamp)
        size = (320, 240) if small else (640, 480)
        path = tmp_path / name
        pictures = render.frames(time, shapes, list(marks), size=size, **changes)
        render.write_video(path, pictures, rate, codec)
        return path, shapes[:, list(marks)]

    return make


@pytest.fixture
def found():
    """Places (k, m, 2) and std (k, m) in a recording, px, rows downwards."""

    def places(recording):
        values = np.stack([channel.values for channel in recording.channels], axis=1).reshape(
            len(recording.time), -1, 3
        )
        return values[..., :2] * [1, -1], values[..., 2]

    return places
