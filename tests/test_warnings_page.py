"""The page on warnings lists every warning of the code, and no other.

A warning is a sentence that some functions make: those that call ``warnings.warn``, those whose name speaks of warnings
or notes, those that fill a field ``warnings`` or ``notes``, and the functions of the same module that these call for
text.  Numbers and names within a sentence are ``…`` here and on the page.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "how_to" / "warnings.md").read_text()
ENTRIES = re.findall(r"^- `(.+)`$", PAGE, re.M)
SOURCES = sorted(path for folder in ("ancf_casadi", "problems") for path in (ROOT / folder).rglob("*.py"))

FIELDS = {"warnings", "warning", "notes", "note", "noted"}
OUTPUT = set(
    "table _table tables account report to_dict _text _run _show_warning _filled run_track".split()
)  # these print, and make none
ERRORS = ("remove the row", "name another column", "is earlier than", "or nothing oscillates", "subtracted from")
REFUSALS = {"library", "installed"}  # raise exceptions of the texts that they take
LONG = 13  # characters of a sentence that count as text


def templates(nodes):
    """Yield the strings in nodes, with ``…`` in place of values; those of docstrings and exceptions are left out."""
    for node in nodes:
        if isinstance(node, ast.Raise) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            continue
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in REFUSALS:
            continue
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        elif isinstance(node, ast.JoinedStr):
            yield "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
            yield from templates(part.value for part in node.values if isinstance(part, ast.FormattedValue))
        else:
            yield from templates(ast.iter_child_nodes(node))


def words(function):
    """Return the names, attributes and keywords that a function uses."""
    nodes = list(ast.walk(function))
    return (
        {node.id for node in nodes if isinstance(node, ast.Name)}
        | {node.attr for node in nodes if isinstance(node, ast.Attribute)}
        | {node.arg for node in nodes if isinstance(node, ast.keyword)}
    )


def with_notes(tree):
    """Return the classes of a module with a field for warnings."""
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    return {
        one.name
        for one in classes
        for node in one.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id in FIELDS
    }


def makers(path):
    """Return the functions of a module that make warnings; the notes of studies are captions, and no warnings."""
    source = path.read_text()
    if not re.search("warn|note|limitations", source):
        return []
    tree = ast.parse(source)
    functions = {node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    fields = {"warn"} if {"study", "paper"} & {*path.parts} else FIELDS | {"warn"} | with_notes(tree)
    found = {
        name
        for name, node in functions.items()
        if name not in OUTPUT and (fields & words(node) or re.search("warn|note|limitations", name))
    }
    waiting = set(found)
    while waiting:
        called = words(functions[waiting.pop()]) & functions.keys() - found - OUTPUT
        texts = {name for name in called if "str" in ast.unparse(functions[name].returns or ast.Constant(""))}
        found |= texts
        waiting |= texts
    return [functions[name] for name in sorted(found)]


def plain(text):
    return " ".join(text.replace("`", "").split()).lower()


@pytest.fixture(scope="module")
def warnings():
    """Each warning of the code, by its place."""
    return {
        f"{path.relative_to(ROOT)}, {maker.name}: {text}": text
        for path in SOURCES
        for maker in makers(path)
        for text in templates(maker.body)
        if max(map(len, text.split("…"))) > LONG and " " in text.strip() and not any(part in text for part in ERRORS)
    }


def test_the_sources_are_found(warnings):
    assert len(warnings) > 50 and len(ENTRIES) > 40


def test_each_warning_of_the_code_is_on_the_page(warnings):
    page = plain(PAGE)
    longest = {place: plain(max(text.split("…"), key=len)).strip(",; ") for place, text in warnings.items()}
    assert {place for place, part in longest.items() if part not in page} == set()


def test_each_entry_of_the_page_is_a_warning_of_the_code(warnings):
    def known(entry):
        parts = [re.escape(part.strip()) for part in entry.split("…") if part.strip()]
        return any(re.search(".*".join(parts), text, re.S) for text in warnings.values())

    assert [entry for entry in ENTRIES if not known(entry)] == []


def test_each_entry_says_what_to_do():
    for entry, text in zip(ENTRIES, re.split(r"^- `.+`$", PAGE, flags=re.M)[1:], strict=True):
        assert len(text.strip().split("\n\n")[0].split()) > 5, entry
