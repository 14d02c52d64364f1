"""Figures that an example of the gallery saves as files."""

import shutil
from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst


def moved_figures(_: object, variables: dict[str, Any], settings: dict[str, Any]) -> str:
    """Move the PNG files that an example saved beside itself to the gallery, and return their reStructuredText."""
    saved = sorted(Path(variables["src_file"]).parent.glob("*.png"))
    pairs = list(zip(saved, variables["image_path_iterator"], strict=False))
    for path, target in pairs:
        shutil.move(path, target)
    return str(figure_rst([target for _, target in pairs], settings["src_dir"]))
