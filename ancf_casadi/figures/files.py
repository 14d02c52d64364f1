"""Files of figures."""

from __future__ import annotations

import io

from matplotlib import rc_context
from matplotlib.figure import Figure

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.figures import DOTS_PER_INCH

DATE_FIELDS = {".png": "Software", ".svg": "Date", ".pdf": "CreationDate"}  # metadata that would differ between runs


def figure_bytes(figure: Figure, suffix: str = ".png") -> bytes:
    """Return the content of a PNG, SVG or PDF file with a figure, identical for identical figures."""
    kind = suffix.lower()
    if kind not in DATE_FIELDS:
        raise InputError(f"must end in {', '.join(DATE_FIELDS)}, got {suffix or 'no suffix'!r}", "figure")
    out = io.BytesIO()
    with rc_context({"svg.hashsalt": "ancf-casadi"}):  # a random one would change the bytes
        figure.savefig(out, format=kind[1:], dpi=DOTS_PER_INCH, bbox_inches="tight", metadata={DATE_FIELDS[kind]: None})
    return out.getvalue()
