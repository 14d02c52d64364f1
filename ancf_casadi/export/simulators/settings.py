"""The beam in other programs: its damping, the fewest segments and the longest time step within a tolerance.

Damping laws in the terms that other programs have:

    Rayleigh      alpha M + beta K: a rate alpha on all masses, dampers beta k at the joints
    quadratic     a rate eta1 and the drag (1183/876) eta2 |v| v, both per mass along the beam
    others        alpha and beta that meet the damping ratio of mode 1, and those of modes 2 and 3 as well as possible

A law that depends on the amplitude becomes a rate alpha, right at one amplitude.  Ratios of all modes are compared at
one speed of the tip, that of mode 1 at the stated amplitude.

Of the tolerance of the first three frequencies, the segments may use a part, and the step the rest.  The step changes
the damping ratio of mode 1 by at most ``OF_RATIO`` tolerances, and must be stable with a margin, because a bent beam is
stiffer than a beam at rest.

The file for each program is a template of this folder, filled with numbers.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import NoneType
from typing import Any, ClassVar

import numpy as np

from ancf_casadi.damping import DRAG_CONSTANT, DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping, SumOfLaws
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.simulators.segments import (
    Discrete,
    SegmentedBeam,
    held_at_beginning,
    poles,
    segmented,
    step_matrix,
)
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import check_file, check_ours, filled_template, template_text, write_file
from ancf_casadi.support.inputs import check_instance, physical, positive, whole
from ancf_casadi.support.tables import Displayed, Table
from ancf_casadi.version import __version__
from ancf_casadi.vibration.modes import Modes, natural_modes

FOLDER = "ancf_casadi.export.simulators"
COMPARED = 3  # modes
STEPS = tuple(float(f"{digit}e{power}") for power in range(-3, -9, -1) for digit in (5, 3, 2, 1.5, 1))  # s
SHARE = 0.7  # of the tolerance that the segments may use
OF_RATIO = 2.0
MARGIN = 1.25
LEAST, MOST = 4, 64  # segments that are tried
RELEASE = 0.02  # tip amplitude without another, per length
UNDAMPED = 1e-3  # damping ratio to which the tolerance refers without damping


@dataclass(frozen=True)
class ExportedBeam(Displayed):
    """A beam as it was written for another program: its settings, and how it vibrates there and here.

    The values of the other program follow from the eigenvalues of its discretised beam in one step of its integrator.

    Parameters
    ----------
    format : str
        The program: exudyn, mujoco, newton or pyelastica.
    segments : int
        Number of segments or elements.
    step : float
        Time step, s.
    amplitude : float
        Tip amplitude in mode 1 to which damping ratios refer, m; in other modes, the tip has the same speed.
    frequencies, reached_frequencies : array (3,)
        First natural frequencies here and in the program, Hz.
    damping_ratios, reached_damping_ratios : array (3,)
        Damping ratios of these modes here and in the program.
    warnings : tuple of str
        Sentences on what the program cannot represent.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping
    >>> from ancf_casadi.export import write_mujoco
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=8)
    >>> found = write_mujoco(Model(beam), "beam.xml", damping=RayleighDamping(alpha=0.2, beta=1e-4))
    >>> print(found.report())
    Beam for mujoco
    -------------------------------------------------------------------------
    mode     f_Hz  f_mujoco_Hz  error_%  damping_ratio  ratio_mujoco  error_%
    -------------------------------------------------------------------------
       1  1.87613      1.87617    0.002     0.00894211    0.00894131   -0.009
       2  10.5792      10.5566   -0.214     0.00470057    0.00468452   -0.341
       3  29.2757      29.0791   -0.671     0.00960837    0.00952985   -0.817
      12 segments, steps of 0.0005 s, tip amplitude 0.01 m in mode 1
    """

    format: str
    segments: int
    step: float
    amplitude: float
    frequencies: Array
    reached_frequencies: Array
    damping_ratios: Array
    reached_damping_ratios: Array
    warnings: tuple[str, ...] = ()

    def table(self) -> Table:
        """Return frequencies and damping ratios here and in the program."""
        columns = ("mode", "f_Hz", f"f_{self.format}_Hz", "error_%", "damping_ratio", f"ratio_{self.format}", "error_%")
        rows = []
        compared = self.frequencies, self.reached_frequencies, self.damping_ratios, self.reached_damping_ratios
        for k, (f, reached, zeta, met) in enumerate(zip(*(own.tolist() for own in compared), strict=True), start=1):
            errors = (round(100 * (now / own - 1), 3) if own else None for own, now in ((f, reached), (zeta, met)))
            rows.append((k, f, reached, next(errors), zeta, met, next(errors)))
        note = f"{self.segments} segments, steps of {self.step:g} s, tip amplitude {self.amplitude:.4g} m in mode 1"
        return Table(f"beam_{self.format}", f"Beam for {self.format}", columns, rows, (note,))

    def report(self) -> str:
        """Return the table and the warnings as text."""
        return "\n".join([self.table().text(), *(f"  note: {one}" for one in self.warnings)])

    def to_dict(self) -> dict[str, Any]:
        """Return the settings, and the frequencies and damping ratios here and in the program, as plain data."""
        return {
            "kind": "exported beam",
            "format": self.format,
            "segments": self.segments,
            "step_s": self.step,
            "amplitude_m": self.amplitude,
            "frequencies_hz": self.frequencies.tolist(),
            "reached_frequencies_hz": self.reached_frequencies.tolist(),
            "damping_ratios": self.damping_ratios.tolist(),
            "reached_damping_ratios": self.reached_damping_ratios.tolist(),
            "warnings": list(self.warnings),
        }

    def _summary(self) -> str:
        worst = 100 * abs(self.reached_frequencies / self.frequencies - 1.0).max()
        return f"{self.format}, {self.segments} segments, steps of {self.step:g} s, frequencies within {worst:.2g} %"

    def _repr_html_(self) -> str:
        """Return the table and the warnings for a notebook."""
        return self.table()._repr_html_() + "".join(f"<p>note: {one}</p>" for one in self.warnings)


@dataclass(frozen=True)
class Dampers:
    """Coefficients: of all mass and of the mass along the beam (1/s), of stiffness (s), of drag (1/m)."""

    alpha: float = 0.0
    beta: float = 0.0
    eta1: float = 0.0
    eta2: float = 0.0
    warnings: tuple[str, ...] = ()

    @property
    def drag(self) -> float:
        """Force of drag per mass along the beam and speed squared, 1/m."""
        return DRAG_CONSTANT * self.eta2


def same_speed(modes: Modes, amplitude: float) -> Array:
    """Return the tip amplitudes of the modes, m, at the speed of mode 1 with the amplitude."""
    return np.asarray(amplitude * modes.frequencies[0] / modes.frequencies)


def terms_of(law: DampingLaw) -> tuple[DampingLaw, ...]:
    """Return the laws that act together."""
    return law.laws if isinstance(law, SumOfLaws) else (law,)


def dampers(terms: Iterable[DampingLaw], modes: Modes, amplitude: float) -> Dampers:
    """Return the coefficients for laws that act together."""
    found = Dampers()
    for term in terms:
        if any(getattr(term, "flow", ())):
            raise InputError("a flow of air cannot be written for a simulator", "damping")
        if isinstance(term, RayleighDamping):
            found = replace(found, alpha=found.alpha + term.alpha, beta=found.beta + term.beta)
        elif isinstance(term, QuadraticDamping):
            found = replace(found, eta1=found.eta1 + term.eta1, eta2=found.eta2 + term.eta2)
        else:
            alpha, beta = _equivalent(term, modes, same_speed(modes, amplitude))
            warning = (
                f"{type(term).__name__} becomes alpha = {alpha:.4g} 1/s and beta = {beta:.4g} s, which meet the "
                f"damping ratio of mode 1 at a tip amplitude of {amplitude:.4g} m, and further ratios of the law as "
                "well as these two can"
            )
            found = replace(
                found, alpha=found.alpha + alpha, beta=found.beta + beta, warnings=(*found.warnings, warning)
            )
    return found


def _equivalent(term: DampingLaw, modes: Modes, amplitudes: Array) -> tuple[float, float]:
    """Return alpha and beta that meet the first damping ratio of a law, and further ratios that it states."""
    ratios, of_alpha, of_beta = (
        law.damping_ratios(modes, amplitudes) for law in (term, RayleighDamping(1.0), RayleighDamping(beta=1.0))
    )
    count = len(term.ratios) if isinstance(term, ModalDamping) else 1
    return meeting_first(ratios[:count], of_alpha[:count], of_beta[:count])


def meeting_first(ratios: Array, of_alpha: Array, of_beta: Array) -> tuple[float, float]:
    """Return alpha and beta, 0 or more, that meet the first damping ratio, and the others by least squares.

    Both are given by the damping ratios of alpha = 1 and of beta = 1; beta is 0 if there is one ratio.
    """
    gains = of_beta - of_beta[0] / of_alpha[0] * of_alpha
    missing = ratios - ratios[0] / of_alpha[0] * of_alpha
    beta = float(np.clip(gains @ missing / (gains @ gains), 0.0, ratios[0] / of_beta[0])) if len(ratios) > 1 else 0.0
    return float((ratios[0] - beta * of_beta[0]) / of_alpha[0]), beta


@dataclass(frozen=True)
class Writing:
    """A beam to be written: its modes, the damping ratios that are to be met, the tolerance, and the file."""

    modes: Modes
    damping: DampingLaw
    amplitude: float
    ratios: Array
    tolerance: float
    segments: int | None
    target: Path
    template: str  # whose name begins with that of the program


@dataclass(frozen=True)
class Segmented(ABC):
    """A beam of segments in another program, which defines its modes, its damping and its steps."""

    implicit: ClassVar[bool] = True  # whether dampers act with the velocity at the end of a step
    early: ClassVar[float] = 0.0  # part of a step by which positions move before velocities change

    given: Writing
    law: Dampers
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
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what the program cannot represent."""
        return self.law.warnings

    def speeds(self, mode: int) -> Array:
        """Return 8/(3 pi) of the speeds of the places (p, 3) in a mode: drag times these is damping of equal energy."""
        omega, shapes = self.modes
        amplitude = same_speed(self.given.modes, self.given.amplitude)[mode]
        moved = omega[mode] * amplitude * self.discrete.jacobian @ shapes[:, mode]
        return np.asarray(8 / (3 * math.pi) * np.abs(moved).reshape(-1, 3))

    @abstractmethod
    def damping(self, mode: int) -> Array:
        """Return the damping matrix, with drag as for the amplitude of a mode."""

    def matrix(self, mode: int, step: float) -> Array:
        """Return the matrix of one step, with the damping of a mode at its amplitude."""
        M, K = self.discrete.mass, self.discrete.stiffness
        return step_matrix(M, self.damping(mode), K, step, implicit=self.implicit, early=self.early)


