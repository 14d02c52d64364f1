"""Run the code of pages: the tests run all of it, and the build of the site draws the figures by it.

A ``{figure}`` of a page is a file that its code writes.

The blocks of a page run in their order, in one namespace and one folder, in which ``examples`` is at hand:

- ``python`` runs.  If its first line is a comment with a file name, ``# swing.py``, it is written to this file, and
  runs as a script of its own.
- ``toml`` and ``csv`` are written to the file that their first line names, ``# beam.toml``; a block without a name
  is only parsed.
- ``sh``: lines that begin with ``ancf-casadi`` run and succeed.  Lines that set up an environment are left out, and
  ``python NAME.py`` names a file that a block has written and run.
- ``text`` is what the blocks before it print, in other lines if need be, and with ``...`` for what is left out.
- ``bash``, ``c``, ``json``, ``matlab`` and ``py`` (code of other programs) are for reading.
"""

from __future__ import annotations

import contextlib
import io
import re
import runpy
import shlex
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from problems.cli import main

DOCS = Path(__file__).parent
READ = ("bash", "c", "json", "matlab", "py")
SET_UP = ("python3 -m venv ", "python -m venv ", "pip install ", ". .venv/bin/activate", ".venv/bin/pip install ")
FIGURE = re.compile(r"^```\{figure\} (\S+)$", re.MULTILINE)
FENCE = re.compile(r"(?P<indent> *)(?P<fence>`{3,}|~{3,})(?P<language>.*)")
NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
FILE_NAME = re.compile(r"# ([\w-]+\.(?:py|toml|csv))")


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its lines, and its first line in the page."""

    language: str
    code: str
    line: int

    @property
    def file_name(self) -> str | None:
        """The file that its first line names, if any."""
        found = FILE_NAME.fullmatch(self.code.partition("\n")[0])
        return found and found[1]


class PageError(Exception):
    """A page whose code does not do what the page says."""


def run_page(path: Path, folder: Path, *, to_last_figure: bool = False) -> None:
    """Run the blocks of a page in an empty folder; errors are those of its code, or a PageError."""
    text = path.read_text()
    figures = [folder / name for name in FIGURE.findall(text)]
    shutil.copytree(DOCS.parent / "examples", folder / "examples")
    names = {"__name__": "__main__"}
    sys.path.insert(0, str(folder))  # a script imports its neighbours
    try:
        with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()) as output:
            for block in blocks(text):
                if to_last_figure and all(figure.is_file() for figure in figures):
                    break
                where = f"{path.name}, line {block.line}"
                if block.language == "text":
                    fault = not_printed(block.code, output.getvalue())
                    if fault:
                        raise PageError(f"{where}: {fault}")
                    output.seek(0)
                    output.truncate()
                else:
                    run_block(block, names, path, where)
    finally:
        sys.path.remove(str(folder))
        for script in folder.glob("*.py"):
            sys.modules.pop(script.stem, None)
    for figure in figures:
        if not figure.is_file():
            raise PageError(f"{path.name}: no block draws {figure.name}")


def draw_figures(path: Path) -> None:
    """Draw the figures of a page by its code, in a temporary folder, and move them beside the page."""
    with tempfile.TemporaryDirectory() as folder:
        run_page(path, Path(folder), to_last_figure=True)
        for name in FIGURE.findall(path.read_text()):
            shutil.move(Path(folder) / name, path.with_name(name))


def blocks(text: str) -> Iterator[Block]:
    """Yield the fenced blocks of a page, without directives such as ``{toctree}``."""
    fence = None
    for number, line in enumerate(text.splitlines(), start=1):
        found = FENCE.fullmatch(line)
        if fence is None:
            if found:
                fence, language, lines, start = found, found["language"].strip(), [], number + 1
        elif found and found["fence"].startswith(fence["fence"]) and not found["language"].strip():
            if not language.startswith("{") or language.startswith("{code"):
                yield Block(language, "\n".join(lines) + "\n", start)
            fence = None
        else:
            lines.append(line.removeprefix(fence["indent"]))
    if fence is not None:
        raise PageError(f"the block in line {start - 1} has no end")


def run_block(block: Block, names: dict[str, object], path: Path, where: str) -> None:
    """Run a block in the current folder and a namespace."""
    if block.file_name and block.language in ("python", "toml", "csv"):
        Path(block.file_name).write_text(block.code)
    if block.language == "python" and block.file_name:
        runpy.run_path(str(Path(block.file_name).resolve()), run_name="__main__")
    elif block.language == "python":
        exec(compile("\n" * (block.line - 1) + block.code, str(path), "exec"), names)
    elif block.language == "sh":
        for line in block.code.replace("\\\n", " ").splitlines():
            run_line(line.strip(), where)
    elif block.language == "toml":
        tomllib.loads(block.code)
    elif block.language not in ("csv", *READ):
        raise PageError(f"{where}: no rule for blocks in {block.language or 'no language'!r}")


def run_line(line: str, where: str) -> None:
    """Run a line of a shell."""
    parts = shlex.split(line, comments=True)
    if not parts or line.startswith(SET_UP):
        return
    if parts[0] == "python" and len(parts) == 2:
        if not Path(parts[1]).is_file():
            raise PageError(f"{where}: no block has written {parts[1]}")
        return
    if parts[0] != "ancf-casadi":
        raise PageError(f"{where}: no rule for {line!r}")
    try:
        code: object = main(parts[1:])
    except SystemExit as ended:  # as --help and wrong options end
        code = ended.code
    if code != 0:
        raise PageError(f"{where}: {line!r} ends with exit code {code}")


def not_printed(stated: str, printed: str) -> str:
    """Return the first piece of a text, between ``...``, that was not printed, or an empty text."""
    rest = words(printed)
    for piece in map(words, stated.split("...")):
        numbers = re.findall(NUMBER, piece)
        pattern = f"({NUMBER})".join(map(re.escape, re.split(NUMBER, piece)))
        for found in re.finditer(pattern, rest):
            if all(map(agree, numbers, found.groups())):
                rest = rest[found.end() :]
                break
        else:
            return f"{piece!r} was not printed, but {rest!r}"
    return ""


def words(text: str) -> str:
    """Return a text on one line, rules of tables shortened, without numbers of iterations, which machines change."""
    return re.sub(r"\d+ iterations", "iterations", " ".join(re.sub("-{3,}", "---", text).split()))


def agree(stated: str, found: str) -> bool:
    """Return True if two numbers differ by no more than two machines do: 1 %, or three of the last decimal."""
    mantissa, _, exponent = stated.partition("e")
    decimals = len(mantissa.partition(".")[2])
    rounding = 3.001 * 10.0 ** (int(exponent or 0) - decimals) if decimals else 0.0
    return abs(float(stated) - float(found)) <= max(0.01 * abs(float(stated)), rounding)
