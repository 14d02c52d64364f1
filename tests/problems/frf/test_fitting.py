import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from tqdm import tqdm

from ancf_casadi import (
    FitError,
    InputError,
    ModalDamping,
    Model,
    RayleighDamping,
    linear_frf,
    natural_modes,
)
from ancf_casadi.estimation.result import FitResult
from ancf_casadi.figures.files import figure_bytes
from ancf_casadi.response.linear_frf import FRF_POWERS
from problems import FrfRecord, Global, fit_frf, match_frequencies
from problems.frf import fitting, selection
from problems.frf.modal_sum import RESIDUAL_POWERS, ModalSum, TrialFit
from problems.frf.refinement import harmonics_notes
from tests.coverage import covers


def modal_sum(f, modes, derivatives=0):
    """Functions (outputs, inputs, k) of modes (frequency in Hz, damping ratio, modal constants (outputs, inputs))."""
    omega = 2 * np.pi * f
    functions = 0
    for frequency, ratio, constants in modes:
        natural, constants = 2 * np.pi * frequency, np.array(constants, dtype=complex)
        pole = natural * (-ratio + 1j * np.sqrt(1 - ratio**2))
        residue = (constants / (2j * np.imag(pole)))[..., None]
        functions = functions + residue / (1j * omega - pole) + residue.conj() / (1j * omega - np.conj(pole))
    functions = functions if functions.ndim == 3 else functions[:, None, :]
    return functions * (1j * omega) ** derivatives


def complex_noise(rng, shape):
    """Circular complex noise of unit variance."""
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


@pytest.fixture(scope="module")
def four_modes():
    """Frequencies, and four modes at three outputs; two of them are 8 % apart."""
    f = np.linspace(2.0, 100.0, 785)
    modes = [
        (12.0, 0.010, (1.0, 0.5, -0.3)),
        (35.0, 0.020, (1.0, -0.5, 0.8)),
        (38.0, 0.015, (0.5, 1.0, 0.4)),
        (80.0, 0.030, (1.0, -0.2, 0.1)),
    ]
    return f, modes


def check(fit, modes, *, errors=4.5):
    """Check that a fit has found modes, each within some standard errors."""
    identified = list(zip(fit.frequencies, fit.damping_ratios, strict=True))
    assert len(identified) == len(modes), identified
    for k, (frequency, ratio, constants) in enumerate(modes, start=1):
        names = (f"frequency_{k}", f"damping_ratio_{k}")
        assert abs(fit.frequencies[k - 1] - frequency) < errors * fit.standard_errors[names[0]]
        assert abs(fit.damping_ratios[k - 1] - ratio) < errors * fit.standard_errors[names[1]]
        off = fit.constants[k - 1] - np.array(constants).reshape(fit.constants[k - 1].shape)
        assert (np.abs(off.real) < errors * fit.constant_errors[k - 1].real).all()
        assert (np.abs(off.imag) < errors * fit.constant_errors[k - 1].imag).all()


CASES = {
    "single mode": (np.linspace(1.0, 20.0, 381), [(8.0, 0.01, (1.0,))], 0.02),
    "heavy damping": (np.linspace(1.0, 60.0, 591), [(15.0, 0.1, (1.0, -0.4)), (40.0, 0.1, (0.6, 1.0))], 0.01),
    "close modes": (np.linspace(5.0, 30.0, 1001), [(15.0, 0.01, (1.0, 0.3)), (15.25, 0.012, (-0.4, 1.0))], 0.01),
    "overlapping modes": (np.linspace(5.0, 30.0, 1001), [(15.0, 0.03, (1.0, 0.1)), (15.5, 0.03, (0.1, 1.0))], 0.003),
    "light damping": (np.linspace(1.0, 20.0, 1901), [(6.0, 0.002, (1.0,)), (13.0, 0.003, (-0.7,))], 0.002),
    "complex modes": (np.linspace(1.0, 20.0, 761), [(6.0, 0.01, (1.0, 0.4 + 0.5j)), (13.0, 0.02, (0.3j, -0.7))], 0.005),
    "two inputs": (
        np.linspace(1.0, 20.0, 761),
        [(6.0, 0.01, [(1.0, 0.5), (0.5, 0.25)]), (13.0, 0.01, [(1.0, -0.8), (-0.8, 0.64)])],
        0.01,
    ),
}  # with the noise relative to the median of the functions


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=[pytest.mark.slow] if case in ("close modes", "light damping", "two inputs") else [])
        for case in CASES
    ],
)
def test_known_modes_are_recovered_from_noise(case):
    f, modes, level = CASES[case]
    values = modal_sum(f, modes)
    noise = level * np.median(np.abs(values)) * complex_noise(np.random.default_rng(1), values.shape)
    check(fit_frf(FrfRecord(f, values + noise, "receptance")), modes)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "derivatives"), [("receptance", 0), ("mobility", 1), ("accelerance", 2)])
