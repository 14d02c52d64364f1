"""The beam in other programs: its damping, the fewest segments and the longest time step within a tolerance.

Damping laws become coefficients that other programs have:

    Rayleigh      alpha M + beta K: a rate alpha on all masses, dampers beta k at the joints
    quadratic     a rate eta1 and the drag (1183/876) eta2 |v| v, both per mass along the beam
    others        alpha and beta that meet the damping ratio of mode 1, and those of modes 2 and 3 as well as possible

A law that depends on the amplitude becomes a rate alpha, right at one amplitude.  Ratios of all modes are compared at
one speed of the tip, that of mode 1 at the stated amplitude.

The segments may use the share ``SEGMENT_SHARE`` of the tolerance of the first three frequencies, and the step the
remaining share.  The step changes the damping ratio of mode 1 by at most ``RATIO_TOLERANCES`` tolerances, and must be
stable with a margin, because a bent beam is stiffer than a beam in equilibrium.

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

from ancf_casadi.damping import DRAG_CONSTANT, DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping
from ancf_casadi.damping.law import law_terms, refuse_branches
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.simulators.segments import (
    SegmentedBeam,
    SmallMotion,
    check_support,
    divide_beam,
    poles,
    step_matrix,
)
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import check_file, check_ours, fill_template, template_text, write_file
from ancf_casadi.support.inputs import check_instance, physical, positive, whole
from ancf_casadi.support.tables import Displayed, Table
from ancf_casadi.version import __version__
from ancf_casadi.vibration.modes import Modes, natural_modes

FOLDER = "ancf_casadi.export.simulators"
COMPARED_MODES = 3  # modes
STEPS = tuple(float(f"{digit}e{power}") for power in range(-3, -9, -1) for digit in (5, 3, 2, 1.5, 1))  # s
SEGMENT_SHARE = 0.7  # of the tolerance of frequencies
RATIO_TOLERANCES = 2.0  # allowed relative change of the damping ratio by the step, in tolerances
STABILITY_MARGIN = 1.25  # between the step and the longest stable step
MIN_SEGMENTS, MAX_SEGMENTS = 4, 64
RELEASE_AMPLITUDE = 0.02  # default tip amplitude, per length
MIN_RATIO = 1e-3  # smallest damping ratio to which the tolerance refers


@dataclass(frozen=True)
class ExportedBeam(Displayed):
    """Settings of a beam written for another program, and its modes in that program and in this toolkit.

    The modes in the other program are computed from the eigenvalues of its discretised beam over one integrator step.

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
        frequencies = _with_errors(self.frequencies, self.reached_frequencies)
        ratios = _with_errors(self.damping_ratios, self.reached_damping_ratios)
        rows = [(k, *f, *zeta) for k, (f, zeta) in enumerate(zip(frequencies, ratios, strict=True), start=1)]
        note = f"{self.segments} segments, steps of {self.step:g} s, tip amplitude {self.amplitude:.4g} m in mode 1"
        return Table(f"beam_{self.format}", f"Beam for {self.format}", columns, rows, (note,))

    def report(self) -> str:
        """Return the table and the warnings as text."""
        return "\n".join([self.table().text(), *(f"  note: {warning}" for warning in self.warnings)])

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
        return self.table()._repr_html_() + "".join(f"<p>note: {warning}</p>" for warning in self.warnings)


def _with_errors(exact: Array, reached: Array) -> list[tuple[float, float, float | None]]:
    """Return exact values, values in the program, and their relative errors, %."""
    pairs = zip(exact.tolist(), reached.tolist(), strict=True)
    return [(e, r, round(100 * (r / e - 1), 3) if e else None) for e, r in pairs]


@dataclass(frozen=True)
class DampingCoefficients:
    """Coefficients of mass and stiffness damping and of drag, and warnings about laws that they approximate."""

    alpha: float  # of all mass, 1/s
    beta: float  # of stiffness, s
    eta1: float  # of the mass along the beam, 1/s
    eta2: float  # of drag, 1/m
    warnings: tuple[str, ...]

    @property
    def drag(self) -> float:
        """Force of drag per mass along the beam and speed squared, 1/m."""
        return DRAG_CONSTANT * self.eta2


