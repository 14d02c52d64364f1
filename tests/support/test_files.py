"""Reading of files: regular files only, up to a size, and TOML in a time that grows as the file does."""

import os
import signal
import time

import pytest

from ancf_casadi import read_recording
from ancf_casadi.exceptions import InputError
from ancf_casadi.export import DataFile, load_functions, read_document
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.support.files import check_file, check_folder, open_file, read_json, read_toml

READERS = (read_recording, Beam.from_toml, read_document, load_functions, DataFile.of)


@pytest.fixture
def alarmed():
    """Raise an exception if a test waits for more than 5 s."""

    def late(*_):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(5)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("read", READERS)
def test_a_pipe_or_a_device_is_refused_at_once(alarmed, tmp_path, read):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(InputError, match="is a device or a pipe; name a file"):
            read(path)
    (tmp_path / "link").symlink_to("/dev/zero")
    with pytest.raises(InputError, match="link: is a device or a pipe; name a file"):
        read(tmp_path / "link")


@pytest.mark.parametrize("read", READERS)
def test_a_file_without_a_size_is_not_read(alarmed, tmp_path, read):
    """The system shows endless sources, such as /proc/kmsg, as regular files of size 0."""
    (tmp_path / "empty").touch()
    with pytest.raises(InputError, match="empty: is empty"):
        read(tmp_path / "empty")


@pytest.mark.parametrize("use", [read_toml, read_recording, check_file, check_folder])
@pytest.mark.parametrize("path", [3, None, b"a.csv", "a\0.csv", ["a.csv"]])
def test_a_path_is_a_text(use, path):
    with pytest.raises(InputError, match=r"(path|folder): "):
        use(path)


def test_a_link_to_a_file_is_read(tmp_path):
    (tmp_path / "file").write_text("content")
    (tmp_path / "link").symlink_to("file")
    with open_file(tmp_path / "link", limit=7) as file:
        assert file.read() == b"content"


def test_a_key_of_many_parts_is_refused_in_a_time_that_grows_as_the_file(tmp_path):
    path = tmp_path / "a.toml"
    begin = time.process_time()
    for key in ("a." * 80_000 + "a", '"a"."\\"".' * 20_000 + "a", "a . 'b.c' ." * 20_000 + "a"):
        path.write_text(f"{key} = 1\n")
        with pytest.raises(InputError, match="has a key of more than 50 parts"):
            read_toml(path)
        path.write_text(f"[{key}]\n")
        with pytest.raises(InputError, match="has a key of more than 50 parts"):
            read_toml(path)
    assert time.process_time() - begin < 1.0


def test_many_points_that_are_no_key_are_read(tmp_path):
    numbers = [0.5] * 200
    (tmp_path / "a.toml").write_text(
        f'# {"." * 100}\na.b.c.d = {numbers}\ntext = "{"A sentence. " * 100}{"." * 100}"\n'
    )
    assert read_toml(tmp_path / "a.toml")["a"]["b"]["c"]["d"] == numbers


@pytest.mark.parametrize(("read", "text"), [(read_toml, "a = 1"), (read_json, '{"a": 1}')])
def test_a_byte_order_mark_is_no_content(tmp_path, read, text):
    path = tmp_path / "marked"
    path.write_text("\ufeff" + text, encoding="utf-8")
    assert read(path) == {"a": 1}
