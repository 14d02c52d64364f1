"""Every code block of every page of the documentation runs, and the site names every public thing.

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

import importlib
import re
import runpy
import shlex
import shutil
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

import ancf_casadi
import ancf_casadi.export
import problems
from problems.cli import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md") if not {"_build", "gallery"} & set(path.relative_to(DOCS).parts))
SLOW = (  # pages that take more than about a second
    "coming_from/matlab.md",
    "export.md",
    "getting_started.md",
    "how_to/accelerometers.md",
    "how_to/choosing_a_law.md",
    "how_to/frequency_response_functions.md",
    "how_to/many_runs.md",
    "how_to/moving_pictures.md",
    "how_to/one_mode.md",
    "how_to/own_optimiser.md",
    "how_to/paths.md",
    "how_to/plan.md",
    "how_to/posterior.md",
    "how_to/response_curves.md",
    "how_to/several_records.md",
    "how_to/steady_vibration.md",
    "how_to/studies.md",
    "how_to/track_a_video.md",
    "how_to/videos.md",
    "how_to/your_set_up.md",
    "tutorials/decay.md",
    "tutorials/decisive_record.md",
    "tutorials/export.md",
    "tutorials/frequencies.md",
    "tutorials/large_motion.md",
    "tutorials/phone_video.md",
)
READ = ("bash", "c", "json", "matlab", "py")
NEEDS = {"track_a_video": ("cv2",), "phone_video": ("cv2", "mujoco")}  # modules that no test environment must have
SET_UP = ("python3 -m venv ", "python -m venv ", "pip install ", ". .venv/bin/activate", ".venv/bin/pip install ")
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
    def file_name(self):
        """The file that its first line names, if any."""
        found = FILE_NAME.fullmatch(self.code.partition("\n")[0])
        return found and found[1]


def blocks(text):
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
    assert fence is None, f"the block in line {start - 1} has no end"


def words(text):
    """Return a text on one line, rules of tables shortened."""
    return " ".join(re.sub("-{3,}", "---", text).split())


def agree(stated, found):
    """Whether two numbers differ by no more than another machine may cause: 1 %, or three of the last decimal."""
    mantissa, _, exponent = stated.partition("e")
    decimals = len(mantissa.partition(".")[2])
    rounding = 3.001 * 10.0 ** (int(exponent or 0) - decimals) if decimals else 0.0
    return abs(float(stated) - float(found)) <= max(0.01 * abs(float(stated)), rounding)


def not_printed(stated, printed):
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


def run_page(path, folder, printed):
    """Run the blocks of a page; ``printed`` returns what has been printed since its last call."""
    names = {"__name__": "__main__"}
    for block in blocks(path.read_text()):
        where = f"{path.name}, line {block.line}"
        if block.language == "text":
            fault = not_printed(block.code, printed())
            assert not fault, f"{where}: {fault}"
            continue
        if block.file_name and block.language in ("python", "toml", "csv"):
            (folder / block.file_name).write_text(block.code)
        if block.language == "python" and block.file_name:
            runpy.run_path(str(folder / block.file_name), run_name="__main__")
        elif block.language == "python":
            exec(compile("\n" * (block.line - 1) + block.code, str(path), "exec"), names)
        elif block.language == "sh":
            for line in block.code.replace("\\\n", " ").splitlines():
                run_line(line.strip(), folder, where)
        elif block.language == "toml":
            tomllib.loads(block.code)
        elif block.language != "csv":
            assert block.language in READ, f"{where}: no rule for blocks in {block.language or 'no language'!r}"


def run_line(line, folder, where):
    """Run a line of a shell."""
    words = shlex.split(line, comments=True)
    if not words or line.startswith(SET_UP):
        return
    if words[0] == "python" and len(words) == 2:
        assert (folder / words[1]).is_file(), f"{where}: no block has written {words[1]}"
        return
    assert words[0] == "ancf-casadi", f"{where}: no rule for {line!r}"
    try:
        code = main(words[1:])
    except SystemExit as ended:  # as --help and wrong options end
        code = ended.code
    assert code == 0, f"{where}: {line!r} ends with exit code {code}"


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(path, id=name, marks=[pytest.mark.slow] if name in SLOW else [])
        for path in PAGES
        for name in [str(path.relative_to(DOCS))]
    ],
)
@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive")
def test_the_code_of_a_page_runs(page, tmp_path, monkeypatch, capsys):
    for module in NEEDS.get(page.stem, ()):
        pytest.importorskip(module)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)  # a script imports its neighbours
    shutil.copytree(ROOT / "examples", "examples")
    try:
        run_page(page, tmp_path, printed=lambda: capsys.readouterr().out)
    finally:
        for script in tmp_path.glob("*.py"):
            sys.modules.pop(script.stem, None)


def test_slow_pages_exist():
    assert all((DOCS / name).is_file() for name in SLOW)


def test_another_output_than_stated_is_seen(tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text("```python\nprint(2)\n```\n\n```text\n3\n```\n")
    with pytest.raises(AssertionError, match=r"page.md, line 6"):
        run_page(page, tmp_path, printed=lambda: capsys.readouterr().out)


PAGE = """
```{toctree}
theory
```

