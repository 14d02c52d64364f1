"""Measure the accuracy of both integrators and print the tables of ``accuracy.md``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse.linalg

from ancf_casadi import (
    Beam,
    ModalDamping,
    Model,
    RayleighDamping,
    SampledBase,
    SimulationError,
    State,
    Trajectory,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.damping import ProportionalStiffness
from ancf_casadi.dynamics.simulation import Method
from ancf_casadi.vibration.modes import Modes

LENGTH = 0.5
BEAM: dict[str, Any] = {
    "length": LENGTH,
    "width": 5e-3,
    "thickness": 0.5e-3,
    "density": 8000.0,
    "elastic_modulus": 210e9,
}  # Table 1
STIFFNESS = 210e9 * 5e-3 * 0.5e-3**3 / 12
WEIGHTLESS: dict[str, Any] = {"axis": (1.0, 0.0), "gravity": (0.0, 0.0)}
SMALL = 1e-3 * LENGTH
EXACT = 1e-11  # tolerance of the radau reference runs
TURNING: tuple[tuple[Method, float], ...] = (("idas", 1e-8), ("radau", 1e-7))
LADDERS: tuple[tuple[Method, tuple[float, ...]], ...] = (
    ("idas", (1e-7, 1e-8, 1e-9, 1e-10)),
    ("radau", (1e-6, 1e-7, 1e-8, 1e-9)),
)
DAMPED = RayleighDamping(alpha=0.2, beta=3e-5)


def bent(modes: Modes, mode: int, amplitude: float) -> State:
    """Return the state of rest under the load that bends the linear beam like a mode, without stretching it."""
    model, free = modes.model, slice(4, modes.model.size)  # the first node is clamped
    shape = modes.shapes[:, mode] / modes.tip_amplitudes()[mode]
    load = model.mass(model.properties).sparse() @ shape * amplitude * modes.angular_frequencies[mode] ** 2
    e = modes.equilibrium.coordinates.copy()
    rest = model.elastic_force(e, model.properties).full().ravel()
    for fraction in np.linspace(0.2, 1.0, 5):
        for _ in range(12):
            residual = model.elastic_force(e, model.properties).full().ravel() - rest - fraction * load
            stiffness = model.tangent_stiffness(e, model.properties).sparse()[free, free]
            e[free] -= scipy.sparse.linalg.spsolve(stiffness.tocsc(), residual[free])
    return State(e, np.zeros(model.size))


def decay_and_frequency(run: Trajectory, modes: Modes, mode: int) -> tuple[float, float]:
    """Return damping ratio and frequency (Hz) of a mode from straight-line fits to log(q - i q_t/omega)."""
    velocity = modes.modal_coordinate(run.velocities + modes.equilibrium.coordinates, mode)
    signal = modes.modal_coordinate(run.coordinates, mode) - 1j * velocity / modes.angular_frequencies[mode]
    omega = np.polyfit(run.time, np.unwrap(np.angle(signal)), 1)[0]
    return float(-np.polyfit(run.time, np.log(np.abs(signal)), 1)[0] / omega), float(omega / (2 * np.pi))


def small_motion() -> Iterator[str]:
    """Numerical damping and frequency error over ten periods of each mode."""
    model = Model(Beam.uniform(**BEAM, **WEIGHTLESS, elements=20))
    modes = natural_modes(model)
    yield row("method", "tolerance", *(f"mode {k}" for k in range(1, 6)), "steps in mode 1", "in mode 5")
    yield rule(9)
    cases = [(method, tolerance) for method, ladder in LADDERS for tolerance in ladder]
    found: dict[tuple[Method, float], list[tuple[float, float, int]]] = {case: [] for case in cases}
    for mode, frequency in enumerate(modes.frequencies.tolist()):
        settings = {
            "start": bent(modes, mode, SMALL),
            "duration": max(0.3, 10 / frequency),
            "sample_rate": 100 * frequency,
        }
        _, exact = decay_and_frequency(simulate(model, method="radau", tolerance=EXACT, **settings), modes, mode)
        for method, tolerance in cases:
            run = simulate(model, method=method, tolerance=tolerance, **settings)
            ratio, omega = decay_and_frequency(run, modes, mode)
            found[method, tolerance].append((ratio, omega / exact - 1, run.steps))
    for (method, tolerance), cells in found.items():
        text = [f"{ratio:.1e}, {shift:.1e}" for ratio, shift, _ in cells]
        yield row(method, f"{tolerance:.0e}", *text, cells[0][2], cells[-1][2])


def orders() -> Iterator[str]:
    """Error of IDAS at 1e-8 against its maximum order, in modes 1 and 5."""
    model = Model(Beam.uniform(**BEAM, **WEIGHTLESS, elements=20))
    modes = natural_modes(model)
    yield row("mode", "damping", *(f"order {k}" for k in range(1, 6)))
    yield rule(7)
    for mode, duration in ((0, 1.8), (4, 0.4)):
        for beta in (0.0, 3e-6, 3e-5):
            settings = {
                "start": bent(modes, mode, SMALL),
                "damping": RayleighDamping(beta=beta),
                "duration": duration,
                "sample_rate": max(1000.0, 100 * modes.frequencies[mode]),
            }
            exact = simulate(model, method="radau", tolerance=EXACT, **settings)
            cells = []
            for order in range(1, 6):
                options = {"max_multistep_order": order, "max_num_steps": 300}
                try:
                    run = simulate(model, method="idas", tolerance=1e-8, options=options, **settings)
                except SimulationError as error:
                    cells.append(f"stalls at {error.time:.2g} s")
                else:
                    cells.append(f"{abs(run.tip - exact.tip).max() / SMALL:.1e}, {run.steps}")
            yield row(mode + 1, rf"$\beta$ = {beta:g} s" if beta else "none", *cells)


def released(elements: int, load: float, **settings: Any) -> Trajectory:
    """Simulate the weightless beam, released from rest under a tip force of load E I/L^2."""
    model = Model(Beam.uniform(**BEAM, **WEIGHTLESS, elements=elements))
    start = static_equilibrium(model, tip_force=(0.0, load * STIFFNESS / LENGTH**2))
    return simulate(model, start=start, **settings)


def tolerances() -> Iterator[str]:
    """Errors of a large damped motion against tolerance, and their slopes."""
    settings = {"damping": DAMPED, "duration": 0.3, "sample_rate": 200.0}
    exact = released(20, 3.0, method="radau", tolerance=EXACT, **settings)
    most = np.abs(exact.clamp_force[1:, :2]).max()
    yield row("method", "tolerance", "tip / $L$", "clamp force / maximum", "energy balance / initial energy", "steps")
    yield rule(6)
    for method, ladder in (("idas", (1e-6, *LADDERS[0][1][:-1])), ("radau", (1e-5, *LADDERS[1][1], 1e-10))):
        errors = []
        for tolerance in ladder:
            run = released(20, 3.0, method=method, tolerance=tolerance, **settings)
            errors.append(abs(run.tip - exact.tip).max() / LENGTH)
            force = np.abs(run.clamp_force[1:, :2] - exact.clamp_force[1:, :2]).max() / most
            balance = np.abs(run.balance_error).max() / run.strain_energy[0]
            yield row(method, f"{tolerance:.0e}", f"{errors[-1]:.1e}", f"{force:.1e}", f"{balance:.1e}", run.steps)
        slope = np.polyfit(np.log(ladder), np.log(errors), 1)[0]
        yield row(method, "slope", f"{slope:.2f}", "", "", "")


def turning() -> Iterator[str]:
    """Dissipated energy in half a turn of the whole beam at 4 pi rad/s, 0.25 s, 10 elements."""
    model = Model(Beam.uniform(**BEAM, **WEIGHTLESS, elements=10))
    time = np.linspace(0.0, 0.5, 201)
    base = SampledBase(time, np.zeros((201, 2)), 4 * np.pi * time)
    yield row(r"stiffness, $\beta$ = 1 ms", "idas, 1e-8: dissipated / kinetic energy", "steps", "radau, 1e-7", "steps")
    yield rule(5)
    kinds: tuple[ProportionalStiffness, ...] = ("strain-rate", "tangent", "reference")
    for kind in kinds:
        with warnings.catch_warnings(action="ignore"):
            law = RayleighDamping(beta=1e-3, stiffness=kind)
        cells: list[object] = []
        for method, tolerance in TURNING:
            settings = {"base": base, "damping": law, "duration": 0.25, "sample_rate": 200.0}
            run = simulate(model, method=method, tolerance=tolerance, **settings)
            cells += [f"{run.dissipated_energy[-1] / run.kinetic_energy[0]:.1e}", run.steps]
        yield row(kind, *cells)


def undamped() -> Iterator[str]:
    """Measure steps and energy change of an undamped release from a bend of 0.8 L, 1 s."""
    yield row("method", "tolerance", "steps", "energy change / initial energy")
    yield rule(4)
    for tolerance in (1e-5, 1e-6, 1e-7):
        run = released(20, 9.1, duration=1.0, method="radau", tolerance=tolerance)
        yield row("radau", f"{tolerance:.0e}", run.steps, f"{np.abs(run.balance_error).max() / run.energy[0]:.1e}")


def backbone() -> Iterator[str]:
    """Frequency of mode 1 against amplitude."""
    yield row(
        "gravity",
        "method, tolerance",
        "tip amplitude / $L$",
        r"$\omega/\omega_{\mathrm{linear}} - 1$",
        "the same over $(A/L)^2$",
    )
    yield rule(5)
    for name, changes, across in (("none", WEIGHTLESS, 1), ("hanging", {}, 0)):
        modes = natural_modes(Model(Beam.uniform(**{**BEAM, **changes, "elements": 8})), count=6)
        others = ModalDamping(modes, (0.0, 0.1, 0.1, 0.1, 0.1, 0.1)) + RayleighDamping(beta=3e-5)
        cases: tuple[tuple[Method, float], ...] = (("radau", 1e-8), ("idas", 6e-10))
        for method, tolerance in cases:
            for amplitude in (0.1, 0.2):
                run = simulate(
                    modes.model,
                    start=bent(modes, 0, amplitude * LENGTH),
                    damping=others,
                    duration=3.5,
                    sample_rate=1000.0,
                    method=method,
                    tolerance=tolerance,
                )
                x = run.tip[:, across]
                (before,) = np.nonzero((x[:-1] < 0) & (x[1:] >= 0))
                crossings = run.time[before] - x[before] / (x[before + 1] - x[before]) / 1000.0
                frequency = (len(crossings) - 2) / (crossings[-1] - crossings[1])
                swings = [np.abs(x[i:j]).max() for i, j in pairwise(before[1:])]
                shift, size = frequency / modes.frequencies[0] - 1, np.mean(swings) / LENGTH
                yield row(name, f"{method}, {tolerance:.0e}", f"{size:.4f}", f"{shift:.3e}", f"{shift / size**2:.5f}")


def elements() -> Iterator[str]:
    """Tip error of a large damped motion against the number of elements."""
    tips = {
        n: released(n, 3.0, damping=DAMPED, duration=0.3, sample_rate=200.0, method="radau", tolerance=1e-10).tip
        for n in (5, 10, 20, 40, 80)
    }
    errors = {n: abs(tips[n] - tips[80]).max() / LENGTH for n in (5, 10, 20, 40)}
    yield row("elements", *errors)
    yield rule(1 + len(errors))
    yield row("tip error / $L$", *(f"{error:.1e}" for error in errors.values()))
    yield row("order", "", *(f"{np.log2(errors[n // 2] / errors[n]):.2f}" for n in (10, 20, 40)))


def row(*cells: object) -> str:
    """Return a row of a Markdown table."""
    return "| " + " | ".join(map(str, cells)) + " |"


def rule(columns: int) -> str:
    """Return the line below the header of a Markdown table."""
    return "|" + "---|" * columns


TABLES: Sequence[Callable[[], Iterator[str]]] = (
    small_motion,
    orders,
    tolerances,
    undamped,
    backbone,
    elements,
    turning,
)

if __name__ == "__main__":
    for table in TABLES:
        print(f"\n{(table.__doc__ or '').splitlines()[0]}\n")
        for line in table():
            print(line, flush=True)
