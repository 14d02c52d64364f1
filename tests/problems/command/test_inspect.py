"""``ancf-casadi inspect``: what a newcomer sees of a file, and the next command that it proposes."""

import json
import shlex

import numpy as np
import pytest

from problems.cli import main

RATE = 100.0
TIME = np.arange(600) / RATE
REST = 0.5  # s
MM = np.where(TIME < REST, 5.0, 5.0 * np.exp(-0.3 * (TIME - REST)) * np.cos(2 * np.pi * 4.0 * (TIME - REST)))


@pytest.fixture
def record(tmp_path, monkeypatch):
    """Write a file in the working folder and return its name."""
    monkeypatch.chdir(tmp_path)

    def write(head="Time (ms);Weg [mm]", keep=TIME >= 0.0, columns=(1e3 * TIME, MM), name="decay.csv"):
        rows = zip(*(column[keep].tolist() for column in columns), strict=True)
        text = "".join(";".join(f"{value:.6f}" for value in row) + "\n" for row in rows)
        (tmp_path / name).write_text(f"{head}\n{text}")
        return name

    return write


def inspected(capsys, *arguments):
    assert main(["inspect", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_channels_rate_spectrum_and_release_are_found(record, capsys):
    data = inspected(capsys, record())
    (channel,) = data["channels"]
    assert (channel["name"], channel["unit"], channel["quantity"]) == ("Weg [mm]", "mm", "length")
    assert (channel["samples"], channel["gaps"]) == (600, 0)
    assert channel["highest"] == pytest.approx(5.0)
    assert channel["frequency"] == pytest.approx(4.0, abs=0.1)
    (times,) = data["times"]
    assert times["rate"] == pytest.approx(RATE)
    assert (times["gaps"], times["end"]) == (0, pytest.approx(5.99))
    assert data["fit"]["release"] == pytest.approx(REST, abs=0.03)
    assert data["fit"]["periods"] == pytest.approx(22.0, abs=1.0)


def test_the_record_is_cut_and_refused_as_by_fit_decay(record, capsys):
    """At uneven times, with an outlier before the release; and a record of noise."""
    rng = np.random.default_rng(0)
    values = np.where(TIME == 0.2, 50.0, MM) + 0.01 * rng.standard_normal(TIME.size)
    name = record(keep=rng.random(TIME.size) > 0.2, columns=(1e3 * TIME, values))
    plan = inspected(capsys, name)["fit"]
    assert main(["fit-decay", name, "--json"]) == 0
    fit = json.loads(capsys.readouterr().out)
    assert (plan["release"], plan["samples"], plan["reason"]) == (
        fit["release_time_s"], fit["samples"], fit["release_reason"],
    )  # fmt: skip
    noise = record(columns=(1e3 * TIME, rng.standard_normal(TIME.size)))
    assert "nothing oscillates" in inspected(capsys, noise)["fit"]["problem"]
    assert main(["fit-decay", noise]) == 2


def test_missing_samples_are_reported_with_the_longest_gap(record, capsys):
    keep = (TIME < 2.0) | (TIME > 2.1)
    keep[77] = False
    data = inspected(capsys, record(keep=keep))
    (times,) = data["times"]
    assert (times["gaps"], times["missing"]) == (2, int(np.sum(~keep)))
    assert times["longest_gap"] == pytest.approx(0.12)
    assert times["longest_gap_at"] == pytest.approx(1.99)
    assert times["rate"] == pytest.approx(RATE)


def test_the_text_ends_with_a_command_that_works(record, capsys):
    name = record("a;b;c", columns=(TIME, MM, 0.1 * MM))
    assert main(["inspect", name]) == 0
    text = capsys.readouterr().out
    assert "A fit needs more: has 2 columns of values, 2 'b', 3 'c'; choose with --column" in text
    assert "no unit is given for 2 'b', 3 'c'; SI units are assumed" in " ".join(text.split())
    proposed = shlex.split(text.strip().splitlines()[-1].partition("ancf-casadi ")[2])
    assert proposed == ["inspect", "decay.csv", "--column", "b"]
    assert main([*proposed, "--unit", "mm"]) == 0
    text = capsys.readouterr().out
    assert "A fit would use column 2 'b' as displacement" in text
    proposed = shlex.split(text.strip().splitlines()[-1].partition("ancf-casadi ")[2])
    assert proposed == ["fit-decay", "decay.csv", "--column", "b", "--unit", "mm"]


def test_a_name_with_a_comma_is_in_quotation_marks_in_a_list(record, capsys):
    name = record("time (s);x, across (mm);y, along (mm)", columns=(TIME, MM, 0.1 * MM))
    assert main(["inspect", name, "--leave-out", '"y, along (mm)"']) == 0
    proposed = shlex.split(capsys.readouterr().out.strip().splitlines()[-1].partition("ancf-casadi ")[2])
    assert proposed == ["fit-decay", name, "--leave-out", '"y, along (mm)"']
    assert main(proposed) == 0


def test_a_file_whose_time_is_not_clear_is_shown_all_the_same(record, capsys):
    name = record("a;b", columns=(MM, 0.1 * MM))
    assert main(["inspect", name]) == 0
    text = capsys.readouterr().out
    assert "no column is clearly the time" in text
    assert "--sample-rate" in text
    data = inspected(capsys, name, "--sample-rate", "100", "--column", "a", "--unit", "mm")
    assert data["channels"][0]["frequency"] == pytest.approx(4.0, abs=0.1)
    assert data["fit"]["problem"] == ""


def test_a_unit_that_is_not_understood_is_marked_and_asked_for(record, capsys):
    name = record("Time (ms);Weg [Skt]")
    assert main(["inspect", name]) == 0
    text = capsys.readouterr().out
    assert "Skt (?)" in text
    assert "the unit 'Skt' is not understood; give the unit with --unit" in text


@pytest.mark.slow
def test_the_figure_is_written(record, tmp_path):
    assert main(["inspect", record(), "--plot", "new/figure.png"]) == 0
    assert (tmp_path / "new" / "figure.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["absent.csv"], "absent.csv: cannot be read"),
        (["decay.csv", "--sample-rate", "-3"], "rate: must be positive, got -3"),
        (["decay.csv", "--plot", "absent.csv/figure.png", "--sample-rate", "0"], "--sample-rate: must be positive,"),
    ],
)
def test_unusable_arguments_are_refused_in_one_line(record, capsys, arguments, message):
    record()
    assert main(["inspect", *arguments]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert message in line


def test_times_of_a_channel_that_do_not_increase_are_reported_as_its_fault(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    header = "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\nChannels\t1\t\n"
    (tmp_path / "a.lvm").write_text(header + "***End_of_Header***\t\nX_Value\ttip\tComment\n0\t1\n0\t2\n0\t3\n")
    data = inspected(capsys, "a.lvm")
    assert data["channels"][0]["fault"] == data["fit"]["problem"].split(": ")[-1] == "has times that do not increase"


def test_numbers_near_the_limit_of_the_computer_are_shown_without_a_warning(record, capsys):
    name = record(columns=(1e3 * TIME, np.sign(MM) * 1e308))
    assert main(["inspect", name]) == 0
    assert capsys.readouterr().err == ""
