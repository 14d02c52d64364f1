"""Formulas in the documentation are typeset between dollar signs, and each can be shown as MathML."""

import importlib
import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import ancf_casadi.export
import problems

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(  # api and gallery come from docstrings
    path for path in DOCS.rglob("*.md") if not {"_build", "api", "gallery"} & set(path.relative_to(DOCS).parts)
)
CODE = re.compile(
    r"^( *)(?P<fence>`{3,}|~{3,}).*?^ *(?P=fence)`*$|(?P<ticks>`+)(?!`).+?(?<!`)(?P=ticks)(?!`)", re.S | re.M
)
FORMULA = re.compile(r"\$\$(?P<display>.+?)\$\$|\$(?P<inline>[^$\n]+)\$", re.S)


def without_code(page: Path) -> str:
    """Return a page without its code, with as many lines."""
    return CODE.sub(lambda found: "\n" * found[0].count("\n"), page.read_text())


def formulas(page: Path) -> Iterator[tuple[str, bool]]:
    """Yield the formulas of a page, and whether they are displayed."""
    for found in FORMULA.finditer(without_code(page)):
        yield found["display"] or found["inline"], found["display"] is not None


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_github_typesets_the_formulas_too(page):
    """It drops a backslash before punctuation, forbids one macro, and takes a dollar beside a word for money."""
    text = without_code(page)
    for found in FORMULA.finditer(text):
        assert not re.search(r"\\[^a-zA-Z]|\\operatorname|<\w|\]\(", found[0])
        assert not re.search(r"[\w/-]$", text[: found.start()][-1:])
        assert not re.match(r"\w", text[found.end() :])
        assert found["display"] or found["inline"] == found["inline"].strip()


@pytest.fixture
def mathml(monkeypatch):
    """The extension of the site, with the library that converts formulas."""
    pytest.importorskip("math_core")
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(DOCS)
    yield importlib.import_module("mathml")
    sys.modules.pop("mathml")


def test_every_formula_is_shown(mathml):
    count = 0
    for page in PAGES:
        numbers = []
        for latex, display in formulas(page):
            formula, number = mathml.numbered(latex) if display else (latex, "")
            assert mathml.mathml(formula, display=display).startswith("<math")
            numbers += [number] if number else []
            count += 1
        assert len(numbers) == len(set(numbers))  # each number is an anchor
    assert count > 400


def test_a_formula_that_cannot_be_shown_is_refused(mathml):
    with pytest.raises(mathml.LatexError):
        mathml.mathml(r"\nosuch x", display=False)


def test_elements_without_line_breaks_change_no_text(mathml):
    """Several texts of the paragraph are equal."""
    nodes = mathml.nodes
    texts = ["a (", ", ", ", ", "\n", ", 2.5e-6, ", ", ", ", 2.5e-6, ", "."]
    paragraph = nodes.paragraph()
    for k, text in enumerate(texts):
        paragraph += [nodes.Text(text), nodes.math("", f"x_{k}")]
    document = nodes.section("", paragraph)
    before = document.astext()
    mathml.keep_numbers_whole(document)
    mathml.keep_punctuation(document)
    assert document.astext() == before
    whole = [node.astext() for node in document.findall(nodes.inline)]
    assert {"(x_0,", "2.5e-6", "x_6."} <= set(whole)


def public_docstrings() -> Iterator[tuple[str, str]]:
    """Yield name and docstring of every public object and its members, without examples."""
    for module in (ancf_casadi, ancf_casadi.export, problems):
        for name in module.__all__:
            item = getattr(module, name)
            members = [key for key in (vars(item) if inspect.isclass(item) else ()) if not key.startswith("_")]
            for key, member in [(name, item), *((f"{name}.{key}", getattr(item, key, None)) for key in members)]:
                if not isinstance(member, int | float | str | tuple):
                    yield key, re.split(r"\nExamples\n", inspect.getdoc(member) or "")[0]


def test_each_formula_that_the_site_replaces_stands_in_a_docstring(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    formulas = importlib.import_module("docstring_formulas")
    texts = dict(public_docstrings())
    together = " ".join(" ".join(texts.values()).split())
    assert [plain for plain in formulas.FORMULAS if plain not in together] == []


def test_formulas_of_docstrings_can_be_shown(mathml):
    formulas = importlib.import_module("docstring_formulas")
    assert all(mathml.mathml(latex, display=False).startswith("<math") for latex in formulas.FORMULAS.values())
