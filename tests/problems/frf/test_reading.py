"""The same functions in every format; units tell the kind; what is not clear is refused with the remedy."""

import numpy as np
import pytest
from scipy.io import savemat

from ancf_casadi import InputError, read_recording
from ancf_casadi.records.layout import TableLayout
from ancf_casadi.records.over_frequency import is_over_frequency
from ancf_casadi.records.reading.formats import read_contents
from problems import FrfRecord, fit_frf
from problems.frf.record import frf_unit

F = np.linspace(1.0, 30.0, 581)
H = np.array([
    sum(a / ((2 * np.pi) ** 2 * (f0**2 - F**2 + 2j * z * f0 * F)) for a, f0, z in modes)
    for modes in (((3.0, 10.0, 0.01), (-2.0, 20.0, 0.008)), ((1.5, 10.0, 0.01), (1.0, 20.0, 0.008)))
])  # fmt: skip


def table(path, head, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=head, comments="", fmt="%.15g")
    return path


def universal(path, functions, *, denominator=13, label="NONE", axis="NONE"):
    """Write functions (output node, input node, values), displacement per force."""
    import pyuff

    sets = [
        pyuff.prepare_58(
            binary=0, func_type=4, rsp_node=output, rsp_dir=3, ref_dir=-3, ref_node=source, ord_data_type=6,
            num_pts=F.size, abscissa_spacing=1, abscissa_min=F[0], abscissa_inc=F[1] - F[0],
            abscissa_spec_data_type=18, abscissa_axis_units_lab=axis, ordinate_spec_data_type=8,
            ordinate_axis_units_lab=label, orddenom_spec_data_type=denominator,
            z_axis_spec_data_type=0, data=values, x=F, id1="frf",
        )
        for output, source, values in functions
    ]  # fmt: skip
    pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")
    return path


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves the file open
class TestUniversalFiles:
    def test_outputs_of_one_input(self, tmp_path):
        record = FrfRecord.from_file(universal(tmp_path / "a.uff", [(4, 1, H[0]), (7, 1, H[1])]))
        np.testing.assert_allclose(record.values[:, 0], H, rtol=1e-5)
        np.testing.assert_allclose(record.frequencies, F, rtol=1e-6)
        assert record.kind == "receptance"
        assert is_over_frequency(read_contents(tmp_path / "a.uff"))

    def test_a_matrix_of_outputs_and_inputs_in_any_order(self, tmp_path):
        functions = [(4, 1, H[0]), (7, 2, 3 * H[1]), (4, 2, 2 * H[0]), (7, 1, H[1])]
        record = FrfRecord.from_file(universal(tmp_path / "a.uff", functions))
        expected = np.array([[H[0], 2 * H[0]], [H[1], 3 * H[1]]])
        np.testing.assert_allclose(record.values, expected, rtol=1e-5)
        with pytest.raises(InputError, match="has no function of node 7 Z for the input 1 -Z; keep the functions"):
            FrfRecord.from_file(universal(tmp_path / "a.uff", functions[:3]))

    @pytest.mark.parametrize(("axis", "factor"), [("Hz", 1.0), ("kHz", 1e3), ("rad/s", 0.5 / np.pi), ("rpm", 1 / 60)])
    def test_frequencies_are_in_the_unit_of_their_label(self, tmp_path, axis, factor):
        record = FrfRecord.from_file(universal(tmp_path / "a.uff", [(4, 1, H[0])], axis=axis))
        np.testing.assert_allclose(record.frequencies, factor * F, rtol=1e-6)
        with pytest.raises(InputError, match=r"a\.uff: .*'foo'"):
            FrfRecord.from_file(universal(tmp_path / "a.uff", [(4, 1, H[0])], axis="foo"))

    def test_a_label_holds_and_a_record_over_time_is_none_of_them(self, tmp_path):
        path = universal(tmp_path / "a.uff", [(4, 1, 1e3 * H[0])], denominator=0, label="mm/N")
        np.testing.assert_allclose(FrfRecord.from_file(path).values[0, 0], H[0], rtol=1e-5)
        with pytest.raises(InputError, match=r"has values over frequency, not over time; .*without a beam fit-mode"):
            read_recording(path)


@pytest.mark.slow
def test_matlab_npz_and_text(tmp_path):
    savemat(tmp_path / "a.mat", {"test": {"f_Hz": F, "H": H.T, "remark": "x"}})
    np.savez(tmp_path / "a.npz", frequency=F, H=H)
    columns = (column for h in H for column in (20 * np.log10(np.abs(h)), np.degrees(np.unwrap(np.angle(h)))))
    table(tmp_path / "a.csv", "f [Hz],tip mag [dB],tip phase [deg],mid mag [dB],mid phase [deg]", F, *columns)
    head = (
        "Frequency (Hz),Disp1/Force real (mm/N),Disp1/Force imag (mm/N),Disp2/Force Re (mm/N),Disp2/Force Im (mm / N)"
    )
    table(tmp_path / "b.csv", head, F, *(1e3 * column for h in H for column in (h.real, h.imag)))
    for name, kind in (("a.mat", "receptance"), ("a.npz", "receptance"), ("a.csv", "receptance"), ("b.csv", None)):
        record = FrfRecord.from_file(tmp_path / name, kind)
        np.testing.assert_allclose(record.values[:, 0], H, rtol=1e-9, err_msg=name)
    assert record.kind == "receptance"


