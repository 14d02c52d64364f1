"""Recognition of the format of a file by its first bytes, and the choice of its reader."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, Recording
from ancf_casadi.records.layout import NO_LAYOUT, TableLayout, chosen_channels
from ancf_casadi.records.reading.arrays import read_hdf5, read_matlab, read_npy, read_npz, read_wav
from ancf_casadi.records.reading.c3d import read_c3d
from ancf_casadi.records.reading.labview import read_lvm, read_tdms
from ancf_casadi.records.reading.text.reader import read_text
from ancf_casadi.records.reading.uff import read_uff
from ancf_casadi.support.files import open_file
from ancf_casadi.support.inputs import LARGEST_TIME

SIGNATURE_BYTES = 1024
HDF5 = b"\x89HDF\r\n\x1a\n"
UNIVERSAL = re.compile(rb"\s*\r?\n? {4}-1 *\r?\n *\d+", re.ASCII)
OTHER_FORMATS = {
    b"\x1f\x8b": "is compressed with gzip; unpack it first",
    b"\xd0\xcf\x11\xe0": "is an Excel workbook; save the sheet as CSV",
    b"PAR1": "is a Parquet file; save the table as CSV",
    b"TDSh": "is the index of a TDMS file; name the .tdms file",
    b"%PDF": "is a PDF document; export the data as CSV",
}


def read_contents(path: str | Path, *, layout: TableLayout = NO_LAYOUT, progress: bool = False) -> Recording:
    """Read all columns of a file of at most 1 GiB."""
    with open_file(path, 2**30) as file:
        start = file.read(SIGNATURE_BYTES)
        file.seek(0)
        recording = _read(Path(path), file, start, layout, progress)
    if not recording.channels:
        raise InputError("has no channels of numbers", str(path))
    channels = chosen_channels(recording.channels, layout, str(path))
    return replace(recording, channels=tuple(map(_within_range, channels)))


def _within_range(channel: RecordedChannel) -> RecordedChannel:
    """Return a channel, with a fault if a number has no finite square."""
    largest = np.abs(channel.values).max(initial=0.0, where=np.isfinite(channel.values))
    fault = f"has numbers beyond {LARGEST_TIME:g}, such as {largest:g}" if largest > LARGEST_TIME else ""
    return replace(channel, fault=channel.fault or fault)


def _read(path: Path, file: BinaryIO, start: bytes, layout: TableLayout, progress: bool) -> Recording:
    """Read an open file; readers in another process, and that of universal files, open it again."""
    suffix = path.suffix.lower()
    for signature, message in OTHER_FORMATS.items():
        if start.startswith(signature):
            raise InputError(message, str(path))
    if start.startswith(HDF5) or start[512:].startswith(HDF5):
        return read_hdf5(path)
    if start.startswith(b"MATLAB 5.0 MAT-file") or suffix == ".mat":
        return read_matlab(path)
    if start.startswith(b"PK\x03\x04"):
        if suffix in (".xlsx", ".xlsm", ".ods"):
            raise InputError("is a workbook; save the sheet as CSV", str(path))
        return read_npz(file, path)
    if start.startswith(b"\x93NUMPY"):
        return read_npy(file, path)
    if start.startswith(b"TDSm"):
        return read_tdms(file, path)
    if suffix == ".c3d" or (len(start) == SIGNATURE_BYTES and start[1] == 0x50 and start[0] < 10 and b"\0" in start):
        return read_c3d(path)
    if start[:4] in (b"RIFF", b"RIFX", b"RF64") and start[8:12] == b"WAVE":
        return read_wav(file, path)
    if start.startswith(b"LabVIEW Measurement"):
        return read_lvm(file, path)
    if UNIVERSAL.match(start):
        return read_uff(path)
    return read_text(file, path, layout, progress=progress)
