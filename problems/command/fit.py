"""``ancf-casadi fit`` and ``fit-response``: a damping law, and properties of the beam, from any mix of measurements.

With ``fit-response``, the curves become tables ``[[curves]]`` beside those of the file of the beam.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, get_args

from ancf_casadi.exceptions import AncfError
from ancf_casadi.export import Document, write_document
from ancf_casadi.records.sensor import Quantity
from ancf_casadi.support.inputs import located
from ancf_casadi.support.specs import keys_of
from problems.beam.curves.record import Control, Sweep
from problems.beam.fitting import fit_beam
from problems.command.output import Output, add_plot, figure_writers, new_files
from problems.command.record_options import add_spectral_options
from problems.spec.file import StudyFile
from problems.spec.records import RECORDS_HELP, CurveFileSpec, read_measurements


def add_fit(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = RECORDS_HELP
    parser.add_argument(
        "file",
        metavar="STUDY.toml",
        help="a file with the tables [beam], [[damping]] and [[records]] or other measurements; init writes one",
    )
    _add_outputs(parser)


def add_fit_response(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = RECORDS_HELP
    parser.add_argument(
        "file",
        metavar="BEAM.toml",
        help="a file with the tables [beam] and [[damping]]; [base] or [load] is the excitation at level 1, if the "
        "curves have no levels with a unit",
    )
    parser.add_argument(
        "curves", nargs="+", metavar="CURVE", help="file with frequency, amplitude, and if measured phase and level"
    )
    parser.add_argument(
        "--sensor",
        choices=get_args(Quantity),
        metavar="QUANTITY",
        help="what was measured (default: as the unit tells)",
    )
    parser.add_argument("--sweep", choices=get_args(Sweep), help="direction of the sweep")
    parser.add_argument("--control", choices=get_args(Control), help="quantity that was held (default: excitation)")
    add_spectral_options(parser, level=True)
    _add_outputs(parser)


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--out", type=Path, metavar="FILE.json", help="write the beam and the law that were found as a JSON document"
    )
    add_plot(parser, "draw measurements and fit, and each prediction in a file FILE-prediction-N")


def run_fit(options: argparse.Namespace) -> Output:
    """Fit the measurements of a file."""
    new_files([options.file], options.out, options.plot)
    return _fitted(options, options.file)


def run_fit_response(options: argparse.Namespace) -> Output:
    """Fit the curves of files."""
    new_files([options.file, *options.curves], options.out, options.plot)
    file = StudyFile.of(options.file)
    keys = [*sorted(keys_of(CurveFileSpec) - {"file"}), "sensor", "sweep", "control"]
    shared = {key: value for key in keys if (value := getattr(options, key)) is not None}
    curves = [{"file": os.path.abspath(path), **shared} for path in options.curves]
    return _fitted(options, StudyFile(file.path, {**file.tables, "curves": [*file.several("curves"), *curves]}))


def _fitted(options: argparse.Namespace, file: str | StudyFile) -> Output:
    given, plot = read_measurements(file), options.plot
    with located(f"{options.file}: [fit]"):
        fit = fit_beam(given.model, given.records, given.damping, **given.settings)
    result, texts = fit.to_dict(), [fit.report()]
    files: list[Callable[[], object]] = []
    if options.out is not None:
        files.append(partial(write_document, options.out, Document(fit.model, fit.law if given.damping else None)))
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
    data = result | ({"predictions": predictions} if predictions else {})
    return Output(lambda: data, lambda: "\n\n".join(texts), files)


def _fail(error: AncfError) -> NoReturn:
    raise error
