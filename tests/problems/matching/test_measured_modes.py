"""Measured modes are checked before any computation, and compared independently of their scale."""

import numpy as np
import pytest

from ancf_casadi import Beam, Clamp, InputError, Model, natural_modes
from ancf_casadi.estimation.solver.unknown import Unknown
from problems import MeasuredModes, match_frequencies
from problems.matching.design_space import DesignSpace
from problems.matching.response import Matching

NAN = float("nan")
POINTS = (0.12, 0.2, 0.33, 0.5)
SHAPES = {"points": (0.1, 0.2), "shapes": ((1, 2), (1, 3))}


@pytest.fixture(scope="module")
def beam() -> Beam:
    return Beam.uniform(
        length=0.5, width=5e-3, thickness=0.5e-3, density=8e3, elastic_modulus=210e9, elements=5, axis=(0.3, -1.0)
    )


@pytest.fixture(scope="module")
def matching(beam) -> Matching:
    """Three modes in another order, with disturbed shapes and one missing displacement."""
    modes = natural_modes(Model(beam), count=3)
    shapes = (MeasuredModes((1.0,), None, POINTS, ((1.0,) * 4,)).observer(modes.model) @ modes.shapes).T
    shapes = shapes * (1 + 0.05 * np.random.default_rng(1).standard_normal(shapes.shape))
    shapes[1, 2] = NAN
    order = [2, 0, 1]
    frequencies = modes.frequencies * [1.01, 0.99, 1.02]
    measured = MeasuredModes(
        tuple(frequencies[order]), tuple(1e-3 * frequencies), POINTS, tuple(map(tuple, shapes[order])), (0.2, 0.1, 0.3)
    )
    priors = (Unknown("density", 8e3, prior=(7.9e3, 80.0)),
              Unknown("thickness[2]", 0.5e-3, prior=(0.52e-3, 0.01), relative_prior=True))  # fmt: skip
    return Matching(DesignSpace(beam), measured, priors=priors)


class TestResiduals:
    def test_targets_are_identified_by_their_shapes(self, matching):
        assert matching.numbers.tolist() == [2, 0, 1]
        first = matching.residuals(matching.space.standard) / matching.unit
        assert len(first) == 3 + 3 * 4 - 1 + 2
        relative = matching.standard.frequencies / matching.measured.frequencies - 1
        assert first[:3] == pytest.approx(relative / matching.measured.relative_std, rel=1e-6)

    def test_residual_of_a_shape_is_the_difference_from_the_best_multiple(self, matching):
        """Compared with least squares by numpy, weighted with the deviations."""
        space = matching.space
        shapes = matching.observer @ matching.state(space.standard).shapes
        expected = []
        for psi, v, std in zip(matching.measured.shapes, shapes.T, (0.2, 0.1, 0.3), strict=True):
            is_measured = np.isfinite(psi)
            expected.append(np.array(psi)[is_measured] / std)
            factor = np.linalg.lstsq(v[is_measured, None] / std, expected[-1])[0]
            expected[-1] = expected[-1] - factor * v[is_measured] / std
        residuals = matching.residuals(space.standard)[3:-2] / matching.unit
        assert residuals == pytest.approx(np.concatenate(expected), rel=1e-6, abs=1e-8)

    @pytest.mark.slow
    def test_derivatives_against_differences(self, matching):
        space = matching.space
        rng = np.random.default_rng(3)
        m = 1 + 0.03 * rng.standard_normal(space.size)
        y = rng.standard_normal(len(matching.residuals(m)))
        jacobian, hessian = matching.jacobian(m), matching.curvature(m, y)
        step = 1e-4
        for k in range(space.size):
            ahead, behind = (m + sign * step * np.eye(space.size)[k] for sign in (1, -1))
            first = (matching.residuals(ahead) - matching.residuals(behind)) / (2 * step)
            second = (matching.jacobian(ahead) - matching.jacobian(behind)).T @ y / (2 * step)
            assert first == pytest.approx(jacobian[:, k], abs=3e-6 * np.abs(jacobian).max())
            assert second == pytest.approx(hessian[k], abs=3e-6 * np.abs(hessian).max())

    def test_scale_and_sign_of_a_computed_shape_do_not_matter(self, matching):
        measured = matching.measured
        v = matching.observer @ matching.standard.shapes
        assert measured.mac(-7.0 * v) == pytest.approx(measured.mac(v))
        assert np.diag(measured.mac(v)).min() > 0.95

    @pytest.mark.parametrize("angle", [0.5, np.pi / 2])
    def test_a_turned_clamp_turns_the_measured_displacements(self, matching, beam, angle):
        weightless = beam.with_(gravity=(0.0, 0.0))
        turned = weightless.with_(supports=[Clamp(rotation=angle)])
        straight_shapes, turned_shapes = (
            matching.measured.observer(modes.model) @ modes.shapes
            for modes in (natural_modes(Model(beam), count=2) for beam in (weightless, turned))
        )
        assert turned_shapes == pytest.approx(straight_shapes, rel=1e-6)

    def test_modes_that_do_not_move_the_points_have_no_mac(self, matching):
        assert matching.measured.mac(np.zeros((4, 2))) == pytest.approx(np.zeros((3, 2)))