def test_a_fit_of_a_file_repeats_the_notes_of_the_reader(tmp_path):
    rng = np.random.default_rng(0)
    noisy = H + 1e-4 * np.abs(H).max() * (rng.normal(size=(2, *H.shape)).T @ [1, 1j]).T
    np.savez(tmp_path / "a.npz", frequency=np.r_[0.0, F], H=np.c_[[1.0, 1.0], noisy])
    record = FrfRecord.from_file(tmp_path / "a.npz", "receptance")
    assert record.frequencies[0] == 1.0
    fit = fit_frf(record, frequencies=[10.0, 20.0])
    np.testing.assert_allclose(fit.frequencies, [10.0, 20.0], rtol=1e-3)
    assert "a.npz: 1 lines at 0 Hz or with a gap are left out" in fit.warnings
    assert any(text.startswith("a.npz: no unit is given for 2 'H real[1]'") for text in fit.warnings)


def test_columns_without_a_phase_beside_functions_are_left_out_and_said(tmp_path):
    path = table(tmp_path / "a.csv", "f_Hz,H real (m/N),H imag (m/N),spectrum (N)", F, H[0].real, H[0].imag, F)
    record = FrfRecord.from_file(path)
    assert record.outputs == 1
    assert record.notes == ("a.csv: column 4 'spectrum (N)' has no phase, and is left out",)


@pytest.mark.parametrize("names", ["Phase1 Phase2 Mag2 Mag1", "phase_1 Phase2 2mag mag1", "ph_a ph_b mag_b mag_a"])
def test_amplitudes_and_phases_are_paired_by_their_words_in_any_order(tmp_path, names):
    head = "f_Hz,{} (rad),{} (rad),{} (m/N),{} (m/N)".format(*names.split())
    path = table(tmp_path / "a.csv", head, F, *np.angle(H), *np.abs(H[::-1]))
    np.testing.assert_allclose(FrfRecord.from_file(path).values[:, 0], H)


def test_amplitudes_and_phases_that_all_have_other_words_are_not_paired_by_their_order(tmp_path):
    path = table(tmp_path / "a.csv", "f_Hz,MagB (m/N),MagA (m/N),Phase A,Phase B", F, *np.abs(H[::-1]), *np.angle(H))
    with pytest.raises(InputError, match="--phase"):
        FrfRecord.from_file(path)
    path = table(tmp_path / "a.csv", "f_Hz,MagB (m/N),MagA (m/N),Phase,Phase", F, *np.abs(H), *np.angle(H))
    np.testing.assert_allclose(FrfRecord.from_file(path).values[:, 0], H)


def test_coherence_gives_weights(tmp_path):
    coherence = np.linspace(0.5, 1.0, F.size)
    path = table(tmp_path / "a.csv", "f_Hz,H real (m/N),H imag (m/N),coherence", F, H[0].real, H[0].imag, coherence)
    np.testing.assert_allclose(FrfRecord.from_file(path).coherence[0, 0], coherence)


@pytest.mark.parametrize(
    ("text", "kind", "factor"),
    [
        ("m/N", "receptance", 1.0), ("mm/kN", "receptance", 1e-6), ("(mm/s)/N", "mobility", 1e-3),
        ("m/s/N", "mobility", 1.0), ("m/s^2/N", "accelerance", 1.0), ("(m/s²)/(N)", "accelerance", 1.0),
        ("g/N", "accelerance", 9.80665), ("g/g", "transmissibility", 1.0), ("1", "transmissibility", 1.0),
        ("(mm/s)/(m/s)", "transmissibility", 1e-3), ("0.001 m/N", "receptance", 1e-3),
    ],
)  # fmt: skip
def test_units_tell_the_kind(text, kind, factor):
    assert frf_unit(text, "") == (kind, pytest.approx(factor))


