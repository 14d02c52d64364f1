"""Tables as text and CSV, data as JSON, and files that are written completely or not at all."""

import csv
import io
import json
import math
import os
import signal
import stat
import subprocess
import sys
import time
from dataclasses import dataclass

import numpy as np
import pytest

from ancf_casadi import InputError
from ancf_casadi.support.files import check_file, check_folder, write_file, write_files
from ancf_casadi.support.tables import Displayed, Table, plural, spread, to_json, wrap_report

TABLE = Table(
    "one",
    "A table",
    ("name", "value_m"),
    [("first", 1 / 3), ("second", 12345678.9), ("third", 7), ("nothing", None), ('quoted, "so"', -1e-12)],
    ("a note", "another"),
)


class TestTable:
    def test_text_is_aligned(self):
        lines = TABLE.text().splitlines()
        assert lines[0] == "A table"
        assert len({len(line) for line in lines[1:9]}) == 1
        assert lines[4].split() == ["first", "0.333333"]
        assert lines[5].split() == ["second", "1.23457e+07"]
        assert lines[6].split() == ["third", "7"]
        assert lines[7].split() == ["nothing"]
        assert lines[9:] == ["  a note", "  another"]

    def test_a_report_is_folded_but_for_rows(self):
        rows = Table("one", "A table", ("name", "value"), [("x" * 60 + " " + "y" * 60, 1.5)], ("word " * 30,)).text()
        lines = wrap_report(rows).splitlines()
        assert lines[:5] == rows.splitlines()[:5] and len(lines[4]) > 120
        assert [line.split() for line in lines[5:]] == [["word"] * 19, ["word"] * 11]

    def test_csv_keeps_all_digits(self):
        rows = list(csv.reader(io.StringIO(TABLE.csv())))
        assert rows[0] == ["name", "value_m"]
        assert float(rows[1][1]) == 1 / 3
        assert rows[3:] == [["third", "7"], ["nothing", ""], ['quoted, "so"', "-1e-12"]]

    def test_without_rows(self):
        assert Table("none", "Nothing", ("a", "b"), []).csv() == "a,b\n"
        assert Table("none", "Nothing", ("a", "b"), []).text().splitlines() == ["Nothing", "----", "a  b", "----"]

    def test_html_shows_cells_as_they_are_written(self):
        html = Table("one", "A < B", ("<script>", "y"), [("a & b", 1 / 3), (None, 2)], ("x > 0",))._repr_html_()
        assert "<caption>A &lt; B</caption>" in html and "<th>&lt;script&gt;</th><th>y</th>" in html
        assert "<td>a &amp; b</td><td>0.333333</td>" in html and "<td></td><td>2</td>" in html
        assert html.endswith("</table><p>x &gt; 0</p>")


@dataclass(frozen=True, eq=False)
class Sample(Displayed):
    size: float
    values: np.ndarray
    words: str = "none"
    inner: object = None


class TestOneLine:
    def test_it_has_the_fields_that_differ_from_their_defaults_in_short(self):
        assert repr(Sample(1 / 3, np.zeros((2, 5)))) == "Sample(size=0.333333, values=array(2, 5))"
        inner = Sample(np.float64(2.0), np.zeros(3), inner=(1, 2.5))
        assert "inner=Sample(size=2, values=array(3,), inner=(1, 2.5))" in repr(Sample(1.0, np.zeros(1), inner=inner))

    @pytest.mark.parametrize("words", ["word " * 1000, "a\n" * 50, ["word"] * 1000, {k: "word" for k in range(1000)}])
    def test_it_is_below_200_characters(self, words):
        text = repr(Sample(1.0, np.zeros(10**6), words=words, inner=[words] * 10))
        assert len(text) < 200 and "\n" not in text and text.endswith(")")

    def test_a_class_without_fields_has_its_name(self):
        assert repr(type("Law", (Displayed,), {})()) == "Law()"

    def test_counts_and_ranges_read_as_words(self):
        assert (plural(1, "mode"), plural(0, "mode"), plural(5, "mode")) == (
            "1 mode",
            "0 modes",
            "5 modes",
        )
        assert (spread([1.0, 3.0, 2.0], "Hz"), spread([2.0], "s"), spread([], "s")) == ("1 to 3 Hz", "2 s", "no s")


class TestJson:
    def test_what_is_not_finite_becomes_null(self):
        data = {"a": [1.0, math.nan, (math.inf, -math.inf)], "b": {"c": math.nan, "d": "nan", "e": True}}
        assert json.loads(to_json(data)) == {"a": [1.0, None, [None, None]], "b": {"c": None, "d": "nan", "e": True}}

    def test_numbers_come_back_bit_for_bit(self):
        values = [0.1, 1 / 3, 5e-324, 1.7976931348623157e308, -0.0, 2**53 + 1]
        assert [value.hex() for value in map(float, json.loads(to_json(values)))] == [float(v).hex() for v in values]

    def test_what_is_not_plain_is_refused(self):
        with pytest.raises(TypeError):
            to_json({"a": {1, 2}})


