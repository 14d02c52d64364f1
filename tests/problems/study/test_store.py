"""Kept results: keys that change with every input, content that keeps every bit, files that are never trusted."""

import dataclasses
import math
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from ancf_casadi import Beam, Clamp, Pin, PointMass, Roller, Spring
from ancf_casadi.mechanics.spec import BeamSpec
from ancf_casadi.support.arrays import Array
from problems.study import compute as store_module
from problems.study.compute import computation_key, decode, encode, kept, run_function, unpack, with_digest


@dataclass(frozen=True)
class Sample:
    """Data of every type that results have."""

    values: Array
    counts: np.ndarray
    numbers: dict[str, float]
    pairs: tuple[tuple[float, float], ...]
    text: str
    content: bytes
    beam: BeamSpec | None
    anything: Any


def sample(scale: float, beam: Beam | None = None) -> Sample:
    return Sample(
        values=np.array([[0.1 * scale, math.nan, -math.inf], [math.inf, -0.0, 5e-324]]),
        counts=np.arange(4, dtype=np.int32),
        numbers={"pi": math.pi, "none": math.nan, "most": math.inf},
        pairs=((0.1, 1e300), (math.nan, 2.0)),
        text="η2 = 0.11 1/m",
        content=b"\x89PNG\x00",
        beam=None if beam is None else BeamSpec.of(beam),
        anything={"rows": [1, 2.5, None, True], "ratio": 0.1 + 0.2},
    )


def other(scale: float, beam: Beam | None = None) -> Sample:
    return sample(scale, beam)


def touch(path: str) -> list[float]:
    Path(path).write_text("executed")
    return []


@pytest.fixture
def beam(paper_beam) -> Beam:
    return paper_beam(3, supports=(Clamp(), Roller(0.3)), attachments=(PointMass(0.5, 1e-3), Spring(0.3, (0.0, 1.0))))


class TestKey:
    def test_is_the_same_each_time(self, beam):
        assert computation_key(sample, 1.0, beam) == computation_key(sample, 1.0, dataclasses.replace(beam))

    @pytest.mark.slow
    def test_is_the_same_in_every_process(self):
        """Computations of the paper, under two orders of hashing."""
        code = (
            "from problems.paper import inputs, table_04\n"
            "from problems.study.compute import Compute, Store\n"
            "store = Store()\n"
            "table_04.decay_fits(Compute(store)), inputs.matched_beam(Compute(store))\n"
            "print(*store.computations, sep='\\n')\n"
        )
        one, two = (
            subprocess.run([sys.executable, "-c", code], env={**os.environ, "PYTHONHASHSEED": seed}, check=True,
                           capture_output=True, text=True).stdout.splitlines()
            for seed in ("1", "2")
        )  # fmt: skip
        assert one == two
        assert len(one) == 6

    def test_changes_with_any_input(self, beam):
        """One bit of a number, one element of the beam, a type, the order, the function."""
        array = np.array([1.0, 2.0])
        inputs = [
            (1.0, None), (np.nextafter(1.0, 2.0).item(), None), (math.nan, None), (-0.0, None), (0.0, None), (1, None),
            ("1.0", None), (1.0, beam), (beam, 1.0), (1.0, beam.with_(tip_mass=1e-9)),
            (1.0, beam.with_(supports=(Clamp(), Pin(0.3)))),
            (1.0, beam.with_(density=8000.1)),
            (array, None), (array.astype(np.float32), None), (array.reshape(1, 2), None), (array[::-1], None),
            ({"a": 1.0}, None), ({"b": 1.0}, None), ([1.0, 2.0], None),
        ]  # fmt: skip
        keys = [*(computation_key(sample, *arguments) for arguments in inputs), computation_key(other, *inputs[0])]
        assert len({*keys}) == len(keys)

    @pytest.mark.slow
    @pytest.mark.parametrize("change", ["source", "new", "renamed", "version"])
    def test_changes_with_the_program(self, tmp_path, monkeypatch, change):
        """The sources stand in for those of this program, in a folder of their own."""
        folder = tmp_path / "package"
        (folder / "sub").mkdir(parents=True)
        (folder / "__init__.py").write_text("")
        (folder / "sub" / "law.py").write_text("eta = 1\n")
        (folder / "laws.toml").write_text("eta = 1\n")
        package = type("Package", (), {"__file__": str(folder / "__init__.py")})
        monkeypatch.setattr(store_module, "problems", package)
        program: Callable[[], str] = store_module._program.__wrapped__
        before = program()
        assert program() == before
        if change == "source":
            (folder / "sub" / "law.py").write_text("eta = 2\n")
        elif change == "new":
            (folder / "sub" / "more.py").write_text("x = 1\n")
        elif change == "renamed":
            (folder / "sub" / "law.py").rename(folder / "sub" / "rule.py")
        else:
            monkeypatch.setattr(store_module, "version", lambda name: "0")
        assert program() != before

    def test_names_what_is_no_plain_data(self):
        with pytest.raises(NotImplementedError, match="function is not plain data"):
            computation_key(sample, lambda: 0)