def test_each_kind_of_function_gives_the_same_modes(four_modes, kind, derivatives):
    f, modes = four_modes
    values = modal_sum(f, modes, derivatives)
    noise = 0.02 * np.median(np.abs(values)) * complex_noise(np.random.default_rng(2), values.shape)
    check(fit_frf(FrfRecord(f, values + noise, kind)), modes)


@pytest.mark.slow
def test_functions_without_noise_give_the_exact_modes(four_modes):
    f, modes = four_modes
    fit = fit_frf(FrfRecord(f, modal_sum(f, modes), "receptance"))
    np.testing.assert_allclose(fit.frequencies, [mode[0] for mode in modes], rtol=1e-7)
    np.testing.assert_allclose(fit.damping_ratios, [mode[1] for mode in modes], rtol=1e-6)
    np.testing.assert_allclose(fit.constants[:, :, 0], [mode[2] for mode in modes], atol=1e-6)


@pytest.mark.slow
def test_modes_out_of_the_band_do_not_disturb_those_in_it(four_modes):
    f, modes = four_modes
    values = modal_sum(f, modes)
    noise = 1e-6 * complex_noise(np.random.default_rng(3), values.shape)
    fit = fit_frf(FrfRecord(f, values + noise, "receptance"), band=(20.0, 60.0))
    assert fit.record.frequencies[0] >= 20.0 and fit.record.frequencies[-1] <= 60.0
    check(fit, modes[1:3])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["receptance", "accelerance", "transmissibility", "relative-transmissibility"])
def test_the_modes_of_a_beam_are_recovered(paper_beam, kind):
    model = Model(paper_beam(8))
    modes = natural_modes(model, count=12)
    law = ModalDamping(modes, np.linspace(0.01, 0.02, 12))
    points, f = (0.15, 0.3, 0.5), np.linspace(0.5, 40.0, 1581)
    frf = linear_frf(model, law, f, kind=kind, points=points)
    rng = np.random.default_rng(4)
    noise = 0.01 * np.median(np.abs(frf.values)) * complex_noise(rng, frf.values.shape)
    fit = fit_frf(FrfRecord(f, frf.values + noise, kind, points=points))
    assert len(fit.frequencies) == 3
    for k, (frequency, ratio) in enumerate(zip(modes.frequencies[:3], law.ratios, strict=False), start=1):
        assert abs(fit.frequencies[k - 1] - frequency) < 4.5 * fit.standard_errors[f"frequency_{k}"]
        assert abs(fit.damping_ratios[k - 1] - ratio) < 4.5 * fit.standard_errors[f"damping_ratio_{k}"]
    shapes = np.array([model.interpolation(s)[0] @ modes.shapes[:, :3] for s in points])
    if kind in ("receptance", "accelerance"):
        off = fit.constants[:, :, 0].real - (shapes * shapes[-1]).T
        assert (np.abs(off) < 4.5 * fit.constant_errors[:, :, 0].real).all()
    assert np.abs(fit.shapes.real - (shapes / shapes[np.abs(shapes).argmax(axis=0), range(3)]).T).max() < 0.02


