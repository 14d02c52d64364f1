"""Amplitudes of a decay over time, read off without the oscillation."""

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import InputError, Measurement, Sensor
from ancf_casadi.decay.closed_forms import friction_envelope, power_envelope, quadratic_envelope
from problems import fit_decay
from problems.decay.amplitudes import is_amplitude_decay
from tests.coverage import covers

TIME, OMEGA = np.linspace(0.0, 20.0, 40), 2 * np.pi * 2.0
COEFFICIENTS = {
    "linear": {"damping_ratio": 0.008},
    "quadratic": {"eta1": 0.1, "eta2": 0.4},
    "friction": {"eta1": 0.1, "eta2": 0.2, "eta0": 0.006},
    "power": {"damping_ratio": 0.008, "exponent": 1.5},
}
NOISE = {"multiplicative": (0.02, 0.0), "additive": (0.0, 1e-4), "both": (0.01, 1e-4)}


def envelope(law):
    """Amplitudes, m, from the closed forms, which start at 0.03."""
    t, c = cs.DM(TIME), COEFFICIENTS[law]
    if law == "linear":
        return 0.03 * np.exp(-c["damping_ratio"] * OMEGA * TIME)
    if law == "power":
        return power_envelope(t, OMEGA, OMEGA * c["damping_ratio"], c["exponent"], 0.03).full().ravel()
    if law == "quadratic":
        return quadratic_envelope(t, OMEGA, c["eta1"], c["eta2"], 0.03).full().ravel()
    return friction_envelope(t, OMEGA, c["eta0"], c["eta1"], c["eta2"], 0.03).full().ravel()


def noisy(law, noise, seed, every=1):
    relative, absolute = NOISE[noise]
    random = np.random.default_rng(seed).normal(size=(2, TIME[::every].size))
    return Measurement(TIME[::every], envelope(law)[::every] * (1 + relative * random[0]) + absolute * random[1])


def fit(record, law, frequency=2.0):
    return fit_decay(record, quantity="amplitude", law=law, frequency=frequency)


@pytest.mark.parametrize("law", COEFFICIENTS)
def test_exact_amplitudes_give_the_coefficients_of_a_decay(law):
    result = fit(Measurement(TIME, envelope(law)), law)
    assert result.estimates["amplitude"] == pytest.approx(0.03, rel=1e-5)
    for name, value in COEFFICIENTS[law].items():
        assert result.estimates[name] == pytest.approx(value, rel=1e-4), name


@pytest.mark.parametrize("law", ["quadratic", "friction"])
def test_rates_need_no_frequency(law):
    result, c = fit(Measurement(TIME, envelope(law)), law, None), COEFFICIENTS[law]
    rates = {"linear_rate": c["eta1"] / 2, "quadratic_rate": 4 * OMEGA * c["eta2"] / (3 * np.pi)}
    if law == "friction":
        rates["friction_rate"] = 2 * c["eta0"] / (np.pi * OMEGA)
    total = sum(rate * 0.03 ** (power - 1) for rate, power in zip(rates.values(), (1, 2, 0), strict=False))
    for name, value in (rates | {"decay_rate": total, "amplitude": 0.03}).items():
        assert result.estimates[name] == pytest.approx(value, rel=2e-3), name
    assert result.units["quadratic_rate"] == "1/(m s)"


def test_the_damping_ratio_is_the_decay_rate_over_the_frequency():
    record = noisy("linear", "multiplicative", 0)
    with_frequency, without = fit(record, "linear"), fit(record, "linear", None)
    rate, ratio = without.estimates["decay_rate"], with_frequency.estimates["damping_ratio"]
    assert rate == pytest.approx(OMEGA * ratio, rel=1e-6)
    assert without.standard_errors["decay_rate"] == pytest.approx(
        OMEGA * with_frequency.standard_errors["damping_ratio"], rel=1e-4
    )