class TestContent:
    def test_keeps_every_bit(self, beam):
        given = sample(1 / 3, beam)
        _, found = unpack(run_function(sample, (1 / 3, beam)), sample)
        assert type(found) is Sample
        for name in ("values", "counts"):
            ours, theirs = getattr(found, name), getattr(given, name)
            assert (ours.dtype, ours.shape, ours.tobytes()) == (theirs.dtype, theirs.shape, theirs.tobytes())
        assert repr(found.numbers) == repr(given.numbers)
        assert repr(found.pairs) == repr(given.pairs)
        assert (found.text, found.content, found.anything) == (given.text, given.content, given.anything)
        assert found.beam.beam() == beam

    @pytest.mark.parametrize("array", [np.empty((0, 3)), np.array(2.0), np.ones((2, 3)).T, np.arange(9)[::2]])
    def test_keeps_arrays_of_any_shape(self, array):
        found = decode(encode(array), np.ndarray)
        assert (found.dtype, found.shape) == (array.dtype, array.shape)
        assert np.array_equal(found, array)

    def test_a_number_of_numpy_is_a_number(self):
        assert decode(encode([np.float64(0.1), np.int64(3), np.bool_(True)]), list[Any]) == [0.1, 3, True]


class TestFiles:
    def test_come_back_as_they_were_found(self, tmp_path):
        """The same bits, and the time of the run."""
        content = run_function(sample, (2.0,))
        (tmp_path / "file").write_bytes(with_digest(content))
        assert encode(kept(tmp_path / "file", sample)) == content
        assert kept(tmp_path / "file", sample).seconds > 0.0

    def test_that_are_missing_are_none(self, tmp_path):
        assert kept(tmp_path / "none" / "file", sample) is None

    @pytest.mark.parametrize("kind", ["longer", "number", "objects", "pickle", "harm", "shape", "dtype"])
    def test_that_are_damaged_or_foreign_are_ignored(self, tmp_path, monkeypatch, kind):
        """Truncated files, other types, arrays of objects and pickles: none is used, none is executed."""
        monkeypatch.chdir(tmp_path)
        path = tmp_path / "file"
        good = run_function(sample, (2.0,))
        path.write_bytes(with_digest(_damaged(good, kind)))
        assert kept(path, sample) is None
        assert not (tmp_path / "harm").exists()
        path.write_bytes(with_digest(good))
        assert kept(path, sample) is not None

    def test_of_every_length_are_ignored(self, tmp_path):
        """A file that was cut at any byte."""
        path = tmp_path / "file"
        good = with_digest(run_function(sample, (2.0,)))
        for size in range(len(good)):
            path.write_bytes(good[:size])
            assert kept(path, sample) is None, size

    def test_with_a_flipped_bit_are_ignored(self, tmp_path):
        """In a number, a flipped bit is still a number: the digest tells."""
        path = tmp_path / "file"
        content = with_digest(run_function(sample, (2.0,)))
        for position in range(0, 8 * len(content), 13):
            damaged = bytearray(content)
            damaged[position // 8] ^= 1 << position % 8
            path.write_bytes(damaged)
            assert kept(path, sample) is None, position


class _Harm:
    def __reduce__(self):
        return touch, ("harm",)


def _damaged(good: bytes, kind: str) -> bytes:
    _, content = msgspec.msgpack.decode(good)

    def again(**changes: Any) -> bytes:
        return msgspec.msgpack.encode([1.0, content | changes])

    return {
        "longer": lambda: good + b"\0",
        "number": lambda: encode([1.0, 3.0]),
        "objects": lambda: again(values=["|O", [1], bytes(8)]),
        "shape": lambda: again(values=["<f8", [7], bytes(8)]),
        "dtype": lambda: again(values=["<f9", [1], bytes(8)]),
        "pickle": lambda: pickle.dumps(_Harm()),
        "harm": lambda: again(values=pickle.dumps(_Harm())),
    }[kind]()
