"""One word per idea: all names that a user types or reads consist of the words in ``docs/vocabulary.md``.

A name is divided at its underscores; a plural counts as its singular.
"""

import argparse
import ast
import inspect
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec import inspect as types

import ancf_casadi
import ancf_casadi.export
import problems
from problems.cli import COMMANDS, functions_of
from problems.schema.match import MatchTable
from problems.schema.motion import AXES, COMPONENTS, READING, SETTINGS, ResponseTable
from problems.schema.plan import PlanTable
from problems.schema.records import CHANNEL, FIT, RECORD
from problems.schema.table import FILE_TABLES
from problems.study.part import LawChoice, Study
from problems.study.study import KINDS

ROOT = Path(__file__).parents[1]
PUBLIC = {
    name: getattr(package, name)
    for package in (ancf_casadi, ancf_casadi.export, problems)
    for name in package.__all__
    if not name.startswith("__")
}
ROW = re.compile(r"(?m)^\| (`[^|]+`) \| ([^|]+) \|([^|]*)\|$")
BEAM = ancf_casadi.Beam.uniform(
    length=0.5, width=5e-3, thickness=0.5e-3, density=8e3, elastic_modulus=210e9, elements=2
)
EXEMPT = {  # name and place, and why
    (
        r"count",
        r"(natural_modes|(Reduced)?Model|(Measured|Damped)?Modes|damped_modes)\b.*",
    ): "promised as natural_modes(model, count=5)",
    (r"(harmonic|residual)_count", r".*"): "not a number of modes",
    (r"counts?", r"(Plan|plan_comparison)\b.*"): "how often a record is on a list, and how many places are chosen",
    (r"value_and_gradient", r".*LogDensity.*"): "promised; the two are computed together",
    (r"noise", r".*\.resampled"): "the noise itself, one value per residual",
    (r".*_stderr.*", r".*\.to_dict"): "keys of written results keep their names",
}


def page() -> tuple[dict[str, str], dict[str, str]]:
    """Return the meaning of each word of the vocabulary, and the word to use for each that is none."""
    text = (ROOT / "docs" / "vocabulary.md").read_text(encoding="utf-8")
    words, others = {}, {}
    for names, meaning, instead in ROW.findall(text):
        for word in re.findall(r"\w+", names):
            assert word not in words, f"the page has {word} twice"
            words[word] = meaning
        others.update(dict.fromkeys(re.findall(r"\w+", instead), names))
    return words, others


def parameters(function: object) -> list[str]:
    try:
        found = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return []
    return [one.name for one in found if one.kind not in (one.VAR_POSITIONAL, one.VAR_KEYWORD) and one.name != "self"]


def own_attributes(kind: type) -> Iterator[str]:
    """Yield the public attributes that a class has from the project."""
    for base in kind.__mro__:
        if base.__module__.split(".")[0] in ("ancf_casadi", "problems"):
            yield from (name for name in (*vars(base), *getattr(base, "__annotations__", ())) if name[0] != "_")


def names_in_python() -> Iterator[tuple[str, str]]:
    """Yield each argument, field, attribute and method of what is public, and its place."""
    for place, found in PUBLIC.items():
        if not inspect.isclass(found):
            yield place, "the package"
            yield from ((name, place) for name in parameters(found))
            continue
        if not issubclass(found, Exception):
            yield from ((name, place) for name in parameters(found))
        for name in dict.fromkeys(own_attributes(found)):
            yield name, place
            yield from ((one, f"{place}.{name}") for one in parameters(getattr(found, name, None)))


def names_in_files() -> Iterator[tuple[str, str]]:
    """Yield each table and key of TOML files, and its place."""
    groups = {"tables": FILE_TABLES, "[[records]]": RECORD | CHANNEL, "[fit]": FIT, "[simulation]": SETTINGS}
    for place, names in {**groups, "files": {*READING, *AXES, *COMPONENTS}}.items():
        yield from ((name, place) for name in names)
    declared = {
        "[match]": MatchTable,
        "[plan]": PlanTable,
        "[response]": ResponseTable,
        "[study]": Study,
        "[[laws]]": LawChoice,
    }
    for place, kind in {**declared, **{f"part {kind.kind}": kind for kind in KINDS}}.items():
        yield from ((name, place) for name in keys(types.type_info(kind)))


def keys(kind: types.Type) -> Iterator[str]:
    """Yield the keys of a declared table, and of the tables in it."""
    match kind:
        case types.Metadata():
            yield from keys(kind.type)
        case types.StructType() | types.DataclassType():
            if kind.cls.__module__.startswith("problems."):
                for field in kind.fields:
                    yield field.encode_name
                    yield from keys(field.type)
        case types.VarTupleType():
            yield from keys(kind.item_type)
        case types.UnionType():
            for one in kind.types:
                yield from keys(one)


