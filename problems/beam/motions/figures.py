"""Figures of fits to large motion and of predictions, made without a display."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import MEASURED, literal_text
from problems.beam.motions.record import Channel, MotionRecord

IN_MM = ("position", "displacement")


def motion_size(records: Sequence[MotionRecord]) -> tuple[float, float]:
    """Return width and height of a figure of motions, inches."""
    return 2.0 + 5.0 * len(records), 1.2 + 4.2 * max(len(_quantities(record)) for record in records)


@literal_text
def motion_figure(records: Sequence[MotionRecord], residuals: Sequence[Array]) -> Figure:
    """Return a figure with ``draw_motions``."""
    figure = Figure(figsize=motion_size(records), layout="constrained")
    draw_motions(figure, records, residuals)
    return figure


@literal_text
def draw_motions(
    figure: Figure | SubFigure, records: Sequence[MotionRecord], residuals: Sequence[Array]
) -> Figure | SubFigure:
    """Draw measured (dots) and computed readings over time, and the residuals below; one column per record.

    Each quantity of a record has two diagrams.

    Parameters
    ----------
    figure : Figure or SubFigure
        Where to draw.
    records : sequence of MotionRecord
        The measurements.
    residuals : sequence of array
        Computed less measured readings of each channel, record by record, in the unit of the sensor.
    """
    rows = max(len(_quantities(record)) for record in records)
    plots = figure.subplots(2 * rows, len(records), height_ratios=(2, 1) * rows, sharex="col", squeeze=False)
    first = 0
    for k, record in enumerate(records):
        own = list(zip(record.own_channels, residuals[first:], strict=False))
        first += len(own)
        for row, quantity in enumerate(_quantities(record)):
            motion, left = plots[2 * row : 2 * row + 2, k]
            _draw(motion, left, [pair for pair in own if pair[0].sensor.quantity == quantity])
        for unused in plots[2 * len(_quantities(record)) :, k]:
            unused.set_visible(False)
        plots[0, k].set_title(f"record {k + 1}" if len(records) > 1 else "")
        lowest = plots[2 * len(_quantities(record)) - 1, k]
        lowest.tick_params(labelbottom=True)
        lowest.set_xlabel("time, s")
    return figure


def _quantities(record: MotionRecord) -> list[str]:
    return list(dict.fromkeys(channel.sensor.quantity for channel in record.own_channels))


def _draw(motion: Axes, left: Axes, channels: Sequence[tuple[Channel, Array]]) -> None:
    """Draw the channels of one quantity: readings less their means above, residuals below."""
    sensor = channels[0][0].sensor
    size, unit = (1e3, "mm") if sensor.quantity in IN_MM else (1.0, sensor.unit)
    for number, (channel, rest) in enumerate(channels):
        time, values = channel.measurement.time, channel.measurement.values
        colour, mean = f"C{number % 10}", values.mean()
        motion.plot(time, size * (values - mean), ".", ms=3, color=MEASURED)
        motion.plot(time, size * (values + rest - mean), lw=1, color=colour, label=channel.sensor.label)
        left.plot(time, size * rest, lw=0.6, color=colour)
    comma = f", {unit}" if unit else ""
    motion.set_ylabel(f"{sensor.quantity} less its mean{comma}")
    motion.legend(frameon=False, ncols=2, fontsize="small")
    left.set_ylabel(f"residual{comma}")
