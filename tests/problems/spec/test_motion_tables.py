"""The tables of base motions, releases and records give the same objects as Python, or name the key."""

import numpy as np
import pytest

from ancf_casadi import (
    FixedBase,
    HarmonicBase,
    HarmonicLoad,
    InputError,
    MovingForce,
    Pin,
    PointLoad,
    Roller,
    SampledBase,
    SampledLoad,
    Sensor,
    SweepBase,
    static_equilibrium,
)
from problems.spec.motion import SimulationTables
from problems.spec.records import Measurements
from tests.problems.conftest import STRIP

BEAM = f"{STRIP}elements = 4\n"
SIMULATION = "[simulation]\nduration = 2.0\n"
LAWS = '[[damping]]\nlaw = "rayleigh"\nalpha = 0.2\n[[damping]]\nlaw = "quadratic"\neta2 = 0.1\n'
TIME = np.arange(0.0, 1.0, 0.01)


@pytest.fixture(autouse=True)
def _measured_motion(tmp_path):
    """Write the measured motion beside the file of a test."""
    motion = np.column_stack([TIME, 1e3 * np.sin(TIME), 1e3 * np.cos(TIME), 0.1 * TIME])
    np.savetxt(tmp_path / "clamp.csv", motion, delimiter=",", header="t,x_mm,y_mm,turn", comments="")


def arguments(path):
    """Return the arguments of ``simulate`` in a file."""
    return SimulationTables.of(path).read().arguments


class TestBase:
    def test_sweep(self, file):
        text = "[base]\namplitude = 1e-3\nfrequencies = [1.0, 3.0]\nstop = 5\n"
        assert arguments(file(BEAM, SIMULATION, text))["base"] == SweepBase(1e-3, (1.0, 3.0), stop=5.0)

    def test_an_amplitude_that_grows(self, file):
        harmonic = "[base]\namplitude = 1e-3\nfrequency = 2.0\nramp = 5\n"
        sweep = "[base]\namplitude = 1e-3\nfrequencies = [1.0, 3.0]\nstop = 9\nramp = 2.5\n"
        load = "[load]\nforce = [1e-3, 0.0]\nfrequency = 2.0\nramp = 4\n"
        assert arguments(file(BEAM, SIMULATION, harmonic))["base"] == HarmonicBase(1e-3, 2.0, ramp=5.0)
        assert arguments(file(BEAM, SIMULATION, sweep))["base"] == SweepBase(1e-3, (1.0, 3.0), 9.0, ramp=2.5)
        found = arguments(file(BEAM, SIMULATION, load))["load"]
        assert found == HarmonicLoad((1e-3, 0.0), 2.0, ramp=4.0)

    def test_fixed(self, file):
        base = arguments(file(BEAM, SIMULATION, "[base]\nrotation = 0.1\n"))["base"]
        assert base == FixedBase(rotation=0.1)

    @pytest.mark.parametrize("columns", ['x = "x_mm"\ny = "y_mm"\nrotation = "turn"', "x = 2\ny = 3\nrotation = 4"])
    def test_sampled_from_a_file_beside_the_study(self, file, columns):
        base = arguments(file(BEAM, SIMULATION, f'[base]\nfile = "clamp.csv"\n{columns}\n'))["base"]
        assert isinstance(base, SampledBase)
        assert base.time == pytest.approx(TIME)
        assert base.displacement == pytest.approx(np.column_stack([np.sin(TIME), np.cos(TIME) - 1]), abs=1e-12)
        assert base.rotation == pytest.approx(0.1 * TIME)

    def test_a_direction_without_a_column_rests(self, file):
        base = arguments(file(BEAM, SIMULATION, '[base]\nfile = "clamp.csv"\ny = 3\n'))["base"]
        assert not base.displacement[:, 0].any() and not base.rotation.any()
        assert base.displacement[-1, 1] == pytest.approx(np.cos(TIME[-1]) - 1)

    @pytest.mark.parametrize(
        ("text", "what"),
        [
            ("amplitude = 1e-3\nfrequencies = [1, 3]\n", r"the key 'stop' is missing"),
            ("amplitude = 1e-3\nfrequency = 2\nstop = 5\nramp = 11\n", r"ramp: lasts until 5\.5 s, after the stop"),
            ('file = "clamp.csv"\n', r"name at least one of the columns x, y, rotation"),
            ('file = "none.csv"\nx = 2\n', r".*none\.csv: cannot be read"),
            ('file = "clamp.csv"\nx = "z"\n', r"x: .*clamp\.csv"),
        ],
    )
    def test_unusable(self, file, text, what):
        with pytest.raises(InputError, match=rf"study\.toml: \[base\]: {what}"):
            arguments(file(BEAM, SIMULATION, "[base]\n", text))


