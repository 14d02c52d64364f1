"""Mutated files and options: exit code 0, 1 or 2, one line for each error, and never a traceback."""

import random
import re

import pytest

from problems.command.init import STUDY

VALUES = [
    "0", "-1", "0.5", "1e300", "-1e300", "1e-300", "nan", "inf", "10000", "99999999999999999999", "true", '"x"', '""',
    "[]", "[[]]", "[1, 2]", "[nan, 1]", "{}", "{a = 1}", "1979-05-27", "1e308", '"motion.csv"', '"."', "[{}]",
    "[{column = 2}]",
]  # fmt: skip
HEADS = ["[beam]", "[[damping]]", "[base]", "[release]", "[markers]", "[[records]]", "[fit]", "[x]", "[[beam]]"]
COMMANDS = (
    ["run", "study.toml", "modes"], ["run", "study.toml", "match"], ["run", "study.toml", "simulation"],
    ["run", "study.toml", "fit"], ["export", "study.toml", "--format", "json", "--out", "o.json"],
)  # fmt: skip
OPTIONS = {
    "--column": ["1", "2", "0", "99", "tip_mm", "x", ""],
    "--time": ["1", "2", "x"],
    "--unit": ["mm", "g", "furlong", ""],
    "--sample-rate": ["100", "0", "-5", "nan", "1e300"],
    "--sensor": ["velocity", "strain", "x"],
    "--begin": ["1", "9", "nan", "x"],
    "--end": ["3", "-1", "1e300"],
    "--release-time": ["1", "9", "1,2", ","],
    "--modes": ["2", "0", "1000000", "9" * 5000],
    "--band": ["2,4", "4,2", "1,2,3", "nan,1", "x"],
    "--law": ["quadratic", "x"],
    "--curve": ["c.csv", ".", ""],
    "--plot": ["p.jpg", "", "."],
}


def mutated(text: str, rng: random.Random) -> str:
    """Return a file with values replaced, lines removed, repeated or moved, tables inserted, or letters replaced."""
    lines = text.split("\n")
    for _ in range(rng.choice((1, 1, 2, 4))):
        place, kind = rng.randrange(len(lines)), rng.randrange(8)
        if kind <= 3:
            place = rng.choice([k for k, line in enumerate(lines) if "=" in line and line[:1] != "#"] or [place])
            lines[place] = f"{lines[place].partition('=')[0]}= {rng.choice(VALUES)}"
        elif kind == 4:
            lines[place] = ""
        elif kind == 5:
            lines.insert(place, rng.choice(lines))
        elif kind == 6:
            lines.insert(place, rng.choice(HEADS))
        else:
            cut = rng.randrange(len(lines[place]) + 1)
            lines[place] = lines[place][:cut] + rng.choice('\0=[]"é9-.') + lines[place][cut + 1 :]
    return "\n".join(lines)


def check(done) -> None:
    """Check what holds for every command, whatever it is given."""
    assert done.code in (0, 1, 2)
    assert "Traceback" not in done.err
    errors = [line for line in done.err.splitlines() if re.match(r"ancf-casadi[\w -]*: (?!warning: )", line)]
    assert len(errors) == (done.code != 0)
    assert all(len(line) < 1000 for line in errors)


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # the command prints them
@pytest.mark.parametrize("seed", range(4))
def test_mutated_studies(run, tmp_path, seed):
    """Short motions of three elements, so that what remains usable is quick."""
    rng = random.Random(seed)
    short = {"elements = 8": "elements = 3", "duration = 2.0": "duration = 0.03", "stop = 1.0": "stop = 0.01"}
    text = STUDY
    for long, quick in short.items():
        text = text.replace(long, quick)
    for _ in range(15):
        (tmp_path / "study.toml").write_text(mutated(text, rng))
        check(run(*rng.choice(COMMANDS)))


@pytest.mark.parametrize("seed", range(4))
def test_mutated_options(run, decay, seed):
    rng = random.Random(100 + seed)
    decay("a.csv", (3.0, 0.02, 5e-3))
    for _ in range(10):
        options = [part for name in rng.sample(sorted(OPTIONS), 2) for part in (name, rng.choice(OPTIONS[name]))]
        check(run("fit-decay", "a.csv", *options))
