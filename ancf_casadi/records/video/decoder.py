"""Decoding of a video, in a process of its own.

A damaged video can crash FFmpeg with the whole process, and FFmpeg prints warnings.  This file therefore runs as a
script and imports nothing of the toolkit.  It prints one line of JSON with frame rate, number of frames and size, and
then for each frame its time (s) on a line, and its grey levels.  ``frames`` is the other side.
"""

from __future__ import annotations

import importlib
import json
import os
import sys

CONTAINERS = "avi,mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,mpegts,mpeg,mpegvideo,asf,flv,ogg,mxf,dv,gif"
SAFE = f"protocol_whitelist;file|format_whitelist;{CONTAINERS}"  # no playlist, and nothing from a network
MAX_MEMORY = 4 * 2**30  # bytes


def limit() -> None:
    """Limit the memory of this process, where the system can."""
    try:
        import resource
    except ImportError:
        return
    for kind, maximum in ((resource.RLIMIT_AS, MAX_MEMORY), (resource.RLIMIT_CORE, 0)):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (maximum if hard == resource.RLIM_INFINITY else min(maximum, hard), hard))


def main(path: str) -> None:
    """Print the frames of a video; nothing if it cannot be read."""
    limit()
    os.environ.update(OPENCV_FFMPEG_LOGLEVEL="-8", OPENCV_LOG_LEVEL="SILENT", OPENCV_FFMPEG_CAPTURE_OPTIONS=SAFE)
    cv2 = importlib.import_module("cv2")
    cv2.setNumThreads(1)
    video = cv2.VideoCapture(path, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    header = {"rate": video.get(cv2.CAP_PROP_FPS), "count": int(video.get(cv2.CAP_PROP_FRAME_COUNT)), "shape": None}
    while True:
        has_frame, frame = video.read()
        if not has_frame:
            return
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        if header["shape"] is None:
            header["shape"] = grey.shape
            sys.stdout.buffer.write(json.dumps(header).encode() + b"\n")
        if grey.shape != header["shape"]:
            return
        time = 1e-3 * video.get(cv2.CAP_PROP_POS_MSEC)
        sys.stdout.buffer.write(f"{time:.9f}\n".encode() + grey.tobytes())


if __name__ == "__main__":
    main(sys.argv[1])
