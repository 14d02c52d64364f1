"""The page in a real browser."""

import os
import re
import shutil
import subprocess
import sys
import urllib.parse

import pytest

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
in_browser = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")]


@pytest.fixture
def look():
    """A function that serves a file, and returns the process and the address of its page."""
    processes = []

    def serve(*arguments):
        command = [sys.executable, "-m", "problems.cli", "look", *map(str, arguments), "--no-browser"]
        # NiceGUI serves its own tests otherwise
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        processes.append(process)
        return process, re.search(r"http://\S+", process.stdout.readline())[0]

    yield serve
    for process in processes:
        process.kill()
        process.stdout.close()
        process.wait()


@pytest.fixture(scope="session")
def browser():
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def page(browser):
    """A page of a browser that notes the hosts to which it sends requests."""
    page = browser.new_page(viewport={"width": 1400, "height": 1400})
    page.hosts = set()
    page.on("request", lambda request: page.hosts.add(urllib.parse.urlsplit(request.url).netloc))
    yield page
    page.context.close()


@pytest.fixture
def opened(look, page):
    """A function that opens the page of files and waits for a text; it returns the process and the address."""

    def open_page(*files, text):
        process, url = look(*files)
        page.goto(url)
        wait_for(page, text)
        return process, url

    return open_page


def wait_for(page, text):
    page.wait_for_function("text => document.body.innerText.includes(text)", arg=text, timeout=30_000)


def run(*arguments):
    command = [sys.executable, "-m", "problems.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout
