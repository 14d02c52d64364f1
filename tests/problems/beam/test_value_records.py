"""Readings of sensors at rest and frequencies: closed forms, derivatives, and refused input."""

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Beam, Clamp, InputError, Model, PointLoad, Sensor, natural_modes
from problems import FrequencyRecord, StaticRecord
from problems.beam.properties import property_owners
from problems.beam.values.records import ValueBlock
from tests.problems.beam.truth import FACTORS, ONES, respond

DOWN, UP = (0.0, -1.0), (0.0, 1.0)


@pytest.fixture(scope="module")
def lying():
    """Factory of a beam along x without gravity; E I = 0.6 N m^2, L = 0.5 m."""

    def make(**changes):
        given = {"length": 0.5, "width": 0.03, "thickness": 1.5e-3, "density": 1500.0, "elements": 10}
        modulus = 0.6 * 12 / (0.03 * 1.5e-3**3)
        return Beam.uniform(
            **{**given, "elastic_modulus": modulus, "axis": (1.0, 0.0), "gravity": (0.0, 0.0), **changes}
        )

    return make


def reading(beam, loads, *sensors, tared=False):
    """Return what sensors read in one case."""
    record = StaticRecord(Model(beam), [loads], np.ones((1, len(sensors))), sensors, tared=tared)
    return respond(record)(ONES)[0]


