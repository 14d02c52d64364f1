"""Options of ``fit-decay`` that the user has chosen on the page; the command line and the study with the same fit."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

DECAY_KEYS = ("time", "time_unit", "sample_rate", "column", "unit", "begin", "end", "release_time")  # of [[decays]]
STEP_DEFAULTS = {"law": "linear", "rest": None}  # keys of the step of a study, with their defaults


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
        from problems.study.kinds.decays import decay_records  # these two are slow to import
        from problems.study.reading import read_study

        study = read_study(file, ["decays"])
        record, *_ = decay_records(study.file).values()
        keys = {key: value for key, value in record.set_fields().items() if value == value}  # not nan, the default
        chosen = {name: keys[name] for name in DECAY_KEYS if name in keys}
        laws = {name: getattr(study.steps[0], name) for name in STEP_DEFAULTS}
        chosen |= {name: law for name, law in laws.items() if law != STEP_DEFAULTS[name]}
        return Choices(str(study.file.beside(record.file)), **chosen)

    def options(self) -> dict[str, Any]:
        """Return the options that differ from the defaults, by name."""
        options = {field.name: getattr(self, field.name) for field in fields(self)[1:]}
        return {name: value for name, value in options.items() if value is not None and value is not False}

    def command(self) -> str:
        """Return the command line that fits the same."""
        words = ["ancf-casadi", "fit-decay", self.file]
        for name, value in self.options().items():
            words.append(f"--{name.replace('_', '-')}")
            if name == "band":
                words.append(",".join(map(str, value)))
            elif value is not True:
                words.append(str(value))
        return shlex.join(words)

    def study(self) -> str:
        """Return the file of a study that fits the same; a comment names the options that only the command has."""
        options = self.options()
        lines = ["[[decays]]", _entry("file", self.file)]
        lines += [_entry(name, options.pop(name)) for name in DECAY_KEYS if name in options]
        if laws := [_entry(name, options.pop(name)) for name in STEP_DEFAULTS if name in options]:
            lines += ["", "[[steps]]", 'kind = "decays"', *laws]
        if options:
            lines += ["", f"# only the command has: {', '.join(options)}"]
        return "\n".join([*lines, ""])


def _entry(key: str, value: str | float) -> str:
    """Return a line of TOML, whose texts have the escapes of JSON."""
    return f"{key} = {json.dumps(value, ensure_ascii=False) if isinstance(value, str) else value}"