@pytest.mark.slow
def test_it_is_the_minimum_that_an_independent_least_squares_method_finds(four_modes):
    f, modes = four_modes
    values = modal_sum(f, modes)[:2, 0]
    level = 3e-6 * np.array([1.0, 2.0])[:, None] * (1 + 10 / f)
    values = values + level * complex_noise(np.random.default_rng(5), values.shape)
    fit = fit_frf(FrfRecord(f, values, "receptance", std=level))
    omega, reference = 2 * np.pi * f, 2 * np.pi * 14.0
    powers = fit.refinement.model.powers

    def residuals(x):  # poles and complex residues, in another form than in the library
        decay, pulsation = np.exp(x[:4]), np.exp(x[4:8])
        residues = (x[8:16] + 1j * x[16:24]).reshape(2, 4, 1) * 1e-2
        terms = x[24:].reshape(2, len(powers)) * 1e-6
        pole = (-decay + 1j * pulsation)[:, None]
        s = 1j * omega
        curve = (residues / (s - pole) + residues.conj() / (s - pole.conj())).sum(axis=1)
        curve += sum(terms[:, k, None] * (s / reference) ** p for k, p in enumerate(powers))
        r = (curve - values) / level
        return np.concatenate([r.real.ravel(), r.imag.ravel()])

    natural = 2 * np.pi * np.array([mode[0] for mode in modes])
    ratio = np.array([mode[1] for mode in modes])
    constants = np.array([mode[2][:2] for mode in modes]).T
    start = np.concatenate(
        [np.log(natural * ratio), np.log(natural * np.sqrt(1 - ratio**2)), 0 * natural, 0 * natural,
         (-constants / (2 * natural) / 1e-2).ravel(), np.zeros(2 * len(powers))]
    )  # fmt: skip
    solution = least_squares(residuals, start, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    poles_found = -np.exp(solution.x[:4]) + 1j * np.exp(solution.x[4:8])
    np.testing.assert_allclose(fit.poles, poles_found, rtol=1e-7)
    covariance = np.linalg.inv(solution.jac.T @ solution.jac) * 2 * solution.cost / (len(solution.fun) - len(start))
    for k in range(4):  # of the logarithm of the imaginary part, and nearly of the frequency
        error = fit.standard_errors[f"frequency_{k + 1}"] / fit.frequencies[k]
        assert error == pytest.approx(np.sqrt(covariance[4 + k, 4 + k]), rel=0.05)


@pytest.mark.slow
def test_it_agrees_with_sdypy_ema_where_noise_is_low(four_modes):
    EMA = pytest.importorskip("sdypy.EMA")
    f, modes = four_modes
    f = np.arange(1, 801) * 0.125
    values = modal_sum(f, modes)
    values += 1e-8 * complex_noise(np.random.default_rng(6), values.shape)
    fit = fit_frf(FrfRecord(f, values, "receptance"))
    model = EMA.Model(values[:, 0], f, lower=f[0], upper=99.9, pol_order_high=30, frf_form="receptance")
    model.get_poles(show_progress=False)
    highest = list(zip(model.pole_freq[-1], model.pole_xi[-1], strict=True))
    nearest = [min(highest, key=lambda pole: abs(pole[0] - f0)) for f0, *_ in modes]
    np.testing.assert_allclose(fit.frequencies, [pole[0] for pole in nearest], rtol=1e-4)
    np.testing.assert_allclose(fit.damping_ratios, [pole[1] for pole in nearest], rtol=1e-2)


@pytest.mark.slow
def test_the_lines_need_not_be_equally_spaced(four_modes):
    _, modes = four_modes
    f = np.geomspace(3.0, 100.0, 1500)
    values = modal_sum(f, modes)
    check(
        fit_frf(FrfRecord(f, values + 1e-6 * complex_noise(np.random.default_rng(7), values.shape), "receptance")),
        modes,
    )


def noise_of(kind, rng, values, f):
    """Noise as it occurs in measurements."""
    noise_ = complex_noise(rng, values.shape)
    shared = complex_noise(rng, f.shape)
    return {
        "constant": 3e-6 * noise_,
        "relative": 0.03 * np.abs(values) * noise_ + 2e-6 * complex_noise(rng, values.shape),
        "falling": 1e-5 * noise_ * (10 / f),
        "shared": 0.03 * values * shared + 1e-6 * noise_,
    }[kind]


@pytest.mark.slow
def test_intervals_cover_the_truth_as_often_as_they_say(four_modes):
    """64 intervals of each kind of noise, and all of them together."""
    f, modes = four_modes
    values = modal_sum(f, modes)
    kinds = {
        kind: [hit for seed in range(8) for hit in contained(f, modes, values, kind, seed)]
        for kind in ("relative", "falling", "shared")
    }
    assert {kind: sum(hits) for kind, hits in kinds.items() if not covers(sum(hits), len(hits))} == {}
    assert covers(sum(map(sum, kinds.values())), sum(map(len, kinds.values())))


def contained(f, modes, values, kind, seed):
    """Return True for each interval of a fit that contains the true value."""
    record = FrfRecord(f, values + noise_of(kind, np.random.default_rng(seed), values, f), "receptance")
    fit = fit_frf(record, frequencies=[mode[0] for mode in modes])
    truth = [value for mode in modes for value in mode[:2]]
    return [low <= value <= high for (low, high), value in zip(fit.intervals().values(), truth, strict=True)]


@pytest.mark.slow
def test_noise_that_all_functions_share_counts_once(four_modes):
    f, modes = four_modes
    values = modal_sum(f, modes)[:1]
    values = values + 3e-6 * complex_noise(np.random.default_rng(8), values.shape)
    guesses = [mode[0] for mode in modes]
    single_fit = fit_frf(FrfRecord(f, values, "receptance"), frequencies=guesses)
    many = fit_frf(FrfRecord(f, np.tile(values, (4, 1, 1)), "receptance"), frequencies=guesses)
    for name, error in single_fit.standard_errors.items():
        assert many.standard_errors[name] == pytest.approx(error, rel=0.1)


@pytest.mark.slow
def test_noise_that_is_correlated_along_the_frequency_gives_larger_errors(four_modes):
    f, modes = four_modes
    values, guesses = modal_sum(f, modes)[:1], [mode[0] for mode in modes]
    white = 3e-6 * complex_noise(np.random.default_rng(9), (1, 1, len(f) + 8))
    coloured = np.apply_along_axis(np.convolve, 2, white, np.full(9, 1 / 3.0), mode="valid")
    plain = fit_frf(FrfRecord(f, values + white[:, :, : len(f)], "receptance"), frequencies=guesses)
    smooth = fit_frf(FrfRecord(f, values + coloured, "receptance"), frequencies=guesses)
    name = "damping_ratio_4"  # of a wide resonance
    assert smooth.standard_errors[name] > 1.8 * plain.standard_errors[name]


@pytest.mark.slow
def test_coherence_and_standard_deviations_give_the_weights(four_modes):
    f, modes = four_modes
    f = f[::2]
    values, guesses = modal_sum(f, modes), [mode[0] for mode in modes]
    level = np.tile(np.where(f < 37.0, 3e-5, 1e-6), (3, 1, 1))
    off = {"std": [], "coherence": [], "equal": []}
    for seed in range(4):
        noisy = values + level * complex_noise(np.random.default_rng(seed), values.shape)
        quality = {
            "std": {"std": level},
            "coherence": {"coherence": 1 / (1 + (level / np.abs(noisy)) ** 2)},
            "equal": {"std": np.ones_like(level)},
        }
        for name, values_ in quality.items():
            fit = fit_frf(FrfRecord(f, noisy, "receptance", **values_), frequencies=guesses)
            off[name].append(fit.frequencies[2] - 38.0)
    rms = {name: np.sqrt(np.mean(np.square(values))) for name, values in off.items()}
    assert rms["std"] < 0.5 * rms["equal"] and rms["coherence"] < 0.5 * rms["equal"]


@pytest.mark.slow
def test_the_number_of_modes_can_be_given(four_modes):
    f, modes = four_modes
    values = modal_sum(f, modes)
    record = FrfRecord(f, values + 1e-6 * complex_noise(np.random.default_rng(10), values.shape), "receptance")
    check(fit_frf(record, modes=4), modes)
    check(fit_frf(record, frequencies=[12.3, 34.5, 38.5, 77.0]), modes)
    two = fit_frf(record, modes=2)
    assert len(two.frequencies) == 2 and any("not noise" in warning for warning in two.warnings)


def test_noise_alone_has_no_mode():
    f = np.linspace(1.0, 20.0, 400)
    noise = complex_noise(np.random.default_rng(11), (2, 400))
    with pytest.raises(FitError, match=r"no mode was found in the band|finds no poles in the band"):
        fit_frf(FrfRecord(f, noise, "receptance"))


@pytest.mark.slow
@pytest.mark.parametrize("size", [1e-15, 1e15])
def test_the_unit_of_the_values_does_not_matter(size):
    f = np.linspace(1.0, 20.0, 381)
    values = modal_sum(f, [(8.0, 0.01, (1.0, 0.5))])
    values = size * (values + 1e-6 * complex_noise(np.random.default_rng(16), values.shape))
    check(fit_frf(FrfRecord(f, values, "receptance")), [(8.0, 0.01, (size, 0.5 * size))])


@pytest.mark.slow
def test_without_sdypy_ema_approximate_frequencies_are_enough(four_modes, monkeypatch):
    f, modes = four_modes
    values = modal_sum(f, modes)
    record = FrfRecord(f, values + 1e-6 * complex_noise(np.random.default_rng(12), values.shape), "receptance")
    monkeypatch.setattr(selection, "MODULE", "no_such_module.EMA")
    with pytest.raises(InputError, match=r"^sdypy-EMA: is not installed.*pip install sdypy-EMA, or give"):
        fit_frf(record)
    check(fit_frf(record, frequencies=[mode[0] for mode in modes]), modes)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"modes": 0}, "modes: must be a whole number, 1 to 20, got 0"),
        ({"modes": 2, "frequencies": [12.0]}, "modes: is 2, but 1 frequencies are given"),
        ({"modes": 15, "band": (34.0, 38.0)}, "record: has too few frequencies, 33, for 15 modes"),
        ({"frequencies": [200.0]}, "frequencies: 200 Hz is outside the band, 2 to 100 Hz"),
        ({"frequencies": [12.0, 12.0]}, "frequencies: has a frequency twice"),
        ({"frequencies": 12.0}, "frequencies: must be one or more frequencies, got 12.0"),
        ({"frequencies": []}, "frequencies: must be one or more frequencies, got []"),
        ({"band": (30.0, 10.0)}, "band: must be two frequencies, Hz, the lower one first"),
        ({"band": (30.0, 30.1)}, "band: has fewer than 8 frequencies of the record"),
    ],
)
def test_what_cannot_be_used_is_refused(four_modes, options, message):
    f, modes = four_modes
    with pytest.raises(InputError) as raised:
        fit_frf(FrfRecord(f, modal_sum(f, modes), "receptance"), **options)
    assert str(raised.value).startswith(message)
    with pytest.raises(InputError, match="record: must be a FrfRecord"):
        fit_frf(modal_sum(f, modes))


