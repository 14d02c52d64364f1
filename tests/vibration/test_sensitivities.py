"""Derivatives of frequencies and mode shapes against differences and the scaling laws of a uniform beam."""

from dataclasses import replace

import numpy as np
import pytest

from ancf_casadi import Beam, Model, natural_modes
from ancf_casadi.vibration.assembly import Position, Structure, structure_properties
from ancf_casadi.vibration.modal_state import (
    ModalState,
    follow,
    gradient,
    hessian,
    modal_state,
    modes_near,
    sensitivities,
)

ELEMENTS = 5
COUNT = 3
STEP = 1e-4


@pytest.fixture(scope="module", params=[{}, {"tip_mass": 2e-3, "clamp_stiffness": 0.3}], ids=["plain", "lumped"])
def state(request) -> ModalState:
    """A beam bent by gravity with different properties in all elements, so no derivative vanishes by symmetry."""
    rng = np.random.default_rng(5)
    spread = 1 + 0.2 * rng.uniform(-1, 1, (4, ELEMENTS))
    values = spread * np.array([5e-3, 0.5e-3, 8e3, 210e9])[:, None]
    names = ("width", "thickness", "density", "elastic_modulus")
    beam = Beam(0.5, *(tuple(values[k]) for k in range(len(names))), axis=(0.4, -1.0)).with_(**request.param)
    return modal_state(natural_modes(Model(beam), count=COUNT), np.arange(COUNT))


@pytest.fixture(scope="module")
def directions(state) -> np.ndarray:
    """Relative changes of single properties, and of all at once."""
    n = len(state.properties)
    chosen = [0, 7, 9, 12, 19] + ([20, 21] if state.model.root else [])
    mixed = np.random.default_rng(6).uniform(-1, 1, (n, 1))
    return state.properties[:, None] * np.concatenate([np.eye(n)[:, chosen], mixed], axis=1)


def neighbours(state, direction) -> tuple[ModalState, ModalState]:
    ahead, behind = (follow(state, state.properties + sign * STEP * direction) for sign in (1, -1))
    return ahead, behind


class TestFirst:
    def test_the_state_agrees_with_natural_modes(self, state):
        modes = natural_modes(state.model, count=COUNT)
        assert state.frequencies == pytest.approx(modes.frequencies, rel=1e-8)
        assert state.shapes == pytest.approx(modes.shapes, abs=1e-7 * np.abs(modes.shapes).max())
        assert state.coordinates == pytest.approx(modes.equilibrium.coordinates, abs=1e-12)

    def test_against_differences(self, state, directions):
        coordinates, eigenvalues, shapes = sensitivities(state, directions)
        for k, direction in enumerate(directions.T):
            ahead, behind = neighbours(state, direction)
            for name, exact in (
                ("coordinates", coordinates[:, k]),
                ("eigenvalues", eigenvalues[:, k]),
                ("shapes", shapes[:, :, k].T),
            ):
                found = (getattr(ahead, name) - getattr(behind, name)) / (2 * STEP)
                largest = np.abs(getattr(state, name)).max(axis=0)
                assert np.abs(exact / largest).max() > 1e-4
                assert found / largest == pytest.approx(exact / largest, abs=3e-6)


class TestSecond:
    @pytest.mark.parametrize("seed", [1, 2])
    def test_against_differences_of_the_first(self, state, directions, seed):
        """A random combination of eigenvalues and shapes."""
        rng = np.random.default_rng(seed)
        b = rng.standard_normal(COUNT) / state.eigenvalues
        c = rng.standard_normal((COUNT, state.model.size)) / np.abs(state.shapes).max()
        second = hessian(state, directions, b, c)

        def derivatives(at: ModalState) -> np.ndarray:
            _, eigenvalues, shapes = sensitivities(at, directions)
            return b @ eigenvalues + np.einsum("ks,ksn->n", c, shapes)

        for k, direction in enumerate(directions.T):
            ahead, behind = neighbours(state, direction)
            found = (derivatives(ahead) - derivatives(behind)) / (2 * STEP)
            assert found == pytest.approx(second[k], abs=2e-6 * np.abs(second).max())
        assert second == pytest.approx(second.T, abs=1e-10 * np.abs(second).max())
        along = directions.T @ gradient(state, b[:, None], c[:, :, None])[:, 0]
        assert along == pytest.approx(derivatives(state), rel=1e-8, abs=1e-9 * np.abs(along).max())


