"""The command ``ancf-casadi``: one sub-command for each thing the toolkit does.

Exit code 0; 2 where the input is unusable, or a result cannot be written, with one line that says what and where; 1
where the numerics failed, with what to try; 128 and the number of the signal that ended it.  Results go to standard
output, as text or with ``--json`` as data, also where a file cannot be written; progress goes to standard error.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ancf_casadi.decay.envelope import damping_curve
from ancf_casadi.decay.measurement import Measurement
from ancf_casadi.dynamics.simulation import simulate
from ancf_casadi.dynamics.trajectory import IntegratorUse, Trajectory
from ancf_casadi.exceptions import AncfError, InputError
from ancf_casadi.export import Document, Identification, write_document
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.files import check_file, check_folder, write_file
from ancf_casadi.support.interrupts import ENDING
from ancf_casadi.support.tables import Table, to_json
from ancf_casadi.version import __version__
from ancf_casadi.vibration.modes import natural_modes
from problems.command.exporting import FORMATS, export, read_identifications
from problems.command.study_file import TABLE_KEYS, read_match, read_model, read_simulation, read_source
from problems.decay.comparison import compare_decay_laws
from problems.decay.fitting import fit_decay
from problems.matching.frequency_matching import match_frequencies

SIGNALLED = 128  # and the number of the signal: the exit code of what a signal ends, as shells give it


@dataclass(frozen=True)
class Output:
    """Result of a command.

    Parameters
    ----------
    text : str
        What to print, also where a file cannot be written.
    files : sequence of callable
        What writes the files.
    closing : str
        What to print below the text once all files are written.
    """

    text: str
    files: Sequence[Callable[[], object]] = ()
    closing: str = ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    try:
        try:
            return _run(_parser().parse_args(arguments))
        finally:
            sys.stdout.flush()
    except BrokenPipeError:  # the reader of our output has left
        _discard_output()
        return 0
    except OSError as error:
        _discard_output()
        return _failed(f"the result cannot be printed ({error.strerror or error})", 2)


def _discard_output() -> None:
    """Let what cannot be printed go, or Python tries again at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _run(options: argparse.Namespace) -> int:
    written = "nothing was written"
    with _noted_endings() as noted, warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            output = options.run(options)
            if output.files:
                written = "not all files were written"
            failure = _write(output.files)
        except KeyboardInterrupt:
            return _stopped(noted, written)
        except Exception as error:
            return _stopped(noted, written) if noted else _reported(error)
    print(output.text if failure else output.text + output.closing, flush=True)
    return _reported(failure) if failure else 0


def _show_warning(message: Warning | str, *where: Any, **more: Any) -> None:
    """Print a warning as one line, without the place in our sources that Python adds."""
    print(f"ancf-casadi: warning: {message}", file=sys.stderr)


def _write(files: Sequence[Callable[[], object]]) -> Exception | None:
    """Write files up to the first that cannot be written, and return the reason."""
    try:
        for write in files:
            write()
    except (AncfError, OSError, MemoryError) as error:
        return error
    return None


def _reported(error: Exception) -> int:
    """Report a failure in one line, and return the exit code."""
    if isinstance(error, AncfError):
        return _failed(error, 2 if isinstance(error, InputError) else 1)
    if isinstance(error, MemoryError):
        return _failed("out of memory; fewer samples, or fewer elements, take less", 1)
    if isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename else ""
        return _failed(f"{place}cannot be used ({error.strerror or error})", 2)
    raise error


def _stopped(noted: Sequence[int], written: str) -> int:
    return _failed(f"stopped; {written}", SIGNALLED + (noted[0] if noted else signal.SIGINT))


@contextlib.contextmanager
def _noted_endings() -> Iterator[list[int]]:
    """Note Ctrl-C, SIGTERM and SIGHUP, and raise ``KeyboardInterrupt`` to end with nothing left behind.

    It may reach us as any error of the CasADi call that it hit, or as a run that ended early.
    """
    noted: list[int] = []

    def end(number: int, _: object) -> None:
        noted.append(number)
        raise KeyboardInterrupt

    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        usual = (signal.default_int_handler, signal.SIG_DFL)
        before = {number: signal.getsignal(number) for number in ENDING if signal.getsignal(number) in usual}
    for number in before:
        signal.signal(number, end)
    try:
        yield noted
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Refuse in one line."""
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


@contextlib.contextmanager
def _located(where: str) -> Iterator[None]:
    """Name the file in what is wrong with its values."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error), where) from None