class TestRelease:
    def test_the_beam_is_held_by_the_load(self, file):
        given = arguments(file(BEAM, SIMULATION, "[release]\ntip_force = [1e-2, 0]\ntip_moment = 1e-4\n"))
        start = given["start"]
        held = static_equilibrium(given["model"], tip_force=(1e-2, 0.0), tip_moment=1e-4)
        assert np.array_equal(start.coordinates, held.coordinates)

    @pytest.mark.parametrize(
        ("text", "what"),
        [
            ("[release]\ntip_force = 1\n", r"\[release\]: tip_force: must be a pair"),
            ("release = 3\n", r"\[release\]: must be a table, got 3"),
        ],
    )
    def test_unusable(self, file, text, what):
        with pytest.raises(InputError, match=what):
            arguments(file(text, BEAM, SIMULATION) if "=" in text[:10] else file(BEAM, SIMULATION, text))

    def test_a_start_beside_it_is_refused(self, file):
        with pytest.raises(InputError, match=r"\[simulation\]: start: is given by the table \[release\]"):
            arguments(file(BEAM, SIMULATION, 'start = "straight"\n[release]\ntip_force = [1, 0]\n'))


class TestLoad:
    def test_harmonic(self, file):
        text = "[load]\nforce = [1e-3, 0.0]\nfrequency = 2.0\nstop = 1.0\n"
        load = arguments(file(BEAM, SIMULATION, text))["load"]
        assert load == HarmonicLoad((1e-3, 0.0), 2.0, stop=1.0)

    def test_values_in_the_table(self, file):
        text = "[load]\nforce = [1e-3, 0.0]\nspeed = 2.0\n"
        load = arguments(file(BEAM, SIMULATION, text))["load"]
        assert load == MovingForce((1e-3, 0.0), 2.0)
        text = "[load]\ntime = [0, 0.1]\nforce = [[1, 0], [1, 0]]\n"
        load = arguments(file(BEAM, SIMULATION, text))["load"]
        assert isinstance(load, SampledLoad)
        assert load.time.tolist() == [0.0, 0.1] and load.force.tolist() == [[1.0, 0.0], [1.0, 0.0]]

    def test_columns_of_a_file(self, file, tmp_path):
        table = np.column_stack([TIME, 1e3 * TIME, 2.0 * TIME])
        np.savetxt(tmp_path / "load.csv", table, delimiter=",", header="t,f_mN,m_N_m", comments="")
        text = '[load]\nfile = "load.csv"\nforce_y = 2\nunit = "mN"\n'
        load = arguments(file(BEAM, SIMULATION, text))["load"]
        assert load.force == pytest.approx(np.column_stack([0 * TIME, TIME]))
        assert not load.moment.any()

    @pytest.mark.parametrize(
        ("text", "what"),
        [
            ("force = [1, 0]\n", r"the key 'frequency' is missing"),
            ("time = [0, 1]\nforce = [1, 0]\n", r"force: must have the shape \(2, 2\)"),
            ('file = "clamp.csv"\n', r"name at least one of the columns force_x, force_y, moment"),
            ("frequency = 1\nforce = 1\n", r"force: must be a pair"),
        ],
    )
    def test_unusable(self, file, text, what):
        with pytest.raises(InputError, match=rf"study\.toml: \[load\]: {what}"):
            arguments(file(BEAM, SIMULATION, "[load]\n", text))


