"""Beams and a motion that several tests of simulations use."""

import pytest

from ancf_casadi import HarmonicBase, ModalDamping, Model, QuadraticDamping, natural_modes, simulate


@pytest.fixture
def uncompiled(monkeypatch):
    """Leave the Functions of an element that only one short test has to the virtual machine."""
    monkeypatch.setenv("ANCF_CASADI_COMPILE", "0")


@pytest.fixture(scope="module")
def small(paper_beam):
    """The paper's beam, hanging, with four elements."""
    return Model(paper_beam(4))


@pytest.fixture(scope="module")
def rubber(rubber_beam):
    """A hanging rubber beam with three elements."""
    return Model(rubber_beam())


@pytest.fixture(scope="module")
def driven(rubber):
    """A damped beam on a base that moves and stops between two samples."""
    modes = natural_modes(rubber, count=2)
    law = ModalDamping(modes, (0.01, 0.02)) + QuadraticDamping(0.1, 0.5)
    base = HarmonicBase(20e-3, 1.85, stop=0.3)
    return simulate(rubber, damping=law, base=base, duration=0.6, sample_rate=970.0, tolerance=1e-9)
