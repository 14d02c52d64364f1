"""Mutated files of every format: a record, or a refusal in one line; never another exception, never a crash."""

import random
import subprocess

import numpy as np
import pytest
from scipy.io import savemat

from ancf_casadi import HarmonicBase
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.reading import libraries
from ancf_casadi.records.recording import read_recording
from problems import FrfRecord, ResponseRecord

TIME = np.arange(25) / 100.0
MM = 5.0 * np.cos(20.0 * TIME)
TOKENS = (
    b",", b";", b"\t", b" ", b"\n", b"\r", b'"', b"nan", b"1e999", b"#", b"\0", b"(ms)", b"[", b"1" * 30, b":", b"T",
    b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\xef\xbb\xbf", b"\xc3", b"time", b"1e308", b"1e-320", b"1_0",
    b"\xd9\xa1",
)  # fmt: skip


def text_files(_):
    def rows(form, separator="\n"):
        return separator.join(form.format(t, y) for t, y in zip(TIME, MM, strict=True)) + separator

    return {
        "a.csv": b"# made by X\nTime (ms),Disp [mm]\n" + rows("{:.3f},{:.4f}").encode(),
        "b.csv": "Zeit;Weg;Text\ns;µm;-\n".encode("latin-1") + rows('{};{};"a b"').replace(".", ",").encode(),
        "c.csv": ("time\tx_mm\n" + rows("2024-05-17T09:30:{:06.3f}\t{:.4f}", "\r\n")).encode("utf-16"),
        "d.txt": b"Sensor: A\n\n  Time (s)   x (mm)\n" + rows("  {:.3f}  {:8.4f}").encode(),
        "e.csv": b"scorer,n,n,n\nbodyparts,t,t,t\ncoords,x,y,likelihood\n" + rows("{},{},1,0.9").encode(),
        "g.csv": b"f (Hz),x (mm/N),phase (deg)\n" + rows("{0:.3f},{1:.4f},{1}").encode() + b"END\n",
        "h.csv": b"f;F_N;real;imag\n" + rows("{0:.3f};{0};{1:.4f};{1}").encode() + b"OVL;OVL;OVL;OVL\n",
        "f.csv": b"clock,x\n" + rows("09:30:{:06.3f},{:.4f}", "\r").encode(),
        "a.lvm": b"LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\nChannels\t1\t\n"
        b"Delta_X\t0.01\t\n***End_of_Header***\t\nX_Value\ttip\tComment\n" + rows("{}\t{}").encode(),
    }


def library_files(folder):
    import h5py
    import pyuff
    from nptdms import ChannelObject, TdmsWriter

    function = pyuff.prepare_58(
        func_type=1, rsp_node=4, rsp_dir=3, ref_node=1, ref_dir=3, ord_data_type=4, num_pts=25, abscissa_spacing=1,
        abscissa_min=0.0, abscissa_inc=0.01, ordinate_spec_data_type=8, abscissa_spec_data_type=17,
        orddenom_spec_data_type=0, z_axis_spec_data_type=0, data=MM, x=TIME, id1="tip",
    )  # fmt: skip
    pyuff.UFF(str(folder / "a.uff")).write_sets(function, mode="add")
    functions = function | {"func_type": 4, "data": MM + 1j, "orddenom_spec_data_type": 13, "ord_data_type": 5}
    pyuff.UFF(str(folder / "b.uff")).write_sets([functions, functions | {"rsp_node": 5}], mode="add")
    np.savez(folder / "a.npz", time=TIME, x_mm=MM)
    np.savez(folder / "c.npz", f_Hz=TIME, H=MM + 1j)
    np.savez_compressed(folder / "b.npz", time=TIME, x_mm=MM)
    with TdmsWriter(str(folder / "a.tdms")) as writer:
        writer.write_segment([ChannelObject("run", "tip", MM, {"wf_increment": 0.01, "unit_string": "mm"})])
    savemat(folder / "a.mat", {"t_s": TIME, "tip_mm": MM})
    savemat(folder / "b.mat", {"run": {"f_Hz": TIME, "H": MM + 1j, "more": {"x": MM}}})
    with h5py.File(folder / "a.h5", "w") as file:
        file["time"], file["x_mm"] = TIME, MM
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def mutated(rng, content):
    data = bytearray(content)
    if rng.random() < 0.15:
        del data[rng.randrange(len(data)) :]
    for _ in range(rng.choice([1, 1, 2, 5, 30])):
        place, token = rng.randrange(len(data) + 1), rng.choice(TOKENS)
        match rng.randrange(5):
            case 0:
                data[place : place + 1] = bytes([rng.randrange(256)])
            case 1:
                data[place:place] = token
            case 2:
                data[place : place + len(token)] = token
            case 3:
                del data[place : place + rng.choice([1, 4, 50])]
            case 4:
                data[place:place] = data[place : place + rng.choice([1, 30, 200])]
    return bytes(data)


def outcome(path, reader=read_recording):
    try:
        return reader(path)
    except InputError as error:
        assert "\n" not in str(error)
        assert len(str(error)) < 900
        return str(error)


def frf(path):
    return FrfRecord.from_file(path, "receptance")


def response(path):
    return ResponseRecord.from_file(path, base=HarmonicBase(1e-3, 1.0))


@pytest.mark.slow
@pytest.mark.parametrize(("files", "each"), [(text_files, 60), (library_files, 25)])
def test_a_mutated_file_is_read_or_refused_in_one_line(tmp_path, files, each):
    (tmp_path / "seeds").mkdir()
    read = 0
    for name, content in files(tmp_path / "seeds").items():
        compiled = name.endswith((".mat", ".h5"))
        for seed in range(3 if compiled else each):
            path = tmp_path / name
            path.write_bytes(mutated(random.Random(f"{name} {seed}"), content))
            for reader in (read_recording, frf, response)[: 1 if compiled and name[0] == "a" else 3]:
                read += not isinstance(outcome(path, reader), str)
    assert read > 0  # the mutations reach beyond the first check


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (subprocess.CompletedProcess([], -11, b"", b""), "is no readable MATLAB file .it crashed the library"),
        (subprocess.CompletedProcess([], -24, b'{"arr', b""), "is no readable MATLAB file"),
        (subprocess.TimeoutExpired([], 60.0), "takes too long to read"),
    ],
)
def test_a_library_that_crashes_or_hangs_leaves_this_process_intact(tmp_path, monkeypatch, run, message):
    def crashing(*_, **__):
        if isinstance(run, Exception):
            raise run
        return run

    path = tmp_path / "a.mat"
    savemat(path, {"t_s": TIME, "tip_mm": MM})
    monkeypatch.setattr(libraries.subprocess, "run", crashing)
    with pytest.raises(InputError, match=message):
        read_recording(path)