class TestUnusable:
    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"frequencies": (2.0, 1.0)}, "targets: must be ascending"),
            ({"frequencies": ()}, "targets: needs at least one frequency"),
            ({"frequency_std": 0.0}, "frequency_std: must be positive"),
            ({"frequency_std": (0.1,)}, "frequency_std: has 1 values for 2"),
            ({"points": (0.1, 0.2)}, "shapes: are missing"),
            ({"points": (0.1, 0.2), "shapes": ((1.0, 2.0),)}, "shapes: 1 shapes for 2 frequencies"),
            ({"points": (0.1, 0.2), "shapes": ((1, 2), (1, 2, 3))}, "shapes: shape 2 needs one displacement per point"),
            ({"points": (0.1, 0.2), "shapes": ((1, 2), (1, NAN))}, "shapes: shape 2 needs two measured displacements"),
            ({"points": (0.1, 0.2), "shapes": ((0, 0), (1, 2))}, "shapes: shape 1 needs two measured displacements"),
            ({"points": (0.1, 0.2), "shapes": ((1, "x"), (1, 2))}, "shapes: shape 1 must be numbers"),
            ({"points": 0.1}, "points: must be a sequence of numbers, got 0.1"),
            ({"frequency_std": 1e300}, r"frequency_std: must be within 1e-12 to 1e\+12 times the measured value"),
            (SHAPES | {"shape_std": 0.1}, "frequency_std: is missing"),
            (SHAPES | {"shape_std": 1e-300, "frequency_std": 0.1}, "shape_std: must be within 1e-12"),
            (SHAPES | {"shape_std": -0.1, "frequency_std": 0.1}, "shape_std: must be positive"),
            (SHAPES | {"shape_std": (0.1,), "frequency_std": 0.1}, "shape_std: has 1 values for 2 shapes"),
        ],
    )
    def test_modes(self, arguments, message):
        with pytest.raises(InputError, match=message):
            MeasuredModes(**{"frequencies": (1.0, 2.0), **arguments})

    def test_arrays_are_as_good_as_tuples(self):
        measured_modes = MeasuredModes(
            np.array([1.0, 2.0]),
            frequency_std=np.array(0.1),
            points=np.array([0.1, 0.2]),
            shapes=np.eye(2) + 1,
            shape_std=np.array(0.2),
        )
        tuples = MeasuredModes((1.0, 2.0), 0.1, (0.1, 0.2), ((2.0, 1.0), (1.0, 2.0)), 0.2)
        assert measured_modes == tuples

    def test_points_off_the_beam(self, beam):
        measured = MeasuredModes((1.8,), points=(0.1, 0.6), shapes=((0.1, 1.0),))
        with pytest.raises(InputError, match=r"points: must be on the beam, 0 to 0\.5 m, got 0\.6"):
            match_frequencies(beam, targets=measured)

    def test_a_shape_like_no_mode(self, beam):
        measured = MeasuredModes((1.8,), points=(0.1, 0.11, 0.12), shapes=((1.0, -1.0, 1.0),))
        with pytest.raises(InputError, match=r"shapes: no mode of the beam has the shape of target 1 \(1\.8 Hz\)"):
            match_frequencies(beam, targets=measured)
