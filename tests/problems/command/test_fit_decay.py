"""``fit-decay``: modes, bands, several records, parts of a record, and what is refused."""

import json

import numpy as np
import pytest

SLOW, FAST = (3.0, 0.02, 5e-3), (19.0, 0.01, 8e-3)


def near(data, name, truth):
    """Return whether an estimate is within four of its standard errors."""
    key = {"frequency": "_hz", "damping_ratio": ""}[name]
    return data[f"{name}{key}"] == pytest.approx(truth, abs=4 * data[f"{name}_stderr{key}"])


class TestModes:
    @pytest.mark.slow
    def test_an_acceleration_has_its_own_unit(self, run, tmp_path):
        time = np.arange(0.0, 5.0, 0.002)
        swing = np.exp(-0.5 * time) * np.cos(20 * time) + 0.4 * np.exp(-time) * np.cos(120 * time)
        swing += 1e-3 * np.random.default_rng(1).standard_normal(len(time))
        np.savetxt(
            tmp_path / "a.csv", np.column_stack([time, swing]), delimiter=",", header="t_s,a (m/s^2)", comments=""
        )
        done = run("fit-decay", "a.csv", "--modes", "--plot", "a.svg")
        assert "the residuals have an rms of 0.001 m/s^2" in done.out
        assert run("fit-decay", "a.csv", "--curve", "curve.csv").code == 0
        assert (tmp_path / "curve.csv").read_text().splitlines()[1].split(",")[1].startswith("0.002")

    @pytest.mark.slow
    def test_the_table_fits_a_terminal_and_the_figure_is_drawn(self, run, decay, tmp_path):
        decay("two.csv", SLOW, FAST)
        done = run("fit-decay", "two.csv", "--modes", "2", "--plot", "new/two.svg")
        assert done.code == 0 and max(map(len, done.out.splitlines())) <= 100
        assert (tmp_path / "new/two.svg").read_bytes().startswith(b"<?xml")


class TestBand:
    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("band", "mode", "other", "law"), [("2,4", SLOW, FAST, "linear"), ("10,30", FAST, SLOW, "quadratic")]
    )
    def test_the_other_mode_is_subtracted(self, run, decay, band, mode, other, law):
        decay("two.csv", SLOW, FAST)
        data = json.loads(run("fit-decay", "two.csv", "--band", band, "--law", law, "--json").out)
        damped = np.sqrt(1 - mode[1] ** 2)  # the closed form of the quadratic law has the frequency of the motion
        assert near(data, "frequency", mode[0] * (damped if law == "quadratic" else 1.0))
        assert data["damping_ratio"] == pytest.approx(mode[1], rel=0.01)
        assert data["residual_rms_m"] == pytest.approx(2e-5, rel=0.1)
        assert data["subtracted_hz"] == [[pytest.approx(other[0], rel=1e-3)]]

    @pytest.mark.slow
    def test_the_errors_are_those_of_a_fit_of_both_modes(self, run, decay):
        decay("two.csv", SLOW, FAST)
        both = json.loads(run("fit-decay", "two.csv", "--modes", "2", "--json").out)["modes"][0]
        band = json.loads(run("fit-decay", "two.csv", "--band", "2,4", "--json").out)
        for name in ("frequency_hz", "frequency_stderr_hz", "damping_ratio", "damping_ratio_stderr"):
            assert band[name] == pytest.approx(both[name], rel=0.02)

    @pytest.mark.slow
    def test_close_modes_give_a_warning(self, run, decay):
        decay("close.csv", (3.0, 0.03, 5e-3), (3.5, 0.03, 4e-3))
        done = run("fit-decay", "close.csv", "--band", "2,3.2")
        assert done.code == 0
        assert "are close, and the latter is subtracted as if it were known" in " ".join(done.out.split())

    @pytest.mark.slow
    def test_an_empty_band_is_refused_with_the_modes_that_are_there(self, run, decay):
        decay("two.csv", SLOW, FAST)
        done = run("fit-decay", "two.csv", "--band", "5,9")
        assert (done.code, done.out) == (2, "")
        assert "no mode is within 5 to 9 Hz; those found are at 3" in done.err