@pytest.fixture(scope="module")
def result(four_modes):
    f, modes = four_modes
    values = modal_sum(f, modes)
    noise = 1e-6 * complex_noise(np.random.default_rng(13), values.shape)
    return fit_frf(FrfRecord(f, values + noise, "receptance", points=(0.1, 0.3, 0.5)))


@pytest.mark.slow
def test_the_result_is_reported_drawn_and_written(result):
    assert isinstance(result, FitResult)
    report = result.report()
    assert "Modes from 3 receptance functions at 785 frequencies, 2 to 100 Hz" in report
    assert all(warning in report for warning in result.warnings)
    table = json.loads(json.dumps(result.to_dict()))
    assert [mode["frequency_hz"] for mode in table["modes"]] == result.frequencies.tolist()
    assert np.shape(table["modes"][0]["constants_real"]) == (3, 1)
    figure = result.figure()
    assert [axes.get_title() for axes in figure.axes[:3]] == ["0.1 m", "0.3 m", "0.5 m"]
    assert figure_bytes(figure).startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_synthesised_functions_are_those_of_the_modes(result, four_modes):
    f, modes = four_modes
    between = f[:-1] + 0.4 * np.diff(f)
    true = modal_sum(between, modes)
    assert np.abs(result.synthesised(between) - true).max() < 3e-6
    assert result.synthesised().shape == result.record.values.shape
    with pytest.raises(InputError, match="frequencies: must be positive"):
        result.synthesised([0.0])


