"""Every public name has an example in its docstring, and every example prints what it says."""

import doctest
import importlib.util
import inspect

import pytest

import ancf_casadi
import ancf_casadi.export
import problems
from ancf_casadi.support.compilation import c_compiler

ELSEWHERE = {"reproduce"}  # tests/problems/paper/test_reproduce.py
PUBLIC = [
    pytest.param(getattr(package, name), id=f"{package.__name__}.{name}")
    for package in (ancf_casadi, ancf_casadi.export, problems)
    for name in package.__all__
    if not name.startswith("__") and name not in ELSEWHERE
]
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@pytest.fixture(autouse=True)
def beginner(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    """Give each example an empty working folder, and no compiled functions."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ANCF_CASADI_COMPILE", "0")


@pytest.mark.slow
@pytest.mark.parametrize("public", PUBLIC)
def test_a_public_name_has_examples_that_print_what_they_say(public):
    if public is ancf_casadi.export.write_fmu and not (c_compiler() and importlib.util.find_spec("fmpy")):
        pytest.skip("an FMU needs a C compiler and fmpy")
    if public is ancf_casadi.track_video and not importlib.util.find_spec("cv2"):
        pytest.skip("videos need opencv-python-headless")
    check_examples(public)


def check_examples(public):
    """Check that a name has examples, and that they print what they say."""
    assert "\nExamples\n--------\n" in inspect.getdoc(public)
    own, *methods = sorted(examples_of(public), key=lambda test: len(test.name))
    assert own.name == public.__name__ and own.examples
    for test in (own, *methods):
        report = []
        outcome = doctest.DocTestRunner(optionflags=OPTIONS).run(test, out=report.append)
        assert outcome.attempted == len(test.examples) and not outcome.failed, "".join(report)


def examples_of(public):
    """Return the docstrings with examples of a name and of its methods; each starts without any variables."""
    return doctest.DocTestFinder(exclude_empty=True).find(public, public.__name__, globs={})