class TestSeveralFiles:
    @pytest.mark.slow
    def test_each_alone_and_all_at_once(self, run, decay):
        decay("a.csv", SLOW, seed=1)
        decay("b.csv", SLOW, seed=2)
        data = json.loads(run("fit-decay", "a.csv", "b.csv", "--json").out)
        alone = [one["damping_ratio"] for one in data["alone"]]
        assert min(alone) < data["damping_ratio"] < max(alone)
        assert {one["damping_ratio"] for one in data["records"]} == {data["damping_ratio"]}
        done = run("fit-decay", "a.csv", "b.csv")
        assert done.code == 0 and "all at once" in done.out and "scatter" in done.out

    @pytest.mark.slow
    def test_figures_and_curves_are_numbered(self, run, decay, tmp_path):
        decay("a.csv", SLOW, seed=1)
        decay("b.csv", SLOW, seed=2)
        assert run("fit-decay", "a.csv", "b.csv", "--plot", "fit.png", "--curve", "curve.csv").code == 0
        names = {path.name for path in tmp_path.iterdir()}
        assert {"fit-1.png", "fit-2.png", "curve-1.csv", "curve-2.csv"} <= names


def test_a_part_of_the_record(run, decay):
    decay("a.csv", SLOW)
    data = json.loads(run("fit-decay", "a.csv", "--begin", "1", "--end", "3", "--json").out)
    assert (data["samples"], data["release_time_s"]) == (1001, 1.0)
    data = json.loads(run("fit-decay", "a.csv", "--release-time", "2", "--json").out)
    assert (data["release_time_s"], data["release_reason"]) == (2.0, "given")
    assert near(data, "frequency", 3.0)


def test_units_and_columns_are_given_by_options(run, tmp_path):
    time = np.arange(0.0, 3000.0, 2.0)
    tip = np.exp(-0.3 * time / 1e3) * np.cos(2 * np.pi * 3e-3 * time)
    np.savetxt(tmp_path / "a.txt", np.column_stack([0 * time, tip, time]), header="rest tip t", comments="")
    options = ["--column", "2", "--time", "t", "--unit", "mm", "--time-unit", "ms"]
    data = json.loads(run("fit-decay", "a.txt", *options, "--json").out)
    assert data["frequency_hz"] == pytest.approx(3.0, rel=2e-3)
    assert data["amplitude_m"] == pytest.approx(1e-3, rel=0.01)


def test_a_record_that_does_not_oscillate_is_refused(run, tmp_path):
    (tmp_path / "a.csv").write_text("t,x\n" + "".join(f"{0.01 * k},{k}\n" for k in range(300)))
    done = run("fit-decay", "a.csv", "--plot", "fit.png")
    assert done.code == 2 and done.err.startswith("ancf-casadi: a.csv: record: is a straight line,")


def test_a_curve_without_windows_has_the_law(run, decay, tmp_path, monkeypatch):
    from ancf_casadi import InputError
    from problems.decay import law_curve

    def fails(*_, **__):
        raise InputError("shows no oscillation above the noise", "record")

    monkeypatch.setattr(law_curve, "damping_curve", fails)
    decay("a.csv", SLOW)
    done = run("fit-decay", "a.csv", "--curve", "curve.csv")
    assert done.code == 0 and done.out.startswith("linear decay")
    header, first, *_ = (tmp_path / "curve.csv").read_text().splitlines()
    assert header.startswith("time_s,amplitude_m,law_damping_ratio,lower_95,upper_95,law_frequency_hz")
    assert first.startswith(",")


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ([*"a.csv a.csv".split(), "--law", "auto"], "--law auto: compares sums of squares on one record"),
        (["a.csv", "--law", "auto", "--robust"], "it does not go with --robust"),
        (["a.csv", "--band", "4,2"], "a.csv: band: must be in order, got 4, 2 Hz"),
        (["a.csv", "--modes", "2", "--robust"], "--modes: fits modes with linear damping to one record; it does"),
        (["a.csv", "--modes", "0"], "argument --modes: must be a whole number above 0"),
        (["a.csv", "--release-time", "1,2"], "--release-time: has 2 times for 1 files"),
        (["a.csv", "--begin", "9"], "a.csv: --begin, --end: cut: from 9 to 4.998 s there are 0 samples"),
        (["a.csv", "--sample-rate", "fast"], "argument --sample-rate: must be a number, got 'fast'"),
        (["a.csv", "--plot", "a.jpg"], "argument --plot: must end in .png, .svg or .pdf, got 'a.jpg'"),
    ],
)
def test_misuse_is_one_line(run, decay, tmp_path, options, what):
    decay("a.csv", SLOW)
    done = run("fit-decay", *options)
    assert (done.code, done.out) == (2, "")
    (line,) = done.err.splitlines()
    assert what in line
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]


