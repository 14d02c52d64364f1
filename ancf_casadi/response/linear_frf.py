"""Frequency response functions of small motion about an equilibrium.

Small displacements w of the free coordinates about an equilibrium obey

    M w_tt + D w_t + K w = S_j^T f(t),

with the tangent stiffness K at the equilibrium (gravity and loads included), the mass M, and D = dQ_damp/de_t at rest,
which includes the low-rank term of modal damping and the dashpots.  The row S_j picks the displacement of the loaded
point along the direction of the load, S_i that of a response.  Under f = F exp(i omega t), the receptance is

    H_ij = S_i (K + i omega D - omega^2 M)^-1 S_j^T.

If the base moves by u exp(i omega t) along a direction, with E the translation of all nodes along it, the motion
relative to the base is w u exp(i omega t) with

    (K + i omega D - omega^2 M) w = -(i omega D - omega^2 M) E    (rows of the free coordinates),

because K E = 0.

The equations are solved directly at each frequency, by LU factors of the banded matrix and Woodbury's identity for the
modal damping, so that no mode is truncated.  Rounding K changes the resonances by less than 1e-10 of their frequency
with 20 elements, and 1e-7 with 400.

The mobility is i omega H and the accelerance -omega^2 H.  The transmissibility is the displacement of a point per
displacement of the base, absolute or relative to the base.

References
----------
D. J. Ewins, Modal Testing: Theory, Practice and Application, Research Studies Press (2000), Chapter 2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import NoneType
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.dynamics.damped_modes import banded, damping_at_rest
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.banded import BandedFactors
from ancf_casadi.support.inputs import LARGEST_TIME, array, check_instance, choice, is_sequence, number, unit_vector
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.tables import Reported, Table, plural, spread
from ancf_casadi.vibration.assembly import BANDWIDTH
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import Modes, natural_modes
from ancf_casadi.vibration.statics import static_equilibrium

FrfKind = Literal["receptance", "mobility", "accelerance", "transmissibility", "relative-transmissibility"]

FRF_UNITS = {
    "receptance": "m/N",
    "mobility": "m/(N s)",
    "accelerance": "m/(N s^2)",
    "transmissibility": "1",
    "relative-transmissibility": "1",
}
FRF_POWERS = {"receptance": 0, "mobility": 1, "accelerance": 2}  # powers of i omega
FREQUENCY_SPAN = 0.2, 1.3  # default first and last frequency, relative to the first and last mode
HALF_WIDTHS = 10.0  # range of the dense frequencies about a resonance
RESONANCES = 5  # number of modes that the default frequencies cover
TRIAL_AMPLITUDE = 0.01  # of the reference point, per length; for the comparison with damping ratios at rest


@dataclass(frozen=True, eq=False)
class LinearFrf(Reported):
    """Frequency response functions of small motion.

    Parameters
    ----------
    kind : {"receptance", "mobility", "accelerance", "transmissibility", "relative-transmissibility"}
        Kind of the functions.
    frequencies : array (k,)
        Frequencies, Hz.
    values : array (outputs, inputs, k)
        Complex values, in ``unit``; one input, the motion of the base, for the transmissibilities.
    points, load_points : tuple of float
        Arc lengths of the responding and of the loaded points, m; without loaded points, the base moves.
    direction, load_direction : (float, float)
        Directions of the responses, and of the loads or the base motion; unit vectors.
    modes : Modes
        The first five modes about the equilibrium, without rigid-body motions.
    damping : DampingLaw
        The damping law.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping, linear_frf
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> frf = linear_frf(Model(beam), RayleighDamping(alpha=0.2), [1.0, 2.0], kind="mobility")
    >>> frf.values.shape, frf.unit
    ((1, 1, 2), 'm/(N s)')
    """

    _drawing = "ancf_casadi.figures.responses.frf_figure"

    kind: FrfKind
    frequencies: Array
    values: ComplexArray
    points: tuple[float, ...]
    load_points: tuple[float, ...]
    direction: tuple[float, float]
    load_direction: tuple[float, float]
    modes: Modes
    damping: DampingLaw

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return FRF_UNITS[self.kind]

    @property
    def amplitude(self) -> Array:
        """Absolute values (outputs, inputs, k)."""
        return np.abs(self.values)

    @property
    def phase(self) -> Array:
        """Phase angles (outputs, inputs, k), rad, in (-pi, pi]; negative if the response lags."""
        return np.asarray(np.angle(self.values))

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """A warning if the damping of a mode at ``TRIAL_AMPLITUDE`` differs from that at rest by more than 1 %."""
        count, length = self.modes.count, self.modes.model.beam.length
        rest_ratios, moving_ratios = (
            self.damping.damping_ratios(self.modes, np.full(count, a)) for a in (0.0, TRIAL_AMPLITUDE * length)
        )
        changed = np.flatnonzero(~np.isclose(moving_ratios, rest_ratios, rtol=0.01, atol=0.0))
        if not changed.size:
            return ()
        k = int(changed[0])
        point = self.modes.reference_points[k]
        location = "of the tip" if point == length else f"at {point:.4g} m"
        return (
            "the damping depends on the amplitude, and these functions hold for very small motion only: at an "
            f"amplitude of {1e3 * TRIAL_AMPLITUDE * length:.2g} mm {location}, the damping ratio of mode {k + 1} is "
            f"{moving_ratios[k]:.3g}, not {rest_ratios[k]:.3g}",
        )

    def labels(self) -> list[list[str]]:
        """Return the name of each function, as ``0.5 m / 0.25 m``, response before load."""
        loads = [f"{s:.4g} m" for s in self.load_points] or ["base"]
        return [[f"{s:.4g} m / {load}" for load in loads] for s in self.points]

    def table(self) -> Table:
        """Return the peaks of each function with amplitude and phase."""
        rows: list[tuple[str | float, ...]] = []
        for names, row in zip(self.labels(), self.values, strict=True):
            for name, values in zip(names, row, strict=True):
                amplitude = np.abs(values)
                peaks = 1 + np.flatnonzero((amplitude[1:-1] > amplitude[:-2]) & (amplitude[1:-1] >= amplitude[2:]))
                rows += [
                    (name, float(self.frequencies[k]), float(amplitude[k]), math.degrees(np.angle(values[k])))
                    for k in peaks.tolist()
                ]
        columns = ("response / load", "frequency_Hz", f"amplitude, {self.unit}", "phase_deg")
        ratios = ratios_at_rest(self.modes, self.damping)
        pairs = zip(self.modes.frequencies.tolist(), ratios.tolist(), strict=True)
        modes = ", ".join(f"{frequency:.4g} Hz ({100 * ratio:.3g} %)" for frequency, ratio in pairs)
        title = f"Peaks of the {self.kind.replace('-', ' ')} at {len(self.frequencies)} frequencies"
        return Table("frf", title, columns, rows, (f"natural frequencies (damping ratios): {modes}",))

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data, with real and imaginary parts as lists (outputs, inputs, k)."""
        return {
            "kind": "frequency response of small motion",
            "quantity": self.kind,
            "unit": self.unit,
            "frequencies_hz": self.frequencies.tolist(),
            "real": self.values.real.tolist(),
            "imaginary": self.values.imag.tolist(),
            "points_m": list(self.points),
            "load_points_m": list(self.load_points),
            "direction": list(self.direction),
            "load_direction": list(self.load_direction),
            "warnings": list(self.warnings),
        }

    def _summary(self) -> str:
        shape = f"{plural(len(self.points), 'point')}, {len(self.frequencies)} frequencies"
        return f"{self.kind}, {shape}, {spread(self.frequencies, 'Hz')}, {self.damping!r}"


