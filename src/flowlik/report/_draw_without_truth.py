"""Figure of a calibration without truth: sizes of errors predicted and found, before and after."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flowlik.report._style import WIDTH, Data

COLOURS = {"before": "#d03a2b", "after": "#2f6fb0"}
SHOWN = (0.5, 0.9)


def draw_without_truth(data: Data) -> Figure:
    """Draw sizes found over sizes predicted, and coverage by fifths of size and of texture."""
    figure = Figure(figsize=(WIDTH, 3.4), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.25, 1, 1))
    names = [str(name) for name in data["names"]]
    ends = [
        min(data["predicted"].min(), data["found"].min()),
        max(data["predicted"].max(), data["found"].max()),
    ]
    left.plot(ends, ends, color="#9aa1ab", lw=1.0, ls="--", zorder=0)
    for name, predicted, found in zip(names, data["predicted"], data["found"]):
        left.plot(predicted, found, "o-", ms=4, lw=1.5, color=COLOURS[name], label=name)
    left.set(xscale="log", yscale="log", xlabel="size predicted  [px]", ylabel="size found  [px]")
    left.legend(loc="upper left", fontsize=8)
    fifths = np.arange(1, 6)
    for ax, kind, label in (
        (middle, "by_size", "fifth by size predicted"),
        (right, "by_texture", "fifth by texture"),
    ):
        for level in SHOWN:
            row = int(np.argmin(np.abs(data["levels"] - level)))
            ax.axhline(level, color="#9aa1ab", lw=1.0, ls="--", zorder=0)
            for name, coverage in zip(names, data[kind]):
                ax.plot(fifths, coverage[row], "o-", ms=4, lw=1.5, color=COLOURS[name])
        ax.set(xlabel=label, ylim=(0.3, 1.0), xticks=fifths)
    middle.set_ylabel("coverage of 50 % and 90 % intervals")
    return figure
