"""Numbers whose squares are not finite are refused where they enter, and not by a library."""

import numpy as np
import pytest

from ancf_casadi import InputError, Measurement, read_recording
from problems.cli import main

TIME = np.arange(0.0, 5.0, 0.01)


@pytest.mark.parametrize("options", [["inspect"], ["fit-decay"]])
@pytest.mark.parametrize("values", [1e308 * (-1.0) ** np.arange(500), 1e154 * np.cos(19 * TIME)])
def test_a_command_refuses_them_in_one_line(tmp_path, capsys, options, values):
    path = tmp_path / "a.csv"
    np.savetxt(path, np.column_stack([TIME, values]), delimiter=",", header="t (s),x (mm)", comments="")
    assert main([*options, str(path), "--plot", str(tmp_path / "a.svg")]) == 2
    assert "has numbers beyond 1e+30, such as 1e+" in capsys.readouterr().err
    assert [channel.fault != "" for channel in read_recording(path).channels] == [True]


def test_a_measurement_names_the_first():
    with pytest.raises(InputError, match=r"^values: sample 3, -1e\+200, is beyond 1e\+30; check the unit"):
        Measurement([0.0, 1.0, 2.0], [1.0, 2.0, -1e200])
    with pytest.raises(InputError, match=r"^time: 1e\+308 is not within"):
        Measurement([0.0, 1e308], [1.0, 2.0])
