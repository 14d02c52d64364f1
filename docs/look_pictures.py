"""Draw ``look.png`` and ``look.gif``: the page of ``ancf-casadi look``, driven in Chromium.

python docs/look_pictures.py
"""

from __future__ import annotations

import io
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright

DOCS = Path(__file__).parent
WIDTH, HEIGHT = 1280, 1130  # px
POINTER = """() => {
    const pointer = document.createElement('div');
    pointer.style = 'position: fixed; z-index: 9999; width: 14px; height: 14px; border-radius: 7px;'
        + 'pointer-events: none; background: rgba(0, 0, 0, 0.5)';
    document.body.appendChild(pointer);
    addEventListener('mousemove', event => {
        pointer.style.left = `${event.clientX - 7}px`;
        pointer.style.top = `${event.clientY - 7}px`;
    }, true);
}"""  # a picture of the page has none


def write_record(path: Path) -> None:
    """Write a beam that is released, and decays by air drag."""
    time = np.arange(0.0, 10.0, 2e-3)
    free = np.maximum(time - 1.042, 0.0)
    amplitude = 0.68 * 20.0 * np.exp(-0.34 * free) / (0.68 + 0.0103 * 20.0 * (1 - np.exp(-0.34 * free)))
    values = amplitude * np.cos(12.3 * free) + np.random.default_rng(0).normal(0.0, 0.05, time.size)
    np.savetxt(path, np.column_stack([time, values]), delimiter=",", header="time (s),tip (mm)", comments="")


def film(page: Page, record: Path) -> list[Image.Image]:
    """Drop a record, choose a part of it and a law, and point at an amplitude; return pictures of the page."""
    pictures: list[Image.Image] = []

    def take(wait: float = 100.0) -> None:
        page.wait_for_timeout(wait)
        pictures.append(Image.open(io.BytesIO(page.screenshot())))

    page.evaluate(POINTER)
    take(500.0)
    page.set_input_files("input[type=file]", record)
    page.wait_for_function("document.body.innerText.includes('±')")
    take(1000.0)
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.15 * box["width"], middle)
    page.mouse.down()
    for share in np.linspace(0.2, 0.8, 7):
        page.mouse.move(box["x"] + share * box["width"], middle)
        take(50.0)
    page.mouse.up()
    page.wait_for_function("document.body.innerText.includes('--begin')")
    take(1000.0)
    page.get_by_label("law", exact=True).click()
    take(500.0)
    page.get_by_role("option", name="quadratic").first.click()
    page.wait_for_function("document.body.innerText.includes('quadratic decay')")
    take(1500.0)
    box = page.locator("canvas").nth(3).bounding_box()
    assert box is not None
    for share in np.linspace(0.9, 0.5, 7):
        page.mouse.move(box["x"] + share * box["width"], box["y"] + 0.5 * box["height"])
        take(150.0)
    take(500.0)
    return pictures


def main() -> None:
    """Draw both pictures."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        record = Path(folder, "tip.csv")
        write_record(record)
        command = [sys.executable, "-m", "problems.cli", "look", "--no-browser"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
            address = re.search(r"http://\S+", process.stdout.readline())
            assert address is not None
            page.goto(address[0])
            pictures = film(page, record)
            browser.close()
            process.kill()
    pictures[-1].convert("RGB").quantize(128).save(DOCS / "look.png", optimize=True)
    small = [picture.convert("RGB").resize((3 * WIDTH // 4, 3 * HEIGHT // 4)) for picture in pictures]
    palette = small[-1].quantize(64)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in small]
    times = [1500, 1500, *[120] * 7, 1200, 800, 1500, *[150] * 7, 3000]  # ms
    frames[0].save(DOCS / "look.gif", save_all=True, append_images=frames[1:], duration=times, loop=0, optimize=True)


if __name__ == "__main__":
    main()
