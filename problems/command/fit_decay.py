"""``ancf-casadi fit-decay``: frequency and damping of one mode, or of several, from measured decays.

With ``--band`` the other modes are subtracted first (``problems.decay.mode_separation``).  Several files are fitted at
once and each alone.  The curve of damping against amplitude is computed last.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, get_args

from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.release import separate_takes
from ancf_casadi.decay.rest_position import Rest
from ancf_casadi.estimation.comparison import LawComparison
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.files import check_file
from ancf_casadi.support.inputs import error_prefix
from problems.command.output import (
    Output,
    add_options,
    add_plot,
    comma_numbers,
    figure_writers,
    file_writers,
    finite,
    new_files,
    option_values,
    positive_count,
    result_output,
)
from problems.command.record_options import (
    add_record_options,
    given_options,
    read_record,
    refuse_combinations,
    releases,
)
from problems.decay.fitting import fit_decay, fit_decays, fit_or_compare
from problems.decay.law_curve import amplitude_table
from problems.decay.laws import Law
from problems.decay.mode_separation import MAX_DECAY_MODES, IsolatedMode, fit_modes, isolate_mode

LAWS = ("law", "frequency_law", "rest")  # options that choose the laws of a mode


def add_fit_decay(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    about = "record of a free decay; several files are takes of the same mode"
    parser.add_argument("files", nargs="+", metavar="FILE", help=about)
    add_law_options(parser, auto=True)
    about = "of several releases in one record, fit the last, or all as takes of the same mode (default: last)"
    parser.add_argument("--release", choices=("last", "all"), default="last", help=about)
    about = f"fit the strongest N modes at once, or as many as the record supports, up to {MAX_DECAY_MODES}; give it "
    parser.add_argument("--modes", nargs="?", type=positive_count, const=0, metavar="N", help=f"{about}after the files")
    band = (
        "fit the strongest mode between these frequencies (Hz); stronger modes outside are fitted and subtracted, "
        "without a filter, which would colour the noise"
    )
    curve = "write damping ratio and frequency against amplitude: windows without a law, and the law with its band"
    add_options(parser, band=(comma_numbers, "LOW,HIGH", band), curve=(Path, "FILE.csv", curve))
    about = "what the record holds: the oscillation, or its amplitudes over time (default: motion)"
    parser.add_argument("--quantity", choices=("motion", "amplitude"), default="motion", help=about)
    add_options(parser, frequency=(finite, "HZ", "natural frequency of amplitudes, for a damping ratio"))
    add_plot(parser, "draw the record and the fit")
    add_record_options(parser)


def add_law_options(parser: argparse.ArgumentParser, *, auto: bool) -> None:
    """Add the options that choose the laws of a mode, or ``auto`` to compare all, and the loss."""
    for name, laws, default, about in (
        ("law", Law, "linear", "damping law"),
        ("frequency-law", FrequencyLaw, "constant", "change of the frequency with the amplitude"),
        ("rest", Rest, "constant", "motion of the rest position"),
    ):
        follows = auto and name != "law"
        choices = (*get_args(laws), *(["auto"] if auto else []))
        text = f"{about}{', or auto to compare all' if auto else ''} (default: {default}"
        text += "; with --law auto: auto)" if follows else ")"
        parser.add_argument(f"--{name}", choices=choices, default=None if follows else default, help=text)
    parser.add_argument("--robust", action="store_true", help="limit the influence of outliers")


def run_fit_decay(options: argparse.Namespace) -> Output:
    """Fit the decays."""
    _check(options)
    _check_outputs(options, len(options.files))
    if options.quantity == "amplitude":
        record = read_record(options.files[0], options)
        settings = option_values(options, ("law", "frequency", "robust"))
        with error_prefix(options.files[0]):
            return result_output(fit_decay(record, quantity="amplitude", **settings), options.plot)
    times = releases(options, len(options.files))
    records = [read_record(path, options) for path in options.files]
    if options.release == "all":
        records = [take for record in records for take in separate_takes(record)]
        times = [None] * len(records)
        _check_outputs(options, len(records))
    if options.modes is not None:
        with error_prefix(options.files[0]):
            return result_output(
                fit_modes(records[0], modes=options.modes or None, release_time=times[0]), options.plot
            )
    isolated: list[IsolatedMode] = []
    if options.band is not None:
        for path, record, time in zip(options.files, records, times, strict=True):
            with error_prefix(path):
                isolated.append(isolate_mode(record, options.band, release_time=time))
        records, times = [mode.record for mode in isolated], [mode.mode.release_time for mode in isolated]
    return _fit(options, records, times, isolated)


def _check_outputs(options: argparse.Namespace, count: int) -> None:
    """Refuse names of files to write that are taken."""
    new_files(options.files, *_numbered_modes(options.plot, count), *_numbered_modes(options.curve, count))


def _check(options: argparse.Namespace) -> None:
    """Refuse options that do not go together."""
    automatic, several = _automatic(options), len(options.files) > 1
    refuse_combinations({
        "--release all": (options.release == "all", "fits one mode by one law to all releases", {
            **given_options(options, "release_time", "modes", "band"), automatic: bool(automatic),
        }),
        "--modes": (options.modes is not None, "fits modes with linear damping to one record", {
            "several files": several, f"--law {options.law}": options.law != "linear", "--robust": options.robust,
            **given_options(options, "frequency_law", "rest", "band", "curve"),
        }),
        "--quantity amplitude": (options.quantity == "amplitude", "fits amplitudes of one record", {
            "several files": several, "--release all": options.release == "all",
            **given_options(options, "frequency_law", "rest", "modes", "band", "curve", "release_time", "decimate"),
        }),
        "--frequency": (options.frequency is not None, "belongs to --quantity amplitude", {
            "the oscillation, which shows it": options.quantity == "motion",
        }),
        automatic: (bool(automatic), "compares sums of squares on one record", {
            "several files": several, "--robust": options.robust,
        }),
    })  # fmt: skip
    if options.band is not None and len(options.band) != 2:
        raise InputError("must be two frequencies LOW,HIGH", "--band")


def _automatic(options: argparse.Namespace) -> str:
    """Return the first option that asks to compare laws, with its value; empty if there is none."""
    return next((f"--{name.replace('_', '-')} auto" for name in LAWS if getattr(options, name) == "auto"), "")


def _fit(
    options: argparse.Namespace,
    records: Sequence[Measurement],
    times: Sequence[float | None],
    isolated: Sequence[IsolatedMode],
) -> Output:
    extra: dict[str, Any] = {}
    with error_prefix(", ".join(options.files)):
        if len(records) == 1:
            laws = {name: getattr(options, name) for name in LAWS}
            result = fit_or_compare(records[0], laws, release_time=times[0], robust=options.robust)
            text = result.report()
            if isinstance(result, LawComparison):
                fits, extra = [result.best], {"comparison": result.to_dict()}
            else:
                fits = [result]
        else:
            settings = option_values(options, (*LAWS, "robust"))
            release_times = [time for time in times if time is not None]
            takes = fit_decays(records, release_times=release_times or None, **settings)
            fits, text, extra = list(takes), takes.report(), takes.to_dict()
    lines = [
        f"  subtracted from {path}: {', '.join(f'{subtracted.frequency:.4g}' for subtracted in mode.others)} Hz"
        for path, mode in zip(options.files, isolated, strict=bool(isolated))
        if mode.others
    ]
    lines += [f"  note: {text}" for mode in isolated for text in mode.warnings]
    if isolated:
        extra["subtracted_hz"] = [[subtracted.frequency for subtracted in mode.others] for mode in isolated]
    files: list[Callable[[], object]] = []
    plots, curves = _numbered_modes(options.plot, len(fits)), _numbered_modes(options.curve, len(fits))
    for fit, plot, curve in zip(fits, plots, curves, strict=True):
        files += figure_writers(plot, fit.figure)
        files += file_writers(curve, lambda fit=fit: amplitude_table(fit).csv())  # type: ignore[misc]
    return Output(lambda: fits[0].to_dict() | extra, lambda: "\n".join([text, *lines]), files)


def _numbered_modes(path: Path | None, count: int) -> list[Path | None]:
    """Return one name per record; with several records, the names are numbered."""
    if path is None or count == 1:
        return [path] * count
    check_file(path)
    return [path.with_stem(f"{path.stem}-{k}") for k in range(1, count + 1)]