class TestReadings:
    """Small loads, so that linear beam theory holds to 1e-6."""

    def test_deflection_and_slope_under_a_force_within_the_beam(self, lying):
        """P a^2 (3 s - a)/(6 E I) beyond the load at a, slope P a^2/(2 E I), whatever lies beyond it."""
        a, P = 0.3, 1e-3
        deflection, slope = reading(
            lying(), PointLoad((0.0, -P), point=a), Sensor("displacement", 0.5, DOWN), Sensor("slope", 0.4)
        )
        assert deflection == pytest.approx(P * a**2 * (3 * 0.5 - a) / (6 * 0.6), rel=1e-6)
        assert slope == pytest.approx(-P * a**2 / (2 * 0.6), rel=1e-6)

    def test_deflection_under_a_moment_within_the_beam(self, lying):
        """m a^2/2 E I at the moment, and the slope m a/E I beyond it."""
        a, m = 0.2, 1e-4
        deflection, slope = reading(
            lying(), PointLoad(moment=m, point=a), Sensor("displacement", a, UP), Sensor("slope")
        )
        assert deflection == pytest.approx(m * a**2 / (2 * 0.6), rel=1e-6)
        assert slope == pytest.approx(m * a / 0.6, rel=1e-6)

    @pytest.mark.parametrize(("turn", "rotation"), [(1.02 * np.pi, 0.0), (-1.9 * np.pi, 4.0)])
    def test_a_slope_beyond_half_a_turn_goes_on(self, lying, turn, rotation):
        """m L/E I, with the derivative -m L/E I by the logarithm of the modulus, also from a turned clamp."""
        beam = lying(elements=24, supports=[Clamp(rotation=rotation)])
        record = StaticRecord(Model(beam), [PointLoad(moment=turn * 0.6 / 0.5)], [1.0], Sensor("slope"))
        values, jacobian = record.response(property_owners(beam, ("elastic_modulus",)))(np.ones(1))
        assert values[0] == pytest.approx(rotation + turn, rel=1e-3)
        assert jacobian[0, 0] == pytest.approx(-turn, rel=1e-3)

    def test_an_elastic_clamp_adds_its_rotation(self, lying):
        """P L^3/3 E I + P L^2/k."""
        P, k = 1e-3, 20.0
        (deflection,) = reading(lying(clamp_stiffness=k), PointLoad((0.0, -P)), Sensor("displacement", 0.5, DOWN))
        assert deflection == pytest.approx(P * 0.5**3 / (3 * 0.6) + P * 0.5**2 / k, rel=1e-6)

    def test_readings_of_a_beam_without_unknowns_have_a_jacobian_without_columns(self, lying):
        record = StaticRecord(Model(lying()), [PointLoad((0.0, -0.5))], [0.01], Sensor("displacement", direction=UP))
        values, jacobian = record.response(property_owners(record.model.beam, ()))(np.zeros(0))
        assert values.shape == (1,) and jacobian.shape == (1, 0)

    def test_force_and_strain_follow_from_the_balance_of_forces(self, lying):
        """The clamp carries load and weight; a tip force P and moment m give the strain -h/2 (m + P (L - s))/E I."""
        beam = lying(gravity=(0.0, -9.81), tip_mass=0.01, clamp_stiffness=50.0)
        P, m, s = 0.5, 0.02, 0.25
        (force,) = reading(beam, PointLoad((0.0, -P), m), Sensor("force", direction=UP))
        assert force == pytest.approx(P + 9.81 * (beam.mass + 0.01), rel=1e-9)
        straight = lying(elements=40)
        gauges = Sensor("strain", s), Sensor("strain", s, distance=-2e-3)
        kappa = (1e-4 + 1e-3 * (0.5 - s)) / 0.6
        strains = reading(straight, PointLoad((0.0, 1e-3), 1e-4), *gauges)
        assert strains == pytest.approx([-1.5e-3 / 2 * kappa, 2e-3 * kappa], rel=1e-4)

    def test_the_clamp_moment_of_a_bent_beam_is_that_of_its_loads(self, lying):
        """Force times the lever arm in the bent shape; without weight nothing else acts."""
        x, moment, slope = reading(
            lying(), PointLoad((0.3, -4.0)), Sensor("position"), Sensor("moment"), Sensor("slope")
        )
        y = reading(lying(), PointLoad((0.3, -4.0)), Sensor("position", direction=UP))[0]
        assert moment == pytest.approx(-(x * -4.0 - y * 0.3), rel=1e-8)
        assert slope < -0.5

    def test_displacements_are_changes_from_rest_and_tared_sensors_read_zero_there(self, lying):
        heavy = lying(gravity=(0.0, -9.81))
        sensors = Sensor("displacement", 0.5, DOWN), Sensor("position", 0.5, DOWN), Sensor("slope")
        assert reading(heavy, (), *sensors)[0] == 0.0
        assert reading(heavy, (), *sensors)[1] > 1e-3
        np.testing.assert_array_equal(reading(heavy, (), *sensors, tared=True), 0.0)

    def test_frequencies_are_those_of_the_beam(self, lying):
        model = Model(lying(tip_mass=0.01, clamp_stiffness=30.0))
        record = FrequencyRecord(model, [1.0, 2.0], modes=(1, 3))
        expected = natural_modes(model, count=3).frequencies[[0, 2]]
        np.testing.assert_allclose(respond(record)(ONES)[0], expected, rtol=1e-9)


