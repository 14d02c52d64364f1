"""Each format, in a file that its own library has written; damaged and hostile files are refused in one line."""

import io
import pickle
import struct
import tracemalloc
import zipfile
from pathlib import Path

import ezc3d
import h5py
import numpy as np
import pytest
import pyuff
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.layout import TableLayout
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.reading.formats import read_contents
from ancf_casadi.records.recording import read_recording
from ancf_casadi.records.sensor import Sensor

SILICONE = Path(__file__).parents[4] / "shared" / "data" / "silicone_beam"
RATE = 100.0
TIME = np.arange(250) / RATE
MM = 5.0 * np.exp(-0.3 * TIME) * np.cos(2 * np.pi * 3.0 * TIME)  # displacement, mm


def uff_function(**changes):
    function = pyuff.prepare_58(
        func_type=1, rsp_node=4, rsp_dir=3, ref_node=1, ref_dir=3, ord_data_type=4, num_pts=len(TIME),
        abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=1 / RATE, abscissa_spec_data_type=17,
        ordinate_spec_data_type=8, ordinate_axis_units_lab="mm", orddenom_spec_data_type=0, z_axis_spec_data_type=0,
        data=MM, x=TIME, id1="tip",
    )  # fmt: skip
    return function | changes


def write_uff(path, *sets):
    path.unlink(missing_ok=True)
    pyuff.UFF(str(path)).write_sets(list(sets), mode="add")


def write_tdms(path, *channels):
    """Write channels of a group: name, values, and properties."""
    with TdmsWriter(str(path)) as writer:
        writer.write_segment([ChannelObject("run", *channel) for channel in channels])


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves the file open
class TestUniversalFile:
    @pytest.mark.parametrize("binary", [0, 1])
    def test_data_set_58(self, tmp_path, binary):
        write_uff(tmp_path / "record.uff", uff_function(binary=binary))
        record = Measurement.from_file(tmp_path / "record.uff")
        np.testing.assert_allclose(record.time, TIME, atol=1e-12)
        np.testing.assert_allclose(record.values, 1e-3 * MM, rtol=1e-6, atol=1e-9)
        assert record.sensor.quantity == "displacement"

    @pytest.mark.parametrize("padding", [1, 2, 5])
    def test_zeros_behind_the_last_value_are_left_out(self, tmp_path, padding):
        path = tmp_path / "record.uff"
        write_uff(path, uff_function())
        lines = path.read_text().rstrip("\n").split("\n")
        zeros = [f"{0.0:20.11e}"] * padding  # 250 values fill half of the last row
        lines[-2] += "".join(zeros[:2])
        lines[-1:-1] = ["".join(zeros[2:])] * (padding > 2)
        path.write_text("\n".join(lines) + "\n")
        record = Measurement.from_file(path)
        np.testing.assert_allclose(record.time, TIME, atol=1e-12)
        np.testing.assert_allclose(record.values, 1e-3 * MM, rtol=1e-5, atol=1e-9)

    def test_the_units_of_the_file_hold_for_functions_without_a_label(self, tmp_path):
        units = pyuff.prepare_164(
            units_code=5, temp_mode=1, length=1000.0, force=1000.0, temp=1.0, temp_offset=273.15
        )  # fmt: skip
        accelerations = uff_function(ordinate_spec_data_type=12, ordinate_axis_units_lab="NONE")
        write_uff(tmp_path / "record.uff", units, accelerations)
        record = Measurement.from_file(tmp_path / "record.uff")
        np.testing.assert_allclose(record.values, 1e-3 * MM, rtol=1e-6, atol=1e-9)
        assert record.sensor.quantity == "acceleration"

    @pytest.mark.parametrize(("label", "factor"), [("s", 1.0), ("ms", 1e-3), ("foo", None), ("Hz", None)])
    def test_times_are_in_the_unit_of_their_label(self, tmp_path, label, factor):
        path = tmp_path / "record.uff"
        write_uff(path, uff_function(abscissa_axis_units_lab=label))
        if factor is None:
            with pytest.raises(InputError, match=r"1 'tip'.*--sample-rate"):
                Measurement.from_file(path)
        options = {} if factor else {"sample_rate": RATE}
        np.testing.assert_allclose(Measurement.from_file(path, **options).time, (factor or 1.0) * TIME, atol=1e-12)

    def test_other_functions_and_truncated_ones_are_refused(self, tmp_path):
        path = tmp_path / "record.uff"
        write_uff(path, uff_function(func_type=2))
        with pytest.raises(InputError, match="has no responses over time or frequency"):
            read_recording(path)
        write_uff(path, uff_function())
        lines = path.read_text().splitlines(keepends=True)
        path.write_text("".join(lines[:20] + lines[-1:]))
        with pytest.raises(InputError, match="has 28 of 250 values"):
            read_recording(path)


