"""README, documentation, examples and the new part of the changelog name only commands and options that exist."""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from problems.cli import COMMANDS, REPLACED, _parser

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *(path for path in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in path.parts)]
EXAMPLES = [path for path in sorted((ROOT / "examples").iterdir()) if path.suffix in (".py", ".toml", ".rst")]
LINE = re.compile(r"ancf-casadi +((?:\\\n|[^\n`|;&#()])*)")
COMMAND = re.compile(rf"(?:{'|'.join(COMMANDS)})(?= |$)")


@cache
def options_of(command: str) -> set[str]:
    """Return the options of a subcommand, or those that need none."""
    parser = _parser([command])
    if command:
        (commands,) = (action for action in parser._actions if action.choices)
        parser = commands.choices[command]
    return {option for action in parser._actions for option in action.option_strings}


def command_lines(path: Path) -> Iterator[str]:
    """Yield the command lines of a file without the name of the program; pages and changelog have them in code."""
    text = path.read_text()
    if path.name == "CHANGELOG.md":
        text = text.partition("\n## ")[2].partition("\n## ")[0]
    codes = re.findall(r"```.*?```|`[^`]+`", text, re.S) if path.suffix == ".md" else [text]
    for code in codes:
        yield from LINE.findall(code)
        if COMMAND.match(code, 1):  # named without the program
            yield code.strip("`")


@pytest.mark.parametrize("path", [*PAGES, *EXAMPLES, ROOT / "CHANGELOG.md"], ids=lambda path: path.name)
def test_named_commands_and_options_exist(path):
    for line in command_lines(path):
        words = line.replace("\\\n", " ").split()
        command = "" if words[0].startswith("-") else words[0]
        assert command in {"", *COMMANDS}, line
        named = {word.partition("=")[0].rstrip(".,:") for word in words if word.startswith("--")}
        assert named <= options_of(command), line


def test_each_command_of_an_earlier_version_leads_to_one_that_exists():
    assert not REPLACED.keys() & COMMANDS.keys()
    assert {re.split("[ ,]", now)[0] for now in REPLACED.values()} <= COMMANDS.keys()