@pytest.mark.slow
def test_the_modes_serve_a_match_and_a_damping_law(paper_beam):
    true = Model(paper_beam(8, elastic_modulus=220e9))
    modes, f, points = natural_modes(true, count=4), np.linspace(0.5, 40.0, 1581), (0.15, 0.3, 0.5)
    law = ModalDamping(modes, (0.01, 0.008, 0.012, 0.01)) + RayleighDamping(alpha=0.01)
    frf = linear_frf(true, law, f, points=points)
    noise = 0.005 * np.median(np.abs(frf.values)) * complex_noise(np.random.default_rng(14), frf.values.shape)
    fit = fit_frf(FrfRecord(f, frf.values + noise, frf.kind, points=points))
    match = match_frequencies(paper_beam(8), targets=fit.measured_modes(), unknowns=[Global("elastic_modulus")])
    assert match.beam.elastic_modulus[0] == pytest.approx(220e9, rel=1e-3)
    assert match.mac.diagonal().min() > 0.999
    damping = ModalDamping(natural_modes(true, count=3), fit.damping_ratios, frequencies=fit.frequencies)
    np.testing.assert_allclose(damping.ratios, law.damping_ratios(modes, np.zeros(4))[:3], rtol=0.05)


@pytest.mark.slow
def test_warnings_name_what_the_functions_cannot_show():
    rng = np.random.default_rng(15)
    f = np.linspace(1.0, 20.0, 77)
    coarse = modal_sum(f, [(8.0, 0.01, (1.0,))])
    fit = fit_frf(FrfRecord(f, coarse + 1e-6 * complex_noise(rng, coarse.shape), "receptance"), frequencies=[8.0])
    assert any("its half-power bandwidth of 0.16 Hz holds few frequencies" in warning for warning in fit.warnings)
    f = np.linspace(8.0, 20.0, 601)
    edge = modal_sum(f, [(8.05, 0.02, (1.0,)), (15.0, 0.01, (1.0,))])
    fit = fit_frf(FrfRecord(f, edge + 1e-6 * complex_noise(rng, edge.shape), "receptance"))
    assert any("is at the end of the band; widen the band" in warning for warning in fit.warnings)
    f = np.linspace(5.0, 20.0, 601)
    outside = modal_sum(f, [(12.0, 0.01, (1.0,)), (21.5, 0.01, (1.0,))])
    fit = fit_frf(FrfRecord(f, outside + 1e-7 * complex_noise(rng, outside.shape), "receptance"))
    assert any("many residual terms" in warning for warning in fit.warnings)
    assert fit.frequencies == pytest.approx([12.0], rel=1e-5)


