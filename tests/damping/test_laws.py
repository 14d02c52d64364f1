"""Damping ratios by three routes: the formula of the law, complex eigenvalues, and a decay simulated by IDAS."""

import re
import warnings
from dataclasses import dataclass

import casadi as cs
import numpy as np
import pytest
import scipy.linalg
from scipy.optimize import least_squares

from ancf_casadi import (
    DampingLaw,
    FrictionDamping,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    Parameter,
    QuadraticDamping,
    RayleighDamping,
    State,
    damped_modes,
    natural_modes,
    simulate,
)
from ancf_casadi.damping import SumOfLaws

NUMERICAL_DAMPING = 2e-5
ALPHA, BETA, ETA0, ETA1, ETA2 = 0.2, 2e-4, 0.3, 0.15, 5.0
RATIOS = (0.010, 0.005)


def reference(beta):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return RayleighDamping(beta=beta, stiffness="reference")


# Each law as a function of the modes and of a factor on all its coefficients.
OBJECTIVE = {
    "mass": lambda modes, k: RayleighDamping(alpha=k * ALPHA),
    "strain-rate": lambda modes, k: RayleighDamping(beta=k * BETA),
    "tangent": lambda modes, k: RayleighDamping(beta=k * BETA, stiffness="tangent"),
    "Rayleigh": lambda modes, k: RayleighDamping(k * ALPHA, k * BETA),
    "air, linear": lambda modes, k: QuadraticDamping(eta1=k * ETA1),
    "friction, creeping": lambda modes, k: FrictionDamping(eta0=k * ETA0, smoothing_speed=1.0),
    "generic": lambda modes, k: ModalDamping(modes, [k * zeta for zeta in RATIOS]),
    "generic + Rayleigh + air": lambda modes, k: (
        ModalDamping(modes, [k * zeta for zeta in RATIOS])
        + RayleighDamping(k * ALPHA, k * BETA)
        + QuadraticDamping(eta1=k * ETA1)
    ),
}
LINEAR = OBJECTIVE | {"reference": lambda modes, k: reference(k * BETA)}


@pytest.fixture(scope="module")
def modes(paper_beam):
    """Modes of a weightless beam of four elements, along -y."""
    return natural_modes(Model(paper_beam(4, gravity=(0.0, 0.0))), count=5)


@pytest.fixture(scope="module")
def hanging_modes(paper_beam):
    return natural_modes(Model(paper_beam(8)), count=5)


def force(law, model, e, e_t):
    """Damping force as numbers."""
    x, v = cs.MX.sym("e", model.size), cs.MX.sym("e_t", model.size)
    return cs.Function("force", [x, v], [law.force(model, x, v)])(e, e_t).full().ravel()


def damping_matrix(law, modes):
    """Jacobian of the damping force with respect to the velocities, at rest."""
    model = modes.model
    e, e_t = cs.MX.sym("e", model.size), cs.MX.sym("e_t", model.size)
    jacobian = cs.Function("C", [e, e_t], [cs.jacobian(law.force(model, e, e_t), e_t)])
    return jacobian(modes.equilibrium.coordinates, np.zeros(model.size)).full()


def eigenvalue_ratios(law, modes):
    """Damping ratios -Re s/|s| of the lowest oscillating modes, from s^2 M + s C + K about the equilibrium.

    Eigenvalues of the inverse, in units of the first natural frequency: the low modes are its largest.
    """
    model, free, omega = modes.model, slice(4, modes.model.size), modes.angular_frequencies[0]
    mass, C = model.mass(model.properties).full()[free, free], damping_matrix(law, modes)[free, free]
    K = modes.equilibrium.stiffness.toarray()
    size = len(K)
    inverse = np.block(
        [
            [-omega * np.linalg.solve(K, C), -(omega**2) * np.linalg.solve(K, mass)],
            [np.eye(size), np.zeros((size, size))],
        ]
    )
    s = 1 / scipy.linalg.eigvals(inverse)
    oscillating = s[s.imag > 1e-3]
    lowest = oscillating[np.argsort(abs(oscillating))][: modes.count]
    return -lowest.real / abs(lowest)


