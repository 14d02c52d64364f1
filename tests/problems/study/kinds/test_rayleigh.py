"""Coefficients of Rayleigh damping in a study: Eq. (17), their errors, and the law for later steps."""

import pytest

from ancf_casadi import InputError
from problems.paper.table_03 import proportional
from problems.study.compute import Compute
from problems.study.reading import read_study
from problems.study.step import Finding
from tests.problems.conftest import DECAYS, RAYLEIGH, without_times
from tests.problems.paper import numbers as paper


def finding(study_file, *pieces: str, **found: Finding):
    steps = {step.kind: step for step in read_study(study_file(*pieces)).steps}
    return steps["rayleigh"].finding(Compute(formats=()), found)


def test_the_coefficients_are_the_law_of_later_steps(study_file):
    outcome = finding(study_file, RAYLEIGH)
    assert outcome.data["alpha_stderr"] is None
    assert outcome.terms == ({"law": "rayleigh", "alpha": outcome.data["alpha"], "beta": outcome.data["beta"]},)


@pytest.mark.slow
def test_errors_come_from_the_identified_decays(study_file):
    rows = [
        {"damping_ratio": 0.01, "damping_ratio_stderr": 1e-4},
        {"damping_ratio": 0.0028, "damping_ratio_stderr": 2e-4},
    ]
    by_hand = finding(study_file, RAYLEIGH, "ratio_std = [1e-4, 2e-4]\n").data
    text = f'{RAYLEIGH}identified_by = "decays"\n'
    identified = finding(study_file, DECAYS, text, decays=Finding([*rows, rows[0]])).data
    assert without_times(identified) == without_times(by_hand)
    unknown = [{**rows[0], "damping_ratio_stderr": None}, rows[1]]
    assert finding(study_file, DECAYS, text, decays=Finding(unknown)).data["alpha_stderr"] is None


@pytest.mark.parametrize("data", [{"alpha": 1.0}, [], [{"damping_ratio": 0.01}], [{"frequency_hz": 1.0}] * 2])
def test_another_part_than_decays_is_refused(study_file, data):
    text = f'{RAYLEIGH}identified_by = "decays"\n'
    with pytest.raises(InputError, match="rayleigh: identified_by: the step 'decays' does not identify these 2 modes"):
        finding(study_file, DECAYS, text, decays=Finding(data))


def test_deviations_that_a_step_finds_are_not_stated_too(study_file):
    text = f'{RAYLEIGH}identified_by = "decays"\nratio_std = [1e-4, 2e-4]\n'
    with pytest.raises(InputError, match="ratio_std"):
        read_study(study_file(DECAYS, text))


@pytest.mark.slow
def test_the_table_shows_the_ratio_of_every_mode():
    """Erratum 5: Eq. (16) gives 0.3358, 0.5656, 0.9057 % for modes 3 to 5."""
    _, ratios = proportional.finding(Compute(formats=()), {}).tables
    assert [row[0] for row in ratios.rows] == pytest.approx(paper.TARGET_FREQUENCIES)
    assert [row[1] for row in ratios.rows] == pytest.approx([1.0, 0.28, 0.28, 0.23, 0.30])
    assert [row[2] for row in ratios.rows] == pytest.approx([1.0, 0.28, 0.3358, 0.5656, 0.9057], abs=5e-5)
