"""The study of the paper: its steps, their agreement with theory, and the files it writes."""

import json
import math
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import casadi as cs
import numpy as np
import pytest
from problems.study.decays import NOISE, linear_decays, quadratic_decays
from problems.study.reproduction import Study
from problems.study.transients import (
    FULL,
    LAW_NAMES,
    QUICK,
    SAMPLES,
    TIP_AMPLITUDES,
    UNDAMPED,
    WINDOWS,
    Effort,
    Transient,
    TransientResult,
    damping_laws,
    plan,
    run_transient,
    run_transients,
)

from ancf_casadi import Beam, InputError, Measurement, Model, Modes, SimulationError, natural_modes
from ancf_casadi.decay.closed_forms import linear_decay, quadratic_decay
from problems import fit_rayleigh
from problems.study import decays, figures, paper, report, reproduction, tables, transients

SHORT = Effort(accuracy=4e-6, driving=0.1, window=0.4)  # as accurate as the full study, a tenth as long
ETA2_UNCERTAINTY = (0.03, 0.22, 0.47, 0.73, 0.18)  # relative standard errors, from a Fisher information computed apart
THIRD = 2  # the mode that is cheapest to simulate


@pytest.fixture(scope="module")
def modes() -> Modes:
    """Five modes of the paper's beam on a coarse mesh, which is quick to simulate."""
    beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=5)
    return natural_modes(Model(beam), count=5)


@pytest.fixture(scope="module")
def laws(modes):
    return damping_laws(modes, fit_rayleigh(paper.FREQUENCIES[:2], paper.DAMPING_RATIOS[:2]))


def experiment(modes, laws, mode: int, name: str, effort: Effort) -> Transient:
    (found,) = (task for task in plan(modes, laws, effort) if (task.mode, task.name) == (mode, name))
    return found


def closed_form(transient: Transient) -> TransientResult:
    """Replace a simulation by the decay of Eq. (9) at the predicted ratio."""
    modes, mode = transient.modes, transient.mode
    ratio = 0.0 if transient.law is None else float(transient.law.damping_ratios(modes, TIP_AMPLITUDES)[mode])
    time = np.arange(0.0, transient.window, 1 / (SAMPLES * transient.base.frequency))
    omega, amplitude = float(modes.angular_frequencies[mode]), TIP_AMPLITUDES[mode]
    decay = Measurement(time, linear_decay(*map(cs.DM, (time, omega, ratio, amplitude, 0.0))).full().ravel())
    return TransientResult(
        mode=mode,
        name=transient.name,
        base_amplitude=transient.base.amplitude,
        amplitude=amplitude,
        frequency=float(modes.frequencies[mode]),
        damping_ratio=ratio,
        expected_ratio=ratio,
        motion=decay,
        decay=decay,
        steps=1,
        seconds=0.0,
    )