def swing(modes, law, amplitudes, duration, **settings):
    """Simulate a straight beam that starts with the velocity of its first modes; return time and modal coordinates.

    The amplitudes are 1e-3 of the length, so the tolerance is a tenth of the default.
    """
    shapes = modes.shapes[:, : len(amplitudes)] / modes.tip_amplitudes()[: len(amplitudes)]
    start = State(modes.equilibrium.coordinates, shapes @ (modes.angular_frequencies[: len(amplitudes)] * amplitudes))
    run = simulate(modes.model, damping=law, start=start, duration=duration, **{"tolerance": 1e-9} | settings)
    return run.time, [modes.modal_coordinate(run.coordinates, mode) for mode in range(len(amplitudes))]


def fitted(time, displacement, omega, envelope, guess):
    """Fit the parameter of the envelope (parameter, omega t) of a decay, with free phase and frequency."""
    scale = abs(displacement).max()

    def residuals(x):
        swing = x[2] * np.cos(x[1] * omega * time) + x[3] * np.sin(x[1] * omega * time)
        return envelope(x[0], omega * time) * swing - displacement / scale

    return least_squares(residuals, [guess, 1.0, 0.0, 1.0], xtol=1e-14, ftol=1e-14, gtol=1e-14).x[0]


def simulated_ratios(law, modes, amplitudes=(1e-3, 2e-4), duration=0.95, **settings):
    """Damping ratios of the exponentials that fit a simulated decay."""
    time, displacements = swing(modes, law, amplitudes, duration, **settings)
    return np.array(
        [
            fitted(time, x, omega, lambda zeta, phase: np.exp(-zeta * phase), 0.005)
            for x, omega in zip(displacements, modes.angular_frequencies, strict=False)
        ]
    )


