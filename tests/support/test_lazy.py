"""Packages import their public names on first use."""

import subprocess
import sys

import pytest

import ancf_casadi
import problems

PACKAGES = (ancf_casadi, problems)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_a_package_lists_and_imports_every_public_name(package):
    assert set(package.__all__) <= set(dir(package))
    assert all(getattr(package, name) is not None for name in package.__all__)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_a_name_that_does_not_exist_is_no_attribute(package):
    with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'Bean'"):
        package.Bean  # noqa: B018
    assert not hasattr(package, "_private")


def test_folders_are_attributes_and_nothing_is_imported_before_it_is_used():
    code = (
        "import sys, ancf_casadi, problems\n"
        "assert not {'numpy', 'casadi', 'scipy'} & set(sys.modules)\n"
        "print(ancf_casadi.mechanics.__name__, problems.decay.__name__)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.stdout.split() == ["ancf_casadi.mechanics", "problems.decay"], run.stderr