def equal_speed_amplitudes(modes: Modes, amplitude: float) -> Array:
    """Return the tip amplitudes, m, at which all modes have the tip speed of mode 1 at the given amplitude."""
    return np.asarray(amplitude * modes.frequencies[0] / modes.frequencies)


def damping_coefficients(laws: Iterable[DampingLaw], modes: Modes, amplitude: float) -> DampingCoefficients:
    """Return the coefficients of the sum of the laws, at a tip amplitude in mode 1."""
    alpha = beta = eta1 = eta2 = 0.0
    warnings = []
    for law in laws:
        refuse_branches(law)
        if any(getattr(law, "flow", ())):
            raise InputError("a flow of air cannot be written for a simulator", "damping")
        if isinstance(law, QuadraticDamping):
            eta1, eta2 = eta1 + law.eta1, eta2 + law.eta2
        elif isinstance(law, RayleighDamping):
            if law.beta and law.stiffness != "strain-rate":
                raise InputError(f"the stiffness {law.stiffness!r} cannot be written; use 'strain-rate'", "damping")
            alpha, beta = alpha + law.alpha, beta + law.beta
        else:
            law_alpha, law_beta = _equivalent_rayleigh(law, modes, equal_speed_amplitudes(modes, amplitude))
            alpha, beta = alpha + law_alpha, beta + law_beta
            warnings.append(
                f"{type(law).__name__} becomes alpha = {law_alpha:.4g} 1/s and beta = {law_beta:.4g} s, which meet the "
                f"damping ratio of mode 1 at a tip amplitude of {amplitude:.4g} m, and those of higher modes as "
                "closely as two coefficients allow"
            )
    return DampingCoefficients(alpha, beta, eta1, eta2, tuple(warnings))


def _equivalent_rayleigh(law: DampingLaw, modes: Modes, amplitudes: Array) -> tuple[float, float]:
    """Return alpha and beta with the first damping ratio of a law; those of a modal law fit its further ratios too."""
    count = len(law.ratios) if isinstance(law, ModalDamping) else 1
    compared_laws = law, RayleighDamping(1.0), RayleighDamping(beta=1.0)
    return match_first_ratio(*(each_law.damping_ratios(modes, amplitudes)[:count] for each_law in compared_laws))


def match_first_ratio(ratios: Array, alpha_ratios: Array, beta_ratios: Array) -> tuple[float, float]:
    """Return nonnegative alpha and beta that meet the first damping ratio, and further ratios by least squares.

    ``alpha_ratios`` and ``beta_ratios`` are the damping ratios for alpha = 1 and for beta = 1.  With a single ratio,
    beta is 0.
    """
    gains = beta_ratios - beta_ratios[0] / alpha_ratios[0] * alpha_ratios
    remainders = ratios - ratios[0] / alpha_ratios[0] * alpha_ratios
    beta = 0.0
    if len(ratios) > 1:
        beta = float(np.clip(gains @ remainders / (gains @ gains), 0.0, ratios[0] / beta_ratios[0]))
    return float((ratios[0] - beta * beta_ratios[0]) / alpha_ratios[0]), beta


@dataclass(frozen=True)
class ExportRequest:
    """The beam to export: its modes and damping ratios, the tolerance of both, and the file to write."""

    modes: Modes
    damping: DampingLaw
    amplitude: float
    ratios: Array
    tolerance: float
    segments: int | None
    target: Path
    template: str  # whose name begins with that of the program