def prepared(
    template: str,
    model: Model,
    path: str | Path,
    damping: DampingLaw | None,
    segments: int | None,
    tolerance: float,
    amplitude: float | None,
) -> Writing:
    """Return the checked arguments of a writer; the file to write is new or begins as the template does."""
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    beam, law = model.beam, damping or RayleighDamping()
    held_at_beginning(beam)
    target = check_file(path)
    check_ours(target, template_text(FOLDER, template).partition(" {{")[0])
    count = None if segments is None else whole(segments, "segments", LEAST, MOST)
    size = RELEASE * beam.length if amplitude is None else physical(amplitude, "amplitude")
    tolerance = positive(tolerance, "tolerance")
    modes = natural_modes(model, count=COMPARED)
    ratios = law.damping_ratios(modes, same_speed(modes, size))
    if ratios.max() >= 1.0:
        message = (
            f"mode {1 + int(ratios.argmax())} has the damping ratio {ratios.max():.3g}; those below 1 can be written"
        )
        raise InputError(message, "damping")
    return Writing(modes, law, size, ratios, tolerance, count, target, template)


def written(kind: type[Segmented], template: str, *options: Any) -> ExportedBeam:
    """Write a beam of segments, and return its account; ``options`` are those of ``prepared``."""
    given = prepared(template, *options)
    law = dampers(terms_of(given.damping), given.modes, given.amplitude)
    count = given.segments or LEAST
    while True:
        program = kind(given, law, segmented(given.modes.model.beam, count))
        frequencies, allowed = program.modes[0] / (2 * math.pi), SHARE * given.tolerance
        error = float(np.abs(frequencies / given.modes.frequencies - 1.0).max())
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
    ratio = program.discrete.ratio(program.damping(0), 0)
    law = replace(law, warnings=program.warnings)
    return settled(given, law, count, frequencies, ratio, program.matrix, program=program, beam=program.beam)