- In a list:

  ```python
  # swing.py
  if __name__ == "__main__":
      open("made", "w").close()
  ```

````python
text = '''
```
'''
````

```sh
python3 -m venv .venv
ancf-casadi modes \\
    examples/beam.toml  # a comment
python swing.py
```
"""


def test_blocks_of_all_kinds_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "examples", "examples")
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    assert [block.language for block in blocks(PAGE)] == ["python", "python", "sh"]
    run_page(page, tmp_path, printed=str)
    assert (tmp_path / "made").exists()
    assert "1.87613" in capsys.readouterr().out


@pytest.mark.parametrize(
    "block",
    [
        "```python\nraise ValueError\n```",
        "```python\n# wrong.py\nif __name__ == '__main__':\n    raise ValueError\n```",
        "```sh\nancf-casadi modes missing.toml\n```",
        "```sh\nancf-casadi modes --no-such-option\n```",
        "```sh\npython missing.py\n```",
        "```sh\nrm file\n```",
        "```toml\nkey = \n```",
        "```\nancf-casadi modes\n```",
        "```{code-block} python\nraise ValueError\n```",
        "```python\n",
    ],
)
def test_a_block_that_fails_is_found(block, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = tmp_path / "page.md"
    page.write_text(block)
    with pytest.raises((AssertionError, ValueError)):
        run_page(page, tmp_path, printed=str)


def test_the_api_reference_holds_every_public_name_once():
    documented = []
    for path in (DOCS / "api").glob("*.rst"):
        module = None
        for directive, name in re.findall(r"^\.\. (currentmodule|data|auto\w+):: (\S+)$", path.read_text(), re.M):
            if directive == "currentmodule":
                module = name
            else:
                documented.append(f"{module}.{name}")
    packages = (ancf_casadi, ancf_casadi.export, problems)
    public = [f"{package.__name__}.{name}" for package in packages for name in package.__all__]
    assert sorted(documented) == sorted(public)


@pytest.fixture
def check(monkeypatch):
    """The faults that the link check of the site finds."""
    monkeypatch.syspath_prepend(str(DOCS))
    return importlib.import_module("check_links").faults


GOOD = '<a href="other.html#there">x</a><a href="#here" id="here">y</a><a href="https://example.org/">z</a>'


def test_the_link_check_passes_a_good_site(check, tmp_path):
    (tmp_path / "index.html").write_text(GOOD)
    (tmp_path / "other.html").write_text('<p id="there">')
    assert list(check(tmp_path)) == []


@pytest.mark.parametrize(
    ("page", "fault"),
    [
        ('<a href="missing.html">', "missing.html does not exist"),
        ('<a href="#nowhere">', "#nowhere has no such anchor"),
        ('<img src="missing.png">', "missing.png does not exist"),
        ('<script src="https://example.org/a.js"></script>', "loads https://example.org/a.js"),
        ('<link rel="stylesheet" href="//example.org/a.css">', "loads //example.org/a.css"),
    ],
)
def test_the_link_check_finds_a_fault(check, tmp_path, page, fault):
    (tmp_path / "index.html").write_text(page)
    assert list(check(tmp_path)) == [f"index.html: {fault}"]


def test_the_link_check_finds_fonts_from_elsewhere(check, tmp_path):
    (tmp_path / "a.css").write_text("@import url('https://example.org/font.css'); b { background: url(c.png) }")
    assert list(check(tmp_path)) == ["a.css: loads https://example.org/font.css"]


def test_the_citation_has_the_version_of_the_package():
    (version,) = re.findall(r'^version: "?([^"\s]+)"?$', (ROOT / "CITATION.cff").read_text(), re.M)
    assert version == ancf_casadi.__version__
