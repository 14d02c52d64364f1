"""The table of takes on the page, and whether they agree."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from ancf_casadi.exceptions import AncfError
from problems.look.charts import SPARKLINE, sparkline
from problems.look.choices import Choices, Takes
from problems.look.computation import compare_takes, fit_chosen, whole_record
from problems.look.widgets import columns, report_label, show_notes
from problems.look.worker import work
from problems.study.formatting import shown

HEADS = {"file": "take", "record": "record", "release": "release, s", "frequency": "frequency at release, Hz",
         "damping_ratio": "damping ratio at release, %", "amplitude": "amplitude range"}  # fmt: skip
WIDTH, HEIGHT = SPARKLINE
ROW = f"""
<q-tr :props="props" class="cursor-pointer" :style="props.row.is_shown ? 'background: rgba(136, 136, 136, 0.2)' : ''"
      tabindex="0" @click="$parent.$emit('choose', props.row.take)"
      @keyup.enter="$parent.$emit('choose', props.row.take)">
  <q-td key="file" :props="props" style="white-space: normal">{{{{ props.row.file }}}}
    <div class="text-negative">{{{{ props.row.error }}}}</div></q-td>
  <q-td key="record" :props="props"><svg width="{WIDTH}" height="{HEIGHT}">
    <polyline :points="props.row.record" fill="none" stroke="#5470c6" /></svg></q-td>
  <q-td v-for="key in ['release', 'frequency', 'damping_ratio', 'amplitude']" :key="key" :props="props">
    {{{{ props.row[key] }}}}</q-td>
</q-tr>
"""


class TakesTable:
    """A table of takes, in which a click shows one, and the words on their agreement."""

    def __init__(self, show_take: Callable[[int], None]) -> None:
        self.report = ""
        self._table = ui.table(columns=columns(HEADS), rows=[], row_key="take").classes("w-full").props("flat dense")
        self._table.mark("takes").add_slot("body", ROW)
        self._table.on("choose", lambda event: show_take(event.args))
        self._verdict = ui.column().classes("w-full gap-0").mark("verdict")
        self._notes = ui.column().classes("w-full gap-1")
        with ui.expansion("Report on all takes").classes("w-full").props("dense") as self._reports:
            self._report = report_label()

    def mark_shown(self, shown_take: int) -> None:
        """Mark the take that the page shows."""
        for row in self._table.rows:
            row["is_shown"] = row["take"] == shown_take
        self._table.update()

    async def show(self, takes: Takes, shown_take: int, is_wanted: Callable[[], bool]) -> None:
        """Fit takes one after another, and compare them, as long as they are those that the user wants."""
        self._table.rows[len(takes) :] = []
        for k, take in enumerate(takes):
            row = {"take": k, "is_shown": k == shown_take} | await _row(take)
            self._table.rows[k : k + 1] = [row]
            self._table.update()
            if self._table.is_deleted or not is_wanted():
                return
        self._verdict.clear()
        self.report, notes = "", list[str]()
        problem = next((f"{row['file']}: {row['error']}" for row in self._table.rows if "error" in row), "")
        try:
            fits = None if problem else await work(compare_takes, takes)
        except AncfError as error:
            fits, problem = None, str(error)
        with self._verdict:
            if fits is None:
                ui.label(f"The takes are not compared: {problem}").classes("text-negative")
            else:
                self.report, notes = fits.report(), list(fits.warnings)
                for agreement in fits.agreements:
                    ui.label(agreement.text())
        self._report.text = self.report
        self._reports.set_visibility(bool(self.report))
        show_notes(self._notes, notes)


async def _row(take: Choices) -> dict[str, Any]:
    """Return a take as a row of the table; an error stands below the name of its file."""
    row: dict[str, Any] = {"file": Path(take.file).name}
    try:
        record = await work(whole_record, take)
        row["record"] = sparkline(record.values)
        view = await work(fit_chosen, take)
    except AncfError as error:
        return row | {"error": str(error).removeprefix(f"{take.file}: ")}
    fit = view.fit
    row["release"] = f"{fit.release_time:.6g}"
    for name, scale in (("frequency", 1.0), ("damping_ratio", 100.0)):
        row[name] = shown(scale * fit.values[name], scale * fit.standard_errors.get(name, np.nan))
    low, high = fit.amplitude_range
    return row | {"amplitude": f"{low:.3g} to {high:.3g} {view.curve.unit}"}
