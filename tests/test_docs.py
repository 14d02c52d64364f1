"""The code of every page of the documentation runs, and the site names every public thing."""

import importlib
import re
import sys
from pathlib import Path

import pytest

import ancf_casadi
import ancf_casadi.export
import problems

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS))
check_links, run_pages = importlib.import_module("check_links"), importlib.import_module("run_pages")
PAGES = sorted(path for path in DOCS.rglob("*.md") if not {"_build", "gallery"} & set(path.relative_to(DOCS).parts))
NEEDS = {  # modules that no test environment must have
    "track_a_video": ("cv2",),
    "phone_video": ("cv2", "mujoco"),
}


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive")
def test_the_code_of_a_page_runs(page, tmp_path, monkeypatch, likeness):
    for module in NEEDS.get(page.stem, ()):
        pytest.importorskip(module)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    run_pages.run_page(page, tmp_path)
    if page.stem == "moving_pictures":
        assert likeness(tmp_path / "swing.gif", DOCS / "swing.gif") > 0.98  # of the README


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
ancf-casadi run \\
    examples/beam.toml modes  # a comment
python swing.py
```

```text
... 1.87613 ...
```
"""


def test_blocks_of_all_kinds_run(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    assert [block.language for block in run_pages.blocks(PAGE)] == ["python", "python", "sh", "text"]
    run_pages.run_page(page, tmp_path)
    assert (tmp_path / "made").exists()


@pytest.mark.parametrize(
    "block",
    [
        "```python\nraise ValueError\n```",
        "```python\nprint(2)\n```\n\n```text\n3\n```\n",
        "```python\n# wrong.py\nif __name__ == '__main__':\n    raise ValueError\n```",
        "```sh\nancf-casadi run missing.toml\n```",
        "```sh\nrm file\n```",
        "```toml\nkey = \n```",
        "```{code-block} python\nraise ValueError\n```",
        "```python\n",
        "```{figure} missing.png\n```",
    ],
)
def test_a_block_that_fails_is_found(block, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(block)
    with pytest.raises((run_pages.PageError, ValueError)):
        run_pages.run_page(page, tmp_path)


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


GOOD = '<a href="other.html#there">x</a><a href="#here" id="here">y</a><a href="https://example.org/">z</a>'


def test_the_link_check_passes_a_good_site(tmp_path):
    (tmp_path / "index.html").write_text(GOOD)
    (tmp_path / "other.html").write_text('<p id="there">')
    assert list(check_links.faults(tmp_path)) == []


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
def test_the_link_check_finds_a_fault(tmp_path, page, fault):
    (tmp_path / "index.html").write_text(page)
    assert list(check_links.faults(tmp_path)) == [f"index.html: {fault}"]


def test_the_link_check_finds_fonts_from_elsewhere(tmp_path):
    (tmp_path / "a.css").write_text("@import url('https://example.org/font.css'); b { background: url(c.png) }")
    assert list(check_links.faults(tmp_path)) == ["a.css: loads https://example.org/font.css"]


def test_the_citation_has_the_version_of_the_package():
    (version,) = re.findall(r'^version: "?([^"\s]+)"?$', (ROOT / "CITATION.cff").read_text(), re.M)
    assert version == ancf_casadi.__version__
