"""The same response curve in every format, under many headings; what is not clear is refused with the remedy."""

import numpy as np
import pytest
from scipy.io import savemat

from ancf_casadi import HarmonicBase, HarmonicLoad, InputError, Sensor
from problems import ResponseRecord

F = np.array([1.80, 1.85, 1.90, 1.95])
Y = np.array([1.1e-3, 5.2e-3, 9.0e-3, 2.0e-3])  # m
PHI = np.array([-0.2, -0.9, -1.5, -2.8])  # rad
FORCE = np.array([0.10, 0.11, 0.10, 0.09])  # N


def table(path, head, *columns, delimiter=","):
    np.savetxt(path, np.column_stack(columns), delimiter=delimiter, header=head, comments="", fmt="%.12g")
    return path


def without_beam(path, *arguments, excitation_unit="N", **options):
    return ResponseRecord.from_file(path, *arguments, excitation_unit=excitation_unit, **options)


def check(curve, *, levels=FORCE):
    np.testing.assert_allclose(curve.frequencies, F)
    np.testing.assert_allclose(curve.amplitudes, Y, rtol=1e-9)
    np.testing.assert_allclose(curve.phases, PHI, rtol=1e-9)
    np.testing.assert_allclose(curve.levels, levels, rtol=1e-9)


@pytest.mark.parametrize(
    ("head", "columns"),
    [
        ("f (Hz),force (N),tip (mm),phase (deg)", (F, FORCE, 1e3 * Y, np.degrees(PHI))),
        ("frequency,F_N,x_mm,phi_rad", (F, FORCE, 1e3 * Y, PHI)),
        ("x_mm,f_Hz,phi_deg,F_N", (1e3 * Y, F, np.degrees(PHI), FORCE)),
        ("f (mHz),force amplitude (mN),displacement amplitude (um),phase", (1e3 * F, 1e3 * FORCE, 1e6 * Y, PHI)),
        ("f (Hz),excitation rms (N),tip rms (m),phase (rad)", (F, FORCE / 2**0.5, Y / 2**0.5, PHI)),
        ("f (Hz),drive pp (N),tip pp (m),phase (rad)", (F, 2 * FORCE, 2 * Y, PHI)),
        ("f (Hz),force (N),tip real (m),tip imag (m)", (F, FORCE, Y * np.cos(PHI), Y * np.sin(PHI))),
    ],
)
def test_headings_tell_the_columns_and_their_units(tmp_path, head, columns):
    curve = without_beam(table(tmp_path / "a.csv", head, *columns))
    check(curve)
    assert (curve.sensor.quantity, curve.excitation_unit) == ("displacement", "N")
    beam = ResponseRecord.from_file(tmp_path / "a.csv")
    np.testing.assert_allclose(beam.a * beam.load.force[0], FORCE)


@pytest.mark.slow
def test_matlab_structs_npz_and_hdf5(tmp_path):
    import h5py

    complex_values = Y * np.exp(1j * PHI)
    savemat(tmp_path / "a.mat", {"sweep": {"f_Hz": F, "force_N": FORCE, "tip_m": complex_values}})
    np.savez(tmp_path / "a.npz", frequency_Hz=F, force_N=FORCE, amplitude_mm=1e3 * Y, phase_deg=np.degrees(PHI))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values, unit in (("f", F, "Hz"), ("force", FORCE, "N"), ("tip", complex_values, "m")):
            file.create_dataset(name, data=values).attrs["units"] = unit
    for name in ("a.mat", "a.npz", "a.h5"):
        check(without_beam(tmp_path / name))


def test_columns_without_names_are_told_by_number(tmp_path):
    path = table(tmp_path / "a.txt", "", F, FORCE, 1e3 * Y, np.degrees(PHI), delimiter=" ")
    with pytest.raises(InputError, match=r"the frequency is in no column that says so .* choose with --frequency"):
        without_beam(path)
    curve = without_beam(path, 3, frequency=1, level=2, phase=4, unit="mm", level_unit="N", phase_unit="deg")
    check(curve)
    assert curve.notes == ("a.txt: column 1 'column 1' has no unit; its frequencies are taken in Hz",)


def test_one_of_several_sensors_with_its_own_phase(tmp_path):
    head = "f_Hz,x_mm,x_deg,y_mm,y_deg"
    path = table(tmp_path / "a.csv", head, F, 2e3 * Y, np.degrees(2 * PHI), 1e3 * Y, np.degrees(PHI))
    with pytest.raises(InputError, match="has 2 columns of amplitudes, 2 'x_mm', 4 'y_mm'; choose with --column"):
        without_beam(path)
    check(without_beam(path, "y_mm"), levels=np.ones(4))


