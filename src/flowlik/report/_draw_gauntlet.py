"""Heat map of how often motions are surely wrong, situation by flow and residual."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from flowlik.report._style import WIDTH, Data

LEAST = 0.002
"""Rate from which a cell is coloured and has its number: below it is white."""


def draw_gauntlet(data: Data) -> Figure:
    """Draw a panel an estimator, a row a situation; grey where nothing is claimed."""
    situations, columns, rates = data["situations"], data["columns"], data["rates"].astype(np.float64)
    figure = Figure(figsize=(WIDTH, 1.6 + 0.22 * len(situations)), layout="constrained")
    panels = figure.subplots(1, len(rates), sharey=True, squeeze=False)[0]
    colours = colormaps["OrRd"].with_extremes(under="white", bad="#dddddd")
    for ax, who, rate in zip(panels, data["estimators"], rates):
        # a logarithm of 0 would be drawn as if nothing was claimed
        seen = np.maximum(rate, 1e-4)
        drawn = ax.imshow(seen, cmap=colours, norm=LogNorm(LEAST, 1.0), aspect="auto", interpolation="none")
        for (i, j), value in np.ndenumerate(rate):
            if value >= LEAST:
                dark = "white" if value > 0.3 else "black"
                ax.text(j, i, f"{100 * value:.2g}", ha="center", va="center", fontsize=5.5, color=dark)
        ax.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
        ax.set_yticks(range(len(situations)), situations, fontsize=7)
        ax.set_title(str(who), fontsize=8.5)
        ax.grid(False)
    figure.colorbar(drawn, ax=panels, label="share of what is claimed", aspect=40)
    return figure
