"""The fewest segments and the longest time step that keep frequencies and damping within a tolerance.

Of the tolerance of the first three frequencies, the segments may use a part, and the step the rest.  The step changes
the damping ratio of mode 1 by at most ``OF_RATIO`` tolerances, and must be stable with a margin, because a bent beam is
stiffer than a beam at rest.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar

import numpy as np

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.simulators.dampers import COMPARED, Dampers, dampers, same_speed
from ancf_casadi.export.simulators.result import ExportedBeam
from ancf_casadi.export.simulators.segments import SegmentedBeam, held_at_beginning, segmented
from ancf_casadi.export.simulators.small_motion import Discrete, poles
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import check_file, check_ours, write_file
from ancf_casadi.support.inputs import check_instance, physical, positive, whole
from ancf_casadi.version import __version__
from ancf_casadi.vibration.modes import Modes, natural_modes

STEPS = tuple(float(f"{digit}e{power}") for power in range(-3, -9, -1) for digit in (5, 3, 2, 1.5, 1))  # s
SHARE = 0.7  # of the tolerance that the segments may use
OF_RATIO = 2.0
MARGIN = 1.25
LEAST, MOST = 4, 64  # segments that are tried
RELEASE = 0.02  # tip amplitude without another, per length
UNDAMPED = 1e-3  # damping ratio to which the tolerance refers without damping


@dataclass(frozen=True)
class Writing:
    """A beam to be written: its modes, the damping ratios that are to be met, and the tolerance."""

    modes: Modes
    damping: DampingLaw | None
    amplitude: float
    ratios: Array
    tolerance: float
    segments: int | None

    @property
    def model(self) -> Model:
        """The model of the beam."""
        return self.modes.model


@dataclass(frozen=True)
class InProgram(ABC):
    """A beam in another program, which defines its modes, its damping and its steps."""

    given: Writing
    law: Dampers

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on damping that the program cannot represent."""
        return self.law.warnings

    @property
    @abstractmethod
    def frequencies(self) -> Array:
        """First natural frequencies, Hz, continuous in time."""

    @property
    @abstractmethod
    def ratio(self) -> float:
        """Damping ratio of mode 1, continuous in time."""

    @abstractmethod
    def matrix(self, mode: int, step: float) -> Array:
        """Return the matrix of one step, with the damping of a mode at its amplitude."""


@dataclass(frozen=True)
class Segmented(InProgram):
    """A beam of segments in another program."""

    beam: SegmentedBeam

    @cached_property
    def discrete(self) -> Discrete:
        """Small motion about rest."""
        return self.beam.discrete()

    @cached_property
    def modes(self) -> tuple[Array, Array]:
        """Angular frequencies and shapes."""
        return self.discrete.modes(COMPARED)

    @property
    def frequencies(self) -> Array:
        """First natural frequencies, Hz, continuous in time."""
        return self.modes[0] / (2 * math.pi)

    @property
    def ratio(self) -> float:
        """Damping ratio of mode 1, continuous in time."""
        return self.discrete.ratio(self.damping(0), 0)

    def speeds(self, mode: int) -> Array:
        """Return 8/(3 pi) of the speeds of the places (p, 3) in a mode: drag times these is damping of equal energy."""
        omega, shapes = self.modes
        amplitude = same_speed(self.given.modes, self.given.amplitude)[mode]
        moved = omega[mode] * amplitude * self.discrete.jacobian @ shapes[:, mode]
        return np.asarray(8 / (3 * math.pi) * np.abs(moved).reshape(-1, 3))

    @abstractmethod
    def damping(self, mode: int) -> Array:
        """Return the damping matrix, with drag as for the amplitude of a mode."""


B = TypeVar("B", bound=InProgram)
S = TypeVar("S", bound=Segmented)


