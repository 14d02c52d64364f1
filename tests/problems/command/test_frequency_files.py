"""``ancf-casadi fit-frf``, and ``run`` with tables ``[[curves]]``: files with values over frequency, or one line."""

import json

import numpy as np
import pytest
from scipy.io import wavfile

from ancf_casadi import (
    Beam,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    natural_modes,
    periodic_motion,
    reduce_model,
)
from problems.spec.records import Measurements
from tests.problems.conftest import STRIP
from tests.problems.frf.time_records import MODES, hammer

F = np.linspace(5.0, 25.0, 401)
BEAM = f"""{STRIP}elements = 4

[[damping]]
law = "modal"
ratios = [0.01]
"""


@pytest.fixture
def functions(tmp_path):
    """Write a function with modes of 10 and 20 Hz, in mm/N."""
    rng = np.random.default_rng(0)
    h = sum(a / (f0**2 - F**2 + 2j * z * f0 * F) for a, f0, z in ((3.0, 10.0, 0.01), (-2.0, 20.0, 0.008)))
    h = h + 1e-3 * (rng.normal(size=(2, F.size)).T @ [1, 1j])
    table = np.column_stack([F, np.abs(h), np.degrees(np.angle(h))])
    np.savetxt(tmp_path / "h.csv", table, delimiter=",", header="f (Hz),tip (mm/N),phase (deg)", comments="")
    return "h.csv"


class TestFitFrf:
    @pytest.mark.slow
    def test_modes_as_text_json_and_figure(self, run, functions, tmp_path):
        done = run("fit-frf", functions, "--frequencies", "10,20", "--plot", "fit.png")
        assert (done.code, done.err) == (0, "")
        assert "Modes from 1 receptance function" in done.out
        assert (tmp_path / "fit.png").stat().st_size > 5000
        data = json.loads(run("fit-frf", functions, "--frequencies", "10", "--band", "5,15", "--json").out)
        first = data["estimates"][0]
        assert (first["name"], first["unit"]) == ("frequency_1", "Hz")
        assert first["value"] == pytest.approx(10.0, abs=4 * first["standard_error"])

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (["--unit", "mm"], "h.csv: column 2 'tip (mm/N)': the unit 'mm' is none of such a function"),
            (["--column", "3"], "h.csv: column 3 'phase (deg)': has amplitudes only"),
            (["--frequencies", "90"], "h.csv: frequencies: 90 Hz is outside the band"),
        ],
    )
    def test_unusable_arguments_are_refused_in_one_line(self, run, functions, options, message):
        done = run("fit-frf", functions, *options)
        (line,) = done.err.strip().splitlines()
        assert done.code == 2 and message in line

    def test_several_files_are_outputs(self, run, functions, tmp_path):
        table = np.loadtxt(tmp_path / functions, delimiter=",", skiprows=1)
        table[:, 1] *= 0.5
        np.savetxt(tmp_path / "half.csv", table, delimiter=",", header="f (Hz),middle (mm/N),phase (deg)", comments="")
        data = json.loads(run("fit-frf", functions, "half.csv", "--frequencies", "10,20", "--json").out)
        for mode in data["modes"]:
            assert np.ravel(mode["shape_real"]) == pytest.approx([1.0, 0.5], rel=0.01)
        np.savetxt(tmp_path / "half.csv", table[1:], delimiter=",", header="f (Hz),m (mm/N),phase (deg)", comments="")
        assert "differ in frequencies" in run("fit-frf", functions, "half.csv").err


class TestHits:
    @pytest.fixture
    def hits(self, tmp_path):
        """Write two files of hits, in N and mm/s^2."""
        for seed, bounces in ((0, ()), (1, (1,))):
            force, response = hammer(np.random.default_rng(seed), bounces=bounces)
            table = np.column_stack([force.time, force.values, 1e3 * response.values])
            header = "t (s),hammer (N),tip (mm/s^2)"
            np.savetxt(tmp_path / f"{seed}.csv", table, fmt="%.7g", delimiter=",", header=header, comments="")
        return "0.csv", "1.csv"

    def test_files_are_averaged(self, run, hits):
        done = run(
            "fit-frf", *hits, "--force", "hammer (N)", "--response", "tip (mm/s^2)", "--frequencies", "8,21", "--json"
        )
        assert (done.code, done.err) == (0, "")
        data = json.loads(done.out)
        assert data["functions"] == "accelerance"
        assert "left out: double hit at 13.01 s of 1.csv" in data["warnings"]
        for mode, (frequency, ratio, constant) in zip(data["modes"], MODES, strict=True):
            assert mode["frequency_hz"] == pytest.approx(frequency, rel=1e-3)
            assert mode["damping_ratio"] == pytest.approx(ratio, rel=0.02)
            assert mode["constants_real"][0][0] == pytest.approx(constant, rel=0.02)

    def test_sound_card(self, run, tmp_path):
        force, response = (record.values for record in hammer(np.random.default_rng(0), noise=(1e-4, 1e-4)))
        channels = np.column_stack([values / np.abs(values).max() * 0.9 for values in (force, response)])
        wavfile.write(tmp_path / "hits.wav", 200, np.round(channels * 32767).astype(np.int16))
        settings = ["--force", "1", "--response", "2", "--frequencies", "8,21", "--json"]
        assert "give the kind of the functions" in run("fit-frf", "hits.wav", *settings).err
        data = json.loads(run("fit-frf", "hits.wav", *settings, "--kind", "accelerance").out)
        for mode, (frequency, ratio, _) in zip(data["modes"], MODES, strict=True):
            assert mode["frequency_hz"] == pytest.approx(frequency, rel=1e-3)
            assert mode["damping_ratio"] == pytest.approx(ratio, rel=0.02)

    def test_units_of_a_file_without_any(self, run, tmp_path, hits):
        table = np.loadtxt(tmp_path / "0.csv", delimiter=",", skiprows=1)
        np.savetxt(tmp_path / "bare.csv", table, delimiter=",", header="t,F,a", comments="")
        settings = ["--force", "F", "--response", "a", "--frequencies", "8,21", "--json", "--time-constant", "3"]
        constants = []
        for unit in ("mm/s^2/N", "(m/s^2)/kN"):
            done = run("fit-frf", "bare.csv", *settings, "--unit", unit)
            assert done.code == 0, done.err
            constants.append(json.loads(done.out)["modes"][0]["constants_real"][0][0])
        assert constants == pytest.approx([1.0, 1.0], rel=0.02)

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (["--force", "2"], "--response: is needed beside --force"),
            (["--force", "2", "--response", "3", "--phase", "3"], "it does not go with --phase"),
            (["--force", "2", "--response", "3", "--unit", "g"], "--unit: must be units of response and force"),
            (["--force", "2", "--response", "3", "--window", "hann"], "window: belongs to a shaker"),
        ],
    )
    def test_unusable_arguments_are_refused_in_one_line(self, run, hits, options, message):
        done = run("fit-frf", hits[0], *options)
        (line,) = done.err.strip().splitlines()
        assert done.code == 2 and message in line