def test_a_fit_of_the_oscillation_agrees():
    time = np.linspace(0.0, 20.0, 4001)
    motion = fit_decay(time, 0.03 * np.exp(-0.1 * time) * np.cos(OMEGA * time))
    read_off = fit(Measurement(TIME, 0.03 * np.exp(-0.1 * TIME)), "linear")
    assert read_off.estimates["damping_ratio"] == pytest.approx(motion.damping_ratio, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("noise", NOISE)
@pytest.mark.parametrize("law", ["linear", "quadratic"])
def test_intervals_cover_under_both_kinds_of_noise(law, noise):
    truth, hits = {"amplitude": 0.03, **COEFFICIENTS[law]}, []
    for seed in range(100):
        intervals = fit(noisy(law, noise, seed), law).intervals()
        hits += [low <= value <= high for value, (low, high) in ((truth[n], intervals[n]) for n in truth)]
    assert covers(sum(hits), len(hits))


@pytest.mark.slow
@pytest.mark.parametrize("law", ["linear", "quadratic"])
def test_intervals_of_few_amplitudes_cover(law):
    """8 amplitudes do not show how their noise depends on the amplitude; without the allowance, 0.927 cover."""
    truth, hits = {"amplitude": 0.03, **COEFFICIENTS[law]}, []
    for noise in NOISE:
        for seed in range(200):
            intervals = fit(noisy(law, noise, seed, every=5), law).intervals()
            hits += [low <= value <= high for value, (low, high) in ((truth[n], intervals[n]) for n in truth)]
    assert 0.93 < np.mean(hits) < 0.97


@pytest.mark.parametrize(("noise", "stated"), [("multiplicative", "multiplicative"), ("additive", "of both kinds")])
def test_the_report_states_which_noise_is_assumed(noise, stated):
    result = fit(noisy("linear", noise, 2), "linear")
    assert f"of the last, {stated}" in result.report()
    (record,) = result.to_dict()["records"]
    assert record["noise"] == stated


def test_weights_follow_the_noise():
    """With additive noise, late amplitudes count less than by their logarithms."""
    errors, logarithmic = [], []
    for seed in range(40):
        record = noisy("linear", "additive", seed)
        errors.append(fit(record, "linear").estimates["damping_ratio"] - 0.008)
        logarithmic.append(-np.polyfit(TIME, np.log(record.values), 1)[0] / OMEGA - 0.008)
    assert np.std(errors) < 0.8 * np.std(logarithmic)


def test_another_record_is_predicted():
    prediction = fit(noisy("linear", "additive", 0), "linear").predict(noisy("linear", "additive", 1))
    (error,) = prediction.rms_errors.values()
    assert error == pytest.approx(1e-4, rel=0.4)


def test_units_are_those_of_the_record():
    volts = Measurement(TIME, 50.0 * envelope("quadratic"), sensor=Sensor("signal", signal_unit="V"))
    result = fit(volts, "quadratic", None)
    assert (result.units["amplitude"], result.units["quadratic_rate"]) == ("V", "1/(V s)")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((TIME, np.cos(TIME)), "record: has the value -0.46221 at 2.05128 s; amplitudes are positive"),
        ((TIME[:4], envelope("linear")[:4]), "record: has 4 amplitudes; a fit needs at least 6"),
    ],
)
def test_unusable_amplitudes_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        fit_decay(*arguments, quantity="amplitude")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"quantity": "amplitude", "law": "smooth"}, "law: "),
        ({"quantity": "amplitude", "rest": "drift"}, "rest: does not go with amplitudes"),
        ({"quantity": "amplitude", "ratio_bounds": (0.0, 0.1)}, "ratio_bounds: does not go with amplitudes"),
        ({"quantity": "amplitude", "frequency": -1.0}, "frequency: "),
        ({"frequency": 2.0}, "frequency: belongs to quantity='amplitude'"),
        ({"quantity": "envelope"}, "quantity: "),
    ],
)
def test_settings_that_do_not_go_together_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        fit_decay(Measurement(TIME, envelope("linear")), **settings)


def test_amplitudes_are_told_from_oscillations():
    decaying = envelope("linear")
    rng = np.random.default_rng(0)
    assert is_amplitude_decay("Envelope (mm)", decaying * (1 + 0.05 * rng.normal(size=40)))
    assert not is_amplitude_decay("tip (mm)", decaying)
    assert not is_amplitude_decay("amplitude", decaying * (1.5 + np.cos(2 * TIME)))
    assert not is_amplitude_decay("amplitude", decaying[::-1])
    assert not is_amplitude_decay("amplitude", decaying - decaying.mean())