def names_in_commands() -> Iterator[tuple[str, str]]:
    """Yield each option and argument of the subcommands, and its place."""
    for command in COMMANDS:
        parser = argparse.ArgumentParser()
        parser.set_defaults(title=command)
        functions_of(command)[0](parser)
        for action in parser._actions:
            for option in action.option_strings or [action.dest]:
                if not re.fullmatch("-[a-z]", option):
                    yield option.lstrip("-").replace("-", "_"), command


def names_in_data() -> Iterator[tuple[str, str]]:
    """Yield each key of ``to_dict`` of some results, and its place."""
    model = ancf_casadi.Model(BEAM)
    time = np.arange(0.0, 3.0, 0.02)
    record = ancf_casadi.Measurement(time, np.exp(-0.2 * time) * np.cos(12.0 * time))
    fits = [problems.fit_decay(record), problems.fit_rayleigh([1.9, 12.0, 33.0], [0.01, 0.004, 0.008])]
    computed = [ancf_casadi.static_equilibrium(model), ancf_casadi.natural_modes(model, count=2)]
    for found in (*fits, *computed):
        yield from ((key, f"{type(found).__name__}.to_dict") for key in nested(found.to_dict()))


def nested(data: object) -> Iterator[str]:
    for key, value in data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ():
        if isinstance(key, str):
            yield key
        yield from nested(value)


def singular(word: str) -> str:
    for end, instead in (("ies", "y"), ("xes", "x"), ("s", "")):
        if word.endswith(end) and len(word) > 3 and not word.endswith("ss"):
            return word.removesuffix(end) + instead
    return word


WORDS, INSTEAD = page()
NAMES = {
    "python": names_in_python, "files": names_in_files, "commands": names_in_commands, "data": names_in_data,
}  # fmt: skip


def unknown_words(name: str, place: str) -> Iterator[str]:
    """Yield the words of a name that are not on the page."""
    if any(re.fullmatch(own, name) and re.fullmatch(where, place) for own, where in EXEMPT):
        return
    rest = re.sub("|".join(word for word in WORDS if "_" in word), "", name).strip("_")
    for word in filter(None, rest.split("_")):
        known = WORDS.get(word) or WORDS.get(singular(word))
        if not known or (known.startswith("within a name") and word == name):
            yield word


@pytest.mark.parametrize("kind", NAMES)
def test_every_name_consists_of_words_of_the_vocabulary(kind):
    found = {
        f"{word} in {name} of {place}" + (f": use {INSTEAD[word]}" if word in INSTEAD else "")
        for name, place in NAMES[kind]()
        for word in unknown_words(name, place)
    }
    assert not found


@pytest.mark.parametrize(
    "name",
    ["standard_deviation", "noise", "deviation", "active_bounds", "frequency_stderr", "count", "rate", "from", "to",
     "n_jobs", "uncertainties", "initial_guess", "zeta", "max_iter"],
)  # fmt: skip
def test_another_word_for_the_same_idea_is_found(name):
    assert list(unknown_words(name, "fit_beam"))


def test_every_word_of_the_vocabulary_is_in_use():
    names = {name for kind in NAMES.values() for name, _ in kind()}
    parts = {part for name in names for word in name.split("_") for part in (word, singular(word))}
    assert not {word for word in WORDS if word not in parts and not ("_" in word and any(word in n for n in names))}


def test_a_word_is_not_one_to_avoid():
    assert not WORDS.keys() & INSTEAD.keys() - {"stop", "from", "to", "first"}


@pytest.mark.parametrize("name", [name for name, one in PUBLIC.items() if "jobs" in parameters(one)])
def test_executor_jobs_and_progress_come_in_this_order(name):
    given = parameters(PUBLIC[name])
    own = [one for one in given if one in ("executor", "jobs", "progress")]
    assert own == ["executor", "jobs", "progress"][: len(own)]
    first = given.index("executor")
    assert given[first : first + len(own)] == own


def definitions(body: list[ast.stmt]) -> Iterator[str]:
    """Yield the names of the classes and constants of a module."""
    for statement in body:
        if isinstance(statement, ast.ClassDef):
            yield statement.name
        targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
        for target in targets:
            for one in target.elts if isinstance(target, ast.Tuple) else [target]:
                if isinstance(one, ast.Name) and re.fullmatch("_?[A-Z][A-Z0-9_]+", one.id):
                    yield one.id


def test_the_name_of_a_class_or_a_constant_exists_once():
    files = [path for package in ("ancf_casadi", "problems") for path in (ROOT / package).rglob("*.py")]
    found = Counter(
        name for path in files for name in set(definitions(ast.parse(path.read_text(encoding="utf-8")).body))
    )
    assert not {name: count for name, count in found.items() if count > 1}