def write_curve(folder, f, y):
    """Write the beam, and a curve of its tip whose base moves by 0.5 mm."""
    (folder / "beam.toml").write_text(BEAM)
    table = np.column_stack([f, np.full(f.size, 0.5), 1e3 * np.abs(y), np.degrees(np.angle(y))])
    np.savetxt(folder / "c.csv", table, delimiter=",", header="f (Hz),base (mm),tip (mm),phase (deg)", comments="")
    return "c.csv"


@pytest.fixture
def curve(tmp_path):
    """Write some curve."""
    f = np.array([1.82, 1.85, 1.88, 1.91])
    return write_curve(tmp_path, f, 1e-3 / (1 - (f / 1.88) ** 2 + 0.01j))


class TestFitResponse:
    @pytest.mark.slow
    def test_the_damping_ratio_is_recovered(self, run, tmp_path):
        beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8e3, elastic_modulus=210e9, elements=4)
        modes = natural_modes(Model(beam), count=1)
        reduced = reduce_model(Model(beam), modes=2, damping=ModalDamping(modes, ratios=[0.006]))
        f = modes.frequencies[0] * np.array([0.97, 0.99, 0.996, 1.0, 1.004, 1.01, 1.03])
        y = np.array([periodic_motion(reduced, base=HarmonicBase(5e-4, x)).harmonics(relative=False)[1] for x in f])
        y = y * (1 + 0.01 * (np.random.default_rng(1).normal(size=(2, f.size)).T @ [1, 1j]))
        (tmp_path / "study.toml").write_text(f"{BEAM}[[curves]]\nfile = '{write_curve(tmp_path, f, y)}'\n")
        done = run("run", "study.toml", "fit", "--out", "new", "--json")
        ratio = json.loads(done.out)["motion"]["fit"]["estimates"][0]
        assert ratio["name"] == "ratio1"
        assert ratio["value"] == pytest.approx(0.006, abs=4 * ratio["standard_error"])
        assert (tmp_path / "new/figures/figure_01.png").stat().st_size > 5000

    def test_a_file_without_levels_takes_the_excitation_of_the_study(self, tmp_path, curve):
        table = np.loadtxt(tmp_path / curve, delimiter=",", skiprows=1)
        np.savetxt(tmp_path / "d.csv", table[:, [0, 2]], delimiter=",", header="f (Hz),tip (mm)", comments="")
        file = tmp_path / "study.toml"
        file.write_text(
            f"{BEAM}\n[base]\namplitude = 5e-4\nfrequency = 2.0\n[[curves]]\nfile = 'd.csv'\nsweep = 'up'\n"
        )
        (record,) = Measurements.of(str(file)).records
        assert record.base.amplitude == 5e-4 and record.sweep == "up" and record.phases is None
        np.testing.assert_allclose(record.amplitudes, 1e-3 * table[:, 2])

    @pytest.mark.parametrize(
        ("keys", "message"),
        [
            ("file = 'c.csv'\nlevel = 'tip (mm)'", "has no column of amplitudes"),
            ("file = 'c.csv'\nunit = 'furlong'", "unit: 'furlong' is not a known unit"),
            ("file = 'c.csv'\nsweep = 'down'", "frequencies: must decrease in a sweep down"),
        ],
    )
    def test_unusable_curves_are_refused_in_one_line(self, run, tmp_path, curve, keys, message):
        (tmp_path / "study.toml").write_text(f"{BEAM}[[curves]]\n{keys}\n")
        done = run("run", "study.toml")
        (line,) = done.err.strip().splitlines()
        assert done.code == 2 and message in line

    def test_keys_of_a_curve_in_a_file_are_checked(self, tmp_path, curve):
        file = tmp_path / "study.toml"
        for key, message in (("values = [1.0]", "values"), ("model = 1", "model"), ("notes = ['x']", "notes")):
            file.write_text(f"{BEAM}\n[[curves]]\nfile = 'c.csv'\n{key}\n")
            with pytest.raises(InputError, match=f"unknown key '{message}'"):
                Measurements.of(str(file)).read()