@pytest.mark.slow
def test_a_nonlinear_resonance_is_one_mode_and_the_note_names_it():
    """Two modes whose frequency falls and whose damping grows with the amplitude: once listed as four modes."""
    f, rng = np.arange(8.0, 40.0, 0.05), np.random.default_rng(20)
    values = np.zeros((2, len(f)), dtype=complex)
    for natural, ratio, constants in ((17.3, 0.008, (1.0, 0.6)), (31.0, 0.006, (1.0, -0.8))):
        h = 1 / (natural**2 - f**2 + 2j * ratio * natural * f)
        for _ in range(200):  # the response at each line depends on its amplitude
            amplitude = 2 * ratio * natural**2 * np.abs(h)
            moved, damped = natural * (1 - 0.25 * ratio * amplitude), ratio * (1 + 0.15 * amplitude)
            h = (h + 1 / (moved**2 - f**2 + 2j * damped * natural * f)) / 2
        values += np.outer(constants, natural**2 * h)
    values = values * (1 + 3e-3 * complex_noise(rng, values.shape)) + 1e-3 * complex_noise(rng, values.shape)
    fit = fit_frf(FrfRecord(f, values, "receptance"))
    assert fit.frequencies == pytest.approx([17.28, 30.97], abs=0.05)
    (note,) = [note for note in fit.warnings if note.startswith("one mode")]
    pairs = re.findall(r"near (\d+)[.\d]* Hz \(second pole at (\d+)", note)
    assert sorted(pairs) in ([("17", "17"), ("30", "31")], [("17", "17"), ("31", "31")], [("17", "17"), ("30", "30")])


def leaked(f, modes):
    """Functions at lines from 0, as averages over Hann windows give them: impulse response times lag window."""
    window = np.hanning(2 * len(f) - 2)
    lags = np.correlate(window, window, "full")[len(window) - 1 :] / np.sum(window**2)
    turns = 2 * np.pi * np.arange(len(window)) / (2 * f[-1])
    responses = [
        np.outer(c, np.exp(-z * natural * turns) * np.sin(natural * turns) * natural) for natural, z, c in modes
    ]
    return np.fft.rfft(sum(responses) * lags) / f[-1]


