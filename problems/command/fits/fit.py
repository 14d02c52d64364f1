"""``ancf-casadi fit``: a damping law, and properties of the beam, from any mix of measurements."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

from ancf_casadi.exceptions import AncfError
from ancf_casadi.export import Document, write_document
from ancf_casadi.support.inputs import located
from problems.beam.fitting import fit_beam
from problems.command.output import Output, add_plot, figure_writers, json_text, new_files
from problems.schema.records import RECORDS_HELP, Measurements, read_measurements


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = RECORDS_HELP
    parser.add_argument(
        "file",
        metavar="STUDY.toml",
        help="a file with the tables [beam], [[damping]] and [[records]] or other measurements; init writes one",
    )
    add_fit_outputs(parser)


def add_fit_outputs(parser: argparse.ArgumentParser) -> None:
    """Add the options that name files to write."""
    parser.add_argument(
        "--out", type=Path, metavar="FILE.json", help="write the beam and the law that were found as a JSON document"
    )
    add_plot(parser, "draw measurements and fit, and each prediction in a file FILE-prediction-N")


def run(options: argparse.Namespace) -> Output:
    """Run the command."""
    out, plot = new_files([options.file], options.out, options.plot)
    return fit_output(options, read_measurements(options.file), out, plot)


def fit_output(options: argparse.Namespace, given: Measurements, out: Path | None, plot: Path | None) -> Output:
    """Return the output of a fit to measurements of a file."""
    with located(f"{options.file}: [fit]"):
        fit = fit_beam(given.model, given.records, given.damping, **given.settings)
    result, texts = fit.to_dict(), [fit.report()]
    files: list[Callable[[], object]] = []
    if out is not None:
        files.append(partial(write_document, out, Document(fit.model, fit.law if given.damping else None)))
    files += figure_writers(plot, fit.figure)
    predictions: list[dict[str, Any] | None] = []
    for k, record in enumerate(given.predictions, start=1):
        try:
            with located(f"{options.file}: [predictions]: {k}"):
                prediction = fit.predict(record)
        except AncfError as error:  # the fit is reported nevertheless
            predictions.append(None)
            files.append(partial(_fail, error))
            continue
        predictions.append(prediction.to_dict())
        texts.append(f"prediction {k}\n{prediction.report()}")
        own = plot and plot.with_stem(f"{plot.stem}-prediction-{k}")
        files += figure_writers(own, prediction.figure)
    if options.json:
        return Output(json_text(result | ({"predictions": predictions} if predictions else {})), files)
    return Output("\n\n".join(texts), files)


def _fail(error: AncfError) -> NoReturn:
    raise error
