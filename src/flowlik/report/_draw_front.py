"""The two pictures at the head of a report: error bars over an image, and what intervals hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from flowlik.report._draw_uncertainty import draw_bars
from flowlik.report._style import GREY, Data, looks_of

FRONT_WIDTH, FRONT_HEIGHT = 6.6, 3.7  # inches
BAND = 0.05


def draw_front_bars(data: Data) -> Figure:
    """Draw the error bars of an uncertainty figure alone, without key and maps."""
    height, width = data["image"].shape
    figure = Figure(figsize=(FRONT_WIDTH, FRONT_WIDTH * height / width))
    draw_bars(figure.add_axes((0, 0, 1, 1)), data)
    return figure


def draw_front_coverage(curves: Mapping[str, Sequence[Sequence[tuple[float, float]]]]) -> Figure:
    """Draw observed over promised shares: of every population pale, their mean bold, a model a colour."""
    figure = Figure(figsize=(FRONT_WIDTH, FRONT_HEIGHT), layout="constrained")
    ax = figure.subplots()
    ax.fill_between([0, 1], [-BAND, 1 - BAND], [BAND, 1 + BAND], color="#eceff3", lw=0)
    ax.plot([0, 1], [0, 1], color=GREY, lw=1, ls="--")
    lowest = 1.0
    for look, populations in zip(looks_of(list(curves)), curves.values()):
        for curve in populations:
            ax.plot(*np.array(curve).T, look.dash, color=look.colour, lw=1, alpha=0.3)
            lowest = min(lowest, curve[0][0], *(observed for _, observed in curve))
        promised = [level for level, _ in populations[0]]
        alike = [curve for curve in populations if [level for level, _ in curve] == promised]
        mean = np.mean([[observed for _, observed in curve] for curve in alike], axis=0)
        style: dict[str, Any] = {"marker": look.marker, "ms": 5, "mec": "white", "mew": 0.6, "lw": 2.2}
        ax.plot(promised, mean, look.dash, color=look.colour, label=look.label, **style)
    first = min(promised for populations in curves.values() for curve in populations for promised, _ in curve)
    ax.set(xlim=(max(first - 0.02, 0.0), 1), ylim=(max(lowest - 0.04, 0.0), 1))
    ax.set(xlabel="promised: share of errors in the interval", ylabel="held")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    ax.text(0.985, 0.05, "below: too bold", ha="right", color=GREY, fontsize=9, transform=ax.transAxes)
    ax.text(0.015, 0.93, "above: too cautious", color=GREY, fontsize=9, transform=ax.transAxes)
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.1), frameon=False)
    return figure
