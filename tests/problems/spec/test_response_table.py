"""The table [response] gives the excitation of each level, or an error with the name of the key."""

import pytest

from ancf_casadi import HarmonicBase, HarmonicLoad, InputError, Model, QuadraticDamping
from ancf_casadi.reduction import ReducedModel
from problems.spec.motion import ResponseTables
from tests.problems.conftest import STRIP

BEAM = f"{STRIP}elements = 8\n"
LAW = '[[damping]]\nlaw = "quadratic"\neta2 = 0.1\n'
RANGE = "[response]\nfrequencies = [9.0, 11]\n"


def test_each_level_drives_the_base_from_the_first_frequency(file):
    task = ResponseTables.of(file(BEAM, LAW, RANGE, "base_amplitudes = [1e-4, 2e-4]\n"))
    assert task.table.frequencies == (9.0, 11.0)
    assert [task.excitation(level) for level in task.levels] == [
        {"base": HarmonicBase(1e-4, 9.0)},
        {"base": HarmonicBase(2e-4, 9.0)},
    ]
    assert task.damping == QuadraticDamping(eta2=0.1)
    assert task.unit == "m"


def test_a_force_at_the_tip_has_the_given_size_and_direction(file):
    task = ResponseTables.of(file(BEAM, RANGE, "tip_forces = 0.5\ndirection = [3, -4]\n"))
    ((name, load),) = task.excitation(0.5).items()
    assert name == "load" and isinstance(load, HarmonicLoad)
    assert load.force == pytest.approx((0.3, -0.4)) and load.frequency == 9.0
    assert task.unit == "N" and task.damping is None


@pytest.mark.slow
def test_the_beam_is_reduced_unless_the_file_asks_for_all_of_it(file):
    drive = "base_amplitudes = 1e-4\n"
    for text, count in (("", 8), ("modes = 3\n", 3)):
        body = ResponseTables.of(file(BEAM, LAW, RANGE, drive, text)).body
        assert isinstance(body, ReducedModel) and body.count == count
        assert body.law == QuadraticDamping(eta2=0.1)
    coarse = ResponseTables.of(file(BEAM.replace("elements = 8", "elements = 2"), LAW, RANGE, drive))
    assert coarse.body.count == 4
    assert isinstance(ResponseTables.of(file(BEAM, LAW, RANGE, drive, 'model = "full"\n')).body, Model)


def test_markers_are_points_of_the_output(file):
    task = ResponseTables.of(file(BEAM, RANGE, "base_amplitudes = 1e-4\n[markers]\nmiddle = 0.25\n"))
    assert task.markers == {"middle": 0.25}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"\[response\]: the table is missing"),
        (RANGE, r"\[response\]: base_amplitudes: give either base_amplitudes \(m\) or tip_forces \(N\)"),
        (RANGE + "base_amplitudes = 1e-4\ntip_forces = 1\n", r"base_amplitudes: give either"),
        (RANGE + "base_amplitudes = []\n", r"base_amplitudes: must be a list of 1 to 20, got \[\]"),
        (RANGE + "base_amplitudes = 1e-4\ndirection = [0, 0]\n", r"direction: must not be the zero vector"),
        (RANGE + "base_amplitudes = 1e-4\ntolerance = 0.1\n", r"tolerance: must be above 0 and at most 0.01, got 0.1"),
        (RANGE + 'base_amplitudes = 1e-4\nmodel = "both"\n', r"\[response\]: model: must be one of full, reduced,"),
        (RANGE + 'base_amplitudes = 1e-4\nmodel = "full"\nmodes = 3\n', r"modes: belongs to the reduced model"),
        ("[response]\nfrequencies = [2, 2]\nbase_amplitudes = 1e-4\n", r"frequencies: must be \[FROM, TO\]"),
        ("[response]\nfrequencies = [0, 1]\nbase_amplitudes = 1e-4\n", r"frequencies: 1: must be positive"),
        (RANGE + "base_amplitudes = 1e-4\n[markers]\nfar = 2.0\n", r"\[markers\]: far: point: the point must be on"),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(file, text, message):
    with pytest.raises(InputError, match=message) as caught:
        ResponseTables.of(file(BEAM, LAW, text))
    assert "\n" not in str(caught.value)
