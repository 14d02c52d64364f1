"""The printed numbers of ``paper.toml`` that tests and benchmarks share.

SI units; frequencies are in Hz, damping ratios are fractions, eta2 is in 1/m.

References
----------
J. W. Lee, H. W. Kim, H. C. Ku, W. S. Yoo, "Comparison of external damping models in a large deformation problem",
Journal of Sound and Vibration 325 (2009) 722-741, Tables 1, 2, 4, 9 and 10.
"""

from __future__ import annotations

import tomllib
from typing import Any

from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.spec import BeamSpec
from ancf_casadi.support.specs import convert
from problems.paper.reproduce import PAPER_FILE

_TABLES = tomllib.loads(PAPER_FILE.read_text(encoding="utf-8"))
_PARTS = {part["name"]: part for part in _TABLES["parts"]}


def _synthetic(part: str, name: str) -> tuple[float, ...]:
    """Return a parameter of the synthetic decays of a part, mode by mode."""
    values: list[dict[str, Any]] = [record["synthetic"] for record in _PARTS[part]["records"]]
    return tuple(value[name] for value in values)


ELEMENTS: int = _TABLES["beam"]["elements"]  # Section 5.1

# Table 2
TARGET_FREQUENCIES: tuple[float, ...] = tuple(_PARTS["frequency_matching"]["targets"])
DAMPING_RATIOS = _synthetic("modal_identification", "damping_ratio")

# Table 4, and the tip amplitudes (m) at which Eq. (26) has the equivalent ratios that it prints
ETA1, ETA2 = _synthetic("quadratic", "eta1"), _synthetic("quadratic", "eta2")
EQUIVALENT_AMPLITUDES = _synthetic("quadratic", "amplitude")

# Tables 9 and 10: width, thickness, density and elastic modulus of the matched beam, and its frequencies
_MM, _GPA = 1e-3, 1e9
OPTIMUM: dict[str, float] = {
    name: unit * value
    for (name, unit), value in zip(
        {"width": _MM, "thickness": _MM, "density": 1.0, "elastic_modulus": _GPA}.items(),
        _PARTS["frequency_matching"]["printed"]["value"],
        strict=True,
    )
}
OPTIMUM_FREQUENCIES: tuple[float, ...] = tuple(_PARTS["frequency_matching"]["printed"]["optimum"])


def standard_beam() -> Beam:
    """Return the hanging beam of Table 1 with the mesh of Section 5.1."""
    return convert(_TABLES["beam"], BeamSpec, PAPER_FILE.name).beam()
