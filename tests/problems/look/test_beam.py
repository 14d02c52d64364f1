"""The panel of a study with a beam, in a real browser."""

import json
import re
import time
import tomllib
import urllib.parse
from pathlib import Path

import numpy as np
import pytest

from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, natural_modes, simulate
from tests.problems.look.conftest import in_browser, run, wait_for

pytest.importorskip("nicegui")

STUDY = """
[beam]
length = 0.5           # m
width = 5e-3
thickness = 0.5e-3
density = 8000.0
elastic_modulus = 210e9
elements = 4

[[damping]]
law = "rayleigh"
alpha = 0.3            # 1/s

[base]
amplitude = 5e-3
frequency = 1.9

[[records]]
file = "motion.csv"
sensor = "position"
channels = [{column = "x_m", direction = [1.0, 0.0]}, {column = "y_m", direction = [0.0, 1.0]}]
"""
STEEL = {"width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9, "elements": 4}
SLOW = "\n[fit]\ntolerance = 1e-12\n"


@pytest.fixture
def study(tmp_path):
    """A function that writes a study of a motion of some duration (s), with the true alpha of 0.5/s."""

    def write(duration, more=""):
        model, base = Model(Beam.uniform(length=0.5, **STEEL)), HarmonicBase(amplitude=5e-3, frequency=1.9)
        motion = simulate(model, damping=RayleighDamping(0.5), base=base, duration=duration, sample_rate=50.0)
        tip = motion.tip + 1e-5 * np.random.default_rng(0).normal(size=motion.tip.shape)
        np.savetxt(
            tmp_path / "motion.csv", np.column_stack([motion.time, tip]), delimiter=",", header="t_s,x_m,y_m",
            comments="",
        )  # fmt: skip
        path = tmp_path / "study.toml"
        path.write_text(STUDY + more)
        return path

    return write


def fill(page, label, text):
    """Type a text into a field of the form."""
    field = page.get_by_label(label, exact=True).first
    field.fill(text)
    field.press("Tab")


def field_text(page, label):
    """Return what stands at a field, with its hint or its error."""
    return page.locator(".q-field", has=page.get_by_label(label, exact=True)).first.inner_text()


def wait_until_idle(page):
    page.wait_for_selector(".q-spinner.hidden", state="attached", timeout=30_000)


def shown_study(page):
    return tomllib.loads(study_text(page))


def study_text(page):
    return page.locator("textarea").last.input_value()


class TestInABrowser:
    pytestmark = in_browser

    def test_a_value_in_the_form_changes_the_study_and_the_modes(self, look, page, study):
        _, url = look(study(0.1))
        page.goto(url)
        for length in (0.5, 0.6):
            fill(page, "length", str(length))
            frequencies = natural_modes(Model(Beam.uniform(length=length, **STEEL)), count=6).frequencies
            wait_for(page, f"{frequencies[5]:.6g}")
            rows = page.locator("tbody tr").all_inner_texts()
            assert [float(row.split()[1]) for row in rows] == [float(f"{f:.6g}") for f in frequencies]
        assert "length = 0.6           # m" in study_text(page)
        assert page.hosts == {urllib.parse.urlsplit(url).netloc}

    def test_supports_and_laws_are_added_with_the_keys_of_their_kind(self, look, page, study):
        _, url = look(study(0.1))
        page.goto(url)
        for label, kind in (("add to supports", "pin"), ("add to damping", "quadratic")):
            wait_until_idle(page)
            page.get_by_label(label, exact=True).click()
            page.get_by_role("option", name=kind, exact=True).click()
            page.get_by_label(f"{label.split()[-1]} 2", exact=True).wait_for()
        wait_for(page, "[beam]: supports: 2: the key 'point' is missing")
        page.get_by_label("point", exact=True).nth(1).fill("0.5")
        page.get_by_label("point", exact=True).nth(1).press("Tab")
        fill(page, "eta2", "0.1")
        wait_for(page, "eta2 0.1 1/m")  # a slider
        tables = shown_study(page)
        assert tables["beam"]["supports"][1] == {"kind": "pin", "point": 0.5}
        assert tables["damping"] == [{"law": "rayleigh", "alpha": 0.3}, {"law": "quadratic", "eta2": 0.1}]

    def test_a_wrong_value_has_its_message_beside_it(self, look, page, study):
        _, url = look(study(0.1))
        page.goto(url)
        for label, text, message in (
            ("length", "-1", "study.toml: [beam]: length: must be positive, got -1"),
            ("alpha", "-0.5", "study.toml: [damping]: alpha: must not be negative, got -0.5"),
            ("width", "wide", "must be a value of TOML, such as 5e-3"),
        ):
            before = page.get_by_label(label, exact=True).input_value()
            fill(page, label, text)
            wait_for(page, message)
            assert message in field_text(page, label)
            fill(page, label, before)
            page.wait_for_function("text => !document.body.innerText.includes(text)", arg=message)

    def test_a_slider_changes_the_guess_and_the_computed_motion(self, opened, page, study):
        opened(study(0.1), text="alpha 0.3 1/s")
        wait_until_idle(page)
        box = page.locator(".q-slider").bounding_box()
        page.mouse.click(box["x"] + 0.6 * box["width"], box["y"] + box["height"] / 2)
        page.wait_for_function("!document.body.innerText.includes('alpha 0.3 1/s')")
        wait_until_idle(page)
        alpha = shown_study(page)["damping"][0]["alpha"]
        assert alpha == pytest.approx(0.3 * 10**0.2, rel=0.02)  # the slider spans a decade to either side
        assert page.get_by_label("alpha", exact=True).input_value() == str(alpha)

    def test_a_fit_stops_and_the_page_stays_usable(self, opened, page, study):
        process, _ = opened(study(3.0, SLOW), text="alpha 0.3 1/s")
        for _ in range(2):
            page.get_by_role("button", name="fit", exact=True).click()
            page.wait_for_function(r"/fit: [1-9]\d* steps/.test(document.body.innerText)")
            page.wait_for_timeout(300)
            began = time.perf_counter()
            page.get_by_role("button", name="stop", exact=True).click()
            wait_for(page, "stopped")
            assert time.perf_counter() - began < 2.0  # 0.3 s on an idle machine
            page.get_by_role("button", name="fit", exact=True).wait_for()
        fill(page, "length", "0.6")
        page.wait_for_function("document.querySelector('textarea').value.includes('length = 0.6')")
        page.get_by_role("button", name="fit", exact=True).click()
        page.wait_for_function(r"/fit: [1-9]\d* steps/.test(document.body.innerText)")
        page.close()
        assert process.wait(timeout=30) == 0  # the page has closed, and with it the fit

    def test_a_fit_has_the_numbers_of_the_study_that_is_saved(self, look, page, study, tmp_path):
        path = study(1.0)
        _, url = look(path)
        page.goto(url)
        fill(page, "alpha", "0.4")
        wait_for(page, "alpha 0.4 1/s")
        wait_until_idle(page)
        page.get_by_role("button", name="fit", exact=True).click()
        wait_for(page, "RayleighDamping(alpha), 95 % intervals")
        with page.expect_download() as download:
            page.get_by_text("save the study").click()
        saved = Path(download.value.path()).rename(tmp_path / "saved.toml")
        report = run("run", saved, "fit").splitlines()
        shown = page.inner_text("body")
        assert all(line in shown for line in report if line.startswith("estimate") or "alpha" in line)
        (estimate,) = json.loads(run("run", saved, "fit", "--json"))["motion"]["fit"]["estimates"]
        value = estimate["value"]
        assert re.search(rf"alpha +{value:.6g} +1/s", shown) and value == pytest.approx(0.5, rel=0.05)
        _, url = look(saved)
        page.goto(url)
        wait_for(page, "alpha 0.4 1/s")
        assert shown_study(page) == tomllib.loads(saved.read_text())

    def test_the_text_of_the_study_and_the_form_change_each_other(self, opened, page, study):
        opened(study(0.1), text="alpha 0.3 1/s")
        text = page.locator("textarea").last
        text.fill(study_text(page).replace("alpha = 0.3 ", "alpha = 0.4 ") + "\n[fit]\nrobust = true\n")
        text.press("Tab")
        wait_for(page, "alpha 0.4 1/s")
        page.get_by_text("[fit]", exact=True).click()
        fill(page, "unknowns", '["elastic_modulus"]')
        page.wait_for_function("document.querySelector('textarea').value.includes('unknowns')")
        assert shown_study(page)["fit"] == {"robust": True, "unknowns": ["elastic_modulus"]}
        text.fill("[beam")
        text.press("Tab")
        wait_for(page, "is not TOML")

    def test_all_steps_of_a_study_run_with_predictions_and_a_plan(self, opened, page, study, tmp_path):
        record = STUDY[STUDY.index("[[records]]") :]
        plan = '[[candidates]]\nname = "longer"\nduration = 2.0\nsample_rate = 50.0\nchannels = [{std = 1e-4}]\n'
        path = study(1.0, record.replace("[[records]]", "[[predictions]]\nname = 'the same again'") + plan)
        _, url = opened(path, text="alpha 0.3 1/s")
        wait_until_idle(page)
        page.get_by_role("button", name="run all steps").click()
        document = page.frame_locator("iframe")
        document.get_by_text("Planned experiments").first.wait_for(timeout=60_000)
        text = document.locator("body").inner_text()
        run("run", path, "--out", tmp_path / "out")
        (alpha,) = json.loads((tmp_path / "out" / "results.json").read_text())["motion"]["fit"]["estimates"]
        assert f"{alpha['value']:.6g}" in text
        assert all(words in text for words in ("the same again", "list within the budget 4"))
        assert page.hosts == {urllib.parse.urlsplit(url).netloc}

    def test_a_record_that_is_missing_is_simulated_first(self, opened, page, tmp_path):
        path, simulation = tmp_path / "study.toml", "[simulation]\nduration = 0.5\nsample_rate = 50.0\n"
        record = (
            '[[records]]\nfile = "out/motion.csv"\nsensor = "position"\ndirection = [1.0, 0.0]\ncolumn = "tip_x_m"\n'
        )
        path.write_text(STUDY[: STUDY.index("[[records]]")] + simulation + record)
        opened(path, text="does not exist; if it is to hold the motion of [simulation]")
        assert not page.get_by_role("button", name="fit", exact=True).is_visible()
        page.get_by_role("button", name="run simulation").click()
        page.get_by_role("button", name="fit", exact=True).wait_for()
        wait_for(page, "The record, and what the guesses give for it")
        assert (tmp_path / "out" / "motion.csv").exists()

    def test_without_a_record_the_simulated_motion_is_shown(self, opened, page, tmp_path):
        path = tmp_path / "study.toml"
        path.write_text(STUDY[: STUDY.index("[[records]]")] + "[simulation]\nduration = 0.2\n")
        opened(path, text="Simulated motion")
        assert not page.get_by_role("button", name="fit", exact=True).is_visible()
