"""A kind of part: its name in TOML files, its title, its keys, and the function that reads it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from problems.study.part import Heading, Part
from problems.study.source import Source


@dataclass(frozen=True)
class Kind:
    """A kind of part.

    Parameters
    ----------
    name : str
        Name in TOML files.
    title : str
        Title of a part that gives none.
    keys : str
        Its keys, as ``--help`` lists them.
    read : callable
        (source, keys of the table without those of the heading, heading, place for messages) -> part.
    """

    name: str
    title: str
    keys: str
    read: Callable[[Source, dict[str, Any], Heading, str], Part]
