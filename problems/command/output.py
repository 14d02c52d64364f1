"""The result of a command, and the files that it writes."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.files import check_file, write_file
from ancf_casadi.support.tables import Reported

PICTURES = (".png", ".svg", ".pdf")


@dataclass(frozen=True)
class Output:
    """Result of a command."""

    data: Callable[[], Any]  # the result as plain data, for --json
    text: Callable[[], str]  # the result to print otherwise, even if a file cannot be written
    files: Sequence[Callable[[], object]] = ()  # write the files, in their order
    closing: str = ""  # to print below the text once all files are written


def positive_count(text: str) -> int:
    """Return a whole number above zero from an argument."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number above 0, got {text!r}")
    return int(text)


def finite(text: str) -> float:
    """Return a finite number from an argument."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"must be a number, got {text!r}")
    return value


def comma_numbers(text: str) -> tuple[float, ...]:
    """Return numbers separated by commas from an argument."""
    try:
        return tuple(finite(number) for number in text.split(","))
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"must be numbers separated by commas, got {text!r}") from None


def add_options(parser: argparse._ActionsContainer, **options: tuple[Any, str, str]) -> None:
    """Add options that take one value, each by its type or the Literal of its values, a placeholder, and its help."""
    for name, (kind, metavar, about) in options.items():
        values = get_args(kind)
        settings = (
            {"choices": values, "help": f"{', '.join(values)}: {about}"} if values else {"type": kind, "help": about}
        )
        parser.add_argument(f"--{name.replace('_', '-')}", metavar=metavar, **settings)


def option_values(options: argparse.Namespace, names: Iterable[str]) -> dict[str, Any]:
    """Return the values of options that are given, by name."""
    return {name: value for name in names if (value := getattr(options, name)) is not None}


def add_plot(parser: argparse.ArgumentParser, about: str) -> None:
    """Add the option ``--plot`` with the name of a picture."""
    parser.add_argument("--plot", type=_picture, metavar="FILE", help=f"{about}, as .png, .svg or .pdf")


def _picture(text: str) -> Path:
    path = Path(text)
    if path.suffix.lower() not in PICTURES:
        raise argparse.ArgumentTypeError(f"must end in {', '.join(PICTURES[:-1])} or {PICTURES[-1]}, got {text!r}")
    return path


def file_writers(path: Path | None, content: Callable[[], str | bytes]) -> list[Callable[[], object]]:
    """Return a function that makes the content of a file and writes it; none without a path."""
    return [] if path is None else [lambda: write_file(path, content())]


def figure_writers(path: Path | None, draw: Callable[[], Figure]) -> list[Callable[[], object]]:
    """Return a function that draws a figure and writes it in the format of its suffix; none without a path."""

    def content(suffix: str) -> bytes:
        from ancf_casadi.figures.files import figure_bytes  # matplotlib is slow to import

        return figure_bytes(draw(), suffix)

    return [] if path is None else file_writers(path, lambda: content(path.suffix))


def result_output(result: Reported, plot: Path | None) -> Output:
    """Return a result, with its figure."""
    return Output(result.to_dict, result.report, figure_writers(plot, result.figure))


def new_files(inputs: Sequence[str], *outputs: Path | None) -> None:
    """Check the output files: each must be writable, different from the others and from every input."""
    refusals = {os.path.realpath(path): "is an input, which would be lost; choose another name" for path in inputs}
    for path in outputs:
        if path is None:
            continue
        check_file(path)
        place = os.path.realpath(path)
        if place in refusals:
            raise InputError(refusals[place], str(path))
        refusals[place] = "is named for two outputs; choose two names"
