"""Errors and costs of tracks in rendered videos, and of what is fitted to them.

    .venv/bin/python -m benchmarks.video_tracks               # also Lucas-Kanade: OpenCV, and pyidi if installed
    .venv/bin/python -m benchmarks.video_tracks --chain 24    # to frequency, damping ratio and modulus, 24 seeds

A strip with six marks turns its end by 60 degrees to either side at 2 Hz: 640 x 480 pixels, 240 frames per second,
noise of 2 grey levels, exposure of a quarter of a frame, light that fades by a fifth, and each mark hidden for 5 % of
the frames or never.  H.264 (constant rate factor 18) needs the package av.  Errors count where the mark is seen and the
method says so.  In the videos of the chain, the strip is at random places within the blocks of 8 pixels of Motion JPEG,
whose errors follow the place.
"""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
from functools import partial
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from scipy.stats import binomtest

from ancf_casadi import Model, RayleighDamping, simulate, static_equilibrium, track_video
from benchmarks.beams import steel
from benchmarks.clock import processor_time
from examples.render_strip import bending_strip, frames, write_video
from problems import BeamFit, DecayFit, MarkerRecord, fit_beam, fit_decay

RATE = 240.0
PATTERNS = ("dots", "checkers", "texture")
MARKS = [10, 20, 30, 40, 50, 60]


def write_h264(path, pictures):
    import av

    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=int(RATE))
        stream.pix_fmt, stream.options = "yuv420p", {"crf": "18"}
        stream.height, stream.width = pictures[0].shape
        for picture in pictures:
            frame = av.VideoFrame.from_ndarray(picture, format="gray").reformat(format="yuv420p")
            file.mux(stream.encode(frame))
        file.mux(stream.encode())


def read(path):
    video = cv2.VideoCapture(str(path))
    while (found := video.read())[0]:
        yield cv2.cvtColor(found[1], cv2.COLOR_BGR2GRAY)


def ours(path, first):
    recording = track_video(path, markers=first)
    values = np.stack([channel.values for channel in recording.channels], axis=1).reshape(len(recording.time), -1, 3)
    return values[..., :2] * [1, -1], values[..., 2]


def lucas_kanade(path, first):
    """Pyramidal, from frame to frame, with a check backwards."""
    pictures = read(path)
    before, found = next(pictures), [first.astype(np.float32)]
    track = partial(cv2.calcOpticalFlowPyrLK, winSize=(21, 21), maxLevel=3)
    for picture in pictures:
        points, _, _ = track(before, picture, found[-1], found[-1].copy())
        back, _, _ = track(picture, before, points, points.copy())
        points[np.hypot(*(back - found[-1]).T) > 0.5] = np.nan
        found.append(points)
        before = picture
    return np.array(found), None


def pyidi_lucas_kanade(path, first):
    """Against the first picture, translation alone."""
    import pyidi

    pictures = np.array(list(read(path)))
    with tempfile.TemporaryDirectory() as folder:
        video = pyidi.VideoReader(pictures, root=folder, fps=RATE)
        method = pyidi.LucasKanade(video)
        method.configure(roi_size=(19, 19), verbose=0, show_pbar=False)
        method.set_points(np.rint(first[:, ::-1]))
        moved = method.get_displacements(autosave=False)
    return (first[:, None] + moved[..., ::-1]).transpose(1, 0, 2), None


def compare(count, patterns):
    instants = np.arange(count) / RATE
    shapes = bending_strip(instants, 2.0, 1.05, 380.0, (320.0, 40.0))
    true = shapes[:, MARKS]
    rng = np.random.default_rng(0)
    covered = [(m, b, b + 10) for m in range(6) for b in (40 + np.arange(0, count - 60, 200) + rng.integers(0, 150))]
    seen = np.ones(true.shape[:2], dtype=bool)
    for mark, begin, end in covered:
        seen[begin - 1 : end + 1, mark] = False
    methods = [ours, lucas_kanade, *([pyidi_lucas_kanade] if importlib.util.find_spec("pyidi") else [])]
    codecs = [("MJPG", "avi"), ("mp4v", "mp4"), *([("H.264", "mp4")] if importlib.util.find_spec("av") else [])]
    print("marks     codec  covered  method              rms px  largest px  lost  std/rms  CPU s")
    with tempfile.TemporaryDirectory() as folder:
        for pattern, hidden in product(patterns, (False, True)):
            bars = covered if hidden else []
            pictures = list(frames(instants, shapes, MARKS, pattern=pattern, drift=-0.2, covered=bars))
            for codec, suffix in codecs:
                path = Path(folder) / f"strip.{suffix}"
                write_h264(path, pictures) if codec == "H.264" else write_video(path, pictures, RATE, codec)
                for method in methods:
                    began = processor_time()
                    places, std = method(path, true[0])
                    cost = processor_time() - began
                    error = np.where(seen[..., None] | (not hidden), places - true, np.nan)
                    rms = np.sqrt(np.nanmean(error**2))
                    ratio = "" if std is None else f"{np.sqrt(np.nanmean(std[seen] ** 2)) / rms:.2f}"
                    lost = np.isnan(places[..., 0])[seen].sum()
                    print(
                        f"{pattern:9s} {codec:6s} {'yes' if hidden else 'no':8s} {method.__name__:18s} {rms:7.3f} "
                        f"{np.nanmax(abs(error)):11.2f} {lost:5d} {ratio:>8s} {cost:6.1f}",
                        flush=True,
                    )


