"""The command ``ancf-casadi``: its subcommands, its exit codes, and the signals that end it.

The exit code is 0 on success; 2 if the input is unusable or a result cannot be written, with one line that says what
and where; 1 if the numerics fail, with advice; 128 plus the number of the signal if one ended the command.  Results go
to standard output, as text or with ``--json`` as data, even if a file cannot be written; progress goes to standard
error.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import warnings
from collections.abc import Collection, Sequence
from importlib import import_module
from io import TextIOWrapper
from typing import TYPE_CHECKING, Any, NoReturn

from ancf_casadi.exceptions import AncfError, InputError
from ancf_casadi.support.interrupts import raised_endings
from ancf_casadi.version import __version__

if TYPE_CHECKING:
    from problems.command.output import Output  # imports NumPy

COMMANDS = {
    "inspect": "show the channels of a file of measurements, and what a fit would use",
    "look": "show a record in the browser, and fit its decay while you choose",
    "track": "track markers through a video, and write their positions as a file of measurements",
    "init": "write a commented TOML file that runs as it is, to start from",
    "run": "do what the tables of a study file say: modes, match, simulation, response, fit, compare, plan",
    "fit-decay": "estimate frequency and damping of one mode, or of several, from measured decays",
    "fit-frf": "estimate the modes of measured frequency response functions",
    "fit-mode": "estimate frequency and damping of one mode from measured decays and response curves together",
    "export": "write a beam and its damping for other programs",
    "reproduce": "run the study of the paper: every table and figure",
}
SHARING = {"reproduce": "run"}  # commands in the module of another one of problems.command
REPLACED = {  # commands of earlier versions
    "study": "run STUDY.toml --out DIR",
    "fit": "run STUDY.toml fit",
    "fit-response": "run STUDY.toml fit, with the files in tables [[curves]]",
    "fit-modes": "fit-decay FILE --modes",
    "compare-laws": "run STUDY.toml compare, or fit-decay FILE --law auto for a decay",
    "modes": "run STUDY.toml modes",
    "match": "run STUDY.toml match",
    "plan": "run STUDY.toml plan",
    "simulate": "run STUDY.toml simulation, with --out DIR for DIR/motion.csv",
    "response": "run STUDY.toml response",
}


LONGEST = 300  # characters of a refusal, which may show an option as it was typed
UNFINISHED = "nothing was written"  # by a command that a signal ended, if the command says nothing else


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    if "_ARGCOMPLETE" in os.environ:  # a shell asks for the completions of a line
        from argcomplete import autocomplete

        autocomplete(_parser(os.environ.get("COMP_LINE", "").split()))  # which exits
    os.environ["MPLBACKEND"] = "agg"  # a command draws to files; the value of the user may name no backend
    open_output = _open_streams()
    try:
        try:
            code = _run(arguments)
        finally:
            sys.stdout.flush()
        return (
            code
            if open_output or code
            else _print_failure("the result cannot be printed (standard output is closed)", 2)
        )
    except BrokenPipeError:  # the reader of our output has left
        _discard_output()
        return 0
    except OSError as error:
        _discard_output()
        return _print_failure(f"the result cannot be printed ({error.strerror or error})", 2)


def _open_streams() -> bool:
    """Let standard streams write any character, to nowhere if they are closed; return whether the output was open."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number; otherwise a file would
    was_open = sys.stdout is not None
    sys.stdout = sys.stdout or open(os.devnull, "w")
    sys.stderr = sys.stderr or open(os.devnull, "w")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    return was_open


class _Parser(argparse.ArgumentParser):
    """The parser of the command, or of a subcommand."""

    def error(self, message: str) -> NoReturn:
        """Refuse in one line."""
        line = " ".join(message.split())
        if len(line) > LONGEST:
            line = f"{line[: LONGEST - 3]}..."
        self.exit(2, f"{self.prog}: {_printable(line)}; see {self.prog} --help\n")