class TestMatlab:
    @pytest.mark.slow
    @pytest.mark.parametrize("compressed", [False, True])
    def test_version_5(self, tmp_path, compressed):
        path = tmp_path / "record.mat"
        savemat(path, {"t_s": TIME, "tip_mm": MM, "fs": RATE, "note": "a test"}, do_compression=compressed)
        record = Measurement.from_file(path)
        np.testing.assert_allclose(record.time, TIME)
        np.testing.assert_allclose(record.values, 1e-3 * MM)
        notes = " ".join(read_recording(path).notes)
        assert read_contents(path).step == 1.0 / RATE  # of fs, which the column of times makes superfluous
        assert "'note' is a char, and is left out" in notes

    @pytest.mark.slow
    def test_a_matrix_has_a_channel_per_column(self, tmp_path):
        path = tmp_path / "record.mat"
        savemat(path, {"data": np.column_stack([TIME, MM, -MM])})
        np.testing.assert_allclose(Measurement.from_file(path, "data[2]", unit="mm").values, 1e-3 * MM)
        np.testing.assert_allclose(Measurement.from_file(path, 3).values, -MM)

    @pytest.mark.slow
    def test_structs_and_struct_arrays_are_named_by_their_path(self, tmp_path):
        path = tmp_path / "record.mat"
        runs = np.zeros(2, dtype=[("t", object), ("tip_mm", object), ("remark", object)])
        for k in range(2):
            runs[k] = (TIME, (k + 1) * MM, "text")
        savemat(path, {"test": {"time": TIME, "sensors": {"tip_mm": MM, "n": 3.0}}, "runs": runs})
        recording = read_recording(path, time="test.time")
        names = [channel.name for channel in recording.channels]
        assert names == ["test.sensors.tip_mm", "runs[1].t", "runs[1].tip_mm", "runs[2].t", "runs[2].tip_mm"]
        assert "'test.sensors.n' is a single number, 3" in " ".join(recording.notes)
        record = Measurement.from_file(path, "runs[2].tip_mm", time="runs[2].t")
        np.testing.assert_allclose(record.values, 2e-3 * MM)

    @pytest.mark.slow
    def test_cells_are_left_out_and_never_executed(self, tmp_path):
        path = tmp_path / "record.mat"
        savemat(path, {"cells": np.array([1, "a"], dtype=object)})
        with pytest.raises(InputError, match="has no channels of numbers"):
            read_recording(path)

    def test_struct_arrays_of_version_7_3_have_the_same_names(self, tmp_path):
        path = tmp_path / "record.mat"
        with h5py.File(path, "w") as file:
            group = file.create_group("runs")
            group.attrs["MATLAB_class"] = np.bytes_("struct")
            for name, values in (("t", [TIME, TIME]), ("tip_mm", [MM, 2 * MM])):
                fields = [file.create_dataset(f"#refs#/{name}{k}", data=row[None]) for k, row in enumerate(values)]
                references = group.create_dataset(name, (3, 1), dtype=h5py.ref_dtype)
                references[::2, 0] = [field.ref for field in fields]  # the second element is empty
        record = Measurement.from_file(path, "runs[3].tip_mm", time="runs[3].t")
        np.testing.assert_allclose(record.values, 2e-3 * MM)

    @pytest.mark.slow
    @pytest.mark.parametrize("place", ["data set", "group", "file"])
    def test_attributes_of_hdf5_give_unit_and_sampling_rate(self, tmp_path, place):
        path = tmp_path / "record.h5"
        with h5py.File(path, "w") as file:
            tip = file.create_dataset("run/tip", data=MM)
            tip.attrs["Units"] = "mm"
            {"data set": tip, "group": tip.parent, "file": file}[place].attrs["sampling_rate"] = np.array([RATE])
        record = Measurement.from_file(path)
        np.testing.assert_allclose(record.time, TIME)
        np.testing.assert_allclose(record.values, 1e-3 * MM)
        assert record.notes == ("record.h5: times from the sampling rate, 100 1/s",)
        with h5py.File(path, "a") as file:  # a column of times holds
            file["run/time"] = 2 * TIME
        np.testing.assert_allclose(Measurement.from_file(path).time, 2 * TIME)

    @pytest.mark.parametrize("value", [-1.0, np.nan, "fast", [1.0, 2.0]])
    def test_an_attribute_that_is_no_rate_counts_for_nothing(self, tmp_path, value):
        path = tmp_path / "record.h5"
        with h5py.File(path, "w") as file:
            file.create_dataset("tip_mm", data=MM).attrs["fs"] = value
        with pytest.raises(InputError, match="give the sampling rate with --sample-rate"):
            Measurement.from_file(path)

    def test_attributes_of_netcdf_mark_gaps_and_scale_packed_numbers(self, tmp_path):
        path = tmp_path / "record.nc"
        counts = np.round(1000 * MM).astype("i2")
        counts[5] = -32768
        with h5py.File(path, "w") as file:
            packed = file.create_dataset("tip_mm", data=counts)
            packed.attrs.update({"_FillValue": np.int16(-32768), "scale_factor": -1e-3, "add_offset": 2.0, "fs": RATE})
        record = Measurement.from_file(path)
        np.testing.assert_allclose(record.values, 1e-3 * np.delete(2.0 - np.round(MM, 3), 5))
        np.testing.assert_allclose(record.time, np.delete(TIME, 5))

    def test_an_attribute_of_a_rate_holds_for_both_parts_of_complex_numbers(self, tmp_path):
        with h5py.File(tmp_path / "record.h5", "w") as file:
            file.create_dataset("x", data=MM + 2j * MM).attrs.update({"fs": RATE, "units": "mm"})
            file.create_dataset("y", data=MM).attrs["fs"] = 10.0
        record = Measurement.from_file(tmp_path / "record.h5", "x imag")
        np.testing.assert_allclose(record.time, TIME)
        np.testing.assert_allclose(record.values, 2e-3 * MM)

    def test_version_7_3(self, tmp_path):
        path = tmp_path / "record.mat"
        with h5py.File(path, "w", userblock_size=512) as file:
            file.create_dataset("time", data=TIME[None, :])
            file.create_dataset("run/tip_mm", data=MM[None, :], compression="gzip")
            file.create_dataset("label", data=np.array([[65]], dtype="uint16")).attrs["MATLAB_class"] = b"char"
        with open(path, "r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(116) + b" " * 8 + struct.pack("<H", 0x0200) + b"IM")
        record = Measurement.from_file(path)
        np.testing.assert_allclose(record.time, TIME)
        np.testing.assert_allclose(record.values, 1e-3 * MM)

    def test_a_data_set_that_is_declared_but_not_stored_is_refused(self, tmp_path):
        path = tmp_path / "record.h5"
        with h5py.File(path, "w") as file:
            file.create_dataset("x", shape=(10**8,), chunks=(1000,), dtype="f8")
        assert path.stat().st_size < 5000
        with pytest.raises(InputError, match="declares 800000000 bytes of data"):
            read_recording(path)

    def test_data_in_other_files_are_left_out(self, tmp_path):
        (tmp_path / "secret").write_bytes(bytes(8000))
        path = tmp_path / "record.h5"
        with h5py.File(path, "w") as file:
            file.create_dataset("x", shape=(1000,), dtype="f8", external=str(tmp_path / "secret"))
            layout = h5py.VirtualLayout(shape=(1000,), dtype="f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "y", shape=(1000,))
            file.create_virtual_dataset("y", layout)
        with pytest.raises(InputError, match="has no data sets of numbers"):
            read_recording(path)


class TestNumpy:
    def test_npz(self, tmp_path):
        path = tmp_path / "record.npz"
        np.savez_compressed(path, time_ms=1e3 * TIME, tip_mm=MM.astype("f4"))
        record = Measurement.from_file(path)
        np.testing.assert_allclose(record.time, TIME)
        np.testing.assert_allclose(record.values, 1e-3 * MM, rtol=1e-6)

    def test_npy_with_a_sampling_rate(self, tmp_path):
        path = tmp_path / "record.npy"
        np.save(path, MM)
        with pytest.raises(InputError, match="or give the sampling rate with --sample-rate"):
            Measurement.from_file(path)
        record = Measurement.from_file(path, sample_rate=RATE, unit="mm")
        np.testing.assert_allclose(record.time, TIME)
        np.testing.assert_allclose(record.values, 1e-3 * MM)

    def test_dates_count_in_seconds(self, tmp_path):
        path = tmp_path / "record.npz"
        dates = np.datetime64("2024-05-17T09:30:00", "ns") + (1e9 * TIME).round().astype("m8[ns]")
        np.savez(path, time=dates, tip_mm=MM)
        np.testing.assert_allclose(Measurement.from_file(path).time, TIME, atol=1e-9)

    def test_pickled_objects_are_never_loaded(self, tmp_path):
        class Loaded:
            def __reduce__(self):
                return (pytest.fail, ("unpickled",))

        path = tmp_path / "record.npz"
        np.savez(path, evil=np.array([Loaded()], dtype=object), t=TIME, x=MM)
        assert len(read_recording(path).channels) == 1
        with open(tmp_path / "evil.npy", "wb") as file:
            pickle.dump(Loaded(), file)
        for name in ("evil.npy", "pickled.npy"):
            if name == "pickled.npy":
                np.save(tmp_path / name, np.array([Loaded()], dtype=object))
            with pytest.raises(InputError):
                read_recording(tmp_path / name)

    def test_a_declared_size_is_checked_before_memory_is_taken(self, tmp_path):
        path = tmp_path / "record.npz"
        content = io.BytesIO()
        np.lib.format.write_array_header_1_0(content, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("x.npy", content.getvalue() + bytes(64))
        with pytest.raises(InputError, match="declares another size than it has"):
            read_recording(path)

    @pytest.mark.slow
    def test_a_zip_bomb_is_refused(self, tmp_path):
        path = tmp_path / "record.npz"
        with (
            zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
            archive.open("x.npy", "w") as file,
        ):
            for _ in range(1100):
                file.write(bytes(2**20))
        with pytest.raises(InputError, match="unpacks to more than 1024 MB"):
            read_recording(path)

    @pytest.mark.parametrize("unit", ["Y", "M", "as"])
    def test_dates_that_do_not_count_in_seconds_are_left_out(self, tmp_path, unit):
        path = tmp_path / "record.npz"
        np.savez(path, date=np.arange(TIME.size).view(f"M8[{unit}]"), time=TIME, x_mm=MM)
        recording = read_recording(path)
        assert [channel.name for channel in recording.channels] == ["x_mm"]
        assert "the dates in 'date' cannot be converted to seconds, and are left out" in recording.notes
        np.save(tmp_path / "record.npy", np.arange(TIME.size).view(f"M8[{unit}]"))
        with pytest.raises(InputError, match=r"record.npy: has no channels of numbers"):
            read_recording(tmp_path / "record.npy")


class TestC3D:
    @pytest.mark.slow
    def test_markers_and_analog_channels(self, tmp_path):
        path = tmp_path / "record.c3d"
        file = ezc3d.c3d()
        file["parameters"]["POINT"]["RATE"]["value"] = [RATE]
        file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
        file["parameters"]["POINT"]["LABELS"]["value"] = ["tip", "base"]
        file["parameters"]["ANALOG"]["RATE"]["value"] = [10 * RATE]
        file["parameters"]["ANALOG"]["LABELS"]["value"] = ["force"]
        file["parameters"]["ANALOG"]["UNITS"]["value"] = ["N"]
        points = np.ones((4, 2, len(TIME)))
        points[0, 0] = MM
        points[:3, 0, 7] = np.nan
        force = np.sin(np.arange(10 * len(TIME)))
        file["data"]["points"] = points
        file["data"]["analogs"] = force[None, None, :]
        file.write(str(path))
        record = Measurement.from_file(path, "tip x")
        seen = np.arange(len(TIME)) != 7
        np.testing.assert_allclose(record.time, TIME[seen])
        np.testing.assert_allclose(record.values, 1e-3 * MM[seen], rtol=1e-6)
        analog = Measurement.from_file(path, "force")
        np.testing.assert_allclose(analog.time, np.arange(10 * len(TIME)) / (10 * RATE))
        np.testing.assert_allclose(analog.values, force, rtol=1e-6, atol=1e-7)
        assert analog.sensor.quantity == "force"
        with pytest.raises(InputError, match="its channels have times of their own"):
            _ = read_recording(path).time

    @pytest.mark.skipif(not SILICONE.is_dir(), reason="the measured records are not part of the repository")
    @pytest.mark.parametrize("name", ["gravity", "load52", "load101"])
    def test_a_measured_file_and_its_copy_as_csv_agree(self, name):
        original = read_recording(SILICONE / f"beam_{name}_V2_a.c3d")
        copied = read_recording(SILICONE / f"beam_{name}_V2_a.csv")
        assert len(original.channels) == len(copied.channels) == 18
        np.testing.assert_allclose(original.time, copied.time, atol=1e-9)
        for channel, copy in zip(original.channels, copied.channels, strict=True):
            np.testing.assert_allclose(channel.values, copy.values, atol=6e-6)  # written with five decimals


class TestTdms:
    def test_a_waveform_and_a_channel_of_times(self, tmp_path):
        path = tmp_path / "record.tdms"
        write_tdms(path, ("tip", MM, {"wf_increment": 1 / RATE, "wf_start_offset": 0.5, "unit_string": "mm"}))
        record = Measurement.from_file(path)
        np.testing.assert_allclose(record.time, 0.5 + TIME)
        np.testing.assert_allclose(record.values, 1e-3 * MM)
        write_tdms(path, ("Time (ms)", 1e3 * TIME), ("acc (g)", MM), ("remark", ["a", "b"]))
        record = Measurement.from_file(path)
        np.testing.assert_allclose(record.time, TIME)
        np.testing.assert_allclose(record.values, 9.80665 * MM)

    def test_a_column_of_times_that_differs_from_the_waveform_is_asked_for(self, tmp_path):
        path = tmp_path / "record.tdms"
        write_tdms(path, ("Time", TIME, {"wf_increment": 1.0}), ("tip", MM, {"wf_increment": 1.0}))
        with pytest.raises(InputError, match=r"1 'Time': differs .*--time.*--leave-out"):
            Measurement.from_file(path)
        np.testing.assert_allclose(Measurement.from_file(path, time="Time").time, TIME)
        record = Measurement.from_file(path, layout=TableLayout(leave_out=["Time"]))
        np.testing.assert_allclose(record.time, np.arange(TIME.size))
        write_tdms(path, ("Time", TIME, {}), ("tip", MM, {"wf_increment": 1.001 / RATE}))
        np.testing.assert_allclose(Measurement.from_file(path, "tip").time, 1.001 * TIME)

    def test_stamps_count_in_seconds(self, tmp_path):
        stamps = np.datetime64("2024-05-17T09:30:00", "us") + (1e6 * TIME).round().astype("m8[us]")
        write_tdms(tmp_path / "record.tdms", ("time", stamps), ("x_mm", MM))
        np.testing.assert_allclose(Measurement.from_file(tmp_path / "record.tdms").time, TIME, atol=1e-6)

    @pytest.mark.parametrize("delay", [0, 250_000, 1_500_000])  # microseconds
    def test_channels_that_start_later_have_later_times(self, tmp_path, delay):
        start = np.datetime64("2024-05-17T09:30:00", "us")
        channels = (
            (name, MM, {"wf_increment": 0.01, "wf_start_offset": 0.0, "wf_start_time": instant})
            for name, instant in (("x_mm", start), ("y_mm", start + np.timedelta64(delay, "us")))
        )
        write_tdms(tmp_path / "record.tdms", *channels)
        x, y = read_recording(tmp_path / "record.tdms").channels
        np.testing.assert_allclose(x.time, TIME, atol=1e-9)
        np.testing.assert_allclose(y.time, TIME + 1e-6 * delay, atol=1e-9)

    @pytest.mark.parametrize(("symbol", "step"), [("s", 0.01), ("ms", 1e-5), ("Hz", None)])
    def test_the_increment_has_a_unit(self, tmp_path, symbol, step):
        properties = {"wf_increment": 0.01, "wf_xunit_string": symbol, "unit_string": "mm"}
        write_tdms(tmp_path / "record.tdms", ("tip", MM, properties))
        (channel,) = read_contents(tmp_path / "record.tdms").channels
        assert (channel.time is None) if step is None else (channel.time[1] == pytest.approx(step))

    def test_a_scale_makes_numbers_larger_than_the_file(self, tmp_path):
        counts = np.round(1000 * MM).astype(np.int16)
        scale = {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear", "NI_Scaling_Status": "unscaled",
                 "NI_Scale[0]_Linear_Slope": 1e-3, "NI_Scale[0]_Linear_Y_Intercept": 0.0}  # fmt: skip
        counts = np.tile(counts, 100)  # the header is small
        write_tdms(tmp_path / "record.tdms", ("tip_mm", counts, scale | {"wf_increment": 0.01}))
        record = Measurement.from_file(tmp_path / "record.tdms")
        np.testing.assert_allclose(record.values, 1e-6 * counts, atol=1e-12)


LVM = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t.
Multi_Headings\tNo
X_Columns\t{columns}
Time_Pref\tRelative
***End_of_Header***\t

Channels\t1\t
Samples\t{samples}\t
Y_Unit_Label\tmm\t
X_Dimension\tTime\t
X0\t0.5\t
Delta_X\t0.01\t
***End_of_Header***\t
X_Value\ttip\tComment
"""


class TestLvm:
    @pytest.mark.parametrize("columns", ["One", "No"])
    def test_one_segment(self, tmp_path, columns):
        """The library reads only; this is the layout in its documentation.  A pickled copy is not loaded."""
        path = tmp_path / "record.lvm"
        (tmp_path / "record.lvm.pkl").write_bytes(pickle.dumps({"Segments": 7}))
        first = [f"{0.5 + t:.6f}" if columns == "One" else "" for t in TIME]
        rows = "".join(f"{t}\t{x:.9f}\n" for t, x in zip(first, MM, strict=True))
        path.write_text(LVM.format(columns=columns, samples=len(TIME)) + rows)
        record = Measurement.from_file(path)
        np.testing.assert_allclose(record.time, 0.5 + TIME)
        np.testing.assert_allclose(record.values, 1e-3 * MM, atol=1e-12)
        assert {file.name for file in tmp_path.iterdir()} == {"record.lvm", "record.lvm.pkl"}

    @pytest.mark.parametrize("columns", ["One", "No"])
    def test_values_over_frequency_have_no_times(self, tmp_path, columns):
        path = tmp_path / "record.lvm"
        header = LVM.format(columns=columns, samples=2).replace("X_Dimension\tTime", "X_Dimension\tFrequency")
        path.write_text(header + ("0.0\t1.0\n0.5\t2.0\n" if columns == "One" else "\t1.0\n\t2.0\n"))
        assert all(channel.time is None for channel in read_contents(path).channels)

    def test_a_long_file_takes_little_more_memory_than_its_numbers(self, tmp_path, monkeypatch):
        path = tmp_path / "record.lvm"
        values = np.arange(30_000) / 1000.0
        path.write_text(LVM.format(columns="One", samples=30_000) + "".join(f"{t}\t{2.0 * t}\n" for t in values))
        monkeypatch.setattr("ancf_casadi.records.reading.text.reader.BLOCK_BYTES", 2**14)
        tracemalloc.start()
        recording = read_contents(path)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        np.testing.assert_array_equal(recording.channels[0].time, values)
        np.testing.assert_array_equal(recording.channels[0].values, 2.0 * values)
        assert peak < 3 * path.stat().st_size

    @pytest.mark.parametrize("rows", [2, 5000])
    def test_several_segments_are_refused(self, tmp_path, monkeypatch, rows):
        path = tmp_path / "record.lvm"
        monkeypatch.setattr("ancf_casadi.records.reading.text.reader.BLOCK_BYTES", 2**14)
        head, _, segment = LVM.format(columns="One", samples=rows).partition("\n\n")
        numbers = "".join(f"{k}\t{k}\n" for k in range(rows))
        path.write_text(f"{head}\n\n{segment}{numbers}\n{segment}{numbers}")
        with pytest.raises(InputError, match="has 2 segments; save each in a file of its own"):
            read_contents(path)


class TestStatedRates:
    @pytest.mark.parametrize(
        ("name", "value"), [("dt", 0.01), ("Fs", 100.0), ("sample_rate", 100.0), ("run.fs", 100.0), ("Ts", 0.01)]
    )
    def test_a_number_beside_the_data_gives_the_times(self, tmp_path, name, value):
        path = tmp_path / "record.npz"
        np.savez(path, **{"tip_mm": MM, name: value})
        np.testing.assert_allclose(Measurement.from_file(path).time, TIME, atol=1e-12)

    @pytest.mark.parametrize(
        ("numbers", "text"),
        [({"fs": 1000.0, "dt": 0.5}, "fs = 1000, dt = 0.5"), ({"dt": 1.0}, "dt = 1"), ({"rate": 0.3}, "rate = 0.3")],
    )
    def test_steps_that_contradict_each_other_or_are_long_without_a_unit_are_asked_for(self, tmp_path, numbers, text):
        path = tmp_path / "record.npz"
        np.savez(path, tip_mm=MM, **numbers)
        with pytest.raises(InputError, match=rf"\({text}\).*--sample-rate"):
            Measurement.from_file(path)
        np.testing.assert_allclose(Measurement.from_file(path, sample_rate=RATE).time, TIME)

    def test_statements_that_agree_but_for_rounding_hold(self, tmp_path):
        np.savez(tmp_path / "record.npz", tip_mm=MM, fs=60.0, dt=0.01667)
        np.testing.assert_allclose(Measurement.from_file(tmp_path / "record.npz").time, np.arange(TIME.size) / 60.0)

    @pytest.mark.parametrize(
        ("name", "value", "unit", "step"),
        [("fs", 1.0, "kHz", 1e-3), ("fs", 1.0, "kS/s", 1e-3), ("fs", 100.0, "samples per second", 0.01),
         ("dt", 1.0, "ms", 1e-3), ("rate", 5.0, "ms", 5e-3), ("dt", 2.0, "s", 2.0),
         ("fs", 1.0, "foo", None), ("fs", 1.0, "mm", None)],
    )  # fmt: skip
    def test_the_unit_of_a_step_is_its_attribute(self, tmp_path, name, value, unit, step):
        path = tmp_path / "record.h5"
        with h5py.File(path, "w") as file:
            file["tip_mm"] = MM
            file[name] = value
            file[name].attrs["units"] = unit
        if step is None:
            with pytest.raises(InputError, match="--sample-rate"):
                Measurement.from_file(path)
        else:
            np.testing.assert_allclose(Measurement.from_file(path).time, step * np.arange(TIME.size))

    @pytest.mark.parametrize("suffix", ["mat", "h5"])
    def test_each_struct_or_group_has_its_own_step(self, tmp_path, suffix):
        path = tmp_path / f"record.{suffix}"
        structs = {"a": {"x": MM, "dt": 0.01}, "b": {"x": MM, "info": {"fs": 50.0}}, "c": {"x": MM}}
        if suffix == "mat":
            savemat(path, structs)
        else:
            with h5py.File(path, "w") as file:
                file["a/x"], file["a/dt"], file["b/x"], file["b/info/fs"], file["c/x"] = MM, 0.01, MM, 50.0, MM
        np.testing.assert_allclose(Measurement.from_file(path, "a.x").time, TIME)
        np.testing.assert_allclose(Measurement.from_file(path, "b.x").time, 2 * TIME)
        with pytest.raises(InputError, match="--sample-rate"):
            Measurement.from_file(path, "c.x")

    @pytest.mark.parametrize("suffix", ["mat", "npz"])
    def test_f_with_negative_values_is_a_force(self, tmp_path, suffix):
        path = tmp_path / f"record.{suffix}"
        columns = {"f": MM, "dt": 0.01}
        savemat(path, columns) if suffix == "mat" else np.savez(path, **columns)
        np.testing.assert_allclose(Measurement.from_file(path).time, TIME, atol=1e-12)


class TestSound:
    @pytest.mark.parametrize(("kind", "scale"), [("int16", 32768.0), ("int32", 2147483648.0), ("float32", 1.0)])
    def test_samples_are_fractions_of_full_scale(self, tmp_path, kind, scale):
        from scipy.io import wavfile

        path = tmp_path / "record.wav"
        wavfile.write(path, 100, (0.1 * MM * scale).astype(kind))
        record = Measurement.from_file(path)
        np.testing.assert_allclose(record.time, TIME)
        np.testing.assert_allclose(record.values, 0.1 * MM, atol=1.0 / 32768.0)
        assert record.sensor.unit == "full scale"


class TestPoseTracks:
    def test_a_deeplabcut_table_with_its_likelihoods(self, tmp_path):
        path = tmp_path / "record.csv"
        likelihood = np.where(np.arange(len(TIME)) % 10 == 3, 0.2, 0.99)
        rows = "".join(f"{k},{x},{2 * x},{p}\n" for k, (x, p) in enumerate(zip(MM, likelihood, strict=True)))
        path.write_text(f"scorer,net,net,net\nbodyparts,tip,tip,tip\ncoords,x,y,likelihood\n{rows}")
        recording = read_recording(path, sample_rate=RATE)
        assert [channel.name for channel in recording.channels] == ["tip x", "tip y"]
        assert "50 coordinates with a likelihood below 0.6 are gaps" in recording.notes
        record = Measurement.from_file(path, "tip y", sample_rate=RATE, unit="0.25 mm")
        seen = likelihood > 0.6
        np.testing.assert_allclose(record.time, TIME[seen])
        np.testing.assert_allclose(record.values, 0.5e-3 * MM[seen])
        signal = Measurement.from_file(path, "tip y", sample_rate=RATE)
        np.testing.assert_allclose(signal.values, 2.0 * MM[seen])
        assert signal.sensor == Sensor("signal", signal_unit="px")
        assert "in px, without a scale" in signal.notes[-1]

    @pytest.mark.parametrize(("factor", "kept"), [(1.0, 1), (1.2, 2), (100.0, 1), (200.0, None)])
    def test_likelihoods_may_be_in_percent(self, tmp_path, factor, kept):
        path = tmp_path / "record.csv"
        rows = "".join(f"{0.1 * k},{k},{factor * p}\n" for k, p in enumerate((0.99, 0.1, 0.55, 0.99)))
        path.write_text("time_s,tip_x_mm,tip_likelihood\n" + rows)
        if kept is None:
            with pytest.raises(InputError, match=r"likelihoods .* up to 198"):
                read_recording(path)
        else:
            assert np.isfinite(read_recording(path).channel().values[1:]).sum() == kept

    def test_a_plain_table_with_likelihoods(self, tmp_path):
        path = tmp_path / "record.csv"
        path.write_text("time_s,tip_x_mm,tip_score\n0,1,0.9\n0.1,2,0.1\n0.2,3,\n0.3,4,0.8\n")
        record = Measurement.from_file(path)
        assert record.time.tolist() == [0.0, 0.3]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv.gz", b"\x1f\x8b\x08" + bytes(50), "is compressed with gzip; unpack it first"),
        ("a.xls", b"\xd0\xcf\x11\xe0" + bytes(50), "is an Excel workbook; save the sheet as CSV"),
        ("a.xlsx", b"PK\x03\x04" + bytes(50), "is a workbook; save the sheet as CSV"),
        ("a.npz", b"PK\x03\x04" + bytes(50), "is no readable NPZ file"),
        ("a.mat", b"MATLAB 5.0 MAT-file" + bytes(200), "is no readable MATLAB file"),
        ("a.mat", b"x" * 200, "is no readable MATLAB file"),
        ("a.h5", b"\x89HDF\r\n\x1a\n" + bytes(50), "is no readable HDF5 file"),
        ("a.c3d", b"\x02\x50" + bytes(50), "has no C3D header"),
        ("a.tdms", b"TDSm" + bytes(50), "is no readable TDMS file|has no channels of numbers"),
        ("a.lvm", b"LabVIEW Measurement\t\n", "is no readable LVM file"),
        ("a.uff", b"    -1\n    58\n    -1\n", "is no readable UFF file"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)


C3D_HEADER = struct.pack("<2B8H", 2, 0x50, 0, 0, 1, 1, 0, 0, 0, 3).ljust(515, b"\0") + b"\x54" + bytes(1020)


@pytest.mark.parametrize("module", ["pyuff", "h5py", "ezc3d", "nptdms", "lvm_read"])
def test_a_missing_library_is_named_with_its_installation(tmp_path, monkeypatch, module):
    starts = {"pyuff": b"    -1\n    58\n", "h5py": b"\x89HDF\r\n\x1a\n", "nptdms": b"TDSm", "ezc3d": C3D_HEADER}
    path = tmp_path / ("a.c3d" if module == "ezc3d" else "a.dat")
    path.write_bytes(starts.get(module, b"LabVIEW Measurement") + bytes(50))
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(InputError, match=rf"{module}: is not installed.*pip install {module}$"):
        read_recording(path)
