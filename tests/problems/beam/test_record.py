"""Tests of measured response curves."""

import numpy as np
import pytest

from ancf_casadi import HarmonicBase, HarmonicLoad, InputError
from problems import ResponseRecord

BASE = HarmonicBase(amplitude=1e-3, frequency=1.0)


def test_complex_values_are_amplitudes_and_phases():
    values = np.array([1.0 + 1.0j, -2.0j])
    record = ResponseRecord([1.0, 2.0], values, base=BASE)
    np.testing.assert_allclose(record.amplitudes, [np.sqrt(2.0), 2.0])
    np.testing.assert_allclose(record.measured_phases, [np.pi / 4, -np.pi / 2])
    np.testing.assert_allclose(record.complex_values, values)


def test_the_controlled_quantity_is_ten_times_as_certain():
    driven = ResponseRecord([1.0], [2.0], base=BASE)
    held = ResponseRecord([1.0], [2.0], base=BASE, control="response")
    assert driven.stds[2, 0] == pytest.approx(held.stds[2, 0] / 10)
    assert held.stds[0, 0] == pytest.approx(0.1 * 0.01 * 2.0)


def test_given_deviations_take_the_place_of_the_defaults():
    record = ResponseRecord([1.0, 2.0], [2.0, 3.0], [0.1, 0.2], base=BASE, amplitude_std=[0.1, 0.2])
    np.testing.assert_allclose(record.stds[0], [0.1, 0.2])
    assert (record.stds[1] > 0.009).all()


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"frequencies": [1.0, -2.0]}, "frequencies"),
        ({"values": [1.0]}, "values"),
        ({"values": [1.0, 0.0]}, "values"),
        ({"values": [1.0j, 2.0], "phases": [0.0, 0.0]}, "phases"),
        ({"phases": [0.0]}, "phases"),
        ({"levels": [1.0, -1.0]}, "levels"),
        ({"sweep": "down"}, "frequencies"),
        ({"sweep": "sideways"}, "sweep"),
        ({"control": "none"}, "control"),
        ({"base": None}, "base"),
        ({"load": HarmonicLoad(force=(1.0, 0.0), frequency=1.0)}, "base"),
        ({"base": HarmonicBase(amplitude=1e-3, frequency=1.0, stop=1.0)}, "base"),
        ({"amplitude_std": [1.0, 2.0, 3.0]}, "amplitude_std"),
        ({"phase_std": 0.0}, "phase_std"),
    ],
)
def test_unusable_records_are_refused_by_name(changes, where):
    with pytest.raises(InputError) as caught:
        ResponseRecord(**{"frequencies": [1.0, 2.0], "values": [1.0, 2.0], "base": BASE, **changes})
    assert caught.value.where == where
