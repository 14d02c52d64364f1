"""The page: files that are given or dropped, and the panel that shows them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import Literal

from nicegui import events, ui

from ancf_casadi.exceptions import AncfError
from problems.look.choices import has_beam, is_film, read_takes
from problems.look.widgets import Panel
from problems.look.worker import work

Kind = Literal["beam", "film", "functions", "records"]


def build_page(files: Sequence[str], folder: Path) -> None:
    """Build the page for files, or for those that are dropped there, which go to a folder."""

    async def show_upload(event: events.MultiUploadEventArguments) -> None:
        apart = Path(mkdtemp(dir=folder))
        names = [Path(file.name).name for file in event.files]
        paths = [apart / (f"{k}-{name}" if name in names[:k] else name) for k, name in enumerate(names)]
        for path, file in zip(paths, event.files, strict=True):
            await file.save(path)
        upload.reset()  # which would ignore files that it has had before
        await show_files([str(path) for path in paths], apart)

    async def show_files(paths: Sequence[str], origin: Path) -> None:
        body.clear()
        with body:
            spinner = ui.spinner()
            try:
                build_panel = await work(find_panel, tuple(paths))
                if spinner.is_deleted:  # other files have been dropped
                    return
                panel = build_panel(paths, origin)
            except AncfError as error:
                ui.label(str(error)).classes("text-negative")
                return
            finally:
                spinner.set_visibility(False)
        panel.start()

    ui.colors(negative="#e03131")  # legible on light and on dark pages
    with ui.row(align_items="center").classes("w-full"):
        ui.label("ancf-casadi look").classes("text-h6")
        upload = ui.upload(label="Drop files here", on_multi_upload=show_upload, multiple=True, auto_upload=True)
        upload.props("flat bordered").style("max-height: 3.5rem").mark("upload")
    ui.add_css(".q-uploader__subtitle { display: none }")
    body = ui.column().classes("w-full")
    if files:
        ui.timer(0.0, lambda: show_files(files, folder), once=True)
        return
    with body:
        ui.label(
            "Drop a record of a free decay, several takes of it, frequency response functions, a film, or a study; "
            "or choose files with +."
        )


def compute_first(files: Sequence[str]) -> None:
    """Compute what the page of files shows first, of beams and films nothing."""
    kind = kind_of(files)
    if kind == "functions":
        from problems.look.frf import FrfChoices, fit_modes, frf_poles  # these are slow to import

        choices = FrfChoices(tuple(files))
        frf_poles(choices)
        fit_modes(choices)
    elif kind == "records":
        from problems.look.computation import fit_chosen

        fit_chosen(read_takes(files)[0])


def kind_of(files: Sequence[str]) -> Kind:
    """Return what files hold; this imports what reads measurements, which is slow."""
    if has_beam(files):
        return "beam"
    if is_film(files):
        return "film"
    from problems.look.computation import over_frequency

    return "functions" if over_frequency(files) else "records"


def find_panel(files: Sequence[str]) -> Callable[[Sequence[str], Path], Panel]:
    """Return what builds the panel for files, which lie in a folder if they were dropped; it is slow to import."""
    match kind_of(files):
        case "beam":
            from problems.look.beam import BeamPanel

            return BeamPanel
        case "film":
            from problems.look.film_page import FilmPanel

            return FilmPanel
        case "functions":
            from problems.look.frf_page import FrfPanel

            return FrfPanel
        case "records":
            from problems.look.record_page import record_panel

            return record_panel