def filmed(path, run, seed, places):
    """Write a video of a strip at a random place and scale; return places (k, m, 2) of its marks, clamp and scale."""
    rng = np.random.default_rng(seed)
    points = np.linspace(0.0, 0.5, 41)
    positions = np.stack([run.position(s) for s in points], axis=1) * [1, -1] / 1.25e-3
    scale = rng.uniform(0.98, 1.02)
    clamp = 60.0 - scale * positions[:, places].min(axis=(0, 1)) + rng.uniform(0.0, 8.0, 2)
    shapes = clamp + positions * scale
    size = np.ceil(shapes[:, places].max(axis=(0, 1))).astype(int) + 60
    write_video(path, frames(run.time, shapes, places, size=tuple(size.tolist()), seed=seed), RATE)
    return shapes[:, places], clamp, 1.25e-3 / scale


def chain(seeds, count):
    """Fit small decays, after mode 2 has died away, and large motions, to tracks of a filmed steel strip."""
    model, law = Model(steel(8)), RayleighDamping(alpha=0.15, beta=1e-3)
    for force in (1.1e-3, 3e-3, 8.6e-3, 0.03):
        start = static_equilibrium(model, tip_force=(force, 0.0))
        run = simulate(model, damping=law, start=start, duration=(count - 1) / RATE, sample_rate=RATE, tolerance=1e-8)
        late = run.time > 1.0  # s; mode 2 has died away
        exact = fit_decay(run.time[late], run.tip[late, 0])
        small = force < 0.01
        names = ("frequency", "damping_ratio") if small else ("elastic_modulus",)
        true = {name: exact.estimates[name] if small else 210e9 for name in names}
        errors: dict[str, list[float]] = {name: [] for name in names}
        within = dict.fromkeys(names, 0)
        for seed in range(seeds):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "strip.avi"
                marks, clamp, scale = filmed(path, run, seed, [40] if small else [16, 24, 32, 40])
                ruler = (*clamp, clamp[0], clamp[1] + 400, 400 * scale)
                recording = track_video(path, markers=marks[0], ruler=ruler, clamp=clamp)
            values = np.stack([one.values for one in recording.channels], axis=1).reshape(count, -1, 3)
            if small:
                fit: DecayFit | BeamFit = fit_decay(recording.time[late], values[late, -1, 0])
            else:
                record = MarkerRecord(recording.time, values[..., :2], points=[0.2, 0.3, 0.4, 0.5], start=start)
                fit = fit_beam(
                    Model(steel(8, elastic_modulus=190e9)),
                    record,
                    RayleighDamping(alpha=0.1, beta=5e-4),
                    unknowns=["elastic_modulus"],
                )
            for name in names:
                low, high = fit.intervals()[name]
                within[name] += bool(low <= true[name] <= high)
                errors[name].append(fit.estimates[name] / true[name] - 1)
        print(f"motion of the tip by {np.ptp(marks[:, -1, 0]):.0f} px")
        for name in names:
            low, high = 100 * np.array(binomtest(within[name], seeds).proportion_ci(0.95, "exact"))
            print(
                f"{name:15s} relative error {np.abs(errors[name]).max():7.1e}, mean {np.mean(errors[name]):8.1e}; "
                f"in {within[name]} of {seeds} intervals of 95 %, or {low:.0f} to {high:.0f} % of all",
                flush=True,
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--patterns", nargs="+", choices=PATTERNS, default=PATTERNS, help="of the marks")
    parser.add_argument("--chain", type=int, metavar="SEEDS")
    options = parser.parse_args()
    chain(options.chain, options.frames) if options.chain else compare(options.frames, options.patterns)


if __name__ == "__main__":
    main()