class TestFolder:
    def test_one_that_is_there_or_can_be_made(self, tmp_path):
        assert check_folder(tmp_path) == tmp_path
        assert check_folder(tmp_path / "new" / "folder") == tmp_path / "new" / "folder"
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("below", ["file", "file/folder", "file/folder/deeper"])
    def test_a_file_is_in_the_way(self, tmp_path, below):
        (tmp_path / "file").write_text("")
        with pytest.raises(InputError, match=r"file: is not a folder$"):
            check_folder(tmp_path / below)

    def test_one_that_cannot_be_written(self, tmp_path, monkeypatch):
        """The superuser may write anywhere, so the answer of the system is replaced."""
        monkeypatch.setattr(os, "access", lambda path, mode: False)
        with pytest.raises(InputError, match=r"cannot be written$"):
            check_folder(tmp_path / "new")


class TestFile:
    def test_text_and_bytes(self, tmp_path):
        write_file(tmp_path / "new" / "a.txt", "zeta ζ\n")
        write_file(tmp_path / "new" / "a.bin", b"\x00\xff")
        assert (tmp_path / "new" / "a.txt").read_bytes() == "zeta ζ\n".encode()
        assert (tmp_path / "new" / "a.bin").read_bytes() == b"\x00\xff"
        assert stat.S_IMODE((tmp_path / "new" / "a.txt").stat().st_mode) == 0o644

    @pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
    def test_interrupted_it_leaves_what_was_there_and_no_draft(self, tmp_path, monkeypatch, error):
        (tmp_path / "a.txt").write_text("old")

        def fails(source, target):
            raise error

        monkeypatch.setattr(os, "replace", fails)
        with pytest.raises((KeyboardInterrupt, InputError)):
            write_file(tmp_path / "a.txt", "new")
        assert (tmp_path / "a.txt").read_text() == "old"
        assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]

    @pytest.mark.parametrize(
        ("name", "message"), [("file/a.txt", "file: is not a folder"), ("a" * 300, r"a{300}: cannot be written \(")]
    )
    def test_one_that_cannot_be_written_is_named(self, tmp_path, name, message):
        (tmp_path / "file").write_text("")
        with pytest.raises(InputError, match=message):
            write_file(tmp_path / name, "new")
        assert [path.name for path in tmp_path.iterdir()] == ["file"]

    def test_a_pipe_or_a_device_is_not_replaced(self, tmp_path):
        os.mkfifo(tmp_path / "pipe")
        for write in (check_file, lambda path: write_file(path, "new")):
            with pytest.raises(InputError, match="pipe: is a device or a pipe; name a file"):
                write(tmp_path / "pipe")
        assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)

    @pytest.mark.parametrize("there", [True, False])
    def test_a_link_stays_one(self, tmp_path, there):
        (tmp_path / "link").symlink_to(tmp_path / "file")
        if there:
            (tmp_path / "file").write_text("old")
        write_file(tmp_path / "link", "new")
        assert (tmp_path / "link").is_symlink()
        assert (tmp_path / "file").read_text() == "new"

    @pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
    def test_several_are_written_all_or_none(self, tmp_path, monkeypatch, error):
        """The disk is full, or the process is interrupted, while the last is written beside its place."""
        contents = {tmp_path / "a.txt": "new", tmp_path / "new" / "b.txt": "new"}
        (tmp_path / "a.txt").write_text("old")
        change_mode = os.chmod

        def fails(draft, mode):
            if ".b.txt-" in draft:
                raise error
            change_mode(draft, mode)

        with monkeypatch.context() as patched:
            patched.setattr(os, "chmod", fails)
            with pytest.raises((KeyboardInterrupt, InputError)):
                write_files(contents)
        assert (tmp_path / "a.txt").read_text() == "old"
        assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["a.txt"]
        write_files(contents)
        assert [path.read_text() for path in contents] == ["new", "new"]

    def test_a_signal_does_not_come_between_the_names(self, tmp_path, monkeypatch):
        """Ctrl-C after the first file has its name: the second gets its name too, and then it is raised."""
        contents = {tmp_path / "a.txt": "new", tmp_path / "b.txt": "new"}
        replace = os.replace

        def interrupted(source, target):
            signal.raise_signal(signal.SIGINT)
            replace(source, target)

        monkeypatch.setattr(os, "replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_files(contents)
        assert [path.read_text() for path in contents] == ["new", "new"]

    @pytest.mark.slow
    @pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no SIGKILL")
    def test_a_killed_process_leaves_old_or_new_files(self, tmp_path):
        """Killed at any moment of writing in a loop, each file is complete."""
        sizes = {"a.txt": 200_000, "b.txt": 300_000}
        for name, size in sizes.items():
            (tmp_path / name).write_text("0" * size)
        code = (
            "import itertools, pathlib; from ancf_casadi.support.files import write_files\n"
            "print(flush=True)\n"
            "for k in itertools.cycle('123'):\n"
            f"    write_files({{pathlib.Path(name): k * size for name, size in {sizes}.items()}})"
        )
        for delay in (0.0, 0.003, 0.011, 0.02):
            with subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE) as process:
                assert process.stdout is not None
                process.stdout.readline()
                time.sleep(delay)
                process.kill()
            for name, size in sizes.items():
                text = (tmp_path / name).read_text()
                assert len(text) == size and len(set(text)) == 1


@pytest.mark.parametrize("text", ["=cmd|'/C calc'!A0", "@SUM(A1)", "+1+cmd|x", "-2+3+cmd", "\tx"])
def test_no_text_of_a_csv_file_is_a_formula(text):
    written = Table("a", "A", (text, "n"), [(text, -1.5), ("-0.25", None)]).csv()
    rows = list(csv.reader(io.StringIO(written)))
    assert rows == [[f"'{text}", "n"], [f"'{text}", "-1.5"], ["-0.25", ""]]