def _failed(reason: object, code: int) -> int:
    print(f"ancf-casadi: {' '.join(str(reason).split())}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="ancf-casadi", description="Damping, properties and large motion of very flexible beams.")
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(name: str, run: Callable[[argparse.Namespace], Output], about: str) -> argparse.ArgumentParser:
        added = commands.add_parser(
            name,
            help=about,
            description=f"{about[0].upper()}{about[1:]}.",
            epilog=TABLE_KEYS if name in ("modes", "match", "simulate", "export") else None,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        added.add_argument("--json", action="store_true", help="print data for machines")
        added.set_defaults(run=run)
        return added

    study = command("reproduce", _reproduce, "the paper's whole study on its embedded data")
    study.add_argument("--out", type=Path, default=Path("results"), metavar="DIR", help="folder (default: results)")
    study.add_argument("--quick", action="store_true", help="short excitations and loose tolerances, for a look")
    study.add_argument(
        "--jobs", type=_count, default=os.cpu_count() or 1, metavar="N", help="processes (default: all cores)"
    )
    decay = command("fit-decay", _fit_decay, "frequency and damping from one measured decay")
    decay.add_argument("file", metavar="FILE.csv", help="times (s) and displacements (m)")
    decay.add_argument(
        "--law",
        choices=("linear", "quadratic", "friction", "one-mode", "auto"),
        default="linear",
        help="damping law, or auto to compare them (default: linear)",
    )
    decay.add_argument("--drift", action="store_true", help="let the point of rest move at a constant velocity")
    decay.add_argument("--robust", action="store_true", help="bear outliers")
    decay.add_argument("--column", help="name of the displacement column (default: the second)")
    decay.add_argument("--plot", type=Path, metavar="FILE.png", help="draw record and fit")
    decay.add_argument("--curve", type=Path, metavar="FILE.csv", help="write damping against amplitude, from no law")
    modes = command("modes", _modes, "natural frequencies of a beam about its equilibrium")
    modes.add_argument("file", metavar="BEAM.toml", help="a file with the table [beam], or a JSON document")
    modes.add_argument("--count", type=int, default=5, metavar="N", help="how many (default: 5)")
    match = command("match", _match, "the beam nearest to a given one that has the measured frequencies")
    match.add_argument("file", metavar="BEAM.toml", help="a file with the tables [beam] and [match]")
    match.add_argument("--out", type=Path, metavar="FILE.json", help="write the matched beam as a JSON document")
    match.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the properties along the beam")
    motion = command("simulate", _simulate, "the large motion of a beam")
    motion.add_argument("file", metavar="STUDY.toml", help="tables [beam], [simulation], [damping], [base]")
    motion.add_argument("--out", type=Path, metavar="FILE.csv", help="write the motion of the tip")
    motion.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the motion of the tip")
    export = command("export", _export, "the beam and its damping for other programs")
    export.add_argument("file", metavar="BEAM.toml", help="tables [beam] and [damping], or a JSON document")
    export.add_argument("--format", choices=tuple(FORMATS), required=True, help="; ".join(FORMATS.values()))
    export.add_argument("--out", type=Path, required=True, metavar="PATH", help="the file to write; for c, the folder")
    export.add_argument(
        "--markers", type=_lengths, default=(), metavar="S,S,...", help="arc lengths of points to put out, m"
    )
    export.add_argument("--reduced", type=_count, metavar="N", help="write the reduced model, of so many modes")
    export.add_argument(
        "--identification",
        action="append",
        default=[],
        metavar="RESULT.json",
        help="what fit-decay --json or match --json printed, to go along; may be repeated",
    )
    export.add_argument(
        "--data", action="append", default=[], metavar="FILE.csv", help="the record it was made from, one for each"
    )
    return parser


def _lengths(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be numbers with commas between, got {text!r}") from None


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number above 0, got {text!r}")
    return int(text)


def _reproduce(options: argparse.Namespace) -> Output:
    from problems.study import report, reproduction  # loaded for this command alone, and by its processes

    folder = check_folder(options.out)
    effort = reproduction.QUICK if options.quick else reproduction.FULL
    study = reproduction.reproduce(effort=effort, jobs=options.jobs, progress=True)
    files = [partial(report.write_study, study, folder)]
    if options.json:
        return Output(_json(report.results(study)), files)
    texts = [table.text() for table in report.tables(study)]
    if options.quick:
        texts.append(
            "Quick look: excitations are a tenth as long and tolerances looser; Table 11 is a few percent off."
        )
    return Output("\n\n".join(texts), files, f"\n\nfiles written to {folder}")


def _fit_decay(options: argparse.Namespace) -> Output:
    plot, curve = _new_files([options.file], options.plot, options.curve)
    record = Measurement.from_csv(options.file, column=options.column, progress=True)
    comparison = None
    with _located(options.file):
        if options.law == "auto":
            if options.robust:
                raise InputError("compares sums of squares; it cannot be robust", "--law auto")
            comparison = compare_decay_laws(record, drift=options.drift)
            fit = comparison.best
        else:
            fit = fit_decay(record, law=options.law, drift=options.drift, robust=options.robust)
        damping = None if curve is None else damping_curve(record).table()
    files = []
    if curve is not None and damping is not None:
        files.append(_file(curve, damping.csv))
    if plot is not None:
        from ancf_casadi.plot import decay_figure, png  # matplotlib is slow to import

        files.append(_file(plot, lambda: png(decay_figure(record, fit.displacement, fit.release_time))))
    if options.json:
        return Output(_json(fit.to_dict() | ({"comparison": comparison.to_dict()} if comparison else {})), files)
    return Output(comparison.report() if comparison else fit.report(), files)


def _modes(options: argparse.Namespace) -> Output:
    modes = natural_modes(read_model(options.file), count=options.count)
    if options.json:
        tip = modes.equilibrium.tip.tolist()
        return Output(_json({"frequencies_hz": modes.frequencies.tolist(), "equilibrium_tip_m": tip}))
    rows = list(enumerate(modes.frequencies.tolist(), start=1))
    x, y = modes.equilibrium.tip
    about = f"about the tip at ({x:.6g}, {y:.6g}) m"
    return Output(Table("modes", "Natural modes", ("mode", "f_Hz"), rows, (about,)).text())


def _match(options: argparse.Namespace) -> Output:
    beam, request = read_match(options.file)
    out, plot = _new_files([options.file], options.out, options.plot)
    with _located(f"{options.file}: [match]"):
        match = match_frequencies(beam, **request)
    files: list[Callable[[], None]] = []
    if out is not None:
        document = Document(Model(match.beam), identifications=[Identification.of(match)])
        files.append(partial(write_document, out, document))
    if plot is not None:
        from ancf_casadi.plot import png  # matplotlib is slow to import

        files.append(_file(plot, lambda: png(match.figure())))
    return Output(_json(match.to_dict()) if options.json else match.report(), files)


def _simulate(options: argparse.Namespace) -> Output:
    study = read_simulation(options.file)
    out, plot = _new_files([options.file], options.out, options.plot)
    with _located(f"{options.file}: [simulation]"):
        run = simulate(study.model, damping=study.damping, base=study.base, progress=True, **study.settings)
    if run.interrupted:
        raise KeyboardInterrupt
    files = []
    if out is not None:
        files.append(_file(out, lambda: _motion(run).csv()))
    if plot is not None:
        from ancf_casadi.plot import motion_figure, png  # matplotlib is slow to import

        files.append(_file(plot, lambda: png(motion_figure(run))))
    relative = run.tip - run.base
    summary = {
        "samples": len(run.time),
        "duration_s": float(run.time[-1]),
        "tip_at_end_m": run.tip[-1].tolist(),
        "tip_travel_m": np.ptp(relative, axis=0).tolist(),
        "steps": run.steps,
        "seconds": run.wall_seconds,
    }
    if options.json:
        return Output(_json(summary | {"integrators": [_use(use) for use in run.integrators]}), files)
    used = ", ".join(f"{use.method} from {use.start:.6g} s at {use.tolerance:.1e}" for use in run.integrators)
    lines = [f"{name:<14}{_plain(value)}" for name, value in summary.items()]
    return Output("\n".join([*lines, f"{'integrators':<14}{used}"]), files)


def _use(use: IntegratorUse) -> dict[str, Any]:
    return {"start_s": use.start, "method": use.method, "tolerance": use.tolerance, "reason": use.reason}


def _file(path: Path, content: Callable[[], str | bytes]) -> Callable[[], None]:
    """Return what makes a content and writes it."""
    return lambda: write_file(path, content())


def _json(value: Any) -> str:
    return to_json(value).rstrip()


def _motion(run: Trajectory) -> Table:
    columns = ("time_s", "tip_x_m", "tip_y_m", "base_x_m", "base_y_m")
    rows = np.column_stack([run.time, run.tip, run.base]).tolist()
    return Table("motion", "Motion of the tip", columns, rows)


def _export(options: argparse.Namespace) -> Output:
    began = time.perf_counter()
    source = read_source(options.file)
    if options.format == "c":
        check_folder(options.out)
    else:
        _new_files([options.file, *options.identification, *options.data], options.out)
    with _located("--markers"):
        for marker in options.markers:
            source.model.element_at(marker)
    found = read_identifications(options.identification, options.data)
    written = export(
        source, options.format, options.out, markers=options.markers, modes=options.reduced, identifications=found
    )
    files = [{"path": str(path), "bytes": path.stat().st_size} for path in written]
    if options.json:
        return Output(_json({"format": options.format, "files": files, "seconds": time.perf_counter() - began}))
    return Output("\n".join(f"{file['path']}  {file['bytes']} bytes" for file in files))


def _plain(value: Any) -> str:
    values = value if isinstance(value, list) else [value]
    return "  ".join(f"{item:.6g}" if isinstance(item, float) else str(item) for item in values)


def _new_files(inputs: Sequence[str], *outputs: Path | None) -> tuple[Path | None, ...]:
    """Check the files to be written, each of them another one, and none that is read."""
    taken = {os.path.realpath(path): "is an input, which would be lost; choose another name" for path in inputs}
    for path in outputs:
        if path is None:
            continue
        check_file(path)
        place = os.path.realpath(path)
        if place in taken:
            raise InputError(taken[place], str(path))
        taken[place] = "is asked for twice; choose two names"
    return outputs


if __name__ == "__main__":
    sys.exit(main())