class TestDerivatives:
    @pytest.fixture(scope="class")
    @staticmethod
    def model(lying):
        return Model(lying(elements=6, gravity=(0.0, -9.81), tip_mass=0.01, clamp_stiffness=30.0))

    @pytest.fixture(scope="class")
    @staticmethod
    def records(model):
        sensors = [
            Sensor("displacement", 0.45, DOWN), Sensor("position", 0.4), Sensor("slope", 0.3), Sensor("strain", 0.2),
            Sensor("force", direction=UP), Sensor("moment"),
        ]  # fmt: skip
        loads = [PointLoad.hung(0.05, 0.45), [PointLoad((0.0, -1.0), 0.2, 0.31), PointLoad((0.3, 0.0))]]
        return StaticRecord(model, loads, np.ones((2, 6)), sensors), FrequencyRecord(model, [1.0, 2.0, 3.0])

    @pytest.mark.slow
    @pytest.mark.parametrize("which", [0, 1])
    def test_derivatives_by_all_properties_agree_with_differences(self, records, which):
        at, step = np.array([1.1, 0.9, 1.2, 0.8, 1.3, 0.7]), 1e-4
        computed = respond(records[which])
        _, jacobian = computed(at)
        differences = [(computed(at + d)[0] - computed(at - d)[0]) / (2 * step) for d in step * np.eye(len(FACTORS))]
        size = np.abs(jacobian).max(axis=1, keepdims=True)
        np.testing.assert_allclose(jacobian / size, np.array(differences).T / size, atol=1e-6)
        assert (np.abs(jacobian).max(axis=0) > 0.0).all()

    @pytest.mark.parametrize("which", [0, 1])
    def test_residuals_are_differentiable_in_named_factors(self, records, which):
        record = records[which]
        x = cs.MX.sym("x", 2)
        block = ValueBlock(record, {"thickness": 2.0, "clamp_stiffness": 1.0})
        r = block.residuals({"thickness": 2.0 * x[0], "clamp_stiffness": x[1], "eta1": cs.MX(3.0)})
        value, forward, reverse = cs.Function("r", [x], [r, cs.jtimes(r, x, cs.DM.eye(2)), cs.jacobian(r, x)])(
            [1.2, 0.7]
        )
        factors = ONES.copy()
        factors[[1, 5]] = 1.2, 0.7
        expected, jacobian = respond(record)(factors)
        np.testing.assert_allclose(value.full().ravel(), expected / record.measured - 1, rtol=1e-12)
        for found in (forward, reverse):
            np.testing.assert_allclose(found.full(), jacobian[:, [1, 5]] / record.measured[:, None], rtol=1e-10)

    def test_the_response_does_not_depend_on_what_was_computed_before(self, records):
        computed = respond(records[0])
        first = computed(ONES)[0]
        computed(3 * ONES)
        np.testing.assert_array_equal(computed(ONES)[0], first)


class TestInput:
    @pytest.fixture(scope="class")
    @staticmethod
    def model(lying):
        return Model(lying())

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"values": [1.0, 2.0]}, r"values: must have the shape \(1, 1\)"),
            ({"values": [np.nan]}, "values: must be finite, or nan"),
            ({"values": [0.0]}, "std: is needed"),
            ({"std": 0.0}, "std: must be positive"),
            ({"sensors": Sensor("velocity")}, "sensors: velocity has no reading at rest"),
            ({"sensors": Sensor("force", frame="body")}, "the direction must be in the laboratory"),
            ({"sensors": Sensor(point=0.6)}, "the point must be on the beam"),
            ({"loads": [PointLoad(point=0.6)]}, "loads: point: 0.6 m is beyond the tip"),
            ({"loads": []}, "loads: must be a sequence"),
            ({"loads": [0.02]}, "loads: must be a PointLoad"),
            ({"loads": PointLoad()}, "loads: must be a sequence"),
        ],
    )
    def test_a_static_record_that_cannot_be_used_is_refused(self, model, changes, message):
        given = {"loads": [PointLoad((0.0, -1.0))], "values": [1.0], "sensors": Sensor(direction=DOWN)}
        with pytest.raises(InputError, match=message):
            StaticRecord(model, **{**given, **changes})

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"frequencies": [1.0, -2.0]}, "frequencies: must be positive"),
            ({"modes": (2, 1)}, "modes: must be 2 ascending numbers"),
            ({"modes": (0, 1)}, "modes: must be a whole number"),
            ({"modes": np.array(1.0)}, "modes: must be numbers of modes, got"),
            ({"std": -1.0}, "std: must be positive"),
        ],
    )
    def test_frequencies_that_cannot_be_used_are_refused(self, model, changes, message):
        with pytest.raises(InputError, match=message):
            FrequencyRecord(model, **{"frequencies": [1.0, 2.0], **changes})

    def test_a_mass_hangs_only_where_gravity_acts(self):
        assert PointLoad.hung(0.1, 0.2) == PointLoad((0.0, -0.1 * 9.81), point=0.2)
        with pytest.raises(InputError, match="gravity: is zero"):
            PointLoad.hung(0.1, gravity=(0.0, 0.0))
        with pytest.raises(InputError, match="mass: must be positive"):
            PointLoad.hung(-0.1)
