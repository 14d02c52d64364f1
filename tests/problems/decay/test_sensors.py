"""Decays measured as velocity, acceleration or slope: the model is differentiated, never the record integrated."""

import math
import re

import casadi as cs
import numpy as np
import pytest

from ancf_casadi.decay.envelope import damping_curve
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Sensor
from problems.decay.fitting import fit_decay, fit_decays
from problems.decay.law_curve import law_curve
from problems.decay.laws import DecayModel
from problems.decay.mode_separation import fit_modes

TIME = np.arange(0.0, 6.0, 0.002)
OMEGA, AMPLITUDE, PHASE = 2 * math.pi * 3.0, 0.04, 0.7
DAMPING = {"linear": (0.01,), "quadratic": (0.2, 0.3), "friction": (0.2, 0.2, 0.1), "power": (0.01, 1.5)}
BENDING = {"constant": (), "linear": (-0.5,), "quadratic": (-10.0,)}


def curve(law, frequency_law, sensor, time=TIME):
    model = DecayModel(law, "zero", frequency_law, reference=AMPLITUDE, sensor=sensor)
    x = (OMEGA, *DAMPING[law], *BENDING[frequency_law], AMPLITUDE, PHASE)
    return np.asarray(cs.evalf(model.curve(time, *map(cs.MX, x)))).ravel()


@pytest.mark.parametrize("law", DAMPING)
@pytest.mark.parametrize("frequency_law", BENDING)
def test_velocity_and_acceleration_are_the_derivatives_of_the_displacement(law, frequency_law):
    h = 1e-4
    before, now, after = (curve(law, frequency_law, Sensor(), TIME[100:2000] + shift) for shift in (-h, 0.0, h))
    velocity = curve(law, frequency_law, Sensor("velocity"), TIME[100:2000])
    acceleration = curve(law, frequency_law, Sensor("acceleration"), TIME[100:2000])
    assert abs((after - before) / (2 * h) - velocity).max() < 1e-5 * abs(velocity).max()
    assert abs((after - 2 * now + before) / h**2 - acceleration).max() < 1e-5 * abs(acceleration).max()


@pytest.mark.parametrize("law", ["linear", "quadratic"])
@pytest.mark.parametrize(("quantity", "noise"), [("velocity", 3e-3), ("acceleration", 0.1), ("slope", 2e-4)])
def test_the_law_is_recovered_from_any_sensor(law, quantity, noise):
    """The sensor has a zero of its own."""
    sensor = Sensor(quantity)
    measured = curve(law, "linear", sensor) + 5 * noise + noise * np.random.default_rng(1).standard_normal(len(TIME))
    fit = fit_decay(Measurement(TIME, measured, sensor=sensor), law=law, frequency_law="linear", release_time=0.0)
    truth = {
        "frequency": 3.0 * (1 - 0.5 * AMPLITUDE),
        "amplitude": AMPLITUDE,
        "offset": 5 * noise,
        "frequency_slope": -0.5,
    }
    truth |= {"damping_ratio": 0.01} if law == "linear" else {"eta1": 0.2, "eta2": 0.3}
    for name, value in truth.items():
        assert abs(getattr(fit, name) - value) < 4 * fit.standard_errors[name], name
    assert fit.residual_rms == pytest.approx(noise, rel=0.1)
    assert not any("not noise" in text for text in fit.warnings)


@pytest.mark.slow
def test_the_units_are_those_of_the_sensor():
    shaken = Measurement(TIME, curve("linear", "constant", Sensor("acceleration")), sensor=Sensor("acceleration"))
    fit = fit_decay(shaken, law="quadratic", release_time=0.0)
    assert (fit.units["amplitude"], fit.units["offset"], fit.units["eta2"]) == ("m", "m/s^2", "1/m")
    table = fit.to_dict()
    assert "amplitude_m" in table and "offset" in table and "offset_m" not in table
    assert table["units"]["offset"] == "m/s^2"
    turned = Measurement(TIME, shaken.values, sensor=Sensor("slope"))
    assert fit_decay(turned, law="quadratic", release_time=0.0).units["eta2"] == "1/rad"


