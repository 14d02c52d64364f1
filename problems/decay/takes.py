"""Several free decays of one mode: the fit to all of them, each alone, and whether they agree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from ancf_casadi.estimation.agreement import Agreement, agreement
from ancf_casadi.support.tables import Table
from problems.decay.laws import LAWS
from problems.decay.result import DecayFit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class DecayFits(Sequence[DecayFit]):
    """Fits of several free decays of one mode; a sequence of the results for each record.

    Parameters
    ----------
    fits : tuple of DecayFit
        Result for each record from the fit to all of them, with the same frequency and damping coefficients.
    alone : tuple of DecayFit
        Result for each record from a fit to this record alone.
    agreements : tuple of Agreement
        Agreement of the records on each quantity of the mode; empty for one record.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import fit_decays
    >>> time, rng = np.linspace(0.0, 10.0, 1001), np.random.default_rng(0)
    >>> y = np.exp(-0.1 * time) * np.cos(12.0 * time)
    >>> takes = [Measurement(time, a * y + rng.normal(scale=1e-4, size=time.size)) for a in (0.02, 0.03)]
    >>> fits = fit_decays(takes)
    >>> len(fits), [one.name for one in fits.agreements]
    (2, ['frequency', 'damping_ratio'])
    """

    fits: tuple[DecayFit, ...]
    alone: tuple[DecayFit, ...]
    agreements: tuple[Agreement, ...]

    @overload
    def __getitem__(self, index: int) -> DecayFit: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[DecayFit, ...]: ...
    def __getitem__(self, index: int | slice) -> DecayFit | tuple[DecayFit, ...]:
        """Return the result for a record from the fit to all of them."""
        return self.fits[index]

    def __len__(self) -> int:
        """Return the number of records."""
        return len(self.fits)

    def __iter__(self) -> Iterator[DecayFit]:
        """Yield the result for each record from the fit to all of them."""
        return iter(self.fits)

    @property
    def standard_errors(self) -> Mapping[str, float]:
        """Standard error of each quantity of the mode, which includes the scatter between the records."""
        if not self.agreements:
            return self.fits[0].standard_errors
        return {one.name: one.error for one in self.agreements}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Disagreements of the records, then the warnings of the fit to each record."""
        own = [one.warning for one in self.agreements if one.warning]
        return (*own, *dict.fromkeys(text for fit in self.fits for text in fit.warnings))

    def table(self) -> Table:
        """Return each quantity of the mode from each record alone, from all at once, and their mean with scatter."""
        names = [one.name for one in self.agreements]
        columns = ("record", *(part for one in self.agreements for part in (_labelled(one), "stderr")), "residual_rms")
        named = [*zip(range(1, len(self) + 1), self.alone, strict=True), ("all at once", self.fits[0])]
        rows: list[tuple[str | float | None, ...]] = [
            (str(label), *(value for name in names for value in (getattr(fit, name), fit.standard_errors[name])),
             fit.residual_rms)
            for label, fit in named
        ]  # fmt: skip
        rows.append(("mean", *(value for one in self.agreements for value in (one.mean, one.error)), None))
        rows.append(("scatter", *(value for one in self.agreements for value in (one.scatter, None)), None))
        notes = [one.text() for one in self.agreements]
        return Table("takes", "The mode from each record, and from all at once", columns, rows, notes)

    def report(self) -> str:
        """Return the table and the fit to all records as text."""
        if not self.agreements:
            return self.fits[0].report()
        notes = [f"  note: {text}" for text in self.warnings if text not in self.fits[0].warnings]
        return "\n".join([self.table().text(), *notes, "", self.fits[0].report()])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        return {
            "records": [fit.to_dict() for fit in self.fits],
            "alone": [fit.to_dict() for fit in self.alone],
            "agreements": [one.to_dict() for one in self.agreements],
            "warnings": list(self.warnings),
        }

    def figure(self) -> Figure:
        """Draw the quantities of the mode from each record with 95 % intervals, and their mean."""
        from ancf_casadi.estimation.figures import agreement_figure  # matplotlib is slow to import

        return agreement_figure([(_labelled(one), one) for one in self.agreements])


def decay_fits(fits: Sequence[DecayFit], alone: Sequence[DecayFit]) -> DecayFits:
    """Return the result for several records from the fit to all of them and the fits to each alone."""
    ratio = ("damping_ratio",) if fits[0].law == "linear" else LAWS[fits[0].law].terms
    agreements = []
    for name in ("frequency", "frequency_slope", "frequency_curvature", *ratio):
        values, errors = (
            np.array(column)
            for column in zip(*((getattr(fit, name), fit.standard_errors[name]) for fit in alone), strict=True)
        )
        if len(alone) > 1 and (errors > 0.0).all():
            agreements.append(agreement(name, fits[0].model.unit(name), values, errors))
    return DecayFits(tuple(fits), tuple(alone), tuple(agreements))


def _labelled(one: Agreement) -> str:
    return f"{one.name}, {one.unit}" if one.unit else one.name
