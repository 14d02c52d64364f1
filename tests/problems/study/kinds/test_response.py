"""A step with the response curves of the file."""

import pytest

from ancf_casadi import InputError
from problems.spec.motion import ResponseTables
from problems.study.reading import read_study
from problems.study.study import run_study
from tests.problems.conftest import BEAM

RESPONSE = """
[[damping]]
law = "modal"
ratios = [0.01, 0.003]

[response]
frequencies = [10.2, 10.8]
base_amplitudes = [5e-5, 2e-4]
modes = 2
points = 20
"""


@pytest.mark.slow
def test_the_table_response_adds_its_curves_to_a_study(study_file, tmp_path):
    path = study_file(BEAM, RESPONSE)
    found = run_study(path, tmp_path / "results")
    task = ResponseTables.of(str(path))
    assert [level["level"] for level in found.results["response"]] == [5e-5, 2e-4]
    for level in found.results["response"]:
        curve = task.curve(level["level"])
        assert level["curve"]["frequency_hz"] == curve.frequencies.tolist()
        assert level["curve"]["points"]["tip"]["amplitude_m"] == curve.amplitude().tolist()
        assert level["curve"]["stable"] == curve.stable.tolist()
    curve = found.results["response"][1]["curve"]  # of mode 2, which softens: it jumps at its folds
    upper, lower = (fold["frequency_hz"] for fold in curve["bifurcations"])
    assert (curve["jumps_up_hz"], curve["jumps_down_hz"]) == ([upper], [lower])
    assert lower < upper and not all(curve["stable"])
    assert curve["peak_damping_ratio"] == pytest.approx(0.003, rel=0.1)
    assert (tmp_path / "results" / "figures").exists()


def test_without_its_table_it_is_refused_before_any_computation(study_file):
    with pytest.raises(InputError, match=r"\[response\]: the table is missing"):
        read_study(study_file(BEAM, '[[steps]]\nkind = "response"\n'))