@dataclass(frozen=True)
class SimulatorBeam(ABC):
    """A beam of segments with the inertia, damping and integrator of another program."""

    implicit: ClassVar[bool] = True  # whether dampers act with the velocity at the end of a step
    early: ClassVar[float] = 0.0  # fraction of a step by which positions move before velocities change

    request: ExportRequest
    coefficients: DampingCoefficients
    beam: SegmentedBeam

    @cached_property
    def chain(self) -> SegmentedBeam:
        """The segments as the program has them."""
        return self.beam

    @cached_property
    def small_motion(self) -> SmallMotion:
        """Small motion about the equilibrium."""
        return self.chain.small_motion()

    @cached_property
    def modes(self) -> tuple[Array, Array]:
        """Angular frequencies and shapes."""
        return self.small_motion.modes(COMPARED_MODES)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what the program cannot represent."""
        return self.coefficients.warnings

    @property
    def step(self) -> float | None:
        """Step that the program needs, s; None for the longest step that meets the tolerance."""
        return None

    def drag_speeds(self, mode: int) -> Array:
        """Return 8/(3 pi) times the amplitudes of x, y and angular velocity of the masses in a mode, (masses, 3).

        A linear damper with the coefficient of drag times this value dissipates as much energy per period as drag.
        """
        omega, shapes = self.modes
        amplitude = equal_speed_amplitudes(self.request.modes, self.request.amplitude)[mode]
        place_speeds = omega[mode] * amplitude * self.small_motion.jacobian @ shapes[:, mode]
        return np.asarray(8 / (3 * math.pi) * np.abs(place_speeds).reshape(-1, 3))

    @abstractmethod
    def damping(self, mode: int) -> Array:
        """Return the damping matrix, with drag linearised at the amplitude of a mode."""

    def transition_matrix(self, mode: int, step: float) -> Array:
        """Return the matrix of one integrator step, with drag linearised at the amplitude of a mode."""
        M, K = self.small_motion.mass, self.small_motion.stiffness
        return step_matrix(M, self.damping(mode), K, step, implicit=self.implicit, early=self.early)


def check_request(
    template: str,
    model: Model,
    path: str | Path,
    damping: DampingLaw | None,
    segments: int | None,
    tolerance: float,
    amplitude: float | None,
) -> ExportRequest:
    """Check the arguments of a writer and solve for the modes; an existing file must begin as the template does."""
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    beam, law = model.beam, damping or RayleighDamping()
    check_support(beam)
    target = check_file(path)
    check_ours(target, template_text(FOLDER, template).partition(" {{")[0])
    count = None if segments is None else whole(segments, "segments", MIN_SEGMENTS, MAX_SEGMENTS)
    tip_amplitude = RELEASE_AMPLITUDE * beam.length if amplitude is None else physical(amplitude, "amplitude")
    tolerance = positive(tolerance, "tolerance")
    modes = natural_modes(model, count=COMPARED_MODES)
    ratios = law.damping_ratios(modes, equal_speed_amplitudes(modes, tip_amplitude))
    if ratios.max() >= 1.0:
        message = (
            f"mode {1 + int(ratios.argmax())} has the damping ratio {ratios.max():.3g}; those below 1 can be written"
        )
        raise InputError(message, "damping")
    return ExportRequest(modes, law, tip_amplitude, ratios, tolerance, count, target, template)


def write_segments(kind: type[SimulatorBeam], template: str, *request_arguments: Any) -> ExportedBeam:
    """Write a beam with the fewest segments within the tolerance; ``request_arguments`` go to ``check_request``."""
    request = check_request(template, *request_arguments)
    coefficients = damping_coefficients(law_terms(request.damping), request.modes, request.amplitude)
    count = request.segments or MIN_SEGMENTS
    while True:
        program = kind(request, coefficients, divide_beam(request.modes.model.beam, count))
        frequencies, segment_tolerance = program.modes[0] / (2 * math.pi), SEGMENT_SHARE * request.tolerance
        error = float(np.abs(frequencies / request.modes.frequencies - 1.0).max())
        if error <= segment_tolerance or request.segments:
            break
        if count == MAX_SEGMENTS:
            raise InputError(
                f"{MAX_SEGMENTS} segments only reach {error:.2g} in the first frequencies; give the beam more "
                "elements, or allow for more",
                "tolerance",
            )
        # the error falls with at most the third power of the number; 0.9 keeps the next below the fewest that suffice
        count = min(MAX_SEGMENTS, max(count + 1, int(0.9 * count * (error / segment_tolerance) ** (1 / 3))))
    ratio = program.small_motion.ratio(program.damping(0), 0)
    coefficients = replace(coefficients, warnings=program.warnings)
    step = program.step or longest_step(request, frequencies, ratio, program.transition_matrix)
    return write_template(
        request, coefficients, count, step, program.transition_matrix, program=program, beam=program.chain
    )


def longest_step(
    request: ExportRequest, frequencies: Array, ratio: float, transition_matrix: Callable[[int, float], Array]
) -> float:
    """Return the longest step, s, that is stable with a margin and keeps frequencies and first damping ratio.

    ``frequencies``, Hz, and the damping ratio of mode 1, ``ratio``, are those of the beam in the program, continuous in
    time.  ``transition_matrix`` is that of ``SimulatorBeam``.
    """
    ratio_tolerance = RATIO_TOLERANCES * request.tolerance * max(ratio, MIN_RATIO)
    for step in STEPS:
        reached, ratios = _step_modes(transition_matrix, step)
        longer = STABILITY_MARGIN * step
        if (
            poles(transition_matrix(0, longer), longer, COMPARED_MODES)[2]
            and np.abs(reached / frequencies - 1.0).max() <= (1.0 - SEGMENT_SHARE) * request.tolerance
            and abs(ratios[0] - ratio) <= ratio_tolerance
        ):
            return step
    raise InputError(f"no step down to {STEPS[-1]:g} s keeps the frequencies; allow for more", "tolerance")


def write_template(
    request: ExportRequest,
    coefficients: DampingCoefficients,
    segments: int,
    step: float,
    transition_matrix: Callable[[int, float], Array],
    **template_values: Any,
) -> ExportedBeam:
    """Fill the template of a program for steps, s; it uses ``template_values``."""
    reached = _step_modes(transition_matrix, step)
    if np.isnan(reached).any():
        raise InputError(f"is so large that a mode does not oscillate with steps of {step:g} s; reduce it", "damping")
    exported = ExportedBeam(
        format=request.template.partition(".")[0],
        segments=segments,
        step=step,
        amplitude=request.amplitude,
        frequencies=request.modes.frequencies,
        reached_frequencies=reached[0],
        damping_ratios=request.ratios,
        reached_damping_ratios=reached[1],
        warnings=coefficients.warnings,
    )
    write_file(request.target, _fill_template(request.template, exported, damping=coefficients, **template_values))
    return exported


def _step_modes(transition_matrix: Callable[[int, float], Array], step: float) -> Array:
    """Return frequencies, Hz, and damping ratios (2, 3) with a step, s; nan if a mode does not oscillate."""
    reached = np.full((2, COMPARED_MODES), math.nan)
    for k in range(COMPARED_MODES):
        frequencies, ratios, _ = poles(transition_matrix(k, step), step, COMPARED_MODES)
        if len(frequencies) == COMPARED_MODES:
            reached[:, k] = frequencies[k], ratios[k]
    return reached


def _fill_template(template: str, exported: ExportedBeam, **template_values: Any) -> str:
    """Return a template of this folder, filled with the table of modes, the warnings and values."""
    lines = [line for line in exported.table().text().splitlines() if line.strip("-")]
    lines += [f"Not represented: {warning}." for warning in exported.warnings]
    summary = {"version": __version__, "account": "\n".join(lines), "exported": exported}
    formats = {"shown": _format_numbers, "digits": _round_digits}
    return fill_template(FOLDER, template, summary | template_values | formats)


def _format_numbers(*values: float) -> str:
    return " ".join(f"{value:.10g}" for value in values)


def _round_digits(values: Array) -> list[Any]:
    """Return numbers as lists, rounded to twelve digits."""
    rounded: list[Any] = np.vectorize(lambda x: float(f"{x:.12g}"), otypes=[float])(values).tolist()
    return rounded