def settled(
    given: Writing,
    law: Dampers,
    count: int,
    frequencies: Array,
    ratio: float,
    matrix: Callable[[int, float], Array],
    **values: Any,
) -> ExportedBeam:
    """Write a beam with the longest step that meets the tolerance, and return its account.

    Frequencies, Hz, and damping ratio of mode 1 are those in the program, continuous in time; ``matrix`` is that of one
    step, as of ``Segmented``, and ``values`` are those that the template needs.
    """
    for step in STEPS:
        reached = _reached(given, frequencies, ratio, matrix, step)
        if reached is not None:
            break
    else:
        raise InputError(f"no step down to {STEPS[-1]:g} s keeps the frequencies; allow for more", "tolerance")
    form, own = given.template.partition(".")[0], given.modes.frequencies
    found = ExportedBeam(form, count, step, given.amplitude, own, reached[0], given.ratios, reached[1], law.warnings)
    write_file(given.target, _filled(given.template, found, law=law, **values))
    return found


def _reached(
    given: Writing, frequencies: Array, ratio: float, matrix: Callable[[int, float], Array], step: float
) -> tuple[Array, Array] | None:
    """Return frequencies and damping ratios with a step; None if it is unstable, or changes them too much."""
    if not poles(matrix(0, MARGIN * step), MARGIN * step, COMPARED)[2]:
        return None
    found = [poles(matrix(k, step), step, COMPARED)[:2] for k in range(COMPARED)]
    if any(len(own) < COMPARED for own, _ in found):
        return None
    reached, ratios = np.array([[own[k] for own in pair] for k, pair in enumerate(found)]).T
    change = np.abs(reached / frequencies - 1.0).max()
    if change > (1.0 - SHARE) * given.tolerance:
        return None
    allowed = OF_RATIO * given.tolerance * max(ratio, UNDAMPED)
    return None if abs(ratios[0] - ratio) > allowed else (reached, ratios)


def _filled(template: str, found: ExportedBeam, **values: Any) -> str:
    """Return a template of this folder with the account of the beam, warnings and values."""
    account = [line for line in found.table().text().splitlines() if line.strip("-")]
    account += [f"Not represented: {one}." for one in found.warnings]
    about = {"version": __version__, "account": "\n".join(account), "found": found}
    return filled_template(FOLDER, template, about | values | {"shown": _ten_digits, "digits": _twelve_digits})


def _ten_digits(*values: float) -> str:
    return " ".join(f"{value:.10g}" for value in values)


def _twelve_digits(values: Array) -> list[Any]:
    """Return numbers as lists, rounded to twelve digits."""
    rounded: list[Any] = np.vectorize(lambda x: float(f"{x:.12g}"), otypes=[float])(values).tolist()
    return rounded
