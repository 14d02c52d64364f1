import importlib
import re
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import pytest

import ancf_casadi

ROOT = Path(__file__).parents[1]
MODULES = sorted(path for package in ("ancf_casadi", "problems") for path in (ROOT / package).rglob("*.py"))


def python(code):
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_modules_import_only_what_the_contracts_in_pyproject_allow():
    code = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))"
    run = python(code)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "0 broken" in run.stdout


@pytest.mark.parametrize("package", ["ancf_casadi", "problems"])
def test_the_packages_say_that_they_are_typed(package):
    assert files(package).joinpath("py.typed").is_file()


def test_every_error_is_an_ancf_error_and_says_where():
    numerics = (ancf_casadi.EquilibriumError, ancf_casadi.SimulationError, ancf_casadi.FitError)
    assert all(issubclass(error, ancf_casadi.NumericsError) for error in numerics)
    assert issubclass(ancf_casadi.NumericsError, ancf_casadi.AncfError)
    error = ancf_casadi.InputError("must be positive", "width")
    assert (str(error), error.where) == ("width: must be positive", "width")
    assert isinstance(error, ancf_casadi.AncfError)


def test_no_module_is_hidden_by_a_name_of_its_package():
    for path in MODULES:
        *package, name = path.relative_to(ROOT).with_suffix("").parts
        if name != "__init__" and package:
            public = getattr(importlib.import_module(".".join(package)), name, None)
            assert public is None or public is sys.modules[".".join([*package, name])], path


def test_the_page_on_the_architecture_names_only_files_that_exist():
    page = (ROOT / "docs" / "architecture.md").read_text()
    named = set(re.findall(r"`((?:ancf_casadi|problems)/[\w/.]*)`", page))
    assert named and all((ROOT / path).exists() for path in named)
