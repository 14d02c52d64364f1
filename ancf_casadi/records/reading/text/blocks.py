r"""A text file as blocks of complete lines.

The lines end in ``\n``, whatever the file uses.  UTF-16 is converted to UTF-8; UTF-8 and Latin-1 stay bytes, because
the numbers are the same in both.
"""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from pathlib import Path

from tqdm import tqdm

from ancf_casadi.exceptions import InputError

BLOCK_BYTES = 4 * 2**20  # bytes
MOST_LINE_BYTES = 2**20  # bytes
MARKS = (
    (codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF32_LE, "utf-32-le"), (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"),
)  # fmt: skip


def text_blocks(path: Path, *, progress: bool = False) -> Iterator[bytes]:
    """Yield blocks of complete lines.

    Raises
    ------
    InputError
        If the file is no text, or has a line of more than 1 MiB.
    """
    with (
        open(path, "rb") as file,
        tqdm(
            total=path.stat().st_size, disable=None if progress else True, delay=1.0, leave=False,
            unit="B", unit_scale=True, desc=path.name,
        ) as bar,
    ):  # fmt: skip
        encoding, mark = _encoding(file.read(4096))
        file.seek(mark)
        decoder = None if encoding == "utf-8" else codecs.getincrementaldecoder(encoding)(errors="replace")
        rest = b""
        while read := file.read(BLOCK_BYTES):
            bar.update(len(read))
            block = rest + (decoder.decode(read).encode(errors="replace") if decoder else read)
            if b"\0" in block:
                raise InputError("is not text, and no other format that is known", str(path))
            end = 1 + max(block.rfind(b"\n"), block.rfind(b"\r", 0, -1))  # a final \r may belong to \r\n
            rest = block[end:]
            if len(rest) > MOST_LINE_BYTES:
                raise InputError(f"has a line of more than {MOST_LINE_BYTES >> 20} MiB, and is no table", str(path))
            if end:
                yield _plain_ends(block[:end])
        if rest:
            yield _plain_ends(rest)


def decoded(block: bytes) -> str:
    """Return a block as text: UTF-8, or Latin-1 if it is not UTF-8."""
    try:
        return block.decode()
    except UnicodeDecodeError:
        return block.decode("latin-1")


def _encoding(start: bytes) -> tuple[str, int]:
    """Return the encoding of a file, and the length of its byte-order mark."""
    for mark, encoding in MARKS:
        if start.startswith(mark):
            return encoding, len(mark)
    half = len(start) // 2
    for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        # share of zero bytes in every other place that tells UTF-16 without a byte-order mark
        if half > 3 and start[first::2].count(0) > 0.8 * half and not start[1 - first :: 2].count(0):
            return encoding, 0
    return "utf-8", 0


def _plain_ends(block: bytes) -> bytes:
    return block.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in block else block