@lasting_interrupts()
def linear_frf(
    model: Model,
    damping: DampingLaw | None = None,
    frequencies: ArrayLike | None = None,
    *,
    kind: FrfKind = "receptance",
    points: float | Sequence[float] | None = None,
    load_points: float | Sequence[float] | None = None,
    direction: tuple[float, float] | None = None,
    load_direction: tuple[float, float] | None = None,
    equilibrium: Equilibrium | None = None,
) -> LinearFrf:
    """Return frequency response functions of small motion about an equilibrium, solved directly at each frequency.

    Drag that is quadratic in the velocity has no effect in small motion; friction counts with its slope at rest.

    Parameters
    ----------
    model : Model
        The beam.
    damping : DampingLaw, optional
        The damping law; none if not given.
    frequencies : array_like (k,), optional
        Frequencies, Hz, 0 or more; chosen to show the first five resonances if not given.
    kind : {"receptance", "mobility", "accelerance", "transmissibility", "relative-transmissibility"}
        Displacement, velocity or acceleration per force, or absolute or relative displacement per displacement of the
        base.
    points : float or sequence of float, optional
        Arc lengths of the responding points, m; if not given, the tip, or if it is held the point of mode 1 in
        ``Modes.reference_points``.
    load_points : float or sequence of float, optional
        Arc lengths of the points at which a force acts, m; as ``points`` if not given.
    direction : (float, float), optional
        Direction of the responses, of any positive length; ``Beam.across`` if not given, that of x for a hanging beam.
    load_direction : (float, float), optional
        Direction of the forces or of the base motion; that of the responses if not given.
    equilibrium : Equilibrium, optional
        The equilibrium; by default under gravity alone.

    Raises
    ------
    InputError
        If an argument has another type, a point is not on the beam, or a frequency is an undamped resonance.
    EquilibriumError
        If the equilibrium is unstable, or none is found.

    Examples
    --------
    The tip of a strip moves 46 times as far as its base at resonance:

    >>> from ancf_casadi import Beam, Model, RayleighDamping, linear_frf
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> law = RayleighDamping(alpha=0.4)
    >>> frf = linear_frf(Model(beam), law, [1.0, 1.876, 3.0], kind="transmissibility")
    >>> frf.amplitude[0, 0].round(1)
    array([ 1.6, 46.1,  1.6])
    """
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    check_instance(equilibrium, "equilibrium", Equilibrium, NoneType)
    choice(kind, get_args(FrfKind), "kind")
    base_moves = kind not in FRF_POWERS
    if base_moves and load_points is not None:
        raise InputError(f"has no meaning for a {kind}, in which the base moves", "load_points")
    response_direction = unit_vector(model.beam.across if direction is None else direction, "direction")
    input_direction = response_direction if load_direction is None else unit_vector(load_direction, "load_direction")
    law = damping or RayleighDamping()
    arc_lengths = _check_points(model, points, "points"), _check_points(model, load_points, "load_points")
    state = equilibrium or static_equilibrium(model, loads=law.loads(model.beam))
    modes = _flexible_modes(model, state)
    response_points, loaded_points = (positions or modes.reference_points[:1] for positions in arc_lengths)
    loaded_points = () if base_moves else loaded_points
    f = _default_frequencies(modes, law) if frequencies is None else _check_frequencies(frequencies)

    rows = _displacement_rows(model, response_points, response_direction)
    if base_moves:
        translation = model.unit_velocities @ np.array(input_direction)[:, None]
        values = _responses(state, law, f, rows, np.zeros((rows.shape[1], 1)), translation)
        if kind == "transmissibility":
            values += np.dot(response_direction, input_direction)
    else:
        forces = _displacement_rows(model, loaded_points, input_direction).T
        values = _responses(state, law, f, rows, forces, np.zeros((model.size, len(loaded_points))))
        values = values * (2j * np.pi * f) ** FRF_POWERS[kind]
    if not np.isfinite(values).all():
        raise InputError("one is a natural frequency of the beam, and there is no damping", "frequencies")
    return LinearFrf(kind, f, values, response_points, loaded_points, response_direction, input_direction, modes, law)


