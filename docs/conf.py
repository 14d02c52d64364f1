"""Settings of the documentation site; ``poe docs`` builds it into ``docs/_build``, without a network."""

import re
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from docutils import nodes
from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx
from sphinx.util.logging import getLogger

from ancf_casadi.version import __version__

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))
from docstring_formulas import typeset_lines  # noqa: E402
from keys_page import write_keys_page  # noqa: E402
from run_pages import FIGURE, draw_figures  # noqa: E402

project = "ancf-casadi"
release = version = __version__
copyright = "2026 The ancf-casadi developers"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "mathml",
]
exclude_patterns = ["_build"]
smartquotes_action = "D"  # dashes alone: an apostrophe may be a derivative

myst_enable_extensions = ["colon_fence", "dollarmath"]
html_math_renderer = "mathml"
myst_heading_anchors = 4

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "description"  # docstrings name the types of parameters; annotations add those of results
autodoc_typehints_description_target = "documented_params"
autodoc_type_aliases = {"Array": "Array", "ArrayLike": "ArrayLike"}
napoleon_google_docstring = False
napoleon_use_rtype = False
toc_object_entries_show_parents = "hide"
python_use_unqualified_type_names = True

sphinx_gallery_conf = {
    "examples_dirs": str(ROOT / "examples"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"/ex\d+_",
    "ignore_pattern": r"render_strip",  # a tool of other pages
    "image_scrapers": ("matplotlib", "saved_figures.moved_figures"),
    "download_all_examples": False,
    "run_stale_examples": True,  # the package may have changed though the example has not
    "min_reported_time": 1e6,
    "within_subsection_order": "FileNameSortKey",
    "show_signature": False,
    "write_computation_times": False,
}

html_theme = "pydata_sphinx_theme"
html_title = "ancf-casadi"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_sidebars = {"getting_started": [], "citation": []}  # pages without a section
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "show_prev_next": False,
    "header_links_before_dropdown": 6,
    "navbar_persistent": ["search-button"],
    "footer_start": ["copyright"],
    "footer_end": [],
}


def draw_figures_of_pages(app: Sphinx) -> None:
    """Draw the figures of all pages by their code, in other processes beside the gallery; warn of a page that fails."""
    pages = [page for page in sorted(Path(__file__).parent.rglob("*.md")) if FIGURE.search(page.read_text())]
    pool = ProcessPoolExecutor(mp_context=get_context("spawn"))
    runs = {page: pool.submit(draw_figures, page) for page in pages}

    def wait(app: Sphinx) -> None:
        for page, run in runs.items():
            if error := run.exception():
                getLogger(__name__).warning("%s draws no figure: %s: %s", page.name, type(error).__name__, error)
        pool.shutdown()

    app.connect("builder-inited", wait)  # after the gallery


def inline_drawings(app: Sphinx, document: nodes.document) -> None:
    """Put SVG files into the page itself: their text can be selected, links work, and they follow the theme."""
    for image in list(document.findall(nodes.image)):
        if image["uri"].endswith(".svg"):
            text = (Path(app.srcdir) / image["uri"]).read_text()
            image.parent.replace(image, nodes.raw("", text, format="html"))


def put_code_before_output(app: Sphinx, page: str, source: list[str]) -> None:
    """Move the printed output of a page of the gallery below its code; the picture stays above."""
    if page.startswith("gallery/ex"):
        output, code = r"\.\. rst-class:: sphx-glr-script-out\n.*?", r"\.\. code-block:: Python\n.*?"
        moved = re.compile(rf"({output})\n\|\n+({code})(?=\n\.\. _sphx_glr_download_)", re.DOTALL)
        source[0] = moved.sub(r"\2\n\n\1\n", source[0])


def setup(app: Sphinx) -> None:
    """Let pages mark CSV files, which Pygments does not know; order the gallery; draw the figures of pages."""
    app.add_lexer("csv", TextLexer)
    app.connect("autodoc-process-docstring", typeset_lines, priority=400)  # before napoleon
    app.connect("builder-inited", lambda app: write_keys_page(Path(app.srcdir) / "api" / "study_keys.md"))
    app.connect("source-read", put_code_before_output)
    app.connect("doctree-read", inline_drawings)
    draw_figures_of_pages(app)