@pytest.mark.parametrize(
    ("head", "options", "message"),
    [
        ("f_Hz,H (m/N),H2 (m/N)", {}, "column 2 'H .m/N.': has amplitudes only; a function needs its phase"),
        ("f_Hz,H real (m/N),phase (deg)", {}, "is a real part without an imaginary one"),
        ("f_Hz,H (m/N),phase [grad]", {}, "give --phase-unit"),
        ("f_Hz,H real (mm/N),H imag (m/N)", {}, "column 3 .*'m/N'"),
        ("f_Hz,H real,H imag", {}, "the values have no unit; give the kind"),
        ("f_Hz,H real (V/N),H imag (V/N)", {}, "the unit 'V/N' is none of such a function"),
        ("f_Hz,H real (m/N),H imag (m/N)", {"kind": "mobility"}, "are in units of mobility and receptance"),
        ("t_s,H real (m/N),H imag (m/N)", {}, "the frequency is in no column that says so"),
    ],
)
def test_what_is_not_clear_is_refused(tmp_path, head, options, message):
    with pytest.raises(InputError, match=message):
        FrfRecord.from_file(table(tmp_path / "a.csv", head, F, H[0].real, H[0].imag), **options)


def test_a_coherence_that_one_function_lacks_is_left_out_with_a_note(tmp_path):
    head = "f_Hz,a real (m/N),a imag (m/N),a coherence,b real (m/N),b imag (m/N)"
    path = table(tmp_path / "a.csv", head, F, H[0].real, H[0].imag, 0.9 + 0 * F, H[1].real, H[1].imag)
    record = FrfRecord.from_file(path)
    assert record.coherence is None
    assert any("coherence: left out" in note and "b real" in note for note in record.notes)


@pytest.mark.parametrize(
    ("coherence", "note"),
    [
        (np.where(F < 2.0, 1.0000000000000009, 0.9), ""),
        (np.where(F < 2.0, 99.5, 90.0), "the coherence is taken in percent"),
        (np.where(F == F[7], 7.0, 0.9), "1 coherences beyond 0 and 1 count as these limits"),
        (np.where(F == F[7], np.nan, 0.9), "1 coherences that are missing count as 0"),
    ],
    ids=["rounding", "percent", "a bad line", "a gap"],
)
def test_a_coherence_beyond_its_limits_is_clipped(tmp_path, coherence, note):
    path = table(tmp_path / "a.csv", "f_Hz,H real (m/N),H imag (m/N),coherence", F, H[0].real, H[0].imag, coherence)
    record = FrfRecord.from_file(path)
    assert record.coherence.min() >= 0.0 and record.coherence.max() <= 1.0
    assert float(np.median(record.coherence)) == pytest.approx(
        float(np.nanmedian(coherence)) / (100 if "perc" in note else 1)
    )
    assert any(note in text for text in record.notes) or not note


COMPLEX_TEXTS = {
    "python": "({0.real:.8e}{0.imag:+.8e}j)", "matlab": "{0.real:.8e}{0.imag:+.8e}i",
    "octave": "{0.real:.8e} {0.imag:+.8e}*i",
}  # fmt: skip


@pytest.mark.parametrize("style", COMPLEX_TEXTS)
def test_complex_text_is_a_function(tmp_path, style):
    path = tmp_path / "a.csv"
    cells = [COMPLEX_TEXTS[style].format(complex(value)) for value in H[0]]
    path.write_text("f (Hz),H (m/N)\n" + "".join(f"{f},{cell}\n" for f, cell in zip(F, cells, strict=True)))
    np.testing.assert_allclose(FrfRecord.from_file(path).values[0, 0], H[0], rtol=1e-7)


def test_a_table_without_names_is_read_by_the_column_of_the_imaginary_parts(tmp_path):
    path = tmp_path / "a.txt"
    np.savetxt(path, np.column_stack([F, H[0].real, H[0].imag]))
    with pytest.raises(InputError, match="choose with --frequency"):
        FrfRecord.from_file(path, unit="m/N")
    with pytest.raises(InputError, match="--imaginary"):
        FrfRecord.from_file(path, unit="m/N", frequency=1)
    record = FrfRecord.from_file(path, unit="m/N", frequency=1, layout=TableLayout(imaginary=3))
    np.testing.assert_allclose(record.values[0, 0], H[0])


@pytest.mark.parametrize(("unit", "factor"), [("m/N", 1.0), ("1 m/N", 1.0), ("mm/N", 1e-3)])
def test_decibels_refer_to_their_unit(tmp_path, unit, factor):
    head = f"f (Hz),H (dB re {unit}),phase (deg)"
    path = table(tmp_path / "a.csv", head, F, 20.0 * np.log10(np.abs(H[0]) / factor), np.degrees(np.angle(H[0])))
    record = FrfRecord.from_file(path)
    assert record.kind == "receptance"
    np.testing.assert_allclose(record.values[0, 0], H[0])


@pytest.mark.parametrize(
    ("head", "over_frequency"),
    [("f (Hz),tip (mm/N),phase (deg)", True), ("time (s),f (Hz),tip (mm)", False), ("a,b,c", False)],
)
def test_a_file_with_frequencies_and_no_times_is_over_frequency(tmp_path, head, over_frequency):
    path = table(tmp_path / "a.csv", head, F, abs(H[0]), abs(H[1]))
    assert is_over_frequency(read_contents(path)) is over_frequency
