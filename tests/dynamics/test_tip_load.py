"""Force and moment at the tip against closed forms, statics and the linear response of the model."""

import casadi as cs
import numpy as np
import pytest
import scipy.linalg
from scipy.integrate import trapezoid
from scipy.interpolate import PchipInterpolator

from ancf_casadi import (
    HarmonicBase,
    HarmonicLoad,
    InputError,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    SampledLoad,
    motion,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.mechanics.state import State

BOTH = pytest.mark.parametrize("method", ["idas", "radau"])
SMALL = 5e-4  # m, a thousandth of the length
ACROSS, TURN = -4, -2  # displacement and slope of the hanging beam's tip across its axis, in the nodal coordinates


def constant(force, until, moment=0.0):
    return SampledLoad([0.0, until], [force, force], [moment, moment])


def half_sine(force, begin, duration, samples=101):
    """A blow along x, with a second of rest before and after it in the record."""
    phase = np.linspace(0.0, np.pi, samples)
    time = np.concatenate([[begin - 1.0], begin + duration * phase / np.pi, [begin + duration + 1.0]])
    return SampledLoad(time, np.outer(np.concatenate([[0.0], force * np.sin(phase), [0.0]]), [1.0, 0.0]))


class Linear:
    """The free coordinates of a hanging beam in small motion about rest."""

    def __init__(self, model, damping=None):
        self.rest, self.free = static_equilibrium(model), slice(4, model.size)
        self.K = self.rest.stiffness.toarray()
        self.M = model.mass(model.properties).full()[self.free, self.free]
        squares, self.shapes = scipy.linalg.eigh(self.K, self.M)
        self.omega = np.sqrt(squares)
        self.C = np.zeros_like(self.K)
        if damping is not None:
            modes, ratios = damping
            P = self.M @ modes.shapes[self.free, : len(ratios)]
            self.C = P @ np.diag(2 * np.array(ratios) * modes.angular_frequencies[: len(ratios)]) @ P.T

    def unit(self, place):
        return np.eye(len(self.K))[place]

    def response(self, force, frequency):
        """Return the complex amplitudes of all free coordinates under a harmonic generalized force."""
        s = 2 * np.pi * frequency
        return np.linalg.solve(self.K - s**2 * self.M + 1j * s * self.C, force)

    def sum_over_modes(self, times, histories):
        """Return the tip's displacement from the function of time that multiplies phi^2 in each mode."""
        return sum(phi**2 * histories(omega, times) for phi, omega in zip(self.shapes[ACROSS], self.omega, strict=True))


@pytest.fixture(scope="module")
def linear(small):
    return Linear(small)


# ----------------------------------------------------------------------------------------------------- small motion


@pytest.mark.slow
@BOTH
def test_a_sudden_force_swings_the_tip_about_the_deflected_equilibrium_as_the_modes_say(small, linear, method):
    """x(t) = sum phi^2 F (1 - cos omega t)/omega^2; mode 1 has 97 % of the deflection, and swings to twice of that."""
    force = SMALL / np.linalg.inv(linear.K)[ACROSS, ACROSS]
    run = simulate(
        small, load=constant((force, 0.0), 10.0), start=linear.rest, duration=0.6, sample_rate=500.0, method=method
    )
    expected = force * linear.sum_over_modes(run.time, lambda w, t: (1 - np.cos(w * t)) / w**2)
    assert abs(run.tip[:, 0] - expected).max() < 2e-4 * SMALL
    share = linear.shapes[ACROSS, 0] ** 2 / linear.omega[0] ** 2 * force / SMALL
    assert 0.95 < share < 0.99
    modes = natural_modes(small, count=1)
    swing = modes.modal_coordinate(run.coordinates, 0)
    assert swing.max() == pytest.approx(2 * share * SMALL, rel=1e-3)
    deflected = static_equilibrium(small, tip_force=(force, 0.0))
    assert swing.mean() == pytest.approx(modes.modal_coordinate(deflected.coordinates, 0), rel=0.2)


@pytest.mark.parametrize(
    ("component", "ratio"),
    [("force", 0.005), ("moment", 0.97), ("force", 1.0), ("moment", 3.0), ("force", 5.5), ("moment", 0.01)],
)
def test_a_harmonic_load_has_the_linear_response_of_the_model_under_modal_damping(small, component, ratio):
    """Start in the steady state, and compare the amplitude and phase of all of it: |X| to 1e-4."""
    ratios = (0.02, 0.01, 0.015)
    modes = natural_modes(small, count=3)
    linear = Linear(small, (modes, ratios))
    frequency = ratio * float(modes.frequencies[0])
    place = ACROSS if component == "force" else TURN
    X = linear.response(linear.unit(place), frequency)
    amplitude = SMALL / abs(X[ACROSS])
    X *= amplitude
    loads = {"force": ((amplitude, 0.0), 0.0), "moment": ((0.0, 0.0), amplitude)}
    force, moment = loads[component]
    phasor = np.concatenate([np.zeros(4), X])
    start = State(linear.rest.coordinates + phasor.imag, (2j * np.pi * frequency * phasor).imag)
    run = simulate(
        small,
        damping=ModalDamping(modes, ratios),
        load=HarmonicLoad(force, frequency, moment),
        start=start,
        duration=min(1.0 / frequency, 2.0),
        sample_rate=25 * max(frequency, 1.0),
        tolerance=2e-8,
        method="radau",
    )
    expected = np.imag(np.outer(np.exp(2j * np.pi * frequency * run.time), phasor[[-4]]))[:, 0]
    assert abs(expected).max() > 0.1 * SMALL
    assert abs(run.tip[:, 0] - expected).max() < 1e-4 * SMALL


def test_a_ramped_load_grows_smoothly_to_the_steady_one_and_ends_with_it():
    steady, load = (HarmonicLoad((3.0, 1.0), 2.0, 0.5, stop=4.0, ramp=ramp) for ramp in (0.0, 5.0))
    t = np.linspace(0.01, 2.49, 100)
    share = load.values(t) / steady.values(t)
    s = t / 2.5
    np.testing.assert_allclose(share, np.outer(s**3 * (10 - 15 * s + 6 * s**2), np.ones(3)), rtol=1e-12)
    later = np.linspace(2.5, 5.0, 100)
    np.testing.assert_array_equal(load.values(later), steady.values(later))


@pytest.mark.slow
@BOTH
def test_a_short_blow_gives_the_sum_of_the_modal_impulse_responses(small, linear, method):
    """A half sine of duration T acts on a mode as the impulse 2 F cos(omega T/2) (pi/T)/((pi/T)^2 - omega^2) in T/2."""
    T, begin, rate = 4e-3, 0.25, 500.0

    def history(omega, t):
        impulse = 2 * np.cos(omega * T / 2) * (np.pi / T) / ((np.pi / T) ** 2 - omega**2)
        return impulse * np.sin(omega * (t - begin - T / 2)) / omega

    after = np.arange(1001) / rate > begin + T
    unit = linear.sum_over_modes(np.arange(1001) / rate, history)
    force = SMALL / abs(unit[after]).max()
    settings = {"load": half_sine(force, begin, T), "duration": 2.0, "sample_rate": rate, "method": method}
    run = simulate(small, **settings)
    assert abs(run.tip[run.time <= begin, 0]).max() < 1e-6 * SMALL
    assert abs(run.tip[after, 0] - force * unit[after]).max() < 1e-3 * SMALL


# ------------------------------------------------------------------------------------------------------ large motion


def test_a_beam_starts_at_rest_under_the_load_and_the_clamp_carries_load_and_weight(small):
    """Force and moment bend it by 0.4 rad; the clamp's force and moment follow from statics."""
    force, moment = (0.02, 0.03), 4e-3
    rest = static_equilibrium(small, tip_force=force, tip_moment=moment)
    run = simulate(small, load=constant(force, 10.0, moment), duration=0.05, sample_rate=200.0, method="radau")
    assert abs(rest.tip_angle + np.pi / 2) > 0.4
    assert abs(run.coordinates - rest.coordinates).max() < 1e-9
    weight = np.array([0.0, -9.81 * small.beam.mass])
    np.testing.assert_allclose(run.clamp_force[:, :2], np.tile(-weight - force, (11, 1)), rtol=1e-6, atol=1e-9)
    n = np.array([1.0, 0.0])  # a slope (0, -1), turned by 90 degrees
    arc = np.linspace(0.0, 0.5, 2001)
    lever = trapezoid([rest.position(s)[0] for s in arc], arc) / 0.5
    expected = -(rest.tip[0] * force[1] - rest.tip[1] * force[0]) - moment - lever * weight[1]
    np.testing.assert_allclose(run.clamp_force[:, 2:] @ n, expected, rtol=1e-5)
    np.testing.assert_allclose(run.tip_force, np.tile(force, (11, 1)), rtol=1e-12)
    np.testing.assert_allclose(run.tip_moment, moment, rtol=1e-12)


@pytest.mark.parametrize("clamp_stiffness", [np.inf, 0.5])
def test_a_slowly_applied_force_and_moment_lead_to_the_static_equilibrium(paper_beam, clamp_stiffness):
    model = Model(paper_beam(6, clamp_stiffness=clamp_stiffness, tip_mass=2e-3))
    force, moment = (0.02, -0.01), 5e-3
    rest = static_equilibrium(model, tip_force=force, tip_moment=moment)
    load = SampledLoad([0.0, 4.0, 20.0], [(0.0, 0.0), force, force], [0.0, moment, moment])
    law = RayleighDamping(alpha=8.0)
    run = simulate(model, damping=law, load=load, duration=12.0, sample_rate=10.0, method="radau")
    assert np.linalg.norm(run.tip[-1] - run.tip[0]) > 0.08
    assert abs(run.coordinates[-1] - rest.coordinates).max() < 1e-7


@pytest.fixture(scope="module", params=["idas", "radau"])
def shaken(request, small):
    """A damped beam on a moving base, under a force and a moment that end between two samples; with its integrator."""
    law = RayleighDamping(0.2, 1e-4) + QuadraticDamping(0.1, 0.5)
    base, load = HarmonicBase(20e-3, 1.85, stop=0.3), HarmonicLoad((0.02, 0.01), 3.0, moment=2e-3, stop=0.4123)
    settings = {"damping": law, "base": base, "load": load, "sample_rate": 970.0, "method": request.param}
    return simulate(small, duration=0.6, tolerance=1e-9 if request.param == "idas" else 1e-8, **settings), settings


@pytest.mark.slow
def test_work_of_base_and_load_and_energy_lost_account_for_the_change_of_energy(shaken):
    """Across the end of the load, too; the load's work is the integral of its power."""
    run, settings = shaken
    scale = np.ptp(run.energy)
    assert np.ptp(run.tip[:, 0]) > 0.1
    for part in (run.base_work, run.load_work):
        assert np.ptp(part) > 0.1 * scale
    assert run.dissipated_energy[-1] > 1e-3 * scale
    assert abs(run.balance_error).max() < (1e-4 if settings["method"] == "idas" else 1e-7) * scale
    slope, rate = run.coordinates[:, -2:], run.velocities[:, -2:]
    spin = (slope[:, 0] * rate[:, 1] - slope[:, 1] * rate[:, 0]) / (slope**2).sum(axis=1)
    power = (run.tip_force * run.velocities[:, -4:-2]).sum(axis=1) + run.tip_moment * spin
    loaded = run.time < 0.4123
    assert trapezoid(power[loaded], run.time[loaded]) == pytest.approx(run.load_work[loaded][-1], abs=1e-3 * scale)
    assert not run.tip_load[~loaded].any()
    assert np.ptp(run.load_work[~loaded]) == 0.0


@pytest.mark.slow
def test_a_run_continues_from_any_sample_under_the_same_load(shaken, small):
    run, settings = shaken
    for index in (150, 400):  # before and after the end of the load
        rest = simulate(small, start=run.state(index), duration=0.6 - run.time[index], tolerance=1e-9, **settings)
        assert rest.time[0] == run.time[index]
        assert abs(rest.tip - run.tip[index:]).max() < 1e-5
        assert abs(rest.tip_load - run.tip_load[index:]).max() < 1e-12


@pytest.mark.slow
@BOTH
def test_a_load_that_ends_releases_the_beam_between_two_samples(small, method):
    """The same as a run that starts released, at the equilibrium under the load."""
    force, end = (0.02, 0.0), 0.1055
    run = simulate(small, load=constant(force, end), duration=0.2, sample_rate=1000.0, method=method)
    rest = static_equilibrium(small, tip_force=force)
    free = simulate(small, start=rest, duration=0.1, sample_rate=2000.0, method=method)
    assert np.ptp(run.tip[:, 0]) > 0.03
    assert abs(run.tip[106:] - free.tip[1::2][:95]).max() < 1e-6


# --------------------------------------------------------------------------------------------------- sampled loads


def test_a_record_that_never_rests_is_one_piece():
    """White noise has many blows; before and after it there is no load."""
    load = SampledLoad(np.arange(50_000) / 1000, np.random.default_rng(2).normal(size=(50_000, 2)))
    assert [piece.end for piece in load.pieces()] == [0.0, 49.999, np.inf]


def test_a_sampled_load_passes_through_its_samples_and_stays_between_them():
    random = np.random.default_rng(1)
    time = 0.1 + np.cumsum(random.uniform(1e-4, 2e-3, size=200))
    force, moment = random.normal(size=(200, 2)) * 1e-4, random.normal(size=200) * 1e-6
    load = SampledLoad(time, force, moment)
    np.testing.assert_allclose(load.values(time[1:-1]), np.column_stack([force, moment])[1:-1], rtol=1e-9, atol=1e-15)
    fine = np.linspace(time[0], time[-1], 5001)[1:-1]
    expected = PchipInterpolator(time, np.column_stack([force, moment]))(fine)
    np.testing.assert_allclose(load.values(fine), expected, rtol=1e-9, atol=1e-15)
    assert not load.values(np.array([0.0, 0.09, time[-1] + 1e-3, 0.99])).any()
    for k in (0, 100, 198):
        np.testing.assert_allclose(load.values(time[[k]]), load.values(time)[[k]], rtol=1e-9, atol=1e-15)
    assert not load.values(np.array([time[-1] + 1.0])).any()


@pytest.mark.slow
@BOTH
def test_no_blow_is_stepped_over_however_short_weak_and_late_it_is(small, method):
    """Two blows of 1 ms in a record of 20 s, the second a fifth of the first: the work is that of the impulses."""
    time = np.arange(0.0, 20.0, 1e-4)
    force = np.zeros(time.size)
    for begin, most in ((7.3, 0.05), (15.0, 0.01)):
        inside = (time >= begin) & (time <= begin + 1e-3)
        force[inside] = most * np.sin(np.pi * (time[inside] - begin) / 1e-3)
    law = RayleighDamping(alpha=4.0, beta=1e-3)
    load = SampledLoad(time, np.outer(force, [1.0, 0.0]))
    run = simulate(small, damping=law, load=load, duration=16.0, sample_rate=100.0, method=method)
    work = run.load_work[[730, 740, 1500, 1510]]
    assert work[0] == pytest.approx(0.0, abs=1e-3 * work[1])
    assert work[3] - work[2] == pytest.approx(0.04 * work[1], rel=0.02)


# ----------------------------------------------------------------------------------------------------- derivatives


@pytest.mark.slow
def test_a_differentiable_motion_carries_the_load(rubber):
    """Force, moment, a blow and an end; forward and reverse derivatives against differences at 1e-10."""
    time = [0.0, 0.03, 0.05, 0.06, 0.07, 0.12]
    force = np.outer([1.0, 1.0, 1.5, 6.0, 1.5, 1.0], [1.0, -0.5])
    load = SampledLoad(time, force, moment=[0.2, 0.2, 0.1, 0.0, -0.1, -0.2])
    law, base = RayleighDamping(alpha=0.6), HarmonicBase(0.01, 3.0)
    settings = {"damping": law, "base": base, "load": load, "duration": 0.15, "sample_rate": 100.0}
    function, tight = (motion(rubber, tolerance=tolerance, **settings) for tolerance in (1e-8, 1e-10))
    run = simulate(rubber, method="radau", tolerance=1e-8, **settings)
    at = [np.array([0.6]), np.array([0.01]), rubber.properties]
    assert np.ptp(run.tip[:, 0]) > 0.02
    assert abs(function(*at).full().T - run.coordinates).max() < 1e-7
    symbols = [cs.MX.sym(name, *function.size_in(k)) for k, name in enumerate("abc")]
    tip = cs.vec(function(*symbols)[-4:-2, :])
    weights = np.random.default_rng(3).normal(size=tip.numel())
    directions = [(0, at[0]), (1, at[1]), (2, at[2] * np.eye(4)[:, [3]])]
    for k, direction in directions:
        moved = [[x + sign * 1e-4 * direction if j == k else x for j, x in enumerate(at)] for sign in (1, -1)]
        ends = [tight(*values).full() for values in moved]
        expected = ((ends[0] - ends[1]) / 2e-4)[-4:-2].ravel(order="F")
        forward = cs.Function("f", symbols, [cs.jtimes(tip, symbols[k], cs.DM(direction))])(*at).full().ravel()
        back = cs.Function("r", symbols, [cs.jtimes(tip, symbols[k], cs.DM(weights), True)])(*at).full()
        assert abs(expected).max() > 1e-5
        assert abs(forward - expected).max() < 1e-3 * abs(expected).max()
        assert (back * direction).sum() == pytest.approx(weights @ forward, rel=1e-8)


# ---------------------------------------------------------------------------------------------------------- misuse


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: HarmonicLoad((1.0, np.nan), 3.0), "force: "),
        (lambda: HarmonicLoad((1.0, 0.0), -3.0), "frequency: must be positive"),
        (lambda: HarmonicLoad((1.0, 0.0), 3.0, moment="much"), "moment: "),
        (lambda: HarmonicLoad((1.0, 0.0), 3.0, stop=0.0), "stop: must be positive"),
        (lambda: HarmonicLoad((1.0, 0.0), 3.0, ramp=-1.0), "ramp: must be positive"),
        (lambda: HarmonicLoad((1.0, 0.0), 2.0, stop=1.0, ramp=3.0), "ramp: lasts until 1.5 s, after the stop at 1 s"),
        (lambda: HarmonicLoad((1e300, 0.0), 3.0), "force: 1e\\+300 is not within .*; check the unit"),
        (lambda: SampledLoad([0.0, 5e-324, 1.0], np.ones((3, 2))), "time: .* is not within"),
        (lambda: SampledLoad([0.0, 1.0], np.ones((2, 2)), [0.0, 1e-320]), "moment: .* is not within"),
        (lambda: SampledLoad([0.0], [[1.0, 0.0]]), "time: needs at least 2 instants"),
        (lambda: SampledLoad([0.0, 0.0], np.ones((2, 2))), "time: must increase"),
        (lambda: SampledLoad([0.0, 1.0], [1.0, 0.0]), r"force: must have the shape \(2, 2\), got \(2,\)"),
        (lambda: SampledLoad([0.0, 1.0], np.ones((2, 2)), [1.0]), r"moment: must have the shape \(2,\), got \(1,\)"),
    ],
)
def test_an_unusable_load_is_refused_in_one_line(make, message):
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_load_of_another_type_or_after_the_motion_is_refused(small):
    with pytest.raises(InputError, match="load: "):
        simulate(small, duration=0.1, load=(1.0, 0.0))
    late = SampledLoad([100.0, 101.0], np.ones((2, 2)))
    with pytest.raises(InputError, match=r"load: begins at 100 s, after the end of the motion at 0\.1 s"):
        simulate(small, duration=0.1, load=late)
