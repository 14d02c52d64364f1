"""The page in a real browser, and the guard of its server."""

import asyncio
import contextlib
import http.client
import json
import re
import runpy
import shlex
import time
import urllib.parse
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("nicegui")

from problems.look.charts import BINS, thin
from problems.look.guard import Guard
from problems.study.formatting import shown
from tests.problems.look.conftest import in_browser, run, wait_for

TOKEN, ADDRESS = "secret", "127.0.0.1:1234"


def answer(headers=(), query="", kind="http"):
    """Return the messages that a request to a guarded application gets."""
    sent = []

    async def application(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message):
        sent.append(message)

    headers = {"host": ADDRESS} | dict(headers)
    encoded = [(name.encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": kind, "headers": encoded, "query_string": query.encode()}
    with ThreadPoolExecutor(1) as other_thread:  # in this one, the browser's event loop may run
        other_thread.submit(asyncio.run, Guard(application, TOKEN, ADDRESS)(scope, None, send)).result()
    return sent


def test_the_token_opens_the_page_once_and_a_cookie_does_afterwards():
    (first,) = answer(query=f"token={TOKEN}")
    assert first["status"] == 200
    ((_, cookie),) = first["headers"]
    assert b"HttpOnly" in cookie and b"SameSite=Strict" in cookie
    (later,) = answer({"cookie": cookie.decode().split(";")[0]})
    assert later["status"] == 200 and not later["headers"]


@pytest.mark.parametrize(
    ("headers", "query"),
    [
        ({}, ""),
        ({}, "token=other"),
        ({"cookie": "ancf_casadi_token=other"}, ""),
        ({"origin": "http://elsewhere.example"}, f"token={TOKEN}"),
        ({"host": "elsewhere.example:1234"}, f"token={TOKEN}"),
    ],
)
def test_whoever_does_not_know_the_token_or_comes_from_elsewhere_is_refused(headers, query):
    assert answer(headers, query)[0]["status"] == 403
    assert answer(headers, query, "websocket")[0]["status"] == 403


def test_a_thinned_line_keeps_its_extremes():
    y = np.random.default_rng(0).normal(size=60_000)
    points = np.array(thin(np.arange(y.size), y))
    assert len(points) <= 2 * BINS
    assert (np.diff(points[:, 0]) > 0).all()
    assert points[:, 1].min() == y.min() and points[:, 1].max() == y.max()


def write_decay(path, samples=1601, header="t (s),tip (mm)", omega=12.3, seed=0):
    time, noise = np.linspace(0.0, 8.0, samples), np.random.default_rng(seed).normal(size=samples)
    y = 20.0 * np.exp(-0.25 * time) * np.cos(omega * time) + 0.05 * noise
    np.savetxt(
        path, np.column_stack([time, y, 2 * y][: header.count(",") + 1]), delimiter=",", header=header, comments=""
    )
    return path


def write_functions(path, header="f (Hz),tip (mm/N),phase (deg)"):
    """Write a function of modes at 12 and 35 Hz."""
    f, noise = np.linspace(5.0, 50.0, 901), np.random.default_rng(0).normal(0.0, 1e-5, (2, 901))
    values = sum(1.0 / (f0**2 - f**2 + 0.02j * f0 * f) for f0 in (12.0, 35.0)) + noise[0] + 1j * noise[1]
    np.savetxt(
        path,
        np.column_stack([f, np.abs(values), np.degrees(np.angle(values))]),
        delimiter=",",
        header=header,
        comments="",
    )
    return path


CLICKED = """([chart, x, y]) => {
    const element = document.querySelectorAll('.nicegui-echart')[chart], box = element.getBoundingClientRect();
    const pixel = getElement(Number(element.id.slice(1))).chart.convertToPixel({gridIndex: 0}, [x, y]);
    return [box.x + pixel[0], box.y + pixel[1]];
}"""  # where a point of a chart is


def options(page, chart):
    """Return the options of a chart as the browser has them."""
    script = "chart => getElement(Number(document.querySelectorAll('.nicegui-echart')[chart].id.slice(1)))"
    return page.evaluate(f"{script}.chart.getOption()", chart)


def brush(page, begin, end, chart=0):
    """Brush over a part of a chart, from one fraction of its width to another."""
    box = page.locator("canvas").nth(chart).bounding_box()
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + begin * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + end * box["width"], y, steps=8)
    page.mouse.up()


def command_line(page):
    return re.search(r"ancf-casadi fit-decay .*", page.inner_text("body"))[0]


class TestInABrowser:
    pytestmark = in_browser

    def test_a_brush_and_a_law_give_the_numbers_of_the_study_that_is_saved(self, opened, page, tmp_path):
        _, url = opened(write_decay(tmp_path / "tip.csv"), text="±")
        page.wait_for_timeout(500)  # until the pointer brushes
        brush(page, 0.2, 0.8)
        wait_for(page, "--begin")
        page.get_by_label("law", exact=True).click()
        page.get_by_role("option", name="quadratic").first.click()
        wait_for(page, "quadratic decay")
        with page.expect_download() as download:
            page.get_by_text("save study.toml").click()
        study = Path(download.value.path()).rename(tmp_path / "study.toml")
        report = run("fit-decay", *shlex.split(command_line(page))[2:])
        text = page.inner_text("body")
        assert all(line.strip() in text for line in report.splitlines())
        (decay,) = json.loads(run("run", study, "--json"))["decays"]
        assert f"frequency                 {decay['frequency_hz']:.6g} +-" in text
        assert page.hosts == {urllib.parse.urlsplit(url).netloc}

    def test_the_value_at_the_cursor_has_its_error(self, opened, page, tmp_path):
        opened(write_decay(tmp_path / "tip.csv"), text="±")
        page.wait_for_timeout(1000)
        box = page.locator("canvas").nth(3).bounding_box()
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.wait_for_function("/at \\S+ m: 1\\.95\\d+ ± \\S+ Hz, \\S+ ± \\S+ %/.test(document.body.innerText)")

    def test_dropped_files_say_what_they_need(self, look, page, tmp_path):
        process, url = look()
        page.goto(url)
        page.wait_for_selector("input[type=file]", state="attached")
        page.set_input_files("input[type=file]", {"name": "none.toml", "mimeType": "text/plain", "buffer": b"[study]"})
        wait_for(page, "decays")
        page.set_input_files("input[type=file]", write_decay(tmp_path / "two.csv", header="t (s),tip (mm),middle (mm)"))
        wait_for(page, "has 2 columns of values")
        page.get_by_label("column").click()
        page.get_by_role("option", name="middle").click()
        wait_for(page, "±")
        assert "--column 'middle (mm)'" in command_line(page)
        page.goto("about:blank")  # leaves the page as a closed tab does; ``close`` may drop its farewell
        assert process.wait(timeout=30) == 0

    def test_a_click_on_the_line_of_a_column_chooses_it_and_saving_waits_for_a_fit(self, opened, page, tmp_path):
        opened(write_decay(tmp_path / "two.csv", header="t (s),tip (mm),middle (mm)"), text="Choose a column")
        assert page.get_by_role("button", name="save the report").is_disabled()
        page.get_by_role("button", name="middle (mm)").click()
        wait_for(page, "±")
        assert "--column 'middle (mm)'" in command_line(page)
        assert "Choose a column" not in page.inner_text("body")
        with page.expect_download() as download:
            page.get_by_role("button", name="save the report").click()
        assert "linear decay" in Path(download.value.path()).read_text()
        assert page.evaluate("document.querySelectorAll('canvas').length") == 5
        page.get_by_label("unit", exact=True).fill("parsecs")
        page.get_by_label("unit", exact=True).press("Enter")
        wait_for(page, "not a known unit")
        assert not any(canvas.is_visible() for canvas in page.locator("canvas").all())
        assert page.get_by_role("button", name="save the figure").is_disabled()

    def test_a_double_click_chooses_the_release_and_laws_have_probabilities(self, look, page, tmp_path):
        _, url = look(write_decay(tmp_path / "tip.csv"))
        page.set_viewport_size({"width": 1000, "height": 1000})
        page.goto(url)
        wait_for(page, "±")
        page.wait_for_timeout(1000)  # until the chart is drawn
        page.mouse.dblclick(*page.evaluate(CLICKED, [0, 2.0, 0.0]))
        wait_for(page, "--release-time")
        (release,) = re.findall(r"--release-time (\S+)", command_line(page))
        assert float(release) == pytest.approx(2.0, abs=0.02)
        assert "--begin" not in command_line(page)
        page.get_by_label("law", exact=True).click()
        page.get_by_role("option", name="auto").first.click()
        wait_for(page, "quadratic ")
        lines = [len(options(page, chart)["series"]) for chart in (3, 4)]
        box = page.get_by_role("checkbox", name=re.compile("linear [0-9.]+ %")).first
        box.click()
        page.wait_for_timeout(500)
        assert [len(options(page, chart)["series"]) for chart in (3, 4)] == [count - 3 for count in lines]
        assert page.evaluate("document.documentElement.scrollWidth") == 1000

    def test_the_line_of_the_release_is_dragged_and_follows_the_size_of_the_page(self, opened, page, tmp_path):
        opened(write_decay(tmp_path / "tip.csv"), text="±")
        for width, instant in ((1400, 2.0), (1000, 3.0)):
            page.set_viewport_size({"width": width, "height": 1000})
            page.wait_for_timeout(1000)  # until the chart is drawn
            (handle,) = options(page, 0)["graphic"][0]["elements"]
            box, target = page.locator("canvas").first.bounding_box(), page.evaluate(CLICKED, [0, instant, 0.0])
            page.mouse.move(box["x"] + handle["x"] + handle["shape"]["width"] / 2, target[1])
            page.mouse.down()
            page.mouse.move(*target, steps=6)
            page.mouse.up()
            pattern = f"/--release-time ({instant:.0f}|{instant - 1:.0f}[.]9)/"
            page.wait_for_function(f"{pattern}.test(document.body.innerText)")
            page.wait_for_timeout(500)
            (release,) = re.findall(r"--release-time (\S+)", command_line(page))
            assert float(release) == pytest.approx(instant, abs=0.03)
        assert "--begin" not in command_line(page)

    def test_the_spectrum_names_peaks_and_harmonics(self, opened, page, tmp_path):
        time, noise = np.linspace(0.0, 20.0, 4001), np.random.default_rng(0).normal(0.0, 0.01, 4001)
        swing = 20.0 * np.exp(-0.1 * time) * np.cos(12.3 * time) + np.exp(-0.2 * time) * np.cos(81.0 * time) + noise
        np.savetxt(
            tmp_path / "tip.csv", np.column_stack([time, swing]), header="t (s),tip (mm)", delimiter=",", comments=""
        )
        opened(tmp_path / "tip.csv", text="±")
        page.wait_for_timeout(500)
        spectrum, peaks = options(page, 2)["series"]
        assert [point[0] for point in peaks["data"]] == pytest.approx([12.3 / 2 / np.pi, 81.0 / 2 / np.pi], abs=0.05)
        marks = {mark["label"]["formatter"]: mark["xAxis"] for mark in spectrum["markLine"]["data"]}
        assert marks == pytest.approx({"f": 1.9576, "2 f": 3.9152, "3 f": 5.8728}, rel=1e-3)

    def test_a_gap_is_no_line(self, opened, page, tmp_path):
        path = write_decay(tmp_path / "tip.csv")
        lines = path.read_text().splitlines()
        path.write_text("\n".join(lines[:400] + lines[600:]) + "\n")
        opened(path, text="±")
        data = options(page, 0)["series"][0]["data"]
        assert sum(point[1] is None for point in data) == 2  # of the gap, and at the end

    def test_takes_are_listed_and_compared_and_saved_as_one_study(self, look, page, tmp_path):
        _, url = look()
        page.goto(url)
        page.wait_for_selector("input[type=file]", state="attached")
        files = [write_decay(tmp_path / f"take{k}.csv", omega=12.3 + k / 50, seed=k) for k in (0, 1, 2)]
        page.set_input_files("input[type=file]", files)
        wait_for(page, "the 3 records do not agree")
        assert command_line(page) == "ancf-casadi fit-decay take0.csv take1.csv take2.csv"
        page.locator("tr", has_text="take1.csv").click()
        page.get_by_label("begin").fill("0.5")
        page.get_by_label("begin").press("Enter")
        wait_for(page, "ancf-casadi run study.toml")
        page.wait_for_selector(".q-spinner.hidden", state="attached")
        with page.expect_download() as download:
            page.get_by_text("save study.toml").click()
        study = Path(download.value.path()).rename(tmp_path / "study.toml")
        decays = json.loads(run("run", study, "--json"))["decays"]
        rows = page.locator("tbody tr").all_inner_texts()
        for decay, row in zip(decays, rows, strict=True):
            assert shown(decay["frequency_hz"], decay["frequency_stderr_hz"]) in row
            assert shown(100 * decay["damping_ratio"], 100 * decay["damping_ratio_stderr"]) in row
        study.write_text(study.read_text().replace("begin = 0.5", "begin = 0.75"))
        page.set_input_files("input[type=file]", [study, *files])
        wait_for(page, "begin = 0.75")
        wait_for(page, "the 3 records do not agree")
        assert page.locator("tbody tr").count() == 3

    def test_a_column_by_its_number_stays_chosen_also_in_a_take_without_it(self, opened, page, tmp_path):
        write_decay(tmp_path / "two.csv", header="t (s),tip (mm),middle (mm)")
        write_decay(tmp_path / "one.csv")
        (tmp_path / "study.toml").write_text(
            "".join(f'[[decays]]\nfile = "{name}.csv"\ncolumn = 3\n' for name in ("two", "one"))
        )
        opened(tmp_path / "study.toml", text="The takes are not compared: one.csv: ")
        page.locator("tr", has_text="one.csv").click()
        page.wait_for_selector(".q-spinner.hidden", state="attached")
        page.locator("tr", has_text="two.csv").click()
        wait_for(page, "linear decay")
        assert command_line(page).endswith("--column 3")

    def test_a_take_that_cannot_be_read_says_why_in_its_row(self, opened, page, tmp_path):
        (tmp_path / "none.csv").write_text("nothing")
        opened(tmp_path / "none.csv", write_decay(tmp_path / "tip.csv"), text="The takes are not compared")
        rows = page.locator("tbody tr").all_inner_texts()
        assert "none.csv" in rows[0] and "±" not in rows[0] and "±" in rows[1]
        page.locator("tr", has_text="tip.csv").click()
        wait_for(page, "linear decay")

    def test_a_click_on_a_pole_fits_its_mode_and_the_command_does_the_same(self, opened, page, tmp_path):
        opened(write_functions(tmp_path / "tip.csv"), text="2 modes")
        page.wait_for_timeout(500)  # until the chart is drawn
        page.mouse.click(*page.evaluate(CLICKED, [1, 35.0, 20]))
        wait_for(page, "--frequencies 12.0")
        wait_for(page, "1 mode\n")
        page.wait_for_timeout(500)
        page.mouse.click(*page.evaluate(CLICKED, [1, 35.0, 20]))
        wait_for(page, "2 modes")
        text = page.inner_text("body")
        words = re.search(r"ancf-casadi fit-frf .* --frequencies .*", text)[0]
        report = run(*shlex.split(words)[1:])
        assert all(line.strip() in text for line in report.splitlines() if "note" not in line)
        (first, second) = json.loads(run(*shlex.split(words)[1:], "--json"))["modes"]
        for mode in (first, second):
            assert shown(mode["frequency_hz"], mode["frequency_stderr_hz"]) in text

    def test_dropped_functions_say_what_they_need(self, look, page, tmp_path):
        _, url = look()
        page.goto(url)
        page.wait_for_selector("input[type=file]", state="attached")
        page.set_input_files("input[type=file]", write_functions(tmp_path / "tip.csv", "f (Hz),tip (mm/N),phase"))
        wait_for(page, "deg or rad; give --phase-unit")
        page.get_by_label("unit of the phases").click()
        page.get_by_role("option", name="deg").click()
        wait_for(page, "2 modes")
        assert "ancf-casadi fit-frf tip.csv --phase-unit deg" in page.inner_text("body")
        page.get_by_label("frequencies, Hz").fill("12, x")
        page.get_by_label("frequencies, Hz").press("Enter")
        wait_for(page, "must be numbers separated by commas")

    def test_a_brush_on_many_samples_fits_within_a_second(self, opened, page, tmp_path):
        opened(write_decay(tmp_path / "tip.csv", samples=60_000), text="±")
        page.wait_for_timeout(1000)
        began = time.perf_counter()
        brush(page, 0.3, 0.8)
        wait_for(page, "--begin")
        page.wait_for_selector(".q-spinner.hidden", state="attached")
        assert time.perf_counter() - began < 3.0  # 0.7 s on an idle machine

    def test_the_pictures_of_the_documentation_are_drawn(self, look, page, tmp_path):
        script = runpy.run_path(str(Path(__file__).parents[3] / "docs" / "look_pictures.py"))
        script["write_record"](tmp_path / "tip.csv")
        _, url = look()
        page.goto(url)
        pictures = script["film"](page, tmp_path / "tip.csv")
        assert len(pictures) == 20 and len({picture.tobytes() for picture in pictures}) > 15
        assert "quadratic decay" in page.inner_text("body") and "--begin" in command_line(page)

    def test_requests_without_the_token_get_nothing(self, look, tmp_path):
        _, url = look(write_decay(tmp_path / "tip.csv"))
        host = urllib.parse.urlsplit(url).netloc
        for path, headers in (("/", {}), (url.removeprefix(f"http://{host}"), {"Origin": "http://elsewhere.example"})):
            with contextlib.closing(http.client.HTTPConnection(host)) as connection:
                connection.request("GET", path, headers=headers)
                response = connection.getresponse()
                assert (response.status, b"tip.csv" in response.read()) == (403, False)
