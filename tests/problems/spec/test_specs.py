"""A declared class reads tables with its types and ranges, names the key of each mistake, and lists its keys."""

from typing import Annotated, Any, Literal

import pytest
from msgspec import Meta

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.specs import Positive, Spec, convert
from problems.spec.help import keys_help
from problems.spec.schema import object_schema


class Mark(Spec, frozen=True):
    """Mark."""

    place: Annotated[float, Meta(ge=0.0, lt=1.0)]
    name: str = ""


class Record(Spec, frozen=True, rename={"begin": "from"}):
    """Record."""

    rate: Annotated[Positive, Meta(description="1/s")]
    begin: float = 0.0
    marks: Annotated[tuple[Mark, ...], Meta(min_length=1)] = ()
    levels: Positive | tuple[Positive, ...] = ()
    bounds: tuple[float, Annotated[float, Meta(le=9.0)]] = (0.0, 1.0)
    count: Annotated[int, Meta(ge=1, le=5)] = 1
    side: Literal["left", "right"] = "left"
    quiet: bool = False
    labels: tuple[str, ...] = ()
    column: Any = None


def test_values_take_their_types_and_the_rest_the_defaults():
    found = convert(
        {"rate": 2, "from": -1, "marks": [{"place": 0}], "levels": 3, "labels": ["a"], "column": 4}, Record, "x"
    )
    assert found == Record(2.0, -1.0, (Mark(0.0),), 3.0, labels=("a",), column=4)
    assert isinstance(found.rate, float)
    assert convert({"rate": 1.0, "levels": [1, 2], "bounds": [0, 9]}, Record, "x").levels == (1.0, 2.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (3, "x: must be a table, got 3"),
        ({}, "x: the key 'rate' is missing"),
        ({"ratte": 1.0}, "x: unknown key 'ratte'; known are bounds"),
        ({"rate": 1.0, "speed": 1.0}, "x: unknown key 'speed'; known are bounds, column, count, from, labels"),
        ({"rate": 0.0}, "x: rate: must be positive, got 0"),
        ({"rate": float("nan")}, "x: rate: must be a finite number, got nan"),
        ({"rate": 1e300}, "x: rate: must be above 0 and at most 1e+30, got 1e+300"),
        ({"rate": 1.0, "marks": []}, "x: marks: must be a list of 1 or more, got []"),
        ({"rate": 1.0, "marks": [{"place": 0.5}, {"at": 1}]}, "x: marks: 2: unknown key 'at'; known are name, place"),
        ({"rate": 1.0, "marks": [{"place": -0.5}]}, "x: marks: 1: place: must not be negative"),
        ({"rate": 1.0, "marks": [{"place": 1}]}, "x: marks: 1: place: must be at least 0 and below 1, got 1"),
        ({"rate": 1.0, "levels": ["a"]}, "x: levels: 1: must be a number, got 'a'"),
        ({"rate": 1.0, "bounds": [1]}, "x: bounds: must be a pair of numbers (x, y), got [1]"),
        ({"rate": 1.0, "bounds": [1, 10]}, "x: bounds: 2: must be at most 9, got 10"),
        ({"rate": 1.0, "count": 6}, "x: count: must be a whole number, 1 to 5, got 6"),
        ({"rate": 1.0, "side": "up"}, "x: side: must be one of left, right, got 'up'"),
        ({"rate": 1.0, "quiet": 1}, "x: quiet: must be true or false, got 1"),
        ({"rate": 1.0, "labels": "a"}, "x: labels: must be a list, got 'a'"),
        ({"rate": 1.0, "labels": [1]}, "x: labels: 1: must be a text, got 1"),
    ],
)
def test_a_mistake_names_its_key(given, message):
    with pytest.raises(InputError) as raised:
        convert(given, Record, "x")
    assert str(raised.value).startswith(message)


def test_the_help_lists_keys_with_units_and_choices():
    definitions: dict[str, Any] = {}
    table = object_schema((Record,), definitions)
    text = keys_help({"properties": {"record": table, "copy": table}, "$defs": definitions})
    assert all(len(line) <= 80 for line in text.splitlines())
    _, head, *lines = text.splitlines()
    text = " ".join(" ".join(lines).split())
    assert head == "  [record]" and "rate (1/s), from, marks" in text
    assert 'side ("left" or "right"), quiet (true or false)' in text
    assert text.endswith("[[record.marks]] Mark: place, name")


def test_the_key_of_a_table_with_free_names_is_told():
    kind = dict[str, tuple[Annotated[float, Meta(gt=0.0)], ...]]
    for source, where in (({"a": [1.0], "b": [2.0, -1.0]}, "here: b: 2"), ({"c": {"a": 3}}, "here: c: a")):
        with pytest.raises(InputError, match=f"^{where}: must be"):
            convert(source, kind if "a" in source else dict[str, dict[str, str]], "here")


class Priors(Spec, frozen=True):
    """A table whose names are free."""

    deviations: dict[str, Positive]
    starts: Annotated[int, Meta(ge=1)] = 1


@pytest.mark.parametrize("starts", [1, 0])
def test_the_refused_one_of_several_free_names_is_named_whatever_else_is_wrong(starts):
    table = {"deviations": {"width": 1.0, "thickness": -2.0, "density": 3.0}, "starts": starts}
    with pytest.raises(InputError, match=r"^x: deviations: thickness: must be positive, got -2"):
        convert(table, Priors, "x")