def prepared(
    model: Model,
    path: str | Path,
    mark: str,
    damping: DampingLaw | None,
    segments: int | None,
    tolerance: float,
    amplitude: float | None,
) -> tuple[Writing, Path]:
    """Return the checked arguments of a writer, and the file to write, which is new or begins with a mark."""
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    beam = model.beam
    held_at_beginning(beam)
    target = check_file(path)
    check_ours(target, mark)
    count = None if segments is None else whole(segments, "segments", LEAST, MOST)
    size = RELEASE * beam.length if amplitude is None else physical(amplitude, "amplitude")
    tolerance = positive(tolerance, "tolerance")
    modes = natural_modes(model, count=COMPARED)
    ratios = (damping or RayleighDamping()).damping_ratios(modes, same_speed(modes, size))
    if ratios.max() >= 1.0:
        message = (
            f"mode {1 + int(ratios.argmax())} has the damping ratio {ratios.max():.3g}; those below 1 can be written"
        )
        raise InputError(message, "damping")
    return Writing(modes, damping, size, ratios, tolerance, count), target


def written(kind: type[S], form: str, mark: str, text: Callable[[S, ExportedBeam], str], *options: Any) -> ExportedBeam:
    """Write a beam of segments, and return its account; ``options`` are those of ``prepared`` without the mark."""
    model, path, *others = options
    given, target = prepared(model, path, mark, *others)
    law = dampers(given.damping, given.modes, given.amplitude)
    beam, found = settled(given, form, lambda count: kind(given, law, segmented(model.beam, count)))
    write_file(target, text(beam, found))
    return found


def listed(numbers: Mapping[str, Array]) -> str:
    """Return arrays as lines of a script, numbers to twelve digits."""
    rounded = {name: np.vectorize(lambda x: float(f"{x:.12g}"), otypes=[float])(own) for name, own in numbers.items()}
    return "\n".join(f"{name} = np.array({own.tolist()})" for name, own in rounded.items())


def settled(given: Writing, form: str, make: Callable[[int], B]) -> tuple[B, ExportedBeam]:
    """Return the beam with the settings that meet the tolerance, and its account."""
    allowed, count = SHARE * given.tolerance, given.segments or LEAST
    while True:
        beam = make(count)
        error = float(np.abs(beam.frequencies / given.modes.frequencies - 1.0).max())
        if error <= allowed or given.segments:
            break
        if count == MOST:
            raise InputError(
                f"{MOST} segments only reach {error:.2g} in the first frequencies; give the beam more elements, or "
                "allow for more",
                "tolerance",
            )
        # the error falls with at most the third power of the number; 0.9 keeps the next below the fewest that suffice
        count = min(MOST, max(count + 1, int(0.9 * count * (error / allowed) ** (1 / 3))))
    for step in STEPS:
        reached = _reached(given, beam, step)
        if reached is not None:
            break
    else:
        raise InputError(f"no step down to {STEPS[-1]:g} s keeps the frequencies; allow for more", "tolerance")
    found = ExportedBeam(
        form, count, step, given.amplitude, given.modes.frequencies, reached[0], given.ratios, reached[1], beam.warnings
    )
    return beam, found


def header(found: ExportedBeam, mapping: Sequence[str]) -> str:
    """Return the beginning of the file: its origin, the mapping of the beam, the account, and the warnings."""
    account = [line for line in found.table().text().splitlines() if line.strip("-")]
    first = f" {__version__}: a beam for {found.format}.  SI units."
    return "\n".join([first, "", *mapping, "", *account, *(f"Not represented: {one}." for one in found.warnings)])


def _reached(given: Writing, beam: InProgram, step: float) -> tuple[Array, Array] | None:
    """Return frequencies and damping ratios with a step; None if it is unstable, or changes them too much."""
    if not poles(beam.matrix(0, MARGIN * step), MARGIN * step, COMPARED)[2]:
        return None
    found = [poles(beam.matrix(k, step), step, COMPARED)[:2] for k in range(COMPARED)]
    if any(len(own) < COMPARED for own, _ in found):
        return None
    frequencies, ratios = np.array([[own[k] for own in pair] for k, pair in enumerate(found)]).T
    change = np.abs(frequencies / beam.frequencies - 1.0).max()
    if change > (1.0 - SHARE) * given.tolerance:
        return None
    allowed = OF_RATIO * given.tolerance * max(beam.ratio, UNDAMPED)
    return None if abs(ratios[0] - beam.ratio) > allowed else (frequencies, ratios)
