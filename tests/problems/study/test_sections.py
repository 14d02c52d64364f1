"""Studies of beams with round sections and sections of given stiffness: their tables name what the sections have."""

import pytest

from ancf_casadi.export import read_document
from problems import run_study

STUDY = """[beam]
length = 0.5
elements = 6
axis = [1.0, 0.0]
{beam}
[match]
targets = [{targets}]
unknowns = {unknowns}
[[steps]]
kind = "beam"
[[steps]]
kind = "match"
[[steps]]
kind = "beam"
beam = "match"
"""
ROD = 'section = {kind = "tube", outer = 3e-3, inner = 1e-3}\ndensity = 1500.0\nelastic_modulus = 3e9\n'
CABLE = 'section = {kind = "stiffness", bending = 0.03, axial = 5e4, mass_per_length = 0.02}\n'


@pytest.mark.parametrize(
    ("beam", "unknown", "names"),
    [
        (ROD, "diameter", ("length", "diameter", "density", "elastic modulus")),
        (CABLE, "bending_stiffness", ("length", "bending stiffness", "axial stiffness", "mass per length")),
    ],
)
def test_tables_have_the_properties_of_the_sections(tmp_path, beam, unknown, names):
    path = tmp_path / "study.toml"
    targets = {"diameter": "2.6, 16.1", "bending_stiffness": "2.8, 17.5"}[unknown]
    path.write_text(STUDY.format(beam=beam, targets=targets, unknowns=f'{{{unknown} = "global"}}'))
    given, _, matched = run_study(path, tmp_path / "out").steps
    for finding in (given, matched):
        (table,) = finding.tables
        assert tuple(row[0] for row in table.rows) == names
        assert any(note.startswith("Sections: Section(") for note in table.notes)
    value = {row[0]: row[2] for row in matched.tables[0].rows}[names[1]]
    document = read_document(tmp_path / "out" / "matched.json")
    scale = 1e3 if unknown == "diameter" else 1.0
    assert value == pytest.approx(scale * getattr(document.model.beam, unknown)[0], rel=1e-12)
