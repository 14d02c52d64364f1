"""Nonlinear oscillators whose steady motion is computed with seven harmonics, and their stepped-sine records.

The equation is x'' + c x' + f(x) = u, with an elastic force, or with the hysteresis of Masing's rule: from a reversal
at X with the force F, f = F -+ 2 B(|X - x|/2), where B is the force of the first loading.  At a given amplitude A of
the fundamental A cos(theta) and a given frequency, the higher harmonics follow from their balance, and the exciting
force from that of the fundamental.  The backbone, where the force leads by a quarter period, gives the true frequency
and rate of decay at A.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, fsolve

from problems import ResponseRecord, fit_mode

SAMPLES = 128
ORDERS = np.array([3, 5, 7])
THETA = 2 * np.pi * np.arange(SAMPLES) / SAMPLES


@dataclass(frozen=True)
class Oscillator:
    """An oscillator: its force of the first loading, per mass, and its viscous damping c, 1/s."""

    loading: callable
    c: float
    hysteresis: bool = False

    def force(self, x):
        """Return the restoring force per mass over a period that begins near the largest displacement."""
        if not self.hysteresis:
            return self.loading(x)
        high, low = x.max(), x.min()
        falling = (np.arange(SAMPLES) - x.argmax()) % SAMPLES < (x.argmin() - x.argmax()) % SAMPLES
        tip = self.loading((high - low) / 2)
        return np.where(falling, tip - 2 * self.loading((high - x) / 2), -tip + 2 * self.loading((x - low) / 2))

    def phasor(self, A, W):
        """Return the exciting force per mass as a phasor relative to the fundamental A of the displacement."""
        higher = np.exp(1j * np.outer(ORDERS, THETA))

        def residual(parts):
            X = parts[:3] + 1j * parts[3:]
            x = A * np.cos(THETA) + (X @ higher).real
            v = W * (-A * np.sin(THETA) + ((1j * ORDERS * X) @ higher).real)
            a = -(W**2) * (A * np.cos(THETA) + ((ORDERS**2 * X) @ higher).real)
            return 2 * np.fft.fft(a + self.c * v + self.force(x)) / SAMPLES

        def balance(parts):
            found = residual(parts * A)[ORDERS]
            return np.append(found.real, found.imag) / (A * W**2)

        return residual(A * fsolve(balance, np.zeros(6), xtol=1e-9))[1]

    def backbone(self, A, near):
        """Return frequency (Hz) and rate of decay (1/s) at an amplitude of the fundamental."""
        omega = brentq(lambda W: self.phasor(A, W).real, 0.8 * near, 1.2 * near, xtol=1e-8 * near)
        return omega / (2 * np.pi), self.phasor(A, omega).imag / (2 * A * omega)


def response_controlled(one, amplitude, frequencies, constant=1.0, **settings):
    """Return the record of an oscillator whose displacement is held."""
    found = np.array([one.phasor(amplitude, 2 * np.pi * f) for f in frequencies]) / constant
    held = np.full(len(frequencies), amplitude)
    return ResponseRecord(frequencies, held, -np.angle(found), levels=np.abs(found), excitation_unit="N",
                          control="response", **settings)  # fmt: skip


def force_controlled(one, level, amplitudes, near, constant=1.0, **settings):
    """Return the record of an oscillator under a held force, on both sides of the resonance at some amplitudes.

    At each amplitude there are two frequencies with the level, one on each side of the backbone.
    """
    points = []
    for A in amplitudes:
        peak = 2 * np.pi * one.backbone(A, near)[0]

        def excess(W, A=A):
            return abs(one.phasor(A, W)) / constant - level

        if excess(peak) >= 0.0:
            continue
        for end in (0.8 * near, 1.2 * near):
            W = brentq(excess, *sorted((peak, end)), xtol=1e-8 * near)
            points.append((W / (2 * np.pi), A, -np.angle(one.phasor(A, W))))
    f, A, phase = np.array(sorted(points)).T
    return ResponseRecord(f, A, phase, levels=np.full(len(f), level), excitation_unit="N", **settings)


def noisy(record, rng, noise=0.01, turn=None):
    """Return a record with relative noise of the response, or of the level if the response was controlled."""
    rows = 1 + noise * rng.standard_normal((2, record.f.size))
    phases = record.measured_phases + rows[1] - 1
    scatter = {"values": 1.0, "levels": 1.0} | {"levels" if record.control == "response" else "values": rows[0]}
    measured = {"values": scatter["values"] * record.amplitudes, "levels": scatter["levels"] * record.a}
    phases = phases if turn is None else turn(phases)
    return ResponseRecord(record.f, phases=phases, control=record.control, excitation_unit=record.excitation_unit,
                          relative=record.relative, sensor=record.sensor, **measured)  # fmt: skip


OMEGA = 2 * np.pi * 10.0


def cubic(shift=0.005, ratio=0.003, size=0.01):
    """Return a Duffing oscillator whose frequency rises by a relative shift at the amplitude ``size`` (m)."""
    alpha = 8 * shift * OMEGA**2 / (3 * size**2)
    return Oscillator(lambda x: OMEGA**2 * x + alpha * x**3, 2 * ratio * OMEGA)


def slipping(shift=0.005, ratio=0.002, size=0.01, power=1.0):
    """Return an oscillator with micro-slip, whose frequency falls and damping grows as a power of the amplitude."""
    b = 2 * shift / size**power
    return Oscillator(lambda s: OMEGA**2 * (s - b * np.abs(s) ** power * s), 2 * ratio * OMEGA, hysteresis=True)


SIZES = (0.0025, 0.005, 0.01)  # amplitudes of the curves, m
CASES = {  # oscillator, and laws of its mode
    "cubic": (cubic(), {"law": "linear", "frequency_law": "quadratic"}),
    "micro-slip": (slipping(), {"law": "quadratic", "frequency_law": "linear"}),
    "micro-slip, square root": (slipping(ratio=0.0, power=0.5), {"law": "power", "frequency_law": "power"}),
}


def records(one, control, sizes=SIZES, points=12):
    """Return a curve for each of the largest amplitudes, under a held force or with the amplitude held."""
    found = []
    for size in sizes:
        f = one.backbone(size, OMEGA)[0]
        if control == "response":
            found.append(response_controlled(one, size, f * np.linspace(0.985, 1.015, 2 * points - 1)))
        else:
            level = abs(one.phasor(size, 2 * np.pi * f)) * (1 + 1e-6)
            found.append(force_controlled(one, level, size * np.linspace(0.15, 1.0, points), OMEGA))
    return found


def held(curves, laws, truth, seed, turn=None, noise=0.01):
    """Return whether the bands of frequency and rate of decay hold the truth at ``SIZES``, (2, 3)."""
    rng = np.random.default_rng(seed)
    fit = fit_mode([noisy(one, rng, noise, turn) for one in curves], **laws)
    bands = fit.law_curve(SIZES)
    rate = bands.damping_ratio_band * fit.fit["omega"]
    ends = np.array([bands.frequency_band, rate])
    return (ends[:, :, 0] < truth) & (truth < ends[:, :, 1])


def truth_of(one):
    """Return frequency (Hz) and rate of decay (1/s) at ``SIZES``, (2, 3)."""
    return np.array([one.backbone(size, OMEGA) for size in SIZES]).T
