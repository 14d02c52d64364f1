"""Options of ``fit-decay`` that the user has chosen on the page; the command line and the study with the same fit.

Each file of several is a take of the same mode: a record with options of its own, and the laws of all.
"""

from __future__ import annotations

import mimetypes
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from ancf_casadi.support.files import read_toml

STUDY_NAME = "study.toml"
DIGITS = 6  # of a time or a frequency that is chosen in a chart
PART_KEYS = ("begin", "end", "release_time")  # of each take
DECAY_KEYS = ("file", "time", "time_unit", "sample_rate", "column", "unit", *PART_KEYS)  # of [[decays]]
STEP_DEFAULTS = {"law": "linear", "rest": None}  # keys of the step of a study, with their defaults


@dataclass(frozen=True)
class CommandOptions:
    """Options of a command by their names, after the files; None or False where the user has left the default."""

    def options(self) -> dict[str, Any]:
        """Return the options that differ from the defaults, by name."""
        options = {field.name: getattr(self, field.name) for field in fields(self)[1:]}
        return {name: value for name, value in options.items() if value is not None and value is not False}


def option_words(options: Mapping[str, Any]) -> list[str]:
    """Return options by their names as words of a command line."""
    words = []
    for name, value in options.items():
        text = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
        words += [f"--{name.replace('_', '-')}", *([] if value is True else [text])]
    return words


@dataclass(frozen=True)
class Choices(CommandOptions):
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


Takes = tuple[Choices, ...]


def has_beam(files: Sequence[str]) -> bool:
    """Return whether files are one study with a beam."""
    return len(files) == 1 and Path(files[0]).suffix.lower() == ".toml" and "beam" in read_toml(files[0])


def is_film(files: Sequence[str]) -> bool:
    """Return whether files are one film, by its name."""
    return len(files) == 1 and (mimetypes.guess_type(files[0])[0] or "").startswith("video/")


def read_takes(files: Sequence[str]) -> Takes:
    """Return the choices for files of measurements, or for the decays of a study, a file ``.toml`` among them."""
    study_path = next((file for file in files if Path(file).suffix.lower() == ".toml"), None)
    if study_path is None:
        return tuple(map(Choices, files))
    from problems.study.kinds.decays import decay_records  # these two are slow to import
    from problems.study.reading import read_study

    study = read_study(study_path, ["decays"])
    laws = {name: getattr(study.steps[0], name) for name in STEP_DEFAULTS}
    laws = {name: law for name, law in laws.items() if law != STEP_DEFAULTS[name]}
    takes = []
    for record in decay_records(study.file).values():
        keys = {key: value for key, value in record.set_fields().items() if value == value}  # not nan, the default
        options = {name: keys[name] for name in DECAY_KEYS[1:] if name in keys}
        takes.append(Choices(str(study.file.beside(record.file)), **options, **laws))
    return tuple(takes)


def change_takes(takes: Takes, shown: int, **changes: Any) -> Takes:
    """Return takes with changes of the one that is shown, and of those that had the same before; a part is its own."""
    before = takes[shown]

    def changed(take: Choices) -> Choices:
        names = [name for name in changes if name not in PART_KEYS and getattr(take, name) == getattr(before, name)]
        return replace(take, **{name: changes[name] for name in names})

    return tuple(replace(take, **changes) if k == shown else changed(take) for k, take in enumerate(takes))


def band_text(band: tuple[float, float] | None) -> str:
    """Return a band of frequencies, Hz, in words."""
    return "band: " + ("{:g} to {:g} Hz".format(*band) if band else "all frequencies")


def beside(file: str, folder: Path) -> str:
    """Return the name of a file as from a folder, if it is there."""
    path = Path(file)
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else file


def command(takes: Takes) -> str:
    """Return the command line that fits the same; takes with options that no command has for each are a study."""
    if not _has_command(takes):
        return f"ancf-casadi run {STUDY_NAME}"
    options = takes[0].options()
    if "release_time" in options:
        options["release_time"] = tuple(take.release_time for take in takes)
    return shlex.join(["ancf-casadi", "fit-decay", *(take.file for take in takes), *option_words(options)])


def _has_command(takes: Takes) -> bool:
    """Return whether ``fit-decay`` has the options: for several files the same, or a release time of each; no auto."""
    if len(takes) == 1:
        return True
    shared = {replace(take, file="", release_time=None) for take in takes}
    are_known = {take.release_time is not None for take in takes}
    return len(shared) == len(are_known) == 1 and "auto" not in takes[0].options().values()


def study(takes: Takes) -> str:
    """Return the file of a study that fits the same; a comment names the options that only the command has."""
    import tomlkit  # slow to import

    options = [{"file": take.file} | take.options() for take in takes]
    tables: dict[str, Any] = {"decays": [{name: take[name] for name in DECAY_KEYS if name in take} for take in options]}
    if laws := {name: options[0][name] for name in STEP_DEFAULTS if name in options[0]}:
        tables["steps"] = [{"kind": "decays"} | laws]
    names = dict.fromkeys(name for take in options for name in take)
    missing = [name for name in names if name not in (*DECAY_KEYS, *STEP_DEFAULTS)]
    return tomlkit.dumps(tables) + (f"\n# only the command has: {', '.join(missing)}\n" if missing else "")
