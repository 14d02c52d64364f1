"""Shared beams, and the environment of all tests."""

import gc
import os
import signal
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

# The test processes would share the processors with threads of numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from PIL import Image

from ancf_casadi import Beam, Model
from ancf_casadi.support.compilation import c_compiler

PAPER = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}  # Table 1


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect the tests without the garbage collector, which takes a quarter of the time and finds nothing."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let slow tests use few elements, to be faster; pages and the others meet no over-bent element unnamed."""
    for item in items:
        if item.get_closest_marker("slow") and item.path.stem != "test_docs":
            item.add_marker(pytest.mark.filterwarnings("ignore:an element bends"))


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Name a test by six digits of a number: the last ones may differ between processes, which would collect others."""
    if isinstance(val, float):
        return f"{val:.6g}"
    return argname if isinstance(val, str | bytes) and len(val) > 100 else None


@pytest.fixture(scope="session", autouse=True)
def compiler() -> Iterator[None]:
    """Run without a C compiler where there is none; compiled functions stay in the user's cache for the next run."""
    with pytest.MonkeyPatch.context() as patch:
        if not c_compiler():
            patch.setenv("ANCF_CASADI_COMPILE", "0")
        yield


@pytest.fixture(scope="session", autouse=True)
def current_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Run in a temporary folder, so that no test leaves a file in the folder of the user."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("current"))
        yield


@pytest.fixture(scope="session", autouse=True)
def signals() -> None:
    """Handle signals as in a terminal; a process in the background ignores some of them."""
    for number in (signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGTERM), signal.SIGTERM):
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)


@pytest.fixture(scope="session")
def paper_beam() -> Callable[..., Beam]:
    """Factory of the paper's beam (Table 1), hanging, 20 elements; takes keywords of ``Beam.uniform``."""

    def make(elements: int = 20, **changes: Any) -> Beam:
        return Beam.uniform(**{**PAPER, "elements": elements, **changes})

    return make


@pytest.fixture(scope="session")
def rubber_beam() -> Callable[..., Beam]:
    """Factory of a beam that swings like the paper's, but is 40 times as thick and softer to match.

    Its axial modes are slow enough for an explicit integrator.
    """

    def make(elements: int = 3, **changes: Any) -> Beam:
        thick = {"thickness": 0.5e-3 * 40, "elastic_modulus": 210e9 / 40**2}
        return Beam.uniform(**{**PAPER, **thick, "elements": elements, **changes})

    return make


@pytest.fixture(scope="session")
def bending_stiffness() -> Callable[[Beam], float]:
    """E I of the first element, N m^2."""
    return lambda beam: beam.elastic_modulus[0] * beam.sections[0].second_moment


@pytest.fixture(scope="session")
def hanging(paper_beam: Callable[..., Beam]) -> Model:
    """The paper's beam, hanging, 20 elements."""
    return Model(paper_beam())


@pytest.fixture(scope="session")
def weightless(paper_beam: Callable[..., Beam]) -> Model:
    """The paper's beam along the x axis, 20 elements, without gravity."""
    return Model(paper_beam(axis=(1.0, 0.0), gravity=(0.0, 0.0)))


@pytest.fixture(scope="session")
def likeness() -> Callable[[Path, Path], float]:
    """Correlation of two pictures on a coarse grid, close to 1 for the same figure in another font."""

    def grid(path: Path) -> Any:
        with Image.open(path) as picture:
            picture.seek(getattr(picture, "n_frames", 1) // 2)  # of a moving one
            return np.asarray(picture.convert("L").resize((60, 40), Image.Resampling.BOX), dtype=float).ravel()

    return lambda picture, other: float(np.corrcoef(grid(picture), grid(other))[0, 1])
