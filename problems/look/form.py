"""A form for the tables of a beam, its damping, its motion and its fit, made from their declarations.

Each key has a field with its unit, range and default; a list of supports, of laws and the like has a box for each, with
the keys of its kind.  A change of a field changes the value at its place in the study.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from msgspec import inspect as types
from nicegui import ui

from ancf_casadi.damping.spec import LawSpec
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.spec import BeamSpec
from ancf_casadi.support.specs import alternatives, listed_fields, value_place
from problems.spec.beam import DocumentName
from problems.spec.editing import EditedStudy, Place, parse_value, toml_value, value_at
from problems.spec.motion import BASE_KINDS, LOAD_KINDS, Kinds, ReleaseSpec, SimulationSpec, table_kind
from problems.spec.records import FitSpec

Change = Callable[[EditedStudy], EditedStudy]
TABLES: Mapping[str, Kinds] = {
    "beam": {"": (BeamSpec,), "document": (DocumentName,)},
    "base": BASE_KINDS, "load": LOAD_KINDS, "release": {"": (ReleaseSpec,)}, "simulation": {"": (SimulationSpec,)},
    "fit": {"": (FitSpec,)},
}  # fmt: skip
TAG_FIELDS = ("kind", "law")  # of supports, attachments and sections, and of damping laws
LIMITS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
ENDLESS = 1e30  # a limit that no value reaches


class Form:
    """Fields for the keys of these tables; ``choose`` gets the change of the study that the user wants."""

    def __init__(self, study: EditedStudy, choose: Callable[[Change], None]) -> None:
        self._study, self._choose = study, choose
        self._fields: dict[Place, Any] = {}
        self._unread: set[Place] = set()  # fields with texts that are no values
        self._defaults: dict[Place, Any] = {}  # of lists of boxes
        self._boxes: dict[Place, list[Any]] = {}  # what each table and each list of boxes was built for
        self._last: Place = ()  # that was changed
        self._column = ui.column().classes("w-full gap-1")
        self._build()

    def show(self, study: EditedStudy) -> None:
        """Show the values of a study."""
        self._study = study
        if any(self._kinds(place) != kinds for place, kinds in self._boxes.items()):
            self._build()
        for place in self._fields.keys() - self._unread:
            self._fields[place].value = self._shown(place, self._fields[place])

    def show_error(self, message: str) -> bool:
        """Show a message beside the field that it names, and take the others away; return whether there is one."""
        lengths = {place: len(where) for place in self._fields if message.startswith(where := self._where(place))}
        places = [place for place, length in lengths.items() if length == max(lengths.values())]
        named = self._last if self._last in places else next(iter(places), None)
        for place in self._fields.keys() - self._unread:
            self._fields[place].error = message if place == named else None
        return named is not None

    def _where(self, place: Place) -> str:
        """Return the place of a value as the beginning of messages, which do not number the laws."""
        table, *steps = place
        return value_place(self._study.file.where(str(table)), steps[isinstance(steps[0], int) :]) + ":"

    def _value(self, place: Place) -> Any:
        """Return the value at a place, also within a list that the study leaves at its default."""
        for end in range(1, len(place) + 1):
            if place[:end] in self._defaults and self._study.value(place[:end]) is None:
                return value_at(self._defaults[place[:end]], place[end:])
        return self._study.value(place)

    def _kinds(self, place: Place) -> list[Any]:
        """Return the declarations of a table, or the kinds of the boxes of a list."""
        items = self._value(place)
        if len(place) == 1 and (kinds := TABLES.get(str(place[0]))):
            return [*table_kind(kinds, items)]
        return [_tag(item) for item in items] if isinstance(items, list) else []

    def _set(self, place: Place, value: Any) -> None:
        """Change a value; within a list that the study leaves at its default, state that list first."""
        self._last, key = place, place[: 3 if isinstance(place[1], int) else 2]

        def change(study: EditedStudy) -> EditedStudy:
            if key != place and study.value(key) is None:
                study = study.with_value(key, self._value(key))
            return study.with_value(place, value)

        self._choose(change)

    def _build(self) -> None:
        for places in (self._fields, self._unread, self._defaults, self._boxes):
            places.clear()
        self._column.clear()
        with self._column:
            for name in TABLES:
                place = (name,)
                self._boxes[place] = self._kinds(place)
                with ui.expansion(f"[{name}]", value=name == "beam").classes("w-full").props("dense"):
                    self._build_table(place, *self._boxes[place])
            ui.label("[[damping]]")
            self._build_boxes(("damping",), _tagged(types.multi_type_info([LawSpec])[0]), [])

    def _build_table(self, place: Place, *declared: type) -> None:
        for field in (field for kind in declared for field in listed_fields(kind)):
            key: Place = (*place, field.encode_name)
            kinds = [kind for kind in alternatives(field.type) if not isinstance(kind, types.NoneType)]
            boxes = _tagged(kinds[0].item_type) if isinstance(kinds[0], types.VarTupleType) else {}
            if boxes:
                default = () if field.required else field.default
                self._build_boxes(key, boxes, msgspec.to_builtins(default))
            else:
                self._build_field(key, field, kinds)

    def _build_boxes(self, place: Place, kinds: Mapping[str, types.StructType], default: Any) -> None:
        """Build a box for each item of a list, with a field for its kind, and a field that adds one."""
        self._defaults[place] = parse_value(toml_value(default))
        self._boxes[place] = present = self._kinds(place)
        names, tag_field = [*kinds], str(next(iter(kinds.values())).tag_field)
        name = str(place[-1]).replace("_", " ")

        def set_kind(number: int) -> Callable[[Any], None]:
            return lambda event: self._set((*place, number), event.value and {tag_field: event.value})

        for number, tag in enumerate(present):
            with ui.column().classes("w-full gap-1 border-l-4 border-gray-400 pl-2"):
                value = tag if tag in names else None
                box = ui.select(names, label=f"{name} {number + 1}", value=value, on_change=set_kind(number))
                box.props("dense clearable").classes("w-full").mark(_mark((*place, number)))
                if tag in names:
                    self._build_table((*place, number), kinds[tag].cls)
        adding = ui.select(names, label=f"add to {name}", on_change=set_kind(len(present)))
        adding.props("dense").classes("w-full").mark(f"add-{_mark(place)}")

    def _build_field(self, place: Place, field: types.Field, kinds: list[types.Type]) -> None:
        """Build the field of a key; its first kind decides how it is shown."""

        def store() -> None:
            self._unread.discard(place)
            widget.error, value = None, None if widget.value == "" else widget.value
            if not isinstance(kinds[0], types.StrType | types.LiteralType | types.BoolType):
                try:
                    value = parse_value(value or "")
                except InputError as error:
                    self._unread.add(place)
                    widget.error = str(error)
                    return
            if value != self._value(place):
                self._set(place, value)

        label, choices = field.encode_name.replace("_", " "), _choices(kinds)
        widget: Any = ui.select(choices, label=label, on_change=store, clearable=True) if choices else ui.input(label)
        widget.value = self._shown(place, widget)
        widget.on("change", store)
        widget.props["hint"] = _hint(field, kinds[0])
        self._fields[place] = widget.props("dense hide-bottom-space").classes("w-full").mark(_mark(place))

    def _shown(self, place: Place, field: Any) -> Any:
        """Return a value as its field shows it: a text, or a choice."""
        value = self._value(place)
        if isinstance(field, ui.select):
            return value if value in field.options else None
        return value if isinstance(value, str) else "" if value is None else toml_value(value)


def _tag(item: Any) -> Any:
    """Return the kind of a table that names it."""
    return next((item[name] for name in TAG_FIELDS if name in item), None) if isinstance(item, dict) else None


def _tagged(declared: types.Type) -> dict[str, types.StructType]:
    """Return the kinds of tables that a type may be, by the name that each has in its table; none if it has others."""
    kinds = alternatives(declared)
    tagged = {str(kind.tag): kind for kind in kinds if isinstance(kind, types.StructType) and kind.tag}
    return tagged if len(tagged) == len(kinds) else {}


def _choices(kinds: list[types.Type]) -> list[Any]:
    """Return the values among which a field chooses; none for other fields."""
    if isinstance(kinds[0], types.BoolType):
        return [True, False]
    return list(kinds[0].values) if isinstance(kinds[0], types.LiteralType) else []


def _hint(field: types.Field, kind: types.Type) -> str:
    """Return description, range and default of a key."""
    schema = field.type.extra_json_schema if isinstance(field.type, types.Metadata) else None
    words = [(schema or {}).get("description", "")]
    limits = {word: getattr(kind, name, None) for name, word in LIMITS.items()}
    words += [f"{word} {limit:g}" for word, limit in limits.items() if limit is not None and limit < ENDLESS]
    if field.default not in (msgspec.NODEFAULT, None, ()):
        words.append(f"default {toml_value(msgspec.to_builtins(field.default))}")
    return "; ".join(filter(None, words))


def _mark(place: Place) -> str:
    return ".".join(map(str, place))
