"""The JSON Schema of a TOML file holds for every file that is read, and finds the mistakes that the reader finds."""

import re
import tomllib
from pathlib import Path

import jsonschema
import pytest

from problems.command.init import STUDY
from problems.study.study import study_schema

ROOT = Path(__file__).parents[3]
PAGES = [page for folder in ("docs", "README.md") for page in ([ROOT / folder] if folder[-3:] == ".md" else
         sorted((ROOT / folder).rglob("*.md"))) if "_build" not in page.parts]  # fmt: skip
VALIDATOR = jsonschema.Draft202012Validator(study_schema())
BEAM = "[beam]\nlength = 0.5\nwidth = 5e-3\nthickness = 5e-4\ndensity = 8000.0\nelastic_modulus = 2e11\nelements = 4\n"


def mistakes(text: str) -> list[str]:
    return [error.message for error in VALIDATOR.iter_errors(tomllib.loads(text))]


def test_it_is_a_schema():
    jsonschema.Draft202012Validator.check_schema(study_schema())


def test_what_init_writes_and_the_examples_are_valid():
    texts = [STUDY, *(path.read_text() for path in (ROOT / "examples").glob("*.toml"))]
    uncommented = re.sub(r"^# (?=[\[a-z_]+[\]\w ]*(\]|=))", "", STUDY, flags=re.MULTILINE)
    assert len(texts) > 2 and not any(mistakes(text) for text in [*texts, uncommented])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tables_of_the_documentation_are_valid(page):
    for block in re.findall(r"```toml\n(.*?)```", page.read_text(), flags=re.DOTALL):
        assert "[tool." in block or "..." in block or not mistakes(block)


@pytest.mark.parametrize(
    "text",
    [
        "[baem]\n",
        BEAM.replace("width = 5e-3", "width = -5e-3"),
        BEAM.replace("width", "wdth"),
        BEAM + 'supports = [{kind = "glue"}]\n',
        BEAM + '[[damping]]\nlaw = "quadratic"\nzeta = 1\n',
        "[base]\namplitude = 1e-3\n",
        "[simulation]\nsample_rate = 100\n",
        '[simulation]\nduration = 1\nstart = "running"\n',
        '[[records]]\nfile = "a.csv"\ncolum = 2\n',
        "[[records]]\nfile = 3\n",
        "[[frequencies]]\nfrequencies = 3\n",
        "[response]\nfrequencies = [1]\n",
        "[fit]\nlaws = [[]]\n",
        "[plan]\nbudget = 0\n",
        '[[steps]]\nkind = "nothing"\n',
        '[[steps]]\nkind = "modes"\nmode = 3\n',
    ],
)
def test_mistakes_are_found(text):
    assert mistakes(text)