class TestUniformBeam:
    """The frequencies of a uniform beam depend on E h^2/rho alone, never on the width."""

    def logarithmic(self, model: Model) -> np.ndarray:
        """Return d ln f/d ln (width, thickness, density, modulus), each of the whole beam, (m, 4)."""
        state = modal_state(natural_modes(model, count=4), np.arange(4))
        whole = np.eye(4).repeat(model.beam.elements, axis=0)
        _, eigenvalues, _ = sensitivities(state, state.properties[:, None] * whole)
        return eigenvalues / (2 * state.eigenvalues[:, None])

    def test_without_gravity(self, paper_beam):
        """f ~ (E/rho)^(1/2) h/L^2: exponents 0, 1, -1/2, 1/2."""
        found = self.logarithmic(Model(paper_beam(8, gravity=(0.0, 0.0))))
        assert found == pytest.approx(np.tile([0.0, 1.0, -0.5, 0.5], (4, 1)), abs=1e-8)

    def test_hanging(self, paper_beam):
        """Gravity adds to the stiffness, so the exponents are smaller, but in the same proportion."""
        found = self.logarithmic(Model(paper_beam(8)))
        of_modulus = found[:, 3]
        assert 0.3 < of_modulus[0] < 0.45
        assert found == pytest.approx(np.outer(of_modulus, [0.0, 2.0, -1.0, 1.0]), abs=1e-6)


class TestFollowing:
    """A steel beam without gravity: bending frequencies rise with the thickness, axial ones do not."""

    def thick(self, paper_beam, thickness: float) -> Model:
        return Model(paper_beam(12, thickness=thickness, axis=(1.0, 0.0), gravity=(0.0, 0.0)))

    def test_bending_crosses_the_first_axial_mode(self, paper_beam):
        """f4 of bending ~ h meets c/(4 L) = 2562 Hz at 22.5 mm: number 4 at 20 mm, 5 at 25 mm."""
        thin = self.thick(paper_beam, 20e-3)
        start = modal_state(natural_modes(thin, count=6), np.array([3, 4]))
        bending, axial = start.frequencies
        assert axial == pytest.approx(np.sqrt(210e9 / 8e3) / (4 * 0.5), rel=1e-3)
        thicker = self.thick(paper_beam, 25e-3)
        end = follow(start, structure_properties(thicker))
        assert end.numbers.tolist() == [4, 3]
        assert end.frequencies == pytest.approx([1.25 * bending, axial], rel=1e-7)
        assert end.frequencies == pytest.approx(natural_modes(thicker, count=6).frequencies[[4, 3]], rel=1e-9)

    def test_the_path_does_not_matter(self, paper_beam):
        thin, thicker = self.thick(paper_beam, 20e-3), self.thick(paper_beam, 25e-3)
        start = modal_state(natural_modes(thin, count=6), np.array([3, 4]))
        by_itself = follow(start, structure_properties(thicker))
        in_steps = start
        for factor in np.linspace(0.1, 1.0, 10):
            in_steps = follow(
                in_steps, (1 - factor) * structure_properties(thin) + factor * structure_properties(thicker)
            )
        assert in_steps.numbers.tolist() == by_itself.numbers.tolist()
        assert in_steps.shapes == pytest.approx(by_itself.shapes, abs=1e-8 * np.abs(by_itself.shapes).max())

    def test_rounding_of_positions_does_not_show(self, paper_beam):
        """Newton's method from eight neighbouring positions gives the same frequencies to 2e-11."""
        model = Model(paper_beam(20))
        rest = natural_modes(model, count=3).equilibrium.coordinates
        found = []
        for seed in range(8):
            near = rest.copy()
            near[slice(4, model.size)] += 1e-9 * np.random.default_rng(seed).standard_normal(model.size - 4)
            state = modes_near(Structure.of(model), Position.of(near), 3)
            assert state is not None
            found.append(state.frequencies)
        assert (np.ptp(found, axis=0) < 2e-11 * found[0]).all()

    @pytest.mark.slow
    def test_a_fine_mesh_has_the_frequencies_of_natural_modes(self, paper_beam):
        """400 elements, from the equilibrium of another beam."""
        thin, bent = (Model(paper_beam(400, axis=(1.0, -1.0), thickness=t)) for t in (0.5e-3, 0.52e-3))
        followed = follow(modal_state(natural_modes(thin), np.arange(5)), structure_properties(bent))
        assert followed.frequencies == pytest.approx(natural_modes(bent).frequencies, rel=1e-10)

    def test_an_unstable_beam_has_no_state(self, paper_beam):
        standing = Model(paper_beam(6, axis=(0.0, 1.0)))
        structure = Structure.of(standing)
        slender = structure.properties.copy()
        slender[6:12] *= 0.4
        near = natural_modes(standing, count=1).equilibrium.exact
        assert modes_near(replace(structure, properties=slender), near, 3) is None