@pytest.fixture(scope="module")
def study() -> Study:
    """The whole study, its twenty simulations replaced by closed forms."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(transients, "run_transient", closed_form)
        return reproduction.reproduce(effort=QUICK, progress=True)


def predicted_ratios(study: Study) -> dict[str, list[float]]:
    """Damping ratios of the laws without the beam: as measured, Eq. (16), and Eq. (26) for mode 1."""
    ω = [2 * math.pi * f for f in study.match.frequencies]
    alpha, beta = 0.228181, 3.18013e-5  # Eq. (17)
    return {
        "generic": list(paper.DAMPING_RATIOS),
        "proportional": [alpha / (2 * w) + beta * w / 2 for w in ω],
        "quadratic": [paper.ETA1[0] / (2 * ω[0]) + 4 * paper.ETA2[0] * TIP_AMPLITUDES[0] / (3 * math.pi)],
    }


class TestDecays:
    @pytest.mark.parametrize("make", [linear_decays, quadratic_decays])
    def test_are_the_same_each_time(self, make):
        for first, second in zip(make(), make(), strict=True):
            assert first.time.tobytes() == second.time.tobytes()
            assert first.values.tobytes() == second.values.tobytes()

    @pytest.mark.parametrize(
        ("make", "curve", "parameters"),
        [
            (
                linear_decays,
                linear_decay,
                [
                    (2 * math.pi * f, zeta, r0, 0.0)
                    for f, zeta, r0 in zip(
                        paper.FREQUENCIES, paper.DAMPING_RATIOS, decays.START_AMPLITUDES, strict=True
                    )
                ],
            ),
            (
                quadratic_decays,
                quadratic_decay,
                [
                    (2 * math.pi * f, eta1, eta2, e0, 0.0)
                    for f, eta1, eta2, e0 in zip(
                        paper.FREQUENCIES, paper.ETA1, paper.ETA2, paper.EQUIVALENT_AMPLITUDES, strict=True
                    )
                ],
            ),
        ],
        ids=["Eq. (9)", "Eq. (27)"],
    )
    def test_are_the_closed_form_and_white_noise(self, make, curve, parameters):
        """Noise of the stated size, not correlated in time or between modes."""
        noises = []
        for record, values in zip(make(), parameters, strict=True):
            exact = curve(*map(cs.DM, (record.time, *values))).full().ravel()
            noises.append(record.values - exact)
            assert len(record.time) == 2500
        for k, noise in enumerate(noises):
            assert np.std(noise) == pytest.approx(NOISE, rel=0.06)
            assert abs(np.mean(noise)) < 4 * NOISE / math.sqrt(noise.size)
            for other in (noise[1:], *(another[1:] for another in noises[:k])):
                assert abs(np.corrcoef(noise[:-1], other)[0, 1]) < 4 / math.sqrt(noise.size)

    def test_fits_recover_table_2(self, study):
        """Each of the ten numbers of Table 2 lies within four standard errors."""
        for fit, f, zeta in zip(study.identification, paper.FREQUENCIES, paper.DAMPING_RATIOS, strict=True):
            assert abs(fit.frequency - f) < 4 * fit.standard_errors["frequency"]
            assert abs(fit.damping_ratio - zeta) < 4 * fit.standard_errors["damping_ratio"]
            assert fit.standard_errors["damping_ratio"] < 0.02 * zeta

    def test_eta2_of_the_higher_modes_is_uncertain(self, study):
        """Erratum 18: with this noise, eta2 of modes 1 to 5 is uncertain by 3, 22, 47, 73 and 18 %."""
        uncertain = [fit.standard_errors["eta2"] / eta2 for fit, eta2 in zip(study.quadratic, paper.ETA2, strict=True)]
        assert uncertain == pytest.approx([0.03, 0.22, 0.47, 0.73, 0.18], rel=0.35)
        for fit, eta1, eta2 in zip(study.quadratic, paper.ETA1, paper.ETA2, strict=True):
            assert abs(fit.eta1 - eta1) < 4 * fit.standard_errors["eta1"]
            assert abs(fit.eta2 - eta2) < 4 * fit.standard_errors["eta2"]
            assert fit.correlation < -0.9


class TestPlan:
    def test_each_mode_under_each_law_and_undamped(self, modes, laws):
        tasks = plan(modes, laws, FULL)
        assert [(task.mode, task.name) for task in tasks] == [
            (k, name) for k in range(5) for name in (*LAW_NAMES, UNDAMPED)
        ]
        assert all((task.law is None) == (task.name == UNDAMPED) for task in tasks)

    def test_drives_at_the_natural_frequency_until_the_papers_stop(self, modes, laws):
        for task in plan(modes, laws, FULL):
            assert task.base.frequency == modes.frequencies[task.mode]
            stop = paper.STOPS[task.mode] * (1.0 if task.law else 0.1)
            assert stop <= task.base.stop_time <= stop + 0.5 / task.base.frequency

    def test_fits_no_longer_than_the_amplitude_takes_to_halve(self, modes, laws):
        for task in plan(modes, laws, FULL):
            window = WINDOWS[task.mode]
            if task.law is not None:
                ratio = task.law.damping_ratios(modes, TIP_AMPLITUDES)[task.mode]
                window = min(window, math.log(2) / (ratio * modes.angular_frequencies[task.mode]))
            assert task.window == pytest.approx(window, rel=1e-12)
            assert task.window * task.base.frequency > 6  # periods: enough to tell a ratio
            assert task.duration >= task.base.stop_time + task.window

    def test_quick_is_less_work_everywhere(self, modes, laws):
        for full, quick in zip(plan(modes, laws, FULL), plan(modes, laws, QUICK), strict=True):
            assert quick.duration < full.duration
            assert quick.tolerance > full.tolerance

    def test_laws_predict_the_ratios_they_were_fitted_to(self, study):
        """All five ratios for the modal law, the first two for the Rayleigh law, the first for the quadratic law."""
        modes = natural_modes(Model(study.match.beam), count=5)
        laws = damping_laws(modes, study.rayleigh)
        ratios = {name: law.damping_ratios(modes, paper.EQUIVALENT_AMPLITUDES) for name, law in laws.items()}
        assert tuple(ratios) == tuple(LAW_NAMES)
        assert ratios["generic"] == pytest.approx(paper.DAMPING_RATIOS, rel=1e-6)
        assert ratios["proportional"][:2] == pytest.approx(paper.DAMPING_RATIOS[:2], rel=1e-6)
        assert 100 * ratios["proportional"][2:] == pytest.approx([0.3358, 0.5656, 0.9057], abs=1e-4)
        assert ratios["quadratic"][0] == pytest.approx(paper.DAMPING_RATIOS[0], rel=0.01)


class TestTransients:
    @pytest.mark.parametrize("name", LAW_NAMES)
    def test_decay_after_the_stop_has_the_predicted_ratio(self, modes, laws, name):
        """The whole beam, driven and stopped, against the prediction of each law for the mode and amplitude."""
        result = run_transient(experiment(modes, laws, THIRD, name, SHORT))
        assert result.expected_ratio > 4e-4
        assert result.damping_ratio == pytest.approx(result.expected_ratio, abs=2e-5)
        assert result.frequency == pytest.approx(modes.frequencies[THIRD], rel=2e-3)

    def test_undamped_motion_keeps_its_amplitude(self, modes, laws):
        """Numerical damping is a hundred times less than the lowest damping ratio; the amplitude is as planned."""
        result = run_transient(experiment(modes, laws, THIRD, UNDAMPED, SHORT))
        assert result.expected_ratio == 0.0
        assert abs(result.damping_ratio) < 2e-5
        assert result.amplitude == pytest.approx(TIP_AMPLITUDES[THIRD], rel=0.01)

    @pytest.mark.parametrize("name", LAW_NAMES)
    def test_first_mode_at_large_swing(self, modes, laws, name):
        """At 7 cm of 50 cm the ratio is still the predicted one, within 2 %."""
        result = run_transient(experiment(modes, laws, 0, name, Effort(accuracy=1e-5, driving=0.1, window=0.3)))
        assert result.amplitude > 0.06
        assert result.damping_ratio == pytest.approx(result.expected_ratio, rel=0.02)

    def test_processes_threads_and_one_after_the_other_give_the_same_bits(self, modes, laws):
        brief = Effort(accuracy=1e-3, driving=0.02, window=0.15)
        tasks = [experiment(modes, laws, 3, name, brief) for name in ("generic", "quadratic")]
        serial = run_transients(tasks, 1, None, progress=False)
        processes = run_transients(tasks, 2, None, progress=False)
        with ThreadPoolExecutor(1) as executor:
            given = run_transients(tasks, 1, executor, progress=False)
        for other in (processes, given):
            for ours, theirs in zip(serial, other, strict=True):
                assert (ours.mode, ours.name) == (theirs.mode, theirs.name)
                assert ours.motion.values.tobytes() == theirs.motion.values.tobytes()
                assert ours.decay.values.tobytes() == theirs.decay.values.tobytes()
                assert (ours.damping_ratio, ours.frequency) == (theirs.damping_ratio, theirs.frequency)

    @pytest.mark.parametrize("jobs", [1, 2])
    def test_an_unusable_experiment_is_the_same_error_in_a_process(self, modes, laws, jobs):
        task = experiment(modes, laws, 3, "generic", Effort(accuracy=1e-3, driving=0.02, window=0.15))
        with pytest.raises(InputError, match="tolerance: must be positive"):
            run_transients([replace(task, tolerance=-1.0), task], jobs, None, progress=False)

    @pytest.mark.parametrize("jobs", [1, 2])
    def test_a_failing_simulation_is_the_same_error_in_a_process(self, modes, laws, jobs):
        """A tolerance below rounding lets no step succeed; the error travels with its time."""
        task = experiment(modes, laws, 3, "generic", Effort(accuracy=1e-3, driving=0.02, window=0.15))
        with pytest.raises(SimulationError, match="IDAS could not meet"):
            run_transients([replace(task, tolerance=1e-30), task], jobs, None, progress=False)


class TestResults:
    def test_keys_that_are_promised(self, study):
        """The meaning of a key never changes silently."""
        results = report.results(study)
        assert {"modal_identification", "proportional", "quadratic", "frequency_matching", "damping_comparison",
                "timing"} <= results.keys()  # fmt: skip
        rows = {
            "modal_identification": {"mode", "frequency_hz", "frequency_stderr_hz", "damping_ratio",
                                     "damping_ratio_stderr"},
            "quadratic": {"mode", "eta1", "eta2_per_m", "equivalent_damping_ratio"},
        }  # fmt: skip
        for key, promised in rows.items():
            assert [row["mode"] for row in results[key]] == [1, 2, 3, 4, 5]
            assert all(promised <= row.keys() for row in results[key])
        assert {"alpha", "beta"} <= results["proportional"].keys()
        matching = results["frequency_matching"]
        assert {"target_hz", "standard_hz", "matched_hz", "width_m", "thickness_m", "elastic_modulus", "density",
                "max_relative_error", "at_bound", "iterations", "solve_seconds"} <= matching.keys()  # fmt: skip
        assert {"experiment", *LAW_NAMES} <= results["damping_comparison"].keys()

    def test_values_are_si_and_fractions(self, study):
        results = report.results(study)
        matching = results["frequency_matching"]
        assert matching["target_hz"] == list(paper.FREQUENCIES)
        assert matching["matched_hz"] == pytest.approx(paper.FREQUENCIES, rel=1e-6)
        assert len(matching["width_m"]) == len(matching["thickness_m"]) == paper.ELEMENTS
        assert matching["width_m"] == pytest.approx([5e-3] * 20, rel=0.1)
        assert matching["thickness_m"] == pytest.approx([0.5e-3] * 20, rel=0.1)
        assert matching["density"] == pytest.approx(8000.0, rel=0.1)
        assert matching["elastic_modulus"] == pytest.approx(210e9, rel=0.1)
        assert results["proportional"] == pytest.approx({"alpha": 0.228181, "beta": 3.18013e-5}, rel=1e-5)
        assert results["damping_comparison"]["experiment"] == list(paper.DAMPING_RATIOS)
        for name, ratios in predicted_ratios(study).items():
            assert results["damping_comparison"][name][: len(ratios)] == pytest.approx(ratios, rel=5e-3)
        found = np.array([row["eta2_per_m"] for row in results["quadratic"]])
        assert (np.abs(found / paper.ETA2 - 1) < 4 * np.array(ETA2_UNCERTAINTY)).all()

    def test_are_json_and_back(self, study):
        results = report.results(study)
        assert json.loads(json.dumps(results, allow_nan=False)) == results

    def test_timing_has_every_step(self, study):
        steps = ["modal_identification", "proportional", "quadratic", "frequency_matching", "transients"]
        assert list(study.timing) == steps
        within = {
            "modal_identification": [fit.fit.solve_seconds for fit in study.identification],
            "quadratic": [fit.fit.solve_seconds for fit in study.quadratic],
            "frequency_matching": [study.match.build_seconds, study.match.solve_seconds],
        }
        for step, seconds in within.items():
            assert 0.0 < sum(seconds) < study.timing[step]
        assert study.timing["proportional"] < study.timing["quadratic"]

    def test_laws_in_the_order_of_the_modes(self, study):
        for name in LAW_NAMES:
            assert [result.mode for result in study.under(name)] == [0, 1, 2, 3, 4]
        for name, ratios in predicted_ratios(study).items():
            assert study.ratios(name)[: len(ratios)] == pytest.approx(ratios, rel=5e-3)
        assert [result.mode for result in study.undamped] == [0, 1, 2, 3, 4]

    def test_tables_stand_beside_the_papers_numbers(self, study):
        found = {table.name.partition("_")[0]: table for table in tables.tables(study)}
        assert list(found)[:6] == ["table02", "table03", "table04", "table09", "table10", "table11"]
        for table in found.values():
            assert all(len(row) == len(table.columns) for row in table.rows)
        assert [row[3] for row in found["table02"].rows] == list(paper.FREQUENCIES)
        assert [row[4] for row in found["table10"].rows] == list(paper.STANDARD_FREQUENCIES)
        assert [row[6] for row in found["table10"].rows] == list(paper.OPTIMUM_FREQUENCIES)

    def test_state_that_the_decays_are_synthetic(self, study):
        """Erratum 20: no raw record is published."""
        assert "ynthetic" in report.results(study)["data"]
        found = {table.name: table for table in tables.tables(study)}
        for name in ("table02_modal_parameters", "table04_quadratic"):
            assert "Synthetic" in found[name].text()

    def test_show_the_right_values_beside_misprints(self, study):
        """Errata 1 and 4: frequencies with 7850 kg/m^3 and no gravity, and the printed beta beside the right one."""
        found = {table.name: table for table in tables.tables(study)}
        weightless = [row[3] for row in found["table10_frequencies"].rows]
        assert weightless == pytest.approx(paper.STANDARD_FREQUENCIES, rel=1e-3)
        (beta,) = (row for row in found["table03_proportional"].rows if row[0] == "beta")
        assert beta[2:] == (pytest.approx(paper.BETA, rel=1e-3), paper.BETA_PRINTED)
        assert "ten times" in found["table03_proportional"].text()


@pytest.fixture
def drawn(monkeypatch):
    """Replace the figures, which take seconds and have tests of their own."""
    monkeypatch.setattr(figures, "figures", lambda study: [("one.png", b"1"), ("two.png", b"2")])


class TestWriting:
    def test_results_come_last(self, study, drawn, tmp_path):
        folder = tmp_path / "new" / "folder"
        written = report.write_study(study, folder)
        assert written[-1] == folder / "results.json"
        assert sorted(folder.iterdir()) == sorted(written)
        assert json.loads(written[-1].read_text()) == report.results(study)

    def test_a_figure_that_fails_leaves_nothing(self, study, tmp_path, monkeypatch):
        def broken(study):
            raise RuntimeError("no ink")

        monkeypatch.setattr(figures, "figures", broken)
        with pytest.raises(RuntimeError, match="no ink"):
            report.write_study(study, tmp_path / "out")
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("stopped_at", ["table04_quadratic.csv", "two.png", "results.json"])
    def test_interrupted_it_leaves_an_earlier_study_as_it_was(self, study, drawn, tmp_path, monkeypatch, stopped_at):
        earlier = {name: "earlier" for name in ("results.json", "table04_quadratic.csv", "two.png")}
        for name, content in earlier.items():
            (tmp_path / name).write_text(content)
        change_mode = os.chmod

        def interrupted(draft, mode):
            if os.path.basename(draft).startswith(f".{stopped_at}-"):
                raise KeyboardInterrupt
            change_mode(draft, mode)

        monkeypatch.setattr(os, "chmod", interrupted)
        with pytest.raises(KeyboardInterrupt):
            report.write_study(study, tmp_path)
        assert {path.name: path.read_text() for path in tmp_path.iterdir()} == earlier

    def test_a_full_disk_is_an_input_error(self, study, drawn, tmp_path, monkeypatch):
        def full(source, target):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "replace", full)
        with pytest.raises(InputError, match=r"cannot be written \(No space left on device\)"):
            report.write_study(study, tmp_path / "out")
        assert list((tmp_path / "out").iterdir()) == []


def test_figures_of_the_study(study):
    """One for each table and each mode, as PNG, the same bytes each time."""
    drawn = figures.figures(study)
    assert [name for name, _ in drawn] == [
        "table02_modal_parameters.png", "table03_proportional.png", "table04_quadratic.png", "table09_properties.png",
        "table10_frequencies.png", "table11_damping_ratios.png", *(f"transients_mode{k}.png" for k in range(1, 6)),
    ]  # fmt: skip
    assert all(content.startswith(b"\x89PNG\r\n\x1a\n") for _, content in drawn)
    assert len({content for _, content in drawn}) == len(drawn)


def test_figures_have_their_panels(study):
    """Five decays, one comparison, width and thickness, and for each mode and law the motion above its decay."""
    assert len(figures.table_2_modal_parameters(study).axes) == 5
    assert len(figures.table_9_properties(study).axes) == 2
    assert len(figures.transients(study, 0).axes) == 2 * len(LAW_NAMES)
    (comparison,) = figures.table_11_damping_ratios(study).axes
    assert (comparison.get_xlabel(), comparison.get_ylabel()) == ("mode", "damping ratio, %")
    assert comparison.get_yscale() == "log"


@pytest.mark.slow
def test_the_command_reproduces_the_study(tmp_path, monkeypatch):
    """The command prints pure JSON, writes all files, and gives ratios within a few percent."""
    monkeypatch.delenv("ANCF_CASADI_COMPILE", raising=False)  # as a user runs it: with a C compiler, if there is one
    out = tmp_path / "study"
    command = [sys.executable, "-m", "problems.cli", "reproduce", "--quick", "--jobs", "2", "--json", "--out", str(out)]
    compiled = {**os.environ, "ANCF_CASADI_COMPILE": "1"}  # where there is a compiler; several times faster
    done = subprocess.run(command, capture_output=True, text=True, timeout=280, check=False, env=compiled)
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)
    assert results == json.loads((out / "results.json").read_text())
    assert "Warning" not in done.stderr
    comparison = results["damping_comparison"]
    assert comparison["generic"] == pytest.approx(paper.DAMPING_RATIOS, rel=0.05)
    assert comparison["proportional"][2:] == pytest.approx([0.003358, 0.005656, 0.009057], rel=0.02)
    assert comparison["quadratic"][2:] == pytest.approx([0.0005, 0.00025, 0.00015], rel=0.1)
    for row in results["transients"]:
        assert row["damping_ratio"] == pytest.approx(row["expected_damping_ratio"], abs=1.2e-4, rel=0.02)
    assert results["frequency_matching"]["max_relative_error"] < 1e-6
    names = {path.name for path in out.iterdir()}
    assert {f"transients_mode{k}.png" for k in range(1, 6)} <= names
    assert sum(name.endswith(".csv") for name in names) == 7