@pytest.mark.parametrize("law", LINEAR.values(), ids=LINEAR)
@pytest.mark.parametrize("gravity", [False, True], ids=["weightless", "hanging"])
def test_a_laws_ratios_are_those_of_the_complex_eigenvalues_of_the_linearised_beam(modes, hanging_modes, law, gravity):
    about = hanging_modes if gravity else modes
    predicted = law(about, 1.0).damping_ratios(about, np.zeros(about.count))
    assert predicted[:2].min() > 40 * NUMERICAL_DAMPING
    np.testing.assert_allclose(eigenvalue_ratios(law(about, 1.0), about), predicted, rtol=2e-4, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("law", OBJECTIVE.values(), ids=OBJECTIVE)
def test_a_simulated_decay_has_the_ratios_that_the_law_predicts(modes, law):
    predicted = law(modes, 1.0).damping_ratios(modes, np.zeros(5))[:2]
    measured = simulated_ratios(law(modes, 1.0), modes)
    assert predicted.min() > 50 * NUMERICAL_DAMPING
    np.testing.assert_allclose(measured, predicted, rtol=2e-3, atol=NUMERICAL_DAMPING / 4)


@pytest.mark.slow
@pytest.mark.parametrize("law", OBJECTIVE.values(), ids=OBJECTIVE)
def test_with_zero_coefficients_a_law_does_not_damp(modes, law):
    assert not force(law(modes, 0.0), modes.model, modes.equilibrium.coordinates, np.ones(modes.model.size)).any()
    assert abs(simulated_ratios(law(modes, 0.0), modes)).max() < NUMERICAL_DAMPING


@pytest.mark.slow
def test_damping_by_the_reference_stiffness_has_the_predicted_ratio_in_very_small_motion_only(modes):
    """The axial part resists the rotation of elements: at 0.2 % of the length the ratio more than doubles."""
    law = reference(2e-3)
    predicted = law.damping_ratios(modes, np.zeros(5))[0]
    tiny = simulated_ratios(law, modes, amplitudes=(1e-5,), duration=0.7, tolerance=1e-11)[0]
    small = simulated_ratios(law, modes, amplitudes=(1e-3,), duration=0.7)[0]
    assert predicted > 0.01
    assert tiny == pytest.approx(predicted, rel=2e-3)
    assert small > 2 * predicted


@pytest.mark.slow
@pytest.mark.parametrize("mode", [0, 1])
@pytest.mark.parametrize("amplitude", [1e-3, 2e-3])
def test_quadratic_air_drag_gives_a_simulated_decay_whose_ratio_is_proportional_to_its_amplitude(
    modes, mode, amplitude
):
    """From dA/dt = -zeta(A) omega A with zeta = k A: A = A0/(1 + k A0 omega t)."""
    law, periods = QuadraticDamping(eta2=ETA2), 2.5
    amplitudes = np.zeros(mode + 1)
    amplitudes[mode] = amplitude
    time, displacements = swing(modes, law, amplitudes, periods / modes.frequencies[mode], sample_rate=4000.0)
    predicted = law.damping_ratios(modes, np.full(5, amplitude))[mode]
    measured = fitted(
        time, displacements[mode], modes.angular_frequencies[mode], lambda kA, phase: 1 / (1 + kA * phase), 0.0
    )
    assert predicted > 50 * NUMERICAL_DAMPING
    assert measured == pytest.approx(predicted, rel=0.01)


def test_without_a_coefficient_a_decay_has_no_ratio_that_grows_with_amplitude(modes):
    time, (displacement,) = swing(modes, QuadraticDamping(eta2=0.0), (2e-3,), 0.95)
    measured = fitted(time, displacement, modes.angular_frequencies[0], lambda kA, phase: 1 / (1 + kA * phase), 0.0)
    assert abs(measured) < NUMERICAL_DAMPING


def test_drag_takes_as_much_energy_in_a_period_as_its_equivalent_viscous_ratio(modes):
    """The loss is 4 pi zeta times the energy of the oscillation at its mean square amplitude."""
    law, omega, amplitude = QuadraticDamping(eta1=ETA1, eta2=ETA2), modes.angular_frequencies[0], 2e-3
    shape = modes.shapes[:, 0] / modes.tip_amplitudes()[0]
    start = State(modes.equilibrium.coordinates, omega * amplitude * shape)
    period = 1 / modes.frequencies[0]
    run = simulate(modes.model, damping=law, start=start, duration=period, sample_rate=200 / period)
    mean = np.sqrt((run.energy[0] + run.energy[-1]) / 2 / run.energy[0]) * amplitude
    energy = run.energy[0] * (mean / amplitude) ** 2
    zeta = run.dissipated_energy[-1] / (4 * np.pi * energy)
    assert zeta == pytest.approx(law.damping_ratios(modes, np.full(5, mean))[0], rel=5e-3)


def test_drag_constants_of_the_true_modes_fall_from_0_739_to_0_618(paper_beam):
    """Ratio int |phi|^3/int phi^2 of the exact cantilever modes, by midpoint sums; that of Eq. (21) is 876/1183."""
    exact = np.array([0.738914, 0.647144, 0.632013, 0.622715, 0.617725])
    modes = natural_modes(Model(paper_beam(40, gravity=(0.0, 0.0))), count=5)
    ratios = QuadraticDamping(eta2=1.0).damping_ratios(modes, np.full(5, 0.01))
    np.testing.assert_allclose(ratios * 3 * np.pi / (4 * 0.01) * 876 / 1183, exact, atol=2e-5)


def test_table_4_is_met_when_eta2_is_read_per_millimetre(weightless):
    """Mode 1: eta1 0.15 1/s leaves 1.00 - 0.6452 % to eta2 = 0.11 1/m at a tip amplitude of 76 mm."""
    modes = natural_modes(weightless, count=1)
    assert QuadraticDamping(eta2=0.11).damping_ratios(modes, [0.076])[0] == pytest.approx(0.0100 - 0.006452, rel=5e-3)


def test_the_drag_coefficients_of_table_4_give_its_eta2(paper_beam):
    """Cd = 2 rho h eta2 (1183/876)/rho_air, for air of 1.2 kg/m^3."""
    found = [QuadraticDamping.from_drag(cd, 1.2, paper_beam()).eta2 for cd in (0.99, 0.54, 0.45)]
    np.testing.assert_allclose(found, [0.11, 0.06, 0.05], rtol=1e-2)
    assert QuadraticDamping.from_drag(0.99, 1.2, paper_beam(width=9e-3)).eta2 == pytest.approx(found[0])


def test_a_falling_strip_reaches_the_velocity_at_which_its_drag_carries_its_weight(paper_beam):
    """Terminal velocity (2 m g/(rho_air Cd b L))^1/2 of the whole strip, whatever its shape in the law."""
    beam, cd, air = paper_beam(4), 1.7, 1.2
    model = Model(beam)
    velocity = np.sqrt(2 * beam.mass * 9.81 / (air * cd * beam.width[0] * beam.length))
    falling = np.tile([velocity, 0.0, 0.0, 0.0], beam.elements + 1)  # across the beam, which hangs along -y
    drag = force(QuadraticDamping.from_drag(cd, air, beam), model, model.straight, falling)
    assert drag @ falling == pytest.approx(beam.mass * 9.81 * velocity, rel=1e-9)


def test_a_beam_of_varying_thickness_loses_the_energy_that_its_drag_takes(paper_beam):
    """The power of 1/2 rho_air Cd b |v|^3 along a tapered beam in the shape of Eq. (21), by a sum over many points."""
    thickness = tuple(0.5e-3 * np.linspace(1.4, 0.6, 20))
    beam, cd, air = paper_beam(20, thickness=thickness, width=tuple(5e-3 * np.linspace(1.0, 1.5, 20))), 1.0, 1.2
    model, s = Model(beam), (np.arange(20_000) + 0.5) / 20_000
    shape = (6 * s**2 - 4 * s**3 + s**4) / 3
    power = air * cd / 2 * (np.repeat(beam.width, 1000) * shape**3).mean() * beam.length
    nodes = np.linspace(0.0, 1.0, 21)
    swing = np.zeros((21, 4))
    swing[:, 0] = (6 * nodes**2 - 4 * nodes**3 + nodes**4) / 3
    swing[:, 2] = (12 * nodes - 12 * nodes**2 + 4 * nodes**3) / 3 / beam.length
    law = QuadraticDamping.from_drag(cd, air, beam)
    assert swing.ravel() @ force(law, model, model.straight, swing.ravel()) == pytest.approx(power, rel=1e-4)
    assert law.eta2 > 1.2 * QuadraticDamping.from_drag(cd, air, beam.with_(thickness=0.5e-3)).eta2


@pytest.mark.slow
def test_the_first_swing_of_a_simulated_beam_loses_the_energy_of_its_drag(modes):
    """Energy per period (8/3) 1/2 rho_air Cd b omega^2 A^3 int |phi|^3 dp, with phi 1 at the tip."""
    cd, air, amplitude = 40.0, 1.2, 2e-3
    beam, omega = modes.model.beam, modes.angular_frequencies[0]
    shape = modes.shapes[:, 0] / modes.tip_amplitudes()[0]
    points = (np.arange(2000) + 0.5) / 2000 * beam.length
    cubes = np.mean([np.linalg.norm(modes.model.interpolation(s) @ shape) ** 3 for s in points]) * beam.length
    start = State(modes.equilibrium.coordinates, omega * amplitude * shape)
    run = simulate(
        modes.model, damping=QuadraticDamping.from_drag(cd, air, beam), start=start, duration=1 / modes.frequencies[0]
    )
    mean = amplitude * (run.energy[-1] / run.energy[0]) ** 0.25  # geometric mean of the first and last amplitude
    lost = 8 / 3 * air * cd / 2 * beam.width[0] * omega**2 * mean**3 * cubes
    assert run.dissipated_energy[-1] == pytest.approx(lost, rel=0.01)


def test_proportional_ratios_are_alpha_over_2_omega_plus_beta_omega_over_2(modes):
    """Eq. (16)."""
    omega = 2 * np.pi * modes.frequencies
    for stiffness in ("strain-rate", "tangent"):
        ratios = RayleighDamping(0.228181, 3.18013e-5, stiffness).damping_ratios(modes, np.zeros(5))
        np.testing.assert_allclose(ratios, 0.228181 / (2 * omega) + 3.18013e-5 * omega / 2, rtol=1e-8)


@pytest.mark.parametrize("measured", [None, (1.85, 10.19)])
def test_generic_damping_is_the_matrix_of_eq_32(modes, measured):
    model, shapes, zeta = modes.model, modes.shapes[:, :2], np.array(RATIOS)
    mass = model.mass(model.properties).full()
    omega = modes.angular_frequencies[:2] if measured is None else 2 * np.pi * np.array(measured)
    expected = mass @ shapes @ np.diag(2 * zeta * omega) @ shapes.T @ mass
    C = damping_matrix(ModalDamping(modes, RATIOS, frequencies=measured), modes)
    np.testing.assert_allclose(C, expected, atol=1e-14 * abs(expected).max())


def test_generic_damping_uses_the_measured_frequencies_where_given(modes):
    measured = (1.85, 10.19)
    ratios = ModalDamping(modes, RATIOS, frequencies=measured).damping_ratios(modes, np.zeros(5))
    np.testing.assert_allclose(ratios[:2], np.array(RATIOS) * measured / modes.frequencies[:2], rtol=1e-9)


def test_parameters_have_units_and_bounds_and_a_sum_numbers_equal_names(modes):
    law = RayleighDamping(ALPHA, BETA) + (RayleighDamping(beta=2 * BETA) + ModalDamping(modes, RATIOS))
    parameters = [(parameter.name, parameter.value, parameter.unit) for parameter in law.parameters]
    ratios = [("ratio1", RATIOS[0], "1"), ("ratio2", RATIOS[1], "1")]
    assert parameters == [("alpha", ALPHA, "1/s"), ("beta", BETA, "s"), ("beta_2", 2 * BETA, "s"), *ratios]
    assert all(parameter.lower == 0.0 < parameter.value < parameter.upper for parameter in law.parameters)
    assert all(parameter.upper < 1.0 for parameter in law.parameters[3:])
    air = QuadraticDamping(eta1=ETA1)
    nested = SumOfLaws((SumOfLaws((air, air)), air))
    assert [parameter.name for parameter in nested.parameters] == ["eta1", "eta1_2", "eta1_3"]
    changed = nested.with_parameters([1.0, 2.0, 3.0])
    assert [parameter.value for parameter in changed.parameters] == [1.0, 2.0, 3.0]
    with pytest.raises(InputError, match=r"^values: has 2 values for 3 parameters$"):
        nested.with_parameters([1.0, 2.0])


def test_laws_add_up_in_force_and_ratio_in_any_order(modes):
    rng = np.random.default_rng(0)
    model = modes.model
    e, e_t = modes.equilibrium.coordinates + 0.01 * rng.normal(size=model.size), rng.normal(size=model.size)
    laws = [
        ModalDamping(modes, RATIOS),
        QuadraticDamping(ETA1, ETA2),
        RayleighDamping(ALPHA, BETA) + FrictionDamping(0.05),
    ]
    amplitudes = np.full(5, 0.01)
    forces = sum(force(law, model, e, e_t) for law in laws)
    ratios = sum(law.damping_ratios(modes, amplitudes) for law in laws)
    for both in (laws[0] + laws[1] + laws[2], laws[2] + (laws[1] + laws[0])):
        np.testing.assert_allclose(force(both, model, e, e_t), forces, atol=1e-12 * abs(forces).max())
        np.testing.assert_allclose(both.damping_ratios(modes, amplitudes), ratios, rtol=1e-12)
        assert len(both.laws) == 4


def test_a_beam_that_turns_as_a_whole_meets_air_but_no_damping_of_its_stiffness(modes):
    model = modes.model
    turned = (model.straight.reshape(-1, 2) @ np.array([[0.0, 1.0], [-1.0, 0.0]])).ravel()
    rates = (turned.reshape(-1, 2) @ np.array([[0.0, 1.0], [-1.0, 0.0]])).ravel()
    scale = abs(model.tangent_stiffness(turned, model.properties).full()).max()
    for stiffness in ("strain-rate", "tangent"):
        assert abs(force(RayleighDamping(beta=1.0, stiffness=stiffness), model, turned, rates)).max() < 1e-13 * scale
    assert abs(force(reference(1.0), model, turned, rates)).max() > 1e-3 * scale
    assert rates @ force(QuadraticDamping(eta1=1.0), model, turned, rates) == pytest.approx(model.beam.mass * 0.25 / 3)


def test_the_reference_stiffness_warns_that_it_is_not_objective():
    with pytest.warns(UserWarning, match="not objective: it resists large rotations$") as caught:
        RayleighDamping(beta=1e-5, stiffness="reference")
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        RayleighDamping(alpha=1.0, stiffness="reference")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda m: RayleighDamping(alpha=-1.0), "alpha: must not be negative, got -1"),
        (lambda m: RayleighDamping(beta=np.nan), "beta: must be a finite number, got nan"),
        (lambda m: RayleighDamping(stiffness="initial"), "stiffness: must be one of strain-rate, tangent, reference"),
        (lambda m: QuadraticDamping(eta1=-0.1), "eta1: must not be negative, got -0.1"),
        (lambda m: QuadraticDamping(eta2="0.1"), "eta2: must be a finite number, got '0.1'"),
        (lambda m: QuadraticDamping.from_drag(-1, 1.2, m.model.beam), "drag_coefficient: must not be negative, got -1"),
        (lambda m: QuadraticDamping.from_drag(1, 0, m.model.beam), "air_density: must be positive, got 0"),
        (lambda m: QuadraticDamping.from_drag(1, 1.2, m.model), "beam: must be a Beam, got a Model; use model.beam"),
        (lambda m: QuadraticDamping(eta2=0.1).damping_ratios(m, [0.01]), "amplitudes: has 1 values for 5 modes"),
        (lambda m: ModalDamping(m, [0.01] * 6), "ratios: has 6 values for 5 modes"),
        (lambda m: ModalDamping(m, []), "ratios: has 0 values for 5 modes"),
        (lambda m: ModalDamping(m, 0.01), "ratios: must have one value per mode, got 0.01"),
        (lambda m: ModalDamping(m, [0.01, -0.01]), "ratios: a damping ratio must be at least 0 and below 1, got -0.01"),
        (lambda m: ModalDamping(m, [1.0]), "ratios: a damping ratio must be at least 0 and below 1, got 1"),
        (lambda m: ModalDamping(m, [None]), "ratios: must be a finite number, got None"),
        (lambda m: ModalDamping(m, [0.1], frequencies=[1, 2]), "frequencies: has 2 values for 1 ratios"),
        (lambda m: ModalDamping(m, [0.1], frequencies=[0.0]), "frequencies: must be positive"),
        (lambda m: ModalDamping(m, [0.1], frequencies=[np.inf]), "frequencies: must be a finite number, got inf"),
    ],
)
def test_coefficients_that_make_no_sense_are_refused_by_name(modes, make, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        make(modes)


def test_modes_of_another_mesh_are_refused(modes, hanging):
    with pytest.raises(InputError, match=r"^modes: belong to a beam with another number of elements$"):
        simulate(hanging, damping=ModalDamping(modes, RATIOS), duration=0.1)


@pytest.mark.parametrize("fewer", [0, 1])  # with one element less, and a node for the base, there are as many nodes
def test_modes_of_a_beam_with_another_support_at_its_beginning_are_refused(paper_beam, modes, fewer):
    sprung = paper_beam(modes.model.beam.elements - fewer, clamp_stiffness=5.0)
    with pytest.raises(InputError, match="^modes: .*" + ("support at its beginning", "number of elements")[fewer]):
        ModalDamping(modes, RATIOS).projection(Model(sprung))


@dataclass
class Resistance(DampingLaw):
    """Mass-proportional damping as a user may write it: a class that can change, and so has no hash."""

    alpha: float

    @property
    def parameters(self):
        return (Parameter("alpha", self.alpha, "1/s", "mass-proportional damping"),)

    def local_force(self, body, e, e_t, properties, parameters):
        return parameters[0] * body.inertia_force(e_t, properties)

    def damping_ratios(self, modes, amplitudes):
        return self.alpha / (2 * modes.angular_frequencies)


def test_a_law_without_a_hash_damps_a_motion_and_modes(paper_beam):
    small = Model(paper_beam(4))
    settings = {"base": HarmonicBase(amplitude=5e-3, frequency=1.85), "duration": 0.1, "sample_rate": 50.0}
    runs = [simulate(small, damping=law, **settings) for law in (Resistance(2.0), RayleighDamping(alpha=2.0))]
    np.testing.assert_allclose(runs[0].tip, runs[1].tip, rtol=0.0, atol=1e-12)
    ratios = [damped_modes(small, law, count=2).damping_ratios for law in (Resistance(2.0), RayleighDamping(alpha=2.0))]
    np.testing.assert_allclose(ratios[0], ratios[1], rtol=1e-9)