def test_the_unknowns_have_the_units_of_the_quantities():
    turned = Measurement(TIME[::10], curve("linear", "constant", Sensor("slope"))[::10], sensor=Sensor("slope"))
    fit = fit_decay(turned, law="quadratic", frequency_law="linear", release_time=0.0)
    units = {unknown.name: unknown.unit for unknown in fit.fit.unknowns}
    assert units["e0"] == fit.units["amplitude"] == "rad"
    for name in ("eta2", "frequency_slope"):
        assert units[name] == fit.units[name] == "1/rad"


@pytest.mark.slow
@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_curves_against_amplitude_are_those_of_the_displacement(quantity):
    """Windows and law give the decay rate eta1/2 + 4 eta2 omega A/(3 pi), as from a measured displacement."""
    sensors = Sensor(), Sensor(quantity)
    records = [Measurement(TIME, curve("quadratic", "linear", sensor), sensor=sensor) for sensor in sensors]
    moved, derived = (damping_curve(record, release_time=0.0) for record in records)
    assert derived.unit == moved.unit == "m"
    assert derived.amplitude == pytest.approx(moved.amplitude, rel=2e-3)
    for found in (moved, derived):
        rate = 0.2 / 2 + 4 * 0.3 * OMEGA / (3 * math.pi) * found.amplitude
        assert 2 * math.pi * found.frequency * found.damping_ratio == pytest.approx(rate, rel=0.01)
    fits = [fit_decay(record, law="quadratic", frequency_law="linear", release_time=0.0) for record in records]
    assert law_curve(fits[1]).amplitude == pytest.approx(law_curve(fits[0]).amplitude, rel=0.02)
    laws = [law_curve(fit, [0.01, 0.02, 0.03]) for fit in fits]
    assert laws[1].damping_ratio == pytest.approx(laws[0].damping_ratio, rel=1e-3)


def test_the_figure_shows_the_record_in_its_unit_and_the_amplitude_in_that_of_the_displacement():
    y = curve("linear", "constant", Sensor("acceleration")) + 0.02 * np.random.default_rng(1).standard_normal(len(TIME))
    figure = fit_decay(Measurement(TIME, y, sensor=Sensor("acceleration")), release_time=0.0).figure()
    labels = [axes.get_ylabel() for axes in figure.axes] + [axes.get_xlabel() for axes in figure.axes]
    assert "record, m/s²" in labels and "record less fit, mm/s²" in labels and "amplitude, mm" in labels


@pytest.mark.slow
def test_modes_are_separated_in_an_acceleration():
    sensor = Sensor("acceleration")
    other = 2 * math.pi * 19.0
    y = curve("linear", "constant", sensor) + 3.0 * np.exp(-0.005 * other * TIME) * np.cos(other * TIME)
    y += 0.05 * np.random.default_rng(2).standard_normal(len(TIME))
    first, second = fit_modes(Measurement(TIME, y, sensor=sensor), modes=2, release_time=0.0)
    assert first.frequency == pytest.approx(3.0, abs=4 * first.standard_errors["frequency"])
    assert second.damping_ratio == pytest.approx(0.005, abs=4 * second.standard_errors["damping_ratio"])
    assert first.amplitude == pytest.approx(AMPLITUDE, rel=0.02)


OTHER_SENSORS = {
    "velocity": (Sensor("displacement"), Sensor("velocity"), "linear"),
    "in px": (Sensor("signal", signal_unit="mV"), Sensor("signal", signal_unit="px"), "linear"),
    "400 mm": (Sensor("displacement", point=0.1), Sensor("displacement", point=0.4), "quadratic"),
}


@pytest.mark.parametrize("name", OTHER_SENSORS)
def test_records_of_different_sensors_are_refused(name):
    first, second, law = OTHER_SENSORS[name]
    records = [Measurement(TIME, curve("linear", "constant", sensor), sensor=sensor) for sensor in (first, second)]
    with pytest.raises(InputError, match=f"records: .*{re.escape(name)}"):
        fit_decays(records, law=law)
