"""Unknowns give the stated beam, and keep it within their bounds."""

import numpy as np
import pytest

from ancf_casadi import Beam, InputError, Model
from problems import Global, LeastChange, PerElement, Smooth, Smoothness
from problems.matching.design_space import PATCHES, DesignSpace

ELEMENTS = 6


@pytest.fixture
def beam() -> Beam:
    widths = tuple(5e-3 * (1 + 0.1 * np.arange(ELEMENTS)))
    return Beam.uniform(
        length=0.5, width=widths, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=ELEMENTS
    )


@pytest.fixture
def space(beam) -> DesignSpace:
    unknowns = (
        Global("elastic_modulus"),
        PerElement("thickness", relative_bounds=0.05),
        Smooth("width", terms=3, relative_bounds=0.2),
    )
    return DesignSpace(beam, unknowns)


class TestDesignSpace:
    def test_the_given_beam_is_the_default_guess(self, space, beam):
        assert space.changed_beam(space.check_guess(None)) == beam
        assert space.names == (
            "elastic_modulus", *(f"thickness[{i}]" for i in range(1, 7)), "width~L0", "width~L1", "width~L2"
        )  # fmt: skip

    def test_what_each_unknown_changes(self, space, beam):
        m = space.standard.copy()
        m[0], m[3], m[8] = 1.02, 0.97, 0.1
        changed = space.changed_beam(m)
        taper = 1 + 0.1 * (2 * np.arange(ELEMENTS) + 1 - ELEMENTS) / ELEMENTS  # L_1 at the centres of the elements
        assert changed.elastic_modulus == pytest.approx([1.02 * 210e9] * ELEMENTS)
        assert changed.thickness == pytest.approx([0.5e-3, 0.5e-3, 0.97 * 0.5e-3, 0.5e-3, 0.5e-3, 0.5e-3])
        assert changed.width == pytest.approx(taper * beam.width)
        assert changed.density == beam.density

    def test_directions_are_the_derivatives_of_the_properties(self, space):
        m = space.random(np.random.default_rng(1))
        for k in range(space.size):
            step = np.zeros(space.size)
            step[k] = 0.25
            slope = (space.properties(m + step) - space.properties(m - step)) / 0.5
            assert slope == pytest.approx(space.directions[:, k], rel=1e-9, abs=1e-9)

    def test_random_points_are_within_the_bounds_and_fill_them(self, space):
        generator = np.random.default_rng(2)
        drawn = [space.properties(space.check_guess(space.random(generator)))[: 4 * ELEMENTS] for _ in range(300)]
        factors = (np.array(drawn) / space.given_properties[: 4 * ELEMENTS]).reshape(300, 4, ELEMENTS)
        assert np.abs(factors[:, 3] - 1).max() <= 0.1  # modulus
        assert np.abs(factors[:, 1] - 1).max() <= 0.05
        assert 0.15 < np.abs(factors[:, 0] - 1).max() <= 0.2
        assert (factors[:, 2] == 1).all()

    def test_bounds_that_are_reached_are_named(self, space):
        m = space.standard.copy()
        m[0], m[2], m[7] = 1.1, 0.95, 0.2
        assert space.at_bound(m) == (
            "elastic_modulus", "thickness[2]", *(f"width[{i}]" for i in range(1, 7))
        )  # fmt: skip

    def test_constants_and_tapers_are_polynomials(self, beam):
        """Two terms are a linear taper exactly; all terms are any thickness."""
        shape = Smooth("thickness", terms=2).shape(ELEMENTS)
        assert np.diff(shape @ [0.3, 0.2]) == pytest.approx(np.full(ELEMENTS - 1, 0.2 * 2 / ELEMENTS))
        assert np.linalg.matrix_rank(Smooth("thickness", terms=ELEMENTS).shape(ELEMENTS)) == ELEMENTS