def test_second_poles_of_leakage_take_one_note_and_show_progress(monkeypatch):
    f, modes = np.arange(401) * 0.1, [(7.0, 0.01, (1.0,)), (16.0, 0.006, (-1.0,)), (31.0, 0.004, (0.7,))]
    values, steps = leaked(f, modes), []
    values = values * (1 + 0.002 * complex_noise(np.random.default_rng(0), values.shape))
    monkeypatch.setattr(tqdm, "update", lambda bar, n=1: steps.append(n))
    fit = fit_frf(FrfRecord(f[10:], values[:, 10:], "receptance"), progress=True)
    assert fit.frequencies == pytest.approx([mode[0] for mode in modes], rel=2e-3)
    (note,) = [note for note in fit.warnings if note.startswith("one mode")]
    assert note.count("second pole at") >= 2
    assert len(steps) > 10


@pytest.mark.slow
@pytest.mark.parametrize(("assurance", "modes"), [(0.8, 2), (0.98, 1)])
def test_two_poles_within_a_bandwidth_are_two_modes_if_their_shapes_differ(assurance, modes):
    f, rng = np.linspace(5.0, 30.0, 1001), np.random.default_rng(1)
    second_shape = np.sqrt(assurance) * np.array([1.0, 0.2]) + np.sqrt(1 - assurance) * np.array([-0.2, 1.0])
    values = modal_sum(f, [(15.0, 0.03, (1.0, 0.2)), (15.4, 0.03, second_shape)])
    noise = 0.003 * np.median(np.abs(values)) * complex_noise(rng, values.shape)
    fit = fit_frf(FrfRecord(f, values + noise, "receptance"))
    assert len(fit.frequencies) == modes
    assert any(note.startswith("one mode near") for note in fit.warnings) == (modes == 1)


@pytest.mark.parametrize(
    ("second", "noise", "named"),
    [(0.4, 1e-4, True), (0.4, 0.03, True), (0.0, 0.03, False), (0.03, 1e-4, False), (0.0, 4.0, False)],
)
def test_two_modes_of_one_frequency_are_named_by_their_shapes(second, named, noise):
    f, rng = np.linspace(5.0, 15.0, 401), np.random.default_rng(5)
    shapes = np.array([[1.0, 0.3], [0.5, -0.8]])
    constants = np.outer(shapes[0], shapes[0]) + second * np.outer(shapes[1], shapes[1])
    values = modal_sum(f, [(10.0, 0.01, constants.ravel())]).reshape(2, 2, -1)
    values = values + noise * np.abs(values).max() * complex_noise(rng, values.shape)
    fit = fit_frf(FrfRecord(f, values, "receptance"), frequencies=[10.0])
    assert any("not those of one shape" in note for note in fit.warnings) == named


def test_tones_at_multiples_of_a_mode_are_named_as_harmonics():
    f, rng = np.linspace(60.0, 340.0, 1121), np.random.default_rng(3)
    tones = [(80.4, 0.004, (1.0,)), (160.8, 0.004, (0.2,)), (200.0, 0.004, (0.6,)), (241.3, 0.004, (-0.2,))]
    values = modal_sum(f, tones) * (1 + 0.01 * complex_noise(rng, f.size))
    fit = fit_frf(FrfRecord(f, values, "receptance"), frequencies=[natural for natural, *_ in tones])
    (note,) = [note for note in fit.warnings if "multiples" in note]
    assert note.startswith(
        "multiples of the 80.4 Hz of mode 1 are listed as modes: 160.8 Hz (mode 2, 2 times), 241.3 Hz "
    )


@pytest.mark.parametrize(
    ("frequencies", "named"),
    [
        ([80.4, 160.8, 241.3, 321.5], [[2, 3, 4]]),
        ([10.0, 20.01, 33.0, 66.1, 99.0], [[2], [4, 5]]),
        ([1.85, 10.19, 26.84, 53.2, 88.6], []),
        ([10.0, 20.1, 29.8, 70.0], []),
    ],
    ids=["of one mode", "of two modes", "cantilever", "near multiples"],
)
def test_harmonics_are_whole_multiples_up_to_order_five(frequencies, named):
    notes = harmonics_notes(np.array(frequencies))
    assert [[int(mode) for mode in re.findall(r"\(mode (\d)", note)] for note in notes] == named


