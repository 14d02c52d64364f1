"""A film on the page: what is clicked in its picture, the tracks, and the command that does the same."""

import math
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ancf_casadi import Measurement
from ancf_casadi.exceptions import InputError
from problems.cli import _parser, main
from problems.look.choices import is_film
from problems.look.film import FilmChoices, film_picture, track_film
from problems.look.worker import Work
from tests.problems.look.conftest import in_browser, wait_for

cv2 = pytest.importorskip("cv2")
RATE = 120.0


def write_film(path, frames=240):
    """Write a film of two dots, of which one is at rest; the other swings at 2 Hz with a damping ratio of 1 %."""
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), RATE, (320, 240), isColor=False)
    for time in np.arange(frames) / RATE:
        x = 160 + 60 * math.exp(-0.02 * math.pi * 2 * time) * math.cos(4 * math.pi * time)
        picture = np.full((240, 320), 200, np.uint8)
        for place in ((160, 20), (x, 180)):
            centre = tuple(round(16 * number) for number in place)  # in sixteenths of a pixel
            cv2.circle(picture, centre, 16 * 6, 30, -1, cv2.LINE_AA, 4)
        video.write(picture)
    video.release()
    return path


def test_the_command_tracks_the_same(tmp_path, monkeypatch, capsys):
    film = str(write_film(tmp_path / "a film.avi"))
    choices = FilmChoices(film, ruler=(10.0, 20.0, 310.0, 20.0), ruler_length=0.3, clamp=(160.0, 20.0))
    choices = replace(choices, **choices.with_marker((220.0, 180.0)))
    tracks, notes = track_film(choices, tmp_path)
    assert tracks.column == "x1_m" and any("slow motion" in note for note in notes)
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(choices.command())[1:]) == 0
    assert (tmp_path / "markers.csv").read_text() == Path(tracks.file).read_text()
    x = Measurement.from_file(tracks.file, "x1_m").values
    assert x[0] == pytest.approx(0.06, abs=2e-4) and x.min() == pytest.approx(-0.058, abs=1e-3)


def test_a_ruler_counts_once_its_length_is_known():
    choices = FilmChoices("film.avi", ruler=(10.0, 20.0, 310.0, 20.0))
    assert "--ruler" not in choices.command() and choices.settings() == {}
    options = vars(
        _parser().parse_args(shlex.split(FilmChoices(**vars(choices) | {"ruler_length": 0.3}).command())[1:])
    )
    assert options["ruler"] == (10.0, 20.0, 310.0, 20.0, 0.3)


def test_a_second_click_takes_a_marker_away():
    first = FilmChoices("film.avi").with_marker((20.0, 30.0))
    assert first == {"markers": ((20.0, 30.0),)}
    assert FilmChoices("film.avi", **first).with_marker((22.0, 31.0)) == {"markers": None}
    assert FilmChoices("film.avi", **first).with_marker((80.0, 30.0))["markers"] == ((20.0, 30.0), (80.0, 30.0))


def test_a_picture_without_markers_is_shown_all_the_same(tmp_path):
    film = FilmChoices(str(write_film(tmp_path / "film.avi", 12)), markers=((300.0, 230.0),))
    picture, reason = film_picture(film)
    assert "marker 1" in reason and film_picture(replace(film, markers=None))[1] == ""
    decoded = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert decoded.shape == (240, 320)
    with pytest.raises(InputError, match="ends before"):
        film_picture(replace(film, begin=5.0))


def test_tracking_stops_when_asked(tmp_path):
    work = Work("track")
    work.stop.set()
    assert work.run(track_film, FilmChoices(str(write_film(tmp_path / "film.avi"))), tmp_path) is None
    assert work.steps == 1 and not [*tmp_path.glob("*/markers.csv")]


def test_films_are_known_by_their_names():
    assert is_film(["a.mp4"]) and is_film(["b.avi"]) and is_film(["c.MOV"])
    assert not is_film(["a.csv"]) and not is_film(["a.mp4", "b.mp4"]) and not is_film([])


@pytest.mark.slow
@in_browser[1]
def test_a_film_is_tracked_and_its_decay_fitted(look, page, tmp_path):
    _, url = look(write_film(tmp_path / "film.avi"))
    page.goto(url)
    page.wait_for_function("document.querySelector('img')?.naturalWidth == 320")
    box = page.locator("img").bounding_box()
    for x in (10, 310):
        page.mouse.click(box["x"] + (x + 0.5) * box["width"] / 320, box["y"] + 20.5 * box["height"] / 240)
    page.get_by_label("length of the ruler, m").fill("0.3")
    page.get_by_label("length of the ruler, m").press("Enter")
    wait_for(page, "--ruler")
    page.mouse.click(box["x"] + 50, box["y"] + 50)  # the first of two points, which the choice of another place forgets
    page.get_by_role("button", name="clamp").click()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 20.5 * box["height"] / 240)
    wait_for(page, "--clamp")
    assert page.locator("circle[r='5']").count() == 3
    page.get_by_role("button", name="track").click()
    page.wait_for_function("document.body.innerText.match(/2\\.00\\d* . \\S+ Hz/)", timeout=30_000)
    wait_for(page, "fit-decay markers.csv --column x2_m")
    page.get_by_role("button", name="show motion over film").click()
    wait_for(page, "0 s: markers as tracked (blue), and as computed (red)")
    box = page.locator(".q-slider").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 3, box["y"] + box["height"] / 2)
    page.wait_for_function("!document.body.innerText.includes('\\n0 s: markers')")
    (time,) = re.findall(r"([\d.]+) s: markers", page.inner_text("body"))
    true = 160 + 60 * math.exp(-0.04 * math.pi * float(time)) * math.cos(4 * math.pi * float(time))
    shown = [
        page.locator("circle[stroke^='#']").nth(-k).get_attribute("cx") for k in (1, 2)
    ]  # as computed, and as tracked
    assert [float(place) for place in shown] == pytest.approx([true, true], abs=0.7)
    assert page.hosts == {url.split("/")[2]}
