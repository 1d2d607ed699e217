"""Figures of drives: errors over length and speed, intrinsics over time, and what moves by itself."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from flowlik.report._style import INK, WIDTH, Data, looks

UNITS = {"f": "px", "cx": "px", "cy": "px"}
INLIER, OUTLIER = "#2f6fb0", "#d03a2b"


def draw_segment_errors(data: Data) -> Figure:
    """Draw the KITTI errors over the length of segments and over speed."""
    figure = Figure(figsize=(WIDTH, 5.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex="col", sharey="row")
    for column, (axis, label) in enumerate((("length", "length  [m]"), ("speed", "speed  [m/s]"))):
        for row, (kind, unit) in enumerate((("translation", "%"), ("rotation", "deg/100 m"))):
            ax = axes[row, column]
            for look, errors in zip(looks(data["names"]), data[f"{kind}_by_{axis}"]):
                ax.plot(data[f"{axis}s"], errors, "o-", color=look.colour, ms=4, lw=1.5, label=look.label)
            if not column:
                ax.set_ylabel(f"{kind} error  [{unit}]")
        axes[1, column].set_xlabel(label)
    for ax in axes[:, 0]:
        ax.set_ylim(bottom=0)
    axes[0, 1].legend(loc="best", fontsize=8)
    return figure


def draw_intrinsics(data: Data) -> Figure:
    """Draw each parameter over time with its 95 % interval."""
    names, seconds = data["names"], data["timestamps"] - data["timestamps"][0]
    figure = Figure(figsize=(WIDTH, 1.9 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for i, (ax, name) in enumerate(zip(axes, names)):
        value, sigma = data["values"][:, i], data["sigma"][:, i]
        ax.fill_between(seconds, value - 1.96 * sigma, value + 1.96 * sigma, color=INLIER, alpha=0.2, lw=0)
        ax.plot(seconds, value, color=INLIER, lw=1.6)
        ax.axhline(value[0], color="#9aa1ab", lw=0.9, ls="--", zorder=0)
        unit = UNITS.get(str(name))
        ax.set_ylabel(f"{name}  [{unit}]" if unit else str(name))
    axes[-1].set_xlabel("time  [s]")
    return figure


def draw_outliers(data: Data) -> Figure:
    """Draw flow vectors over the image, those that contradict the motion in another colour."""
    height, width = data["image"].shape
    figure = Figure(figsize=(WIDTH, WIDTH * height / width + 0.3), layout="constrained")
    ax = figure.subplots()
    ax.imshow(data["image"], cmap="gray", vmin=0, vmax=255, alpha=0.75)
    inlier = data["inlier"].astype(bool)
    for which, colour, label in ((inlier, INLIER, "agrees"), (~inlier, OUTLIER, "does not")):
        begin = data["pixels"][which]
        lines = np.stack([begin, begin + data["flow"][which]], axis=1)
        ax.add_collection(LineCollection(list(lines), colors=colour, linewidths=0.9))
        ax.plot(*begin.T, ".", color=colour, ms=2.5, mew=0, label=f"{label}: {int(which.sum())}")
    ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])
    ax.legend(loc="lower right", fontsize=8, markerscale=4, labelcolor=INK)
    return figure
