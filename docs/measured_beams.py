"""Fit the three measured beams of ``measured_beams.md``; print its tables, and draw the motion of the silicone beam.

Usage: python docs/measured_beams.py [SILICONE_FOLDER], with the folder of the silicone records, which are not part of
the repository: beam_gravity_V2_a.csv, beam_load52_V2_a.csv and beam_load101_V2_a.csv.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ancf_casadi import Beam, Model, PointLoad, RayleighDamping, Sensor, Trajectory, simulate
from ancf_casadi.figures.files import figure_bytes
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import COMPUTED, MEASURED
from problems import BeamFit, FrequencyRecord, MarkerRecord, StaticRecord, fit_beam, fit_decay

HERE = Path(__file__).parent
DOWN, UP = (0.0, -1.0), (0.0, 1.0)
WEIGHT = (0.0, -9.81)

LENGTHS = (0.3, 0.4, 0.5, 0.6)  # m
STRIP_HZ = ((16.493, 107.6), (9.383, 61.537), (6.02, 39.63), (4.25, 27.347))
THICKNESSES = (2.0e-3, 2.032e-3)  # as measured, and as sold (0.08 in), m
ORIENTATIONS: Mapping[str, tuple[tuple[float, float], tuple[float, float]]] = {
    "motion in a horizontal plane": ((1.0, 0.0), (0.0, 0.0)),
    "horizontal, motion vertical": ((1.0, 0.0), WEIGHT),
    "hanging": ((0.0, -1.0), WEIGHT),
    "standing": ((0.0, 1.0), WEIGHT),
}  # axis and gravity
LEVEL, HORIZONTAL_PLANE = 0.95, "motion in a horizontal plane"

HUNG_G = (20, 50, 75, 100, 150, 200, 400)
DEFLECTION_MM = (14.125, 35.861, 53.245, 69.113, 101.43, 130.90, 217.90)
LAMINATE = 0.707  # E I from laminate theory, N m^2

SILICONE = {"gravity": 0.0, "load52": 0.052, "load101": 0.101}  # record, hung mass in kg
STILL = 30  # frames at rest before the release
SETTLED = 100  # frames at rest at the end
MOVES = 3e-4  # displacement at which the tip has left its rest, four times the scatter before, m
WATCHED = 1.2  # s


def strip_records(
    thickness: float = THICKNESSES[0], orientation: str = HORIZONTAL_PLANE, tip_mass: float = 5e-3
) -> list[FrequencyRecord]:
    """Return the frequencies of the aluminium strip at four free lengths."""
    axis, gravity = ORIENTATIONS[orientation]
    return [
        FrequencyRecord(
            Model(
                Beam.uniform(
                    length=length, width=0.05, thickness=thickness, density=2700.0, elastic_modulus=69e9,
                    elements=12, axis=axis, gravity=gravity, tip_mass=tip_mass,
                )
            ),
            frequencies,
            name=f"{100 * length:.0f} cm",
        )
        for length, frequencies in zip(LENGTHS, STRIP_HZ, strict=True)
    ]  # fmt: skip


def composite_record(mass_per_length: float = 1e-6, most_g: float = 400.0) -> StaticRecord:
    """Return the deflections of the composite strip under loads of up to ``most_g``.

    Width and thickness have no effect; the self-weight is unknown, and zero by default.
    """
    width, thickness = 0.03, 1.5e-3
    beam = Beam.uniform(
        length=0.55, width=width, thickness=thickness, density=mass_per_length / (width * thickness),
        elastic_modulus=12 * LAMINATE / (width * thickness**3), elements=22, axis=(1.0, 0.0),
    )  # fmt: skip
    pairs = [(g, mm) for g, mm in zip(HUNG_G, DEFLECTION_MM, strict=True) if g <= most_g]
    loads = [PointLoad.hung(1e-3 * g, 0.5) for g, _ in pairs]
    values = [1e-3 * mm for _, mm in pairs]
    return StaticRecord(Model(beam), loads, values, Sensor("displacement", 0.5, DOWN), name="composite strip")


def silicone_beam(hung: float = 0.0, elements: int = 8) -> Model:
    """Return the silicone beam with a mass (kg) at its tip."""
    return Model(
        Beam.uniform(
            length=0.1, width=0.03, thickness=0.03, density=1070.0, elastic_modulus=264e3, elements=elements,
            axis=(1.0, 0.0), tip_mass=hung,
        )
    )  # fmt: skip


def silicone_motion(folder: Path, name: str) -> tuple[Array, Array]:
    """Return times, s (k,), and the mean tip marker relative to the mean clamp marker, (k, 2), m.

    The columns are the displacements along the beam and upwards, from the rest before the release.
    """
    table = np.genfromtxt(folder / f"beam_{name}_V2_a.csv", delimiter=",", skip_header=1)
    markers = table[:, 1:].reshape(-1, 6, 3)
    relative = markers[:, :3].mean(axis=1) - markers[:, 3:].mean(axis=1)
    moved = relative - relative[:STILL].mean(axis=0)
    return table[:, 0], moved[:, [2, 0]]


def silicone_records(folder: Path) -> tuple[StaticRecord, list[FrequencyRecord]]:
    """Return the positions of the tip at the end of the three records, and the frequencies of their decays."""
    ends, tones = [], []
    for name, hung in SILICONE.items():
        time, moved = silicone_motion(folder, name)
        ends.append(float(moved[-SETTLED:, 1].mean()))
        frequency = fit_decay(time, moved[:, 1]).frequency
        tones.append(FrequencyRecord(silicone_beam(hung), [frequency], name=f"{1e3 * hung:.0f} g"))
    loads = [PointLoad.hung(hung) if hung else () for hung in SILICONE.values()]
    return StaticRecord(silicone_beam(), loads, ends, Sensor("position", direction=UP), name="tip at rest"), tones


def silicone_release(folder: Path, name: str) -> MarkerRecord:
    """Return the motion of the tip from the last frame before it moves, for ``WATCHED`` seconds."""
    time, moved = silicone_motion(folder, name)
    first = int(np.argmax(np.abs(moved[:, 1]) > MOVES)) - 1
    last = first + round(WATCHED / (time[1] - time[0])) + 1
    return MarkerRecord(time[first:last] - time[first], moved[first:last] + np.array([0.1, 0.0]), start="straight")


def silicone_motion_fit(folder: Path) -> tuple[BeamFit, dict[str, tuple[MarkerRecord, Trajectory]]]:
    """Return modulus and damping from the motion under gravity alone, and all motions computed with them."""
    fit = fit_beam(
        silicone_beam(elements=6),
        silicone_release(folder, "gravity"),
        RayleighDamping(beta=1e-3),
        unknowns=["elastic_modulus"],
        bounds={"elastic_modulus": (185e3, 370e3)},
    )
    runs = {}
    for name, hung in SILICONE.items():
        record = silicone_release(folder, name)
        model = fit.configured(silicone_beam(hung, elements=6))
        time = np.asarray(record.time)
        rate = (time.size - 1) / time[-1]
        runs[name] = record, simulate(model, damping=fit.law, start="straight", duration=time[-1], sample_rate=rate)
    return fit, runs


def motion_table(folder: Path) -> Iterator[str]:
    """Silicone beam: a fit to the motion under gravity, and the motions with hung masses predicted from it."""
    fit, runs = silicone_motion_fit(folder)
    found, errors = fit.estimates, fit.standard_errors
    modulus = f"E = {1e-3 * found['elastic_modulus']:.1f} +- {1e-3 * errors['elastic_modulus']:.1f} kPa"
    yield f"{modulus}, beta = {1e3 * found['beta']:.2f} +- {1e3 * errors['beta']:.2f} ms"
    yield ""
    yield row("record", "travel, mm", "rms error, mm", "error / travel, %", "lowest, measured, mm", "computed, mm")
    yield rule(6)
    for name, (record, run) in runs.items():
        measured = np.asarray(record.positions)[:, 0, 1]
        rms, travel = 1e3 * np.sqrt(np.mean((run.tip[:, 1] - measured) ** 2)), 1e3 * np.ptp(measured)
        kind = "fitted" if name == "gravity" else "predicted"
        cells = f"{travel:.1f}", f"{rms:.2f}", f"{100 * rms / travel:.1f}"
        lowest = f"{1e3 * measured.min():.1f}", f"{1e3 * run.tip[:, 1].min():.1f}"
        yield row(f"{1e3 * SILICONE[name]:.0f} g, {kind}", *cells, *lowest)


def motion_figure(runs: Mapping[str, tuple[MarkerRecord, Trajectory]]) -> Figure:
    """Draw measured and computed motions of the silicone beam."""
    figure = Figure(figsize=(8, 6.4), layout="constrained")
    for axes, (name, (record, run)) in zip(figure.subplots(3, 1, sharex=True), runs.items(), strict=True):
        axes.plot(run.time, 1e3 * np.asarray(record.positions)[:, 0, 1], ".", ms=4, color=MEASURED, label="measured")
        axes.plot(run.time, 1e3 * run.tip[:, 1], lw=1, color=COMPUTED, label="computed")
        kind = "fitted" if name == "gravity" else "predicted"
        axes.set(ylabel="tip, mm", title=f"{1e3 * SILICONE[name]:.0f} g hung at the tip, {kind}")
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
    figure.axes[0].legend(frameon=False, ncols=2, loc="lower right")
    figure.axes[-1].set(xlabel="time after the release, s")
    return figure


def shear_share(length: float, thickness: float) -> float:
    """Return the shear deflection over the bending deflection under a tip load: 3 E I/(k G A L^2).

    Timoshenko's beam of rectangular section, k = 5/6, of an incompressible material, G = E/3.
    """
    return 3 * thickness**2 / 12 / (5 / 6 / 3 * length**2)


def strip_fits() -> Iterator[str]:
    """Aluminium strip: fits to eight frequencies."""
    yield row(
        "thickness, mm",
        "orientation",
        "unknowns",
        "$E$, GPa",
        "$EI$, N m²",
        "tip mass, g",
        "clamp, N m/rad",
        "scatter, %",
    )
    yield rule(8)
    cases = [(THICKNESSES[0], HORIZONTAL_PLANE, names) for names in STRIP_UNKNOWNS]
    cases += [(THICKNESSES[1], HORIZONTAL_PLANE, names) for names in STRIP_UNKNOWNS[:2]]
    cases += [(THICKNESSES[0], place, STRIP_UNKNOWNS[1]) for place in list(ORIENTATIONS)[1:]]
    for thickness, place, names in cases:
        fit = property_fit(strip_records(thickness, place), names)
        section = fit.combinations["bending_stiffness"][0] / fit.estimates["elastic_modulus"]
        yield row(
            f"{1e3 * thickness:g}", place, " and ".join(map(SHORT.get, names)), shown(fit, "elastic_modulus", 1e-9),
            shown(fit, "elastic_modulus", section), shown(fit, "tip_mass", 1e3), shown(fit, "clamp_stiffness"),
            f"{100 * fit.scatter:.2f}",
        )  # fmt: skip


def composite_fits() -> Iterator[str]:
    """Composite strip: fits to seven deflections."""
    yield row("unknowns", "mass, g/m", "loads up to, g", "$EI$, N m²", "clamp, N m/rad", "scatter, %")
    yield rule(6)
    for names, mass, most in COMPOSITE_CASES:
        fit = property_fit([composite_record(mass, most)], names)
        weight = f"{1e3 * mass:.0f}"
        cells = shown(fit, "bending_stiffness"), shown(fit, "clamp_stiffness"), f"{100 * fit.scatter:.2f}"
        yield row(" and ".join(map(SHORT.get, names)), weight, f"{most:g}", *cells)


def silicone_fits(folder: Path) -> Iterator[str]:
    """Silicone beam: fits to positions at rest and frequencies, and predictions."""
    rest, tones = silicone_records(folder)
    yield row("records", "unknowns", "$E$, kPa", "density, kg/m³", "residuals, %")
    yield rule(5)
    for words, records, names in silicone_cases(rest, tones):
        fit = property_fit(records, names)
        channels = [channel for record in records for channel in fit.predict(record).channels]
        errors = np.concatenate([one.predicted / one.measured - 1 for one in channels])
        residuals = ", ".join(f"{100 * error:+.1f}" for error in errors.tolist()) if len(errors) > 1 else "–"
        yield row(
            words,
            " and ".join(map(SHORT.get, names)),
            shown(fit, "elastic_modulus", 1e-3),
            shown(fit, "density"),
            residuals,
        )


def silicone_cases(
    rest: StaticRecord, tones: Sequence[FrequencyRecord]
) -> Iterator[tuple[str, list[StaticRecord | FrequencyRecord], tuple[str, ...]]]:
    """Yield the fits of the silicone beam: description, records and unknowns."""
    values = np.ravel(rest.values)
    own = StaticRecord(rest.model, [()], values[:1], rest.sensors)
    changes = StaticRecord(rest.model, rest.cases[1:], values[1:] - values[0], Sensor("displacement", direction=UP))
    modulus, both = ("elastic_modulus",), ("elastic_modulus", "density")
    yield "rest under self-weight", [own], modulus
    yield "further deflection under 52 g and 101 g", [changes], modulus
    for tone in tones:
        yield f"frequency with {tone.name}", [tone], modulus
    yield "all at rest", [rest], modulus
    yield "all at rest", [rest], both
    yield "all at rest, all frequencies", [rest, *tones], both


STRIP_UNKNOWNS = (
    ("elastic_modulus",),
    ("elastic_modulus", "clamp_stiffness"),
    ("elastic_modulus", "tip_mass"),
    ("elastic_modulus", "tip_mass", "clamp_stiffness"),
)
COMPOSITE_CASES = (
    (("bending_stiffness",), 1e-6, 400.0),
    (("bending_stiffness", "clamp_stiffness"), 1e-6, 400.0),
    (("clamp_stiffness",), 1e-6, 400.0),
    (("bending_stiffness",), 0.07, 400.0),
    (("bending_stiffness",), 1e-6, 200.0),
    (("bending_stiffness", "clamp_stiffness"), 1e-6, 200.0),
)
SHORT = {
    "elastic_modulus": "$E$",
    "bending_stiffness": "$EI$",
    "clamp_stiffness": "clamp",
    "tip_mass": "tip mass",
    "density": "density",
}


def property_fit(records: Sequence[StaticRecord | FrequencyRecord], names: Sequence[str]) -> BeamFit:
    """Return the fit of unknown properties; the beam of the first record has their first values."""
    return fit_beam(records[0].model, records, unknowns=names)


def shown(fit: BeamFit, name: str, scale: float = 1.0) -> str:
    """Return a value with its interval, or a dash if the fit did not change it."""
    if name not in fit.estimates:
        return "–"
    low, high = (scale * end for end in fit.intervals(LEVEL)[name])
    if np.isinf(high):
        return f"above {low:.4g}"
    if np.isnan(low):
        return f"{scale * fit.estimates[name]:.4g}"
    return f"{scale * fit.estimates[name]:.4g} ({low:.4g} to {high:.4g})"


def row(*cells: object) -> str:
    """Return a row of a Markdown table."""
    return "| " + " | ".join(map(str, cells)) + " |"


def rule(columns: int) -> str:
    """Return the line below the header of a Markdown table."""
    return "|" + "---|" * columns


if __name__ == "__main__":
    tables = [strip_fits(), composite_fits()]
    for folder in map(Path, sys.argv[1:2]):
        tables += [silicone_fits(folder), motion_table(folder)]
        (HERE / "measured_silicone.png").write_bytes(figure_bytes(motion_figure(silicone_motion_fit(folder)[1])))
    for table in tables:
        print(*table, "", sep="\n", flush=True)