def test_rows_with_gaps_are_left_out_and_said(tmp_path):
    path = table(tmp_path / "a.csv", "f_Hz,x,phase_rad", F, np.where(F == 1.85, np.nan, Y), PHI)
    curve = without_beam(path)
    np.testing.assert_allclose(curve.frequencies, F[[0, 2, 3]])
    assert curve.notes == (
        "a.csv: no unit is given for 2 'x'; SI units are assumed", "a.csv: 1 rows with a gap are left out",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("head", "columns", "options", "message"),
    [
        ("f (Hz),x (mm),phase", (F, Y, np.degrees(PHI)), {}, "in deg or rad; give --phase-unit"),
        ("f (Hz),x (mm),phase (mm)", (F, Y, PHI), {}, "is in mm, and holds no phases"),
        ("f (Hz),f2 (Hz),x (mm)", (F, F, Y), {}, "the frequency may be column 1 .* or 2 .*--frequency"),
        ("f (mm),x (mm)", (F, Y), {"frequency": 1}, "is in mm, and holds no frequencies"),
        ("f (Hz),phase (deg)", (F, PHI), {}, "has no column of amplitudes"),
        ("f (Hz),x (mm),force (N),input (N)", (F, Y, Y, Y), {}, "the level may be column 3 .*choose with --level"),
        ("f (Hz),x (mm)", (F, Y), {"level": "y"}, "--level 'y': there is no such column"),
        ("f (Hz),x (mm)", (F, Y), {"unit": "furlong"}, "unit: 'furlong' is not a known unit"),
        ("f (Hz),x (mm)", (F, np.nan * Y), {}, "no rows of numbers|no row with a frequency|no column of amplitudes"),
    ],
)
def test_what_is_not_clear_is_refused(tmp_path, head, columns, options, message):
    with pytest.raises(InputError, match=message):
        without_beam(table(tmp_path / "a.csv", head, *columns), **options)


def test_volts_are_amplitudes_without_a_beam_only(tmp_path):
    path = table(tmp_path / "a.csv", "f_Hz,x_mV,phase_deg", F, 1e3 * Y, np.degrees(PHI))
    curve = without_beam(path)
    check(curve, levels=np.ones(4))
    assert curve.sensor == Sensor("signal", signal_unit="V")
    with pytest.raises(InputError, match=r"excitation_unit: is missing, .* state it, for a command in a table \[\[cur"):
        without_beam(path, excitation_unit="")
    with pytest.raises(InputError, match="the reading is in V, which no sensor of a beam has; give its scale"):
        ResponseRecord.from_file(path, base=HarmonicBase(1e-3, 1.0))
    record = ResponseRecord.from_file(path, unit="2 m", base=HarmonicBase(1e-3, 1.0))
    np.testing.assert_allclose(record.amplitudes, 2e3 * Y)


class TestRecordOfABeam:
    def test_levels_in_newtons_are_a_horizontal_force_at_the_tip(self, tmp_path):
        path = table(tmp_path / "a.csv", "f_Hz,F_N,x_mm,phi_deg", F, FORCE, 1e3 * Y, np.degrees(PHI))
        record = ResponseRecord.from_file(path, sweep="up")
        np.testing.assert_allclose(np.outer(record.a, record.load.force), np.outer(FORCE, [1.0, 0.0]))
        np.testing.assert_allclose(record.complex_values, Y * np.exp(1j * PHI))
        assert (record.sweep, record.name) == ("up", "a.csv")

    @pytest.mark.parametrize(("unit", "order"), [("mm", 0), ("mm/s", 1), ("mm/s^2", 2)])
    def test_levels_of_a_base_are_displacements_whatever_was_measured(self, tmp_path, unit, order):
        base = 1e-3 * np.array([1.0, 1.1, 1.2, 0.9])
        measured = 1e3 * base * (2 * np.pi * F) ** order
        path = table(tmp_path / "a.csv", f"f_Hz,base ({unit}),x_mm", F, measured, 1e3 * Y)
        record = ResponseRecord.from_file(path)
        np.testing.assert_allclose(record.base.amplitude * record.a, base)
        upright = ResponseRecord.from_file(path, base=HarmonicBase(2e-3, 1.0, direction=(0.0, 1.0)))
        np.testing.assert_allclose(2e-3 * upright.a, base)
        assert upright.base.direction == (0.0, 1.0)

    def test_levels_without_a_unit_are_multiples_of_the_excitation(self, tmp_path):
        path = table(tmp_path / "a.csv", "f_Hz,level,x_mm", F, [1.0, 2.0, 3.0, 4.0], 1e3 * Y)
        with pytest.raises(InputError, match="has levels that are no motion and no force; give the base motion"):
            ResponseRecord.from_file(path)
        load = HarmonicLoad((0.1, 0.0), 1.0)
        assert ResponseRecord.from_file(path, load=load).a.tolist() == [1.0, 2.0, 3.0, 4.0]
        with pytest.raises(InputError, match="level: holds a force, but the excitation is in m"):
            ResponseRecord.from_file(path, level_unit="N", base=HarmonicBase(1e-3, 1.0))

    def test_a_curve_without_levels_needs_an_excitation(self, tmp_path):
        path = table(tmp_path / "a.csv", "f_Hz,acc (g)", F, Y)
        with pytest.raises(InputError, match="has no levels of the excitation; give the base motion"):
            ResponseRecord.from_file(path)
        sensor = Sensor("acceleration", point=0.1)
        record = ResponseRecord.from_file(path, base=HarmonicBase(1e-3, 1.0), sensor=sensor, control="response")
        np.testing.assert_allclose(record.amplitudes, 9.80665 * Y)
        assert (record.sensor, record.control, record.a.tolist()) == (sensor, "response", [1.0] * 4)
