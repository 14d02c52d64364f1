import numpy as np
import pytest
from scipy.integrate import quad

from problems.frf.modal_sum import RESIDUAL_POWERS, ModalSum
from problems.frf.window import BlockWindow

HANN = BlockWindow(2.0, hann=True)
F = np.linspace(1.0, 20.0, 150)


@pytest.mark.parametrize("z", [0.3 + 4j, 0.001 + 1.0001j * np.pi, 2e-3j, 5.0 - 3j])
def test_a_resonance_under_a_hann_window_is_the_transform_of_the_windowed_decay(z):
    def windowed(tau):
        x = tau / HANN.duration
        lag = (1 - x) * (2 / 3 + np.cos(2 * np.pi * x) / 3) + np.sin(2 * np.pi * x) / (2 * np.pi)
        return lag * np.exp(-z * tau)

    parts = [quad(lambda tau, part=part: part(windowed(tau)), 0.0, 2.0, epsabs=1e-13)[0] for part in (np.real, np.imag)]
    value, slope = HANN.resonance(np.array(z))
    assert abs(value - (parts[0] + 1j * parts[1])) < 1e-12
    step = 1e-5
    difference = (HANN.resonance(np.array(z + step))[0] - HANN.resonance(np.array(z - step))[0]) / (2 * step)
    assert abs(slope - difference) < 1e-9


@pytest.mark.parametrize("kind", ["receptance", "mobility", "accelerance"])
def test_derivatives_of_smeared_functions_are_their_differences(kind):
    model = ModalSum.of(F, kind, RESIDUAL_POWERS[0], HANN)
    x, coefficients = np.array([5.0, 0.02, 9.0, 0.01]), np.random.default_rng(0).normal(size=(8, 3))
    slopes = model.slopes(x[::2], x[1::2], coefficients)
    for k, step in enumerate((1e-5, 1e-6, 1e-5, 1e-6)):
        ends = x + step * np.eye(4)[k], x - step * np.eye(4)[k]
        upper, lower = (model.columns(end[::2], end[1::2]) @ coefficients for end in ends)
        difference = (upper - lower).T / (2 * step)
        np.testing.assert_allclose(slopes[:, :, k], difference, atol=1e-7 * np.abs(difference).max())


@pytest.mark.parametrize("kind", ["receptance", "mobility", "accelerance"])
def test_a_long_hann_window_leaves_the_resonances_beside_residual_terms(kind):
    plain, smeared = (
        ModalSum.of(F, kind, RESIDUAL_POWERS[0], window) for window in (None, BlockWindow(1e4, hann=True))
    )
    modes = np.array([5.0, 9.0]), np.array([0.02, 0.01])
    change, terms = smeared.modal(*modes) - plain.modal(*modes), plain.columns(np.array([]), np.array([]))
    remaining = change - terms @ np.linalg.lstsq(terms, change)[0]
    assert (np.abs(remaining).max(axis=0) < 1e-6 * np.abs(plain.modal(*modes)).max(axis=0)).all()


def test_an_exponential_window_shifts_the_poles():
    rate, ratio, natural = 0.4, 0.01, 2 * np.pi * 5.0
    shifted = ModalSum.of(F, "receptance", (), BlockWindow(10.0, rate)).modal(np.array([5.0]), np.array([ratio]))[:, 0]
    pole = natural * (-ratio + 1j * np.sqrt(1 - ratio**2)) - rate
    expected = 1 / ((2j * np.pi * F - pole) * (2j * np.pi * F - np.conj(pole)))
    np.testing.assert_allclose(shifted, expected, rtol=1e-12)