def _check_points(model: Model, value: Any, name: str) -> tuple[float, ...]:
    """Return arc lengths of points on the beam; empty for None."""
    if value is None:
        return ()
    values = tuple(number(s, name) for s in value) if is_sequence(value) else (number(value, name),)
    if not values:
        raise InputError("is empty; give at least one arc length", name)
    for s in values:
        if not 0.0 <= s <= model.beam.length:
            raise InputError(f"must be on the beam, 0 to {model.beam.length:g} m, got {s:g}", name)
    return values


def _check_frequencies(value: ArrayLike) -> Array:
    """Return frequencies as an array."""
    f = np.atleast_1d(array(value, "frequencies"))
    if f.ndim != 1 or not f.size or (f < 0.0).any() or (f > LARGEST_TIME).any():
        raise InputError(f"must be one or more frequencies, Hz, from 0 to {LARGEST_TIME:g}", "frequencies")
    return f


def _default_frequencies(modes: Modes, law: DampingLaw) -> Array:
    """Return frequencies that cover the resonances of the modes, dense where the response changes fast."""
    f = modes.frequencies
    ratios = np.clip(ratios_at_rest(modes, law), 1e-4, 0.1)
    grid = np.geomspace(FREQUENCY_SPAN[0] * f[0], FREQUENCY_SPAN[1] * f[-1], 400)
    offsets = HALF_WIDTHS * np.sinh(np.linspace(-4.0, 4.0, 61)) / np.sinh(4.0)
    near_resonances = f[:, None] * (1 + ratios[:, None] * offsets)
    return np.unique(np.append(grid, near_resonances))


