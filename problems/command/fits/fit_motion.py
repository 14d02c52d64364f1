"""``ancf-casadi fit-motion``: a damping law, and properties of the beam, from measured large motion."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

from ancf_casadi.exceptions import AncfError
from ancf_casadi.export import Document, write_document
from ancf_casadi.support.inputs import located
from problems.command.output import Output, add_plot, figure_writer, json_text, new_files
from problems.schema.records import RECORDS_HELP, read_motions
from problems.transient.fitting import fit_transient


def add_fit_motion(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.set_defaults(run=_run)
    parser.epilog = RECORDS_HELP
    parser.add_argument(
        "file", metavar="STUDY.toml", help="a file with the tables [beam], [[damping]] and [[records]]; init writes one"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE.json", help="write the beam and the law that were found as a JSON document"
    )
    add_plot(parser, "draw the measured and the fitted motion, and each prediction in a file FILE-prediction-N")


def _run(options: argparse.Namespace) -> Output:
    out, plot = new_files([options.file], options.out, options.plot)
    motions = read_motions(options.file)
    with located(f"{options.file}: [fit]"):
        fit = fit_transient(motions.model, motions.records, motions.damping, **motions.settings)
    result, texts = fit.to_dict(), [fit.report()]
    files: list[Callable[[], object]] = []
    if out is not None:
        files.append(partial(write_document, out, Document(fit.model, fit.law)))
    if plot is not None:
        files.append(figure_writer(plot, fit.figure))
    predictions: list[dict[str, Any] | None] = []
    for k, (record, mass) in enumerate(motions.predictions, start=1):
        try:
            with located(f"{options.file}: [predictions]: {k}"):
                prediction = fit.predict(record, tip_mass=mass)
        except AncfError as error:  # the fit is reported nevertheless
            predictions.append(None)
            files.append(partial(_fail, error))
            continue
        predictions.append(prediction.to_dict())
        texts.append(f"prediction {k}\n{prediction.report()}")
        if plot is not None:
            files.append(figure_writer(plot.with_stem(f"{plot.stem}-prediction-{k}"), prediction.figure))
    if options.json:
        return Output(json_text(result | ({"predictions": predictions} if predictions else {})), files)
    return Output("\n\n".join(texts), files)


def _fail(error: AncfError) -> NoReturn:
    raise error
