"""Rotary inertia of the sections: Rayleigh's correction of a beam that is not slender."""

import json
import math
import re

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    HarmonicBase,
    InputError,
    Model,
    Pin,
    Roller,
    Section,
    StrainMeasures,
    natural_modes,
    simulate,
)
from ancf_casadi.export import write_exudyn, write_pyelastica
from ancf_casadi.export.simulators.segments import divide_beam
from ancf_casadi.mechanics.spec import BeamSpec
from problems import match_frequencies
from problems.matching.unknowns import Global

L, H, E, RHO = 0.5, 20e-3, 210e9, 8000.0
STEEL = {"length": L, "density": RHO, "elastic_modulus": E, "axis": (1.0, 0.0), "gravity": (0.0, 0.0)}
THICK = {**STEEL, "width": 5e-3, "thickness": H, "elements": 40, "rotary_sections": True}
SOFT = Beam.uniform(length=0.1, width=0.02, thickness=0.02, density=1070.0, elastic_modulus=264e3, elements=8,
                    rotary_sections=True)  # fmt: skip


def pinned_frequencies(gyration: float, numbers: np.ndarray) -> np.ndarray:
    """Return the frequencies of a pinned beam with rotary inertia, Hz (Rayleigh, The Theory of Sound, Section 186)."""
    k = numbers * math.pi / L
    return math.sqrt(E / RHO) * gyration * k**2 / np.sqrt(1 + (gyration * k) ** 2) / (2 * math.pi)


@pytest.mark.parametrize(
    ("section", "gyration"),
    [
        pytest.param(Section.rectangle(5e-3, H), H / math.sqrt(12), id="rectangle"),
        pytest.param(Section.circle(H), H / 4, id="circle"),
    ],
)
def test_frequencies_of_a_pinned_beam_are_those_of_rayleigh(section, gyration):
    supports = Pin(0.0), Roller(L)
    beam = Beam.uniform(**STEEL, section=section, elements=40, supports=supports, rotary_sections=True)
    expected = pinned_frequencies(gyration, np.arange(1, 3))
    assert natural_modes(Model(beam), count=2).frequencies == pytest.approx(expected, rel=1e-6)
    slender = natural_modes(Model(beam.with_(rotary_sections=False)), count=2).frequencies
    assert (slender > (1 + 3e-4) * expected).all()


@pytest.mark.parametrize("measures", [StrainMeasures(), StrainMeasures("green", "small")])
def test_energy_of_a_rigid_rotation_is_that_of_a_block(measures):
    model = Model(Beam.uniform(**{**THICK, "axis": (0.6, 0.8), "elements": 3}), measures)
    x, y = model.straight.reshape(-1, 2).T
    rotation = np.column_stack([-y, x]).ravel()
    mass = model.beam.mass
    inertia = rotation @ model.inertia_force(rotation, model.properties).full().ravel()
    assert inertia == pytest.approx(mass * (L**2 / 3 + H**2 / 12), rel=1e-12)


def test_motions_by_both_integrators_agree_and_keep_the_energy():
    settings = {"base": HarmonicBase(amplitude=0.02, frequency=3.0), "duration": 0.5, "sample_rate": 200.0}
    model = Model(SOFT)
    radau = simulate(model, method="radau", tolerance=1e-8, **settings)
    idas = simulate(model, method="idas", tolerance=1e-8, **settings)
    slender = simulate(Model(SOFT.with_(rotary_sections=False)), tolerance=1e-8, **settings)
    assert np.abs(radau.tip - idas.tip).max() < 2e-6
    assert np.abs(radau.tip - slender.tip).max() > 1e-4
    assert np.abs(radau.balance_error).max() < 1e-6 * np.ptp(radau.strain_energy)


def test_a_match_recovers_the_thickness():
    beam = Beam.uniform(**{**THICK, "thickness": 1.05 * H, "supports": (Pin(0.0), Roller(L))})
    gyration = H / math.sqrt(12)
    match = match_frequencies(
        beam, targets=pinned_frequencies(gyration, np.arange(1, 3)), unknowns=[Global("thickness")]
    )
    assert match.beam.thickness[0] == pytest.approx(H, rel=1e-6)


def test_files_keep_it_and_others_stay_as_they_were(tmp_path):
    (tmp_path / "beam.toml").write_text(
        "[beam]\nlength = 0.5\nwidth = 5e-3\nthickness = 0.02\ndensity = 8000.0\nelastic_modulus = 210e9\n"
        "elements = 2\nrotary_sections = true\n"
    )
    beam = Beam.from_toml(tmp_path / "beam.toml")
    assert beam.rotary_sections
    assert BeamSpec.of(beam).beam() == beam
    assert "rotary_sections" not in BeamSpec.of(beam.with_(rotary_sections=False)).set_fields()
    with pytest.raises(InputError, match="rotary_sections"):
        beam.with_(rotary_sections=1.0)


def test_segments_of_simulators_have_it_and_exudyn_refuses(tmp_path):
    beam = Beam.uniform(**THICK)
    segments, slender = (divide_beam(each, 10) for each in (beam, beam.with_(rotary_sections=False)))
    assert segments.inertias - slender.inertias == pytest.approx(beam.mass / 10 * H**2 / 12)
    texts = []
    for each in (beam, beam.with_(rotary_sections=False)):
        write_pyelastica(Model(each), tmp_path / "beam.py", segments=10)
        texts.append((tmp_path / "beam.py").read_text())
    turns, of_slender = (np.array(json.loads(re.search(r"TURNS = np.array\((.*?)\)", text)[1])) for text in texts)
    assert turns - of_slender == pytest.approx(beam.mass / 10 * H**2 / 12)
    with pytest.raises(InputError, match="rotary"):
        write_exudyn(Model(beam), tmp_path / "beam.py")