def _add_options(parser: argparse.ArgumentParser, command: str) -> None:
    """Add the options of a subcommand to its parser."""
    name = command.replace("-", "_")
    module = import_module(f"problems.command.{SHARING.get(command, name)}")
    getattr(module, f"add_{name}")(parser)
    words = [
        f"{action.metavar}{' ...' * (action.nargs in ('+', '*'))}"
        for action in parser._actions
        if not action.option_strings
    ]
    parser.usage = " ".join([parser.prog, "[options]", *words])  # all options are explained below it
    parser.set_defaults(run=getattr(module, f"run_{name}"))


def _parser(words: Collection[str] = COMMANDS) -> argparse.ArgumentParser:
    """Return the parser; only subcommands among the words get their options, whose modules import slowly."""
    parser = _Parser(
        prog="ancf-casadi",
        allow_abbrev=False,
        description="Identify the damping and the properties of very flexible beams, and predict their large motion.",
        epilog="Start with 'inspect FILE' for a record, or 'init' for a study; 'COMMAND --help' explains each command.",
    )
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    for name, about in COMMANDS.items():
        added = commands.add_parser(
            name,
            help=about,
            description=f"{about[0].upper()}{about[1:]}.",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        added.add_argument("--json", action="store_true", help="print the result as JSON")
        added.set_defaults(title=name, refuse=added.error, unfinished=UNFINISHED)
        if name in words:
            _add_options(added, name)
    return parser


def _run(arguments: Sequence[str] | None) -> int:
    written, words = UNFINISHED, sys.argv[1:] if arguments is None else arguments
    failures: list[Exception] = []  # reasons why some of the files cannot be made or written
    with raised_endings() as noted, warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            parser = _parser(words)
            if words and words[0] in REPLACED:
                parser.error(f"{words[0]} is now: ancf-casadi {REPLACED[words[0]]}")
            options, unknown = parser.parse_known_args(words)
            if unknown:
                options.refuse(f"unrecognized arguments: {' '.join(unknown)}")
            written = options.unfinished
            from ancf_casadi.support.progress import counter  # slow to import, for a help text
            from ancf_casadi.support.tables import to_json, wrap_report

            with counter(options.title):
                output: Output = options.run(options)
                text = to_json({"version": __version__} | output.data()).rstrip() if options.json else output.text()
            if output.files:
                written = "not all files were written"
            for write in output.files:
                try:
                    write()
                except (AncfError, OSError, MemoryError) as error:
                    failures.append(error)
        except KeyboardInterrupt:
            return _report_stop(noted, written)
        except Exception as error:
            return _report_stop(noted, written) if noted else _report_failure(error)
    if not options.json:
        text = _printable(wrap_report(text if failures else text + output.closing))
    if text:
        print(text, flush=True)
    return max([_report_failure(failure) for failure in failures], default=0)


def _show_warning(message: Warning | str, *place: Any, **origin: Any) -> None:
    """Print a warning as one line, without the place in our sources that Python adds."""
    print(_printable(f"ancf-casadi: warning: {message}"), file=sys.stderr)


def _report_failure(error: Exception) -> int:
    """Report a failure in one line, and return the exit code."""
    if isinstance(error, AncfError):
        return _print_failure(error, 2 if isinstance(error, InputError) else 1)
    if isinstance(error, MemoryError):
        return _print_failure("out of memory; use fewer samples or fewer elements", 1)
    if isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename else ""
        return _print_failure(f"{place}cannot be used ({error.strerror or error})", 2)
    raise error


def _report_stop(noted: Sequence[int], written: str) -> int:
    # plus the number of the signal: the exit code that shells give
    return _print_failure(f"stopped; {written}", 128 + (noted[0] if noted else signal.SIGINT))


def _print_failure(reason: object, code: int) -> int:
    print(_printable(f"ancf-casadi: {' '.join(str(reason).split())}"), file=sys.stderr)
    return code


def _printable(text: str) -> str:
    """Return a text without control characters, as ``printable`` of the tables, which is slow to import."""
    if text.isascii() and text.replace("\n", "").isprintable():
        return text
    from ancf_casadi.support.tables import printable

    return printable(text)


def _discard_output() -> None:
    """Redirect the output that cannot be printed; otherwise Python tries to print it again when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
