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

        def residual(components):
            X = components[:3] + 1j * components[3:]
            x = A * np.cos(THETA) + (X @ higher).real
            v = W * (-A * np.sin(THETA) + ((1j * ORDERS * X) @ higher).real)
            a = -(W**2) * (A * np.cos(THETA) + ((ORDERS**2 * X) @ higher).real)
            return 2 * np.fft.fft(a + self.c * v + self.force(x)) / SAMPLES

        def balance(components):
            harmonics = residual(components * A)[ORDERS]
            return np.append(harmonics.real, harmonics.imag) / (A * W**2)

        return residual(A * fsolve(balance, np.zeros(6), xtol=1e-9))[1]

    def backbone(self, A, start):
        """Return frequency (Hz) and rate of decay (1/s) at an amplitude of the fundamental."""
        omega = brentq(lambda W: self.phasor(A, W).real, 0.8 * start, 1.2 * start, xtol=1e-8 * start)
        return omega / (2 * np.pi), self.phasor(A, omega).imag / (2 * A * omega)


def response_controlled(oscillator, amplitude, frequencies, constant=1.0, **settings):
    """Return the record of an oscillator whose displacement is held."""
    values = np.array([oscillator.phasor(amplitude, 2 * np.pi * f) for f in frequencies]) / constant
    controlled = np.full(len(frequencies), amplitude)
    return ResponseRecord(frequencies, controlled, -np.angle(values), levels=np.abs(values), excitation_unit="N",
                          control="response", **settings)  # fmt: skip


def force_controlled(oscillator, level, amplitudes, start, constant=1.0, **settings):
    """Return the record of an oscillator under a held force, on both sides of the resonance at some amplitudes.

    At each amplitude there are two frequencies with the level, one on each side of the backbone.
    """
    points = []
    for A in amplitudes:
        peak = 2 * np.pi * oscillator.backbone(A, start)[0]

        def excess(W, A=A):
            return abs(oscillator.phasor(A, W)) / constant - level

        if excess(peak) >= 0.0:
            continue
        for end in (0.8 * start, 1.2 * start):
            W = brentq(excess, *sorted((peak, end)), xtol=1e-8 * start)
            points.append((W / (2 * np.pi), A, -np.angle(oscillator.phasor(A, W))))
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


def records(oscillator, control, sizes=SIZES, points=12):
    """Return a curve for each of the largest amplitudes, under a held force or with the amplitude held."""
    curves = []
    for size in sizes:
        f = oscillator.backbone(size, OMEGA)[0]
        if control == "response":
            curves.append(response_controlled(oscillator, size, f * np.linspace(0.985, 1.015, 2 * points - 1)))
        else:
            level = abs(oscillator.phasor(size, 2 * np.pi * f)) * (1 + 1e-6)
            curves.append(force_controlled(oscillator, level, size * np.linspace(0.15, 1.0, points), OMEGA))
    return curves


def held(curves, laws, truth, seed, turn=None, noise=0.01):
    """Return whether the bands of frequency and rate of decay hold the truth at ``SIZES``, (2, 3)."""
    rng = np.random.default_rng(seed)
    fit = fit_mode([noisy(curve, rng, noise, turn) for curve in curves], **laws)
    bands = fit.law_curve(SIZES)
    rate = bands.damping_ratio_band * fit.fit["omega"]
    ends = np.array([bands.frequency_band, rate])
    return (ends[:, :, 0] < truth) & (truth < ends[:, :, 1])


def truth_of(oscillator):
    """Return frequency (Hz) and rate of decay (1/s) at ``SIZES``, (2, 3)."""
    return np.array([oscillator.backbone(size, OMEGA) for size in SIZES]).T
