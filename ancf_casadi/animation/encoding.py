"""Files with moving pictures."""

from __future__ import annotations

import base64
import contextlib
import io
import itertools
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
from matplotlib import rcParams
from matplotlib.colors import to_rgb
from PIL import Image

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.figures import COMPUTED, MEASURED, SERIES

SUFFIXES = (".gif", ".mp4", ".html")
TRANSPARENT = 255  # colour that stands for the one below
PLAYER = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Motion of a beam</title></head><body>
<figure id="motion" style="margin: 0; width: {width}px; max-width: 100%">
<img alt="Motion of a beam" style="width: 100%; background-size: 100% 100%">
<div style="display: flex; gap: .5em"><button type="button" style="width: 5em">Pause</button>
<input type="range" min="0" max="{last}" value="0" style="flex: 1" aria-label="picture"></div>
</figure>
<script>(() => {{
  const pictures = [{pictures}];
  const box = document.getElementById("motion"); box.removeAttribute("id");
  const image = box.querySelector("img"), button = box.querySelector("button"), range = box.querySelector("input");
  const address = k => "data:{kind};base64," + pictures[k];
  let timer = 0;
  const show = k => {{ range.value = k; image.src = address(k); }};
  const play = () => {{ timer = setInterval(() => show((+range.value + 1) % pictures.length), {delay}); }};
  const stop = () => {{ clearInterval(timer); timer = 0; }};
  const turn = () => {{ timer ? stop() : play(); button.textContent = timer ? "Pause" : "Play"; }};
  button.onclick = turn;
  range.oninput = () => {{ if (timer) turn(); show(+range.value); }};
  image.style.backgroundImage = `url(${{address(0)}})`;  // below pictures that hold differences from the first
  show(0);
  play();
}})();</script></body></html>
"""


def check_animation(path: str | Path) -> str:
    """Return the suffix of a file with moving pictures that can be made here."""
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}", str(path))
    if suffix == ".mp4":
        _ffmpeg()
    return suffix


def encoded(pictures: Iterator[Image.Image], suffix: str, delay: float, background: Image.Image | None = None) -> bytes:
    """Return the content of a file with pictures of one size, each shown for a time (s).

    Those over a background, of which one picture is given, have its colours too.
    """
    if suffix == ".mp4":
        return _mp4(pictures, delay)
    if suffix == ".gif" or background is None:
        pictures = _in_few_colours(pictures, background)
    first = next(pictures)
    if suffix == ".html":
        return _page(first, pictures, delay)
    out = io.BytesIO()
    first.save(out, "GIF", save_all=True, append_images=pictures, duration=round(1e3 * delay), loop=0)
    return out.getvalue()


def _in_few_colours(pictures: Iterator[Image.Image], background: Image.Image | None) -> Iterator[Image.Image]:
    """Yield pictures in the colours of the lines, each on white, and those of the background."""
    inks = np.array([to_rgb(ink) for ink in ("black", MEASURED, COMPUTED, *(ink for ink, *_ in SERIES))])
    shades = 1.0 - np.linspace(0.0, 1.0, 12)[:, None, None] * (1.0 - inks)
    colours = np.unique(np.round(255 * shades).astype(np.uint8).reshape(-1, 3), axis=0)
    own = b""
    if background is not None:
        some = background.quantize(TRANSPARENT - len(colours))
        own = bytes(some.getpalette() or [])
    palette = Image.new("P", (1, 1))
    palette.putpalette((colours.tobytes() + own).ljust(3 * (TRANSPARENT + 1), b"\xff"))  # PNG files need all
    for one in pictures:
        yield one.quantize(palette=palette, dither=Image.Dither.NONE)


def _page(first: Image.Image, others: Iterator[Image.Image], delay: float) -> bytes:
    """Return an HTML page that holds all pictures; those of few colours as their differences from the first."""
    kind = "PNG" if first.mode == "P" else "JPEG"
    texts: list[str] = []
    for one in itertools.chain([first], others):
        if texts and kind == "PNG":
            one.paste(TRANSPARENT, mask=Image.fromarray(np.asarray(one) == np.asarray(first)))
        out = io.BytesIO()
        one.save(out, kind, **({"transparency": TRANSPARENT} if kind == "PNG" else {}))
        texts.append(base64.b64encode(out.getvalue()).decode())
    return PLAYER.format(
        width=first.width, last=len(texts) - 1, delay=round(1e3 * delay), kind=f"image/{kind.lower()}",
        pictures=",".join(f'"{text}"' for text in texts),
    ).encode()  # fmt: skip


def _ffmpeg() -> str:
    """Return the path of ffmpeg: that of matplotlib's settings, or of imageio-ffmpeg."""
    found: str | None = shutil.which(rcParams["animation.ffmpeg_path"])
    with contextlib.suppress(ImportError, RuntimeError):
        found = found or import_module("imageio_ffmpeg").get_ffmpeg_exe()
    if not found:
        raise InputError("needs ffmpeg, or the package imageio-ffmpeg; or write .gif or .html", ".mp4")
    return found


def _mp4(pictures: Iterator[Image.Image], delay: float) -> bytes:
    first = next(pictures)
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as messages:
        path = Path(folder) / "motion.mp4"
        given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{first.width}x{first.height}", "-r", f"{1 / delay:.9f}"]
        command = [_ffmpeg(), "-loglevel", "error", *given, "-i", "-", "-an", "-pix_fmt", "yuv420p", str(path)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=messages, stderr=messages) as process:
            assert process.stdin is not None
            with contextlib.suppress(BrokenPipeError):  # the message below tells why
                for one in itertools.chain([first], pictures):
                    process.stdin.write(one.tobytes())
        if process.returncode or not path.exists():
            messages.seek(0)
            *_, last = ["no message", *messages.read().decode(errors="replace").strip().splitlines()]
            raise InputError(f"ffmpeg failed: {last}", ".mp4")
        return path.read_bytes()
