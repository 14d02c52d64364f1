"""The document is one file that needs nothing else, and shows texts of users as texts."""

import csv
import io
import json
import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path

import pytest

from ancf_casadi.support.figures import PAGE_WIDTH
from ancf_casadi.support.tables import Table
from problems.study.drawing import STYLE
from problems.study.formatting import numeric_table
from problems.study.results import _numeric, file_name, inline_svg, label_findings
from problems.study.results import page as document
from problems.study.step import Finding, Study
from problems.study.study import StudyReport, run_study
from tests.problems.conftest import BEAM, DECAYS, RAYLEIGH, write_decays
from tests.problems.study.test_runner import Doubles

NASTY = '<script>alert("x")</script> & $\\bad$ {{ 7 * 7 }} black'
LAW = """
[[laws]]
name = "drag"
title = TEXT
terms = [{law = "quadratic", eta1 = 1.0}]

[[steps]]
kind = "transients"
title = TEXT
text = TEXT
section = TEXT
notes = [TEXT]
figures = ["Figure <b>"]
laws = ["drag"]
runs = [{mode = 1, amplitude = 0.005, stop = 1.0}]
"""
RESOURCES = {"link": "href", "script": "src", "img": "src", "iframe": "src", "object": "data", "source": "src"}
VOID = {"meta", "br", "img", "link", "hr", "input"}


