"""What a user has chosen on the page: options of ``fit-decay``, as that command and as a study."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from problems.study.kinds.decays import decay_records
from problems.study.reading import read_study

READING = ("time", "time_unit", "sample_rate")  # options that say how to read the file
CHOOSING = ("column", "unit", "sensor", "begin", "end", "release_time")  # options of one channel and its part
LAWS = ("law", "frequency_law", "rest")
DEFAULTS = {"law": "linear", "rest": None}  # of the step of a study
COMMAND_ONLY = ("sensor", "band", "frequency_law", "robust")  # options that no study has


@dataclass(frozen=True)
class Choices:
    """Options of ``fit-decay`` by their names; None or False where the user has left the default."""

    file: str
    time: str | None = None
    time_unit: str | None = None
    sample_rate: float | None = None
    column: str | None = None
    unit: str | None = None
    sensor: str | None = None
    begin: float | None = None  # s
    end: float | None = None  # s
    release_time: float | None = None  # s
    band: tuple[float, float] | None = None  # Hz
    law: str | None = None
    frequency_law: str | None = None
    rest: str | None = None
    robust: bool = False

    @staticmethod
    def of(file: str) -> Choices:
        """Return the choices for a file of measurements, or those of the first decay of a study, a file ``.toml``."""
        if Path(file).suffix.lower() != ".toml":
            return Choices(file)
        study = read_study(file, ["decays"])
        record, *_ = decay_records(study.file).values()
        keys = {key: value for key, value in record.set_fields().items() if value == value}  # not nan, the default
        chosen = {name: keys[name] for name in (*READING, *CHOOSING) if name in keys}
        laws = {name: getattr(study.steps[0], name) for name in LAWS if hasattr(study.steps[0], name)}
        chosen |= {name: law for name, law in laws.items() if law != DEFAULTS[name]}
        return Choices(**chosen | {"file": str(study.file.beside(record.file))})

    def given(self) -> dict[str, Any]:
        """Return the options that differ from the defaults, by name."""
        options = {field.name: getattr(self, field.name) for field in fields(self)[1:]}
        return {name: value for name, value in options.items() if value not in (None, False)}

    def command(self) -> str:
        """Return the command line that fits the same."""
        words = ["ancf-casadi", "fit-decay", self.file]
        for name, value in self.given().items():
            words.append(f"--{name.replace('_', '-')}")
            if name == "band":
                words.append(",".join(map(str, value)))
            elif value is not True:
                words.append(str(value))
        return shlex.join(words)

    def study(self) -> str:
        """Return the file of a study that fits the same; a comment names the options that only the command has."""
        given = self.given()
        lines = ["[[decays]]", _entry("file", self.file)]
        lines += [_entry(name, given[name]) for name in (*READING, *CHOOSING) if name in given.keys() - {*COMMAND_ONLY}]
        if laws := [_entry(name, given[name]) for name in LAWS if name in given.keys() - {*COMMAND_ONLY}]:
            lines += ["", "[[steps]]", 'kind = "decays"', *laws]
        if missing := [name for name in COMMAND_ONLY if name in given]:
            lines += ["", f"# only the command has: {', '.join(missing)}"]
        return "\n".join([*lines, ""])


def _entry(key: str, value: str | float) -> str:
    """Return a line of TOML, whose texts have the escapes of JSON."""
    return f"{key} = {json.dumps(value, ensure_ascii=False) if isinstance(value, str) else value}"