class TestDecimate:
    """The option gives the estimates of the same part of the record, whose release it does not smooth."""

    @pytest.mark.slow
    def test_the_estimates_are_the_same(self, run, tmp_path):
        time = np.arange(8000) / 500.0
        free = np.maximum(time - 1.0, 0.0)
        motion = (
            10.0 * np.exp(-0.2 * free) * np.cos(25.0 * free) + np.random.default_rng(0).normal(size=time.size) * 1e-2
        )
        table = np.column_stack([time, motion])
        np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="t_s,x_mm", comments="")
        data = json.loads(run("fit-decay", "a.csv", "--decimate", "5", "--json").out)
        begin = data["release_time_s"]
        assert begin == pytest.approx(1.0 + 13 * 5 / 500.0, abs=0.02)
        same = json.loads(run("fit-decay", "a.csv", "--begin", f"{begin}", "--end", f"{time[-66]}", "--json").out)
        assert data["samples"] < same["samples"] / 4
        for one, other in zip(data["estimates"], same["estimates"], strict=True):
            if one["name"] in ("frequency", "damping_ratio", "eta1"):
                assert one["value"] == pytest.approx(other["value"], abs=0.1 * other["standard_error"])
                assert one["standard_error"] == pytest.approx(other["standard_error"], rel=0.1)

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (["--decimate", "1000"], "--decimate: factor: 2500 samples are too few"),
            (["--decimate", "2", "--release-time", "1"], "--release-time: the record begins after the release"),
        ],
    )
    def test_unusable_options_are_refused_in_one_line(self, run, decay, options, message):
        decay("a.csv", (4.0, 0.01, 1e-3))
        done = run("fit-decay", "a.csv", *options)
        (line,) = done.err.strip().splitlines()
        assert done.code == 2 and message in line


class TestAmplitudes:
    @pytest.fixture
    def table(self, tmp_path):
        time = np.linspace(0.0, 20.0, 40)
        amplitudes = 30.0 * np.exp(-0.1 * time) * (1 + 0.02 * np.random.default_rng(0).normal(size=40))
        rows = np.column_stack([time, amplitudes])
        np.savetxt(tmp_path / "read.csv", rows, delimiter=",", header="t (s),amplitude (mm)", comments="")
        return "read.csv"

    def test_inspect_names_the_command(self, run, table):
        assert "--quantity amplitude [--frequency HZ]" in run("inspect", table).out

    def test_fit(self, run, table):
        done = run("fit-decay", table, "--quantity", "amplitude", "--frequency", "2", "--plot", "fit.png")
        assert done.code == 0, done.err
        assert "linear decay of 40 amplitudes, 2 Hz" in done.out and "damping_ratio  0.00" in done.out

    @pytest.mark.parametrize(
        "options",
        [["--frequency", "2"], ["--quantity", "amplitude", "--modes"], ["--quantity", "amplitude", "--rest", "zero"]],
    )
    def test_options_that_do_not_go_together(self, run, table, options):
        done = run("fit-decay", table, *options)
        assert done.code == 2 and "it does not go with" in done.err