class Page(HTMLParser):
    """Elements of a page: ids, links, texts by element, and whether every element is closed."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.names: Counter[str] = Counter()
        self.texts: list[tuple[str, str]] = []
        self.handlers: list[str] = []
        self._open: list[str] = []
        self.source = page.read_text(encoding="utf-8")
        self.feed(self.source)
        assert self._open == []

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.handle_endtag(tag)

    def handle_starttag(self, tag, attributes):
        self.names[tag] += 1
        for name, value in attributes:
            if name == "id":
                self.ids.append(value)
            if name == "href" and tag == "a":
                self.links.append(value)
            if RESOURCES.get(tag) == name or (name == "xlink:href" and not value.startswith("#")):
                self.loaded.append(value)
            if name.startswith("on"):
                self.handlers.append(name)
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if data.strip():
            self.texts.append((self._open[-1] if self._open else "", data))


@pytest.fixture(scope="module")
def page(small_paper) -> Page:
    return Page(small_paper.page)


@pytest.fixture(scope="module")
def nasty(tmp_path_factory) -> StudyReport:
    """A study whose every text has the letters of HTML, of formulas and of templates."""
    folder, text = tmp_path_factory.mktemp("nasty"), json.dumps(NASTY)
    head = f"[study]\ntitle = {text}\ntext = {text}\nsource = {text}\nprinted_by = {text}\n"
    write_decays(folder)
    (folder / "study.toml").write_text(head + BEAM + DECAYS + LAW.replace("TEXT", text), encoding="utf-8")
    return run_study(folder / "study.toml", folder / "results", quick=True, command=f"study {NASTY}")


@pytest.mark.slow
class TestPage:
    def test_loads_nothing_and_runs_nothing(self, page):
        """No script, no style sheet, no picture, no font from elsewhere; links lead to files beside it."""
        assert page.loaded == []
        assert page.handlers == []
        assert page.names["script"] == page.names["img"] == page.names["link"] == page.names["iframe"] == 0
        assert not re.search(r"@import|url\((?!#)|@font-face", page.source)
        assert not [link for link in page.links if re.match(r"\w+:|//", link)]

    def test_ids_are_unique_and_links_lead_somewhere(self, page, small_paper):
        assert [name for name, count in Counter(page.ids).items() if count > 1] == []
        for link in page.links:
            if link.startswith("#"):
                assert link[1:] in page.ids
            else:
                assert (small_paper.page.parent / link).is_file(), link
        for used in re.findall(r'xlink:href="#([^"]+)"|url\(#([^)]+)\)', page.source):
            assert "".join(used) in page.ids

    def test_shows_every_table_and_figure_with_files(self, page, small_paper):
        folder, text = small_paper.page.parent, "".join(data for _, data in page.texts)
        assert page.names["svg"] == sum(len(step.figures) for step in small_paper.steps)
        for step in small_paper.steps:
            for table in step.tables:
                assert f"{table.name}." in text
                content = (folder / "tables" / f"{file_name(table.name)}.csv").read_text(encoding="utf-8")
                assert len(list(csv.reader(io.StringIO(content)))) == 1 + len(table.rows)
            for figure in step.figures:
                assert f"{figure.name}." in text
                name = file_name(figure.name)
                assert (folder / "figures" / f"{name}.svg").read_text(encoding="utf-8") == figure.svg
                assert not (folder / "figures" / f"{name}.png").exists()  # in a quick look, whose page shows the SVG
        files = {path.stem for kind in ("tables", "figures") for path in (folder / kind).iterdir()}
        labels = [item.name for step in small_paper.steps for item in (*step.tables, *step.figures)]
        assert files == {file_name(label) for label in labels}

    def test_names_what_is_not_computed(self, page):
        text = "".join(data for _, data in page.texts)
        assert "Figure 2, Figure 3, Figure 4" in text
        assert "not computed" in text

    def test_names_command_versions_seed_and_times(self, page, small_paper):
        text = "".join(data for _, data in page.texts)
        assert "Seed of all random numbers: 20" in text
        for name, version in small_paper.results["versions"].items():
            assert f"{name} {version}" in text
        for step in small_paper.steps:
            assert f"{step.seconds:.1f}" in text
        assert "Quick look" in text

    def test_prints_two_figures_on_a_page(self, page, small_paper):
        """Of US letter, beside their captions, with letters of 7 points or more; one law for all modes fills a page."""
        figures = [figure for step in small_paper.steps for figure in step.figures]
        sizes = {
            figure.name: re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', figure.svg).groups()
            for figure in figures
            if "against its amplitude" not in figure.caption
        }
        scale = float(re.search(r"minmax\(0, ([\d.]+)in\)", page.source)[1]) / PAGE_WIDTH
        assert scale * min(STYLE["legend.fontsize"], 0.833 * STYLE["font.size"]) >= 7.0
        assert {label for label, (_, height) in sizes.items() if 2 * scale * float(height) > 72 * 9.6} == set()
        assert {width for width, _ in sizes.values()} == {f"{72 * PAGE_WIDTH:.1f}"}

    def test_breaks_no_line_between_a_number_and_its_unit_or_sign(self, page):
        cells = [data for tag, data in page.texts if tag == "td"]
        assert [cell for cell in cells if re.search(r"\d %$|± \d", cell)] == []
        assert any(re.search(r"\d ±\u00a0\d", cell) for cell in cells)
        assert any(re.search(r"\d\u00a0%$", cell) for cell in cells)
        texts = [data for tag, data in page.texts if tag in ("p", "li", "figcaption")]
        assert [text for text in texts if re.search(r"\d (%|Hz|mm|m|s|1/s|1/m)(?![\w/])", text)] == []
        assert any("\u00a0%" in text for text in texts) and any("\u00a0Hz" in text for text in texts)


@pytest.mark.slow
class TestTextsOfUsers:
    def test_are_texts(self, nasty):
        """A tag, a formula and a template in every text: the page shows them as they were written."""
        page = Page(nasty.page)
        assert page.names["script"] == 0
        places = [(tag, data) for tag, data in page.texts if NASTY in data]
        assert {tag for tag, _ in places} >= {"title", "h1", "h2", "h3", "p", "li", "a", "code", "td", "text"}
        assert "49" not in "".join(data for _, data in page.texts if "7 * 7" in data)
        assert [name for name, count in Counter(page.ids).items() if count > 1] == []

    def test_stand_in_the_files_as_they_are(self, nasty):
        folder = nasty.page.parent
        assert json.loads((folder / "results.json").read_text())["study"]["title"] == NASTY
        table = next(table for step in nasty.steps for table in step.tables if table.columns[1] == "law")
        rows = list(csv.reader(io.StringIO(numeric_table(table).csv())))
        assert any(NASTY in row for row in rows)
        assert NASTY in nasty.report()

    def test_name_files_in_the_folder_alone(self, nasty):
        figures = {path.name for path in (nasty.page.parent / "figures").iterdir()}
        assert "figure_b.svg" in figures
        assert {path.parent.name for path in nasty.page.parent.rglob("*.svg")} == {"figures"}


class TestLabels:
    def step(self, name: str, **labels: tuple[str, ...]) -> Doubles:
        return Doubles(name=name, title=name, terms=(), after=(), log="", **labels)

    @pytest.mark.parametrize(
        ("label", "name"),
        [("Table 2", "table_02"), ("Figure 27", "figure_27"), ("Table A1", "table_a1"), ("Bild 3", "bild_03"),
         ("../../Table 1", "table_01"), ("Figure 3/4", "figure_3_4"), ("C:\\x", "c_x"), ("Tafel ü", "tafel_ü"),
         ("--", "")],
    )  # fmt: skip
    def test_name_files(self, label, name):
        assert file_name(label) == name

    @pytest.mark.slow
    def test_others_are_numbered(self, small_paper):
        """Two tables in steps without labels; in a study with labels, theirs start with A and avoid those given."""
        table, figure = small_paper.steps[1].tables[0], small_paper.steps[0].figures[0]
        finding = Finding({}, (table, table), (figure,))
        plain = Study("plain", (self.step("a"), self.step("b")))
        shown = label_findings(plain, [finding, finding])
        assert [item.name for step in shown for item in step.tables] == ["Table 1", "Table 2", "Table 3", "Table 4"]
        assert [item.name for step in shown for item in step.figures] == ["Figure 1", "Figure 2"]
        own = Study("own", (self.step("a", tables=("Table 7",)), self.step("b", figures=("Table A1",))))
        shown = label_findings(own, [finding, finding])
        assert [item.name for step in shown for item in step.tables] == ["Table 7", "Table A2", "Table A3", "Table A4"]
        assert [item.name for step in shown for item in step.figures] == ["Figure A1", "Table A1"]


@pytest.mark.slow
def test_a_study_without_labels_counts(study_file, tmp_path):
    report = run_study(study_file(BEAM, RAYLEIGH, DECAYS), tmp_path / "results")
    assert [item.name for step in report.steps for item in (*step.tables, *step.figures)] == [
        "Table 1", "Table 2", "Figure 1", "Table 3", "Figure 2", "Figure 3",
    ]  # fmt: skip


def test_a_computation_that_steps_share_counts_once_for_all():
    """The total of a study is no more than the time that it takes."""
    a, b = (Doubles(name=name, terms=(), after=(), log="") for name in "ab")
    ran = (
        Finding({}, name="a", times={"1": 0.75, "2": 0.5, "3": 0.75}),
        Finding({}, name="b", times={"2": 0.5, "3": 0.75}),
    )
    source = document(Study("shared", (a, b)), ran, command="study", versions={}, quick=False, left_out=())
    rows = [
        f'<td class="n">{count}</td><td class="n">{seconds}</td>' for count, seconds in ((3, 2.0), (2, 1.2), (3, 2.0))
    ]
    assert [row in source for row in rows] == [True] * 3
    assert f"<td>all</td>{rows[-1]}" in source


def test_labels_without_a_table_and_notes_of_a_step_without_tables_show():
    step = Doubles(name="a", terms=(), after=(), log="", tables=("Table 1", "Table 2"), notes=("A note.",))
    table = Table("", "", ("law",), [("drag",)])
    for tables, missing in (((table,), "Table 2"), ((), "Table 1, Table 2")):
        study = Study("labels", (step,))
        source = document(
            study, label_findings(study, [Finding({}, tables)]), command="study", versions={}, quick=False, left_out=()
        )
        assert f"<b>{missing}</b>: not computed" in source
        assert source.count("<li>A note.</li>") == 1


def test_limits_of_numbers_are_aligned_like_numbers():
    """Below the resolution of a simulation, a column of numbers has the cell < 0.01."""
    table = Table("", "left", ("law", "tip, mm"), [("drag", "< 0.01"), ("none", "18.86")])
    assert _numeric(table) == [False, True]


def test_names_inside_a_figure_become_its_own():
    svg = (
        '<?xml version="1.0"?>\n<svg width="10.5pt" height="20pt" viewBox="0 0 10 20"><metadata>x</metadata>'
        '<clipPath id="p1"/><g id="axes" style="fill: #222222; stroke: black" clip-path="url(#p1)">'
        '<use xlink:href="#p1" style="stroke: #009e73"/><text style="fill:#000000">black #222222</text></g></svg>'
    )
    found = inline_svg(svg, "figure_05", 'a "b" <c>')
    style = "aspect-ratio: 10.5 / 20; min-width: 7.875px"
    assert found.startswith(f'<svg role="img" aria-label="a &quot;b&quot; &lt;c&gt;" style="{style}"')
    assert 'id="figure_05-p1"' in found
    assert "url(#figure_05-p1)" in found
    assert 'xlink:href="#figure_05-p1"' in found
    assert "fill: currentColor; stroke: currentColor" in found
    assert '<text style="fill:currentColor">black #222222</text>' in found
    assert "#009e73" in found
    assert "metadata" not in found