# Three modes of 19 to 43 % damping, three lightly damped ones, and two at two outputs.
DELAYED = {
    "heavy": ([(8.0, 0.43, (64.0,)), (20.0, 0.19, (320.0,)), (45.0, 0.25, (1215.0,))], 0.01, "receptance"),
    "light": ([(10.0, 0.02, (100.0,)), (25.0, 0.01, (-375.0,)), (60.0, 0.02, (2880.0,))], 0.02, "receptance"),
    "accelerance": ([(10.0, 0.1, (1.0, 0.5)), (30.0, 0.2, (-0.5, 0.8))], 0.015, "accelerance"),
}


@pytest.mark.parametrize(
    "case", ["heavy", *(pytest.param(case, marks=pytest.mark.slow) for case in ("light", "accelerance"))]
)
def test_a_delay_is_taken_out_and_named(case):
    modes, delay, kind = DELAYED[case]
    f = np.arange(0.5, 80.0, 0.25)
    values = modal_sum(f, modes, FRF_POWERS[kind]) * np.exp(-2j * np.pi * f * delay)
    values = values * (1 + 0.01 * complex_noise(np.random.default_rng(4), values.shape))
    fit = fit_frf(FrfRecord(f, values, kind))
    check(fit, modes)
    (note,) = [note for note in fit.warnings if note.startswith("a delay of")]
    assert float(note.split()[3]) == pytest.approx(1e3 * delay, rel=0.02)


def test_poles_of_the_modes_are_stable_in_the_chart(four_modes):
    f, modes = four_modes
    noise = 1e-5 * complex_noise(np.random.default_rng(1), (3, 1, f.size))
    chart = selection.stability_chart(FrfRecord(f, modal_sum(f, modes) + noise, "receptance"))
    natural = [frequency for frequency, _, _ in modes]
    assert len(chart.frequencies) == len(chart.orders) == len(chart.is_stable)
    assert chart.orders.min() >= 1 and chart.orders.max() <= 40
    assert chart.is_stable[chart.recurring].all()
    for k in np.flatnonzero(chart.is_stable & (chart.orders == chart.orders.max())):
        assert chart.matches(int(k), natural).sum() == 1


def test_bins_are_few_and_lose_three_percent_of_the_precision_at_most():
    f, natural, ratio = np.arange(8.0, 32.0, 0.01), np.array([15.0]), np.array([0.01])
    lines = ModalSum.of(f, "receptance", RESIDUAL_POWERS[0])
    bins = replace(lines, starts=selection.bins(f, selection.Candidates(natural, ratio, np.array([0]))))
    assert 5 * len(bins.bin_sizes) < len(f)
    triangles, values = [], modal_sum(f, [(15.0, 0.01, (1.0,))])[0].T
    for model in (lines, bins):
        weights = np.ones((len(model.bin_sizes), 1))
        jacobian = TrialFit(model, model.bin_means(values), weights, natural, ratio).jacobian
        triangles.append(np.linalg.inv(np.linalg.qr(jacobian, mode="r")))
    all_lines, means = (np.linalg.norm(triangle, axis=1) for triangle in triangles)
    assert (means < 1.03 * all_lines).all()


@pytest.mark.slow
def test_bins_of_a_record_with_many_lines_leave_the_estimates_unchanged(monkeypatch):
    f, rng = np.arange(8.0, 32.0, 0.02), np.random.default_rng(21)
    modes = [(12.0, 0.02, (1.0, 0.5)), (25.0, 0.03, (0.6, -1.0))]
    values = modal_sum(f, modes)
    record = FrfRecord(f, values + 1e-5 * complex_noise(rng, values.shape), "receptance")
    sizes = []
    plain = fitting.select_modes
    monkeypatch.setattr(
        fitting, "select_modes", lambda selection, model: sizes.append(len(selection.values)) or plain(selection, model)
    )
    binned = fit_frf(record, frequencies=[12.1, 24.8])
    check(binned, modes)
    monkeypatch.setattr(fitting, "bins", lambda *_: None)
    all_lines = fit_frf(record, frequencies=[12.1, 24.8])
    assert 3 * sizes[0] < sizes[1] == len(f)
    for name, error in all_lines.standard_errors.items():
        assert abs(binned.estimates[name] - all_lines.estimates[name]) < 1e-3 * error