class TestPreference:
    def test_least_change_is_the_mean_square_along_the_beam(self, space):
        """c int (f - 1)^2 dx, with c = 1 for the modulus and the smooth width and 20 for elements."""
        change = np.random.default_rng(3).standard_normal(space.size)
        changed = space.properties(space.standard + change)[: 4 * ELEMENTS]
        factors = (changed / space.given_properties[: 4 * ELEMENTS]).reshape(4, ELEMENTS) - 1
        width, thickness, _, modulus = (factors**2).mean(axis=1)
        for weight, matrix in (
            (4.0, LeastChange(weight=4.0).matrix(space, 1e-8)),
            (0.5, LeastChange().matrix(space, 0.5)),
        ):
            assert change @ matrix @ change == pytest.approx(weight * (width + PATCHES * thickness + modulus))

    def test_lumped_properties_count_as_global_ones(self, beam):
        heavy = DesignSpace(
            beam.with_(tip_mass=1e-3), (Global("tip_mass"), Global("density"), Smooth("width", terms=1))
        )
        assert LeastChange(weight=2.0).matrix(heavy, 0.0) == pytest.approx(2.0 * np.eye(3))

    def test_smoothness_depends_on_the_gradient_along_the_beam_only(self, space):
        """A constant costs nothing, one element out of line n 2 d^2, and a linear taper its gradient squared."""
        m = np.zeros(space.size)
        m[0], m[1:7], m[7] = 0.3, 0.2, 0.1  # all constant along the beam
        matrix = Smoothness(weight=2.0).matrix(space, 0.0)
        assert m @ matrix @ m == pytest.approx(0.0, abs=1e-15)
        m[3] += 0.5
        assert m @ matrix @ m == pytest.approx(2.0 * ELEMENTS * 2 * 0.5**2)
        taper = np.zeros(space.size)
        taper[8] = 0.3  # from -0.3 to 0.3
        assert taper @ matrix @ taper == pytest.approx(2.0 * 0.6**2 * (ELEMENTS - 1) / ELEMENTS)


class TestUnusable:
    @pytest.mark.parametrize(
        ("make", "message"),
        [
            (lambda beam: DesignSpace(beam, (Global("tip_mass"),)), "unknowns: the beam has no tip_mass to change"),
            (lambda beam: DesignSpace(beam, (Global("clamp_stiffness"),)), "unknowns: the beam has no clamp_stiffness"),
            (lambda beam: PerElement("tip_mass"), "unknowns: must be one of width, thickness, density, elastic_modul"),
            (lambda beam: DesignSpace(beam, ()), "unknowns: nothing may change"),
            (lambda beam: DesignSpace(beam, (Global("width"), Smooth("width"))), "unknowns: width is given 2 times"),
            (lambda beam: DesignSpace(beam, ("width",)), "unknowns: must be a Global, a PerElement or a Smooth"),
            (lambda beam: DesignSpace(beam, Global("width")), "unknowns: must be a sequence of"),
            (lambda beam: Global("width", relative_bounds=1.5), "unknowns: width: relative_bounds: must be one number"),
            (lambda beam: Smooth("width", terms=0), "unknowns: width: terms: must be a whole number, 1 to"),
            (lambda beam: DesignSpace(beam, (Smooth("width", terms=7),)), "7 terms are more than the 6 elements"),
            (lambda beam: LeastChange(weight=0.0), "preference: weight: must be positive"),
            (lambda beam: Smoothness(weight=float("nan")), "preference: weight: must be a finite number"),
        ],
    )
    def test_unknowns(self, beam, make, message):
        with pytest.raises(InputError, match=message):
            make(beam)

    @pytest.mark.parametrize(
        ("guess", "message"),
        [
            ([1.0] * 3, "guess: needs 10 values, one per unknown, got 3"),
            ([1.0] + [1.06] * 6 + [0.0] * 3, r"between 0\.95 and 1\.05, got 1\.06 for thickness\[1\]"),
            ([1.0] * 7 + [0.15, 0.15, 0.0], r"between 0\.8 and 1\.2, got 1\.275 for width\[6\]"),
            (1.0, "guess: must be a sequence of numbers"),
        ],
    )
    def test_guess(self, space, guess, message):
        with pytest.raises(InputError, match=message):
            space.check_guess(guess)


def test_properties_are_those_of_the_model(space, beam):
    assert space.properties(space.standard)[: 4 * ELEMENTS] == pytest.approx(Model(beam).properties.ravel())