def _flexible_modes(model: Model, equilibrium: Equilibrium) -> Modes:
    """Return the first five modes, or all of a coarse mesh, without those of rigid motion."""
    count = RESONANCES if model.is_held else RESONANCES + 3
    modes = natural_modes(model, count=min(count, model.freedoms), equilibrium=equilibrium)
    flexible = np.flatnonzero(modes.frequencies > 0.0)[:RESONANCES]
    return Modes(equilibrium, modes.frequencies[flexible], modes.shapes[:, flexible])


def ratios_at_rest(modes: Modes, law: DampingLaw) -> Array:
    """Return the damping ratios of very small motion due to the law and the dashpots of the beam, (m,)."""
    model, shapes = modes.model, modes.shapes
    dashpot_damping = (shapes * model.dashpot_force(shapes, model.properties).full()).sum(axis=0)
    law_ratios: Array = law.damping_ratios(modes, np.zeros(modes.count))
    return np.asarray(law_ratios + dashpot_damping / (2 * modes.angular_frequencies))


def _displacement_rows(model: Model, points: Sequence[float], direction: tuple[float, float]) -> Array:
    """Return the rows S that pick the displacements of points along a direction, (points, free)."""
    return np.array([model.of_free(np.array(direction) @ model.interpolation(s)) for s in points])


def _responses(
    equilibrium: Equilibrium, law: DampingLaw, f: Array, rows: Array, forces: Array, translation: Array
) -> ComplexArray:
    """Return the displacements relative to the base that the rows pick, (outputs, inputs, k)."""
    model, B = equilibrium.model, law.projection(equilibrium.model)
    D, tangent_damping, d, V = damping_at_rest(model, law)(equilibrium.coordinates)
    M, d = model.mass(model.properties).sparse(), d.full()
    damping_force = model.of_free(D.sparse() @ translation + B @ (d * (B.T @ translation)))
    inertia_force = model.of_free(M @ translation)
    _, stiffness, mass = equilibrium.structure.linearisation(equilibrium.exact)
    damping, material_stiffness = banded(tangent_damping.sparse(), stiffness), banded(V.sparse(), stiffness)
    B, responses = model.of_free(B), []
    ωs = 2 * np.pi * f
    for ω, r in zip(ωs, law.relaxation(1j * ωs), strict=True):
        storage = np.zeros((3 * BANDWIDTH + 1, stiffness.shape[1]), dtype=complex, order="F")
        storage[BANDWIDTH:] = stiffness + r * material_stiffness + 1j * ω * damping - ω**2 * mass
        factors = BandedFactors.of(storage, BANDWIDTH, 1j * ω * B * d.T, B)
        responses.append(rows @ factors.solve(forces - 1j * ω * damping_force + ω**2 * inertia_force))
    return np.stack(responses, axis=2)