class TestRecords:
    RECORDS = """
    [[records]]
    file = "clamp.csv"
    begin = 0.2
    channels = [
        {column = "x_mm", direction = [2, 0]},
        {column = 4, sensor = "slope", point = 0.25, offset = [-0.01, 0.01]},
    ]
    """

    def test_channels_share_the_keys_beside_them(self, file):
        (record,) = Measurements.of(file(BEAM, LAWS, self.RECORDS)).records
        first, second = record.channels
        assert first.sensor == Sensor("position", direction=(2.0, 0.0))
        assert first.measurement.time[0] == pytest.approx(0.2)
        assert first.measurement.values == pytest.approx(np.sin(TIME[20:]))
        assert second.sensor == Sensor("slope", point=0.25)
        assert second.offset == (-0.01, 0.01)
        assert (record.base, record.start, record.release_time) == (None, "equilibrium", 0.0)

    def test_channels_of_one_file_may_have_times_in_other_units(self, file):
        text = self.RECORDS.replace("column = 4,", "column = 4, time_unit = 'ms',").replace("begin = 0.2", "")
        first, second = Measurements.of(file(BEAM, LAWS, text)).records[0].channels
        assert second.measurement.time[-1] == pytest.approx(1e-3 * first.measurement.time[-1])

    def test_tables_of_the_study_hold_unless_a_record_has_its_own(self, file):
        base = "[base]\nrotation = 0.1\n[load]\nforce = [1e-3, 0]\nfrequency = 2\n[release]\ntip_force = [1e-2, 0]\n"
        own = self.RECORDS + 'base = {rotation = 0.2}\nstart = "straight"\nrelease_time = [0.1, 0.3]\n'
        first, second = Measurements.of(file(BEAM, LAWS, base, self.RECORDS, own)).records
        assert (first.base, second.base) == (FixedBase(rotation=0.1), FixedBase(rotation=0.2))
        assert first.load == second.load == HarmonicLoad((1e-3, 0.0), 2.0)
        assert first.start.tip_force == (1e-2, 0.0)
        assert (second.start, second.release_time) == ("straight", (0.1, 0.3))

    def test_a_camera_and_a_prediction(self, file):
        text = self.RECORDS + "camera = {scale = [0.9, 1.1]}\n"
        predicted = self.RECORDS.replace("records", "predictions") + "tip_mass = 0.01\n"
        study = Measurements.of(file(BEAM, LAWS, text, predicted)).read()
        assert study.records[0].camera.scale == (0.9, 1.1)
        (record,) = study.predictions
        assert record.model.beam.tip_mass == 0.01 and len(record.channels) == 2 and study.records[0].model is None

    def test_natural_frequencies_of_another_configuration(self, file):
        text = "[[frequencies]]\nfrequencies = [1.8, 11.2]\nstd = [0.01, 0.05]\nmodes = [1, 2]\ntip_mass = 1e-3\n"
        study = Measurements.of(file(BEAM, text)).read()
        (record,) = study.records
        assert study.damping is None and study.laws == ()
        assert record.model.beam.tip_mass == 1e-3 and record.std.tolist() == [0.01, 0.05] and record.modes == (1, 2)

    def test_supports_and_attachments_of_another_configuration(self, file):
        """The mass stays at the tip of the shorter strip; the second strip has other parts in place of all of it."""
        mass = '[[beam.attachments]]\nkind = "mass"\npoint = 0.5\nmass = 1e-3\n'
        text = """
            [[frequencies]]
            frequencies = [1.8]
            length = 0.4
            [[frequencies]]
            frequencies = [1.8]
            supports = [{kind = "pin", point = 0.0}, {kind = "roller", point = 0.5, direction = [0.0, 1.0]}]
            attachments = [{kind = "spring", point = 0.25, stiffness = [0.0, 20.0]}]
            """
        shorter, other = (one.model.beam for one in Measurements.of(file(BEAM, mass, text)).records)
        assert (shorter.length, shorter.lumped) == (0.4, {"tip_mass": 1e-3})
        assert other.supports == (Pin(0.0), Roller(0.5, (0.0, 1.0))) and other.lumped == {"spring_y": 20.0}
        wrong = text.replace('"roller"', '"glue"')
        with pytest.raises(InputError, match=r"\[frequencies\]: supports: 2: kind: must be one of clamp"):
            Measurements.of(file(BEAM, wrong)).read()

    def test_a_static_test_of_another_configuration(self, file):
        """Two sensors, three load cases: a weight, a force with a moment, and both."""
        text = """
            [[statics]]
            loads = [{mass = 1e-3, point = 0.4}, {force = [0.0, -2e-3], moment = 1e-4},
                     [{mass = 1e-3}, {force = [0.0, -1e-3], point = 0.25}]]
            axis = [1.0, 0.0]
            direction = [0.0, -1.0]
            channels = [{values = [0.02, 0.03, nan], std = 1e-4},
                        {sensor = "slope", point = 0.2, values = [0.1, 0.2, 0.3], std = [1e-3, 2e-3, 3e-3]}]
            tared = true
            """
        (record,) = Measurements.of(file(BEAM, text)).records
        assert record.cases == (
            (PointLoad.hung(1e-3, point=0.4),),
            (PointLoad((0.0, -2e-3), 1e-4),),
            (PointLoad.hung(1e-3), PointLoad((0.0, -1e-3), point=0.25)),
        )
        assert record.model.beam.axis == (1.0, 0.0) and record.tared
        assert record.columns == (
            Sensor("displacement", direction=(0.0, -1.0)),
            Sensor("slope", point=0.2, direction=(0.0, -1.0)),
        )
        assert record.measured.tolist() == [0.02, 0.1, 0.03, 0.2, 0.3]
        assert record.stds.tolist() == [1e-4, 1e-3, 1e-4, 2e-3, 3e-3]

    def test_cases_of_a_static_test_in_a_file(self, file, tmp_path):
        """Masses in g at varying points, sags in mm, one of them missing; the first row has no mass."""
        rows = "mass_g,at (mm),push_mN,sag (mm),std (mm),turn (rad)\n"
        rows += "0,400,0,0.0,0.1,0.0\n1,400,2,20,0.1,0.1\n2,500,3,,0.2,0.2\n"
        (tmp_path / "sag.csv").write_text(rows)
        text = """
            [[statics]]
            file = "sag.csv"
            load = [{mass = "mass_g", point = "at (mm)"}, {force = [0.0, "push_mN"], point = 0.25}]
            axis = [1.0, 0.0]
            direction = [0.0, -1.0]
            channels = [{column = "sag (mm)", std = "std (mm)"}, {sensor = "slope", column = 6, std = 1e-3}]
            """
        (record,) = Measurements.of(file(BEAM, text)).records
        assert record.cases == (
            (PointLoad((0.0, 0.0), point=0.25),),
            (PointLoad.hung(1e-3, point=0.4), PointLoad((0.0, 2e-3), point=0.25)),
            (PointLoad.hung(2e-3, point=0.5), PointLoad((0.0, 3e-3), point=0.25)),
        )
        assert record.columns == (Sensor("displacement", direction=(0.0, -1.0)),
                                  Sensor("slope", direction=(0.0, -1.0)))  # fmt: skip
        assert record.measured.tolist() == [0.0, 0.0, 0.02, 0.1, 0.2]
        assert record.stds.tolist() == [1e-4, 1e-3, 1e-4, 1e-3, 1e-3]

    @pytest.mark.parametrize(
        ("rows", "keys", "what"),
        [
            ("mass_g,x_mm\n1,2\n", "load = 3", r"\[statics\]: load: must be a table or a list"),
            ("mass_g,x_mm\n1,2\n", "load = {mass = true}", r"\[statics\]: load: mass: must be a number or a text"),
            ("mass_g,x_mm\n1,2\n", "load = {mass = 100.0, unit = 'g'}", r"\[statics\]: load: unit: "),
            ("mass_g,x_mm\n1,2\n", "load = {force = [0.0, 1.0], unit = 'mN'}", r"\[statics\]: load: unit: "),
            ("mass_g,x_mm\n1,2\n", "load = {mass = 'm'}", r"\[statics\]: load: mass: \S*sag.csv: .*no such column"),
            ("mass,x_mm\n1,2\n", "load = {mass = 'mass'}", r"load: mass: \S*sag.csv: column 1 'mass': has no unit"),
            ("m_mm,x_mm\n1,2\n", "load = {mass = 'm_mm'}", r"column 1 'm_mm': is in mm, a unit of length, not of mass"),
            ("p_g,x_mm\n1,2\n", "load = {force = [0, 'p_g']}", r"load: force: \S*sag.csv: column 1 'p_g': is in g"),
            (
                "m_g,x_mm\n1,2\n\n,3\n",
                "load = [{mass = 'm_g'}]",
                r"load: 1: mass: \S*sag.csv: .* line 4: has no number",
            ),
            ("m_g,x_mm\n1,2\n-1,3\n", "load = {mass = 'm_g'}", r"load: \S*sag.csv: line 3: mass: must be"),
            ("m_g,x\n1,2\n", "load = {mass = 'm_g'}", r"column: \S*sag.csv: column 2 'x': has no unit"),
        ],
    )
    def test_unusable_static_files(self, file, tmp_path, rows, keys, what):
        (tmp_path / "sag.csv").write_text(rows)
        with pytest.raises(InputError, match=what):
            Measurements.of(file(BEAM, f"[[statics]]\nfile = 'sag.csv'\ncolumn = 2\n{keys}\n")).read()

    def test_a_response_curve(self, file):
        text = """
            [[curves]]
            frequencies = [1.8, 1.9]
            values = [0.01, 0.02]
            phases = [-0.1, -1.5]
            levels = [1.0, 2.0]
            base = {amplitude = 1e-3}
            sensor = "acceleration"
            point = 0.3
            control = "response"
            level_std = 0.01
            tip_mass = 1e-3
            """
        (record,) = Measurements.of(file(BEAM, LAWS, text)).records
        assert record.complex_values == pytest.approx([0.01 * np.exp(-0.1j), 0.02 * np.exp(-1.5j)])
        assert (record.base.amplitude, record.sensor) == (1e-3, Sensor("acceleration", point=0.3))
        assert record.levels.tolist() == [1.0, 2.0] and record.control == "response"
        assert record.model.beam.tip_mass == 1e-3

    @pytest.mark.parametrize(
        ("text", "what"),
        [
            ("[[statics]]\nvalues = [1.0]\n", r"\[statics\]: the key 'loads' is missing"),
            ("[[statics]]\nloads = [{mass = 1}]\nvalues = [1, 2]\n", r"values: has 2 values for 1 load cases"),
            ("[[statics]]\nloads = [{mass = 1}]\nvalues = [1]\nstd = [1, 2]\n", r"std: has 2 values for 1 load cases"),
            ("[[statics]]\nloads = [{mass = 1}]\nvalues = [1]\nsensor = 'velocity'\n", r"\[statics\]: .*velocity"),
            ("[[curves]]\nfrequencies = [1]\nvalues = [1]\n", r"\[curves\]: .*base.*load"),
            ("[[curves]]\nfrequencies = [1]\nvalues = [1]\nbase = {frequency = 1}\n", r"base: .*'frequency'"),
        ],
    )
    def test_unusable_numbers(self, file, text, what):
        with pytest.raises(InputError, match=what):
            Measurements.of(file(BEAM, LAWS, text)).read()

    def test_laws_to_compare(self, file):
        named = Measurements.of(file(BEAM, LAWS, self.RECORDS, "[fit]\nlaws = [[2], [1, 2]]\n")).laws
        names = [[own.name for own in law.parameters] for law in named]
        assert names == [["eta2"], ["alpha", "eta2"]]
        usual = Measurements.of(file(BEAM, LAWS, self.RECORDS)).laws
        assert [len(law.parameters) for law in usual] == [1, 1, 2]

    @pytest.mark.parametrize(
        ("text", "what"),
        [
            ("", r"\[records\]: the table is missing; it names the file"),
            ('[[records]]\nfile = "clamp.csv"\ncolumn = 9\n', r"\[records\]: .*clamp\.csv"),
            ('[[records]]\nfile = "clamp.csv"\ncolumn = 2\nbegin = 3\n', r"\[records\]: cut: from 3"),
            ("records = 3\n", r"must be a table \[records\], or several"),
        ],
    )
    def test_unusable(self, file, text, what):
        with pytest.raises(InputError, match=what):
            Measurements.of(file(text, BEAM, LAWS) if text.startswith("records =") else file(BEAM, LAWS, text)).read()

    @pytest.mark.parametrize("laws", ["3", "[[3]]", "[[0]]"])
    def test_laws_that_do_not_exist(self, file, laws):
        with pytest.raises(InputError, match=r"\[fit\]: laws: (1: )*must be"):
            Measurements.of(file(BEAM, LAWS, self.RECORDS, f"[fit]\nlaws = {laws}\n")).read()
