"""Figures of the evidence about a model: PIT, sparsification, coverage over texture, bias, eigenbasis."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from flowlik.report._style import (
    BLUE,
    GREY,
    INK,
    PALE,
    TEXTURE_LABEL,
    VERMILION,
    WIDTH,
    Data,
    Look,
    legend_above,
    looks,
)

COVERAGE_BAND = 0.05
HIGHEST_DENSITY = 2.0


def _line(look: Look, markers: bool = True) -> dict[str, Any]:
    style = {"color": look.colour, "ls": look.dash}
    return style | ({"marker": look.marker, "ms": 4.5, "mec": "white", "mew": 0.6} if markers else {})


def _percent(ax: Axes, axis: str) -> None:
    getattr(ax, f"{axis}axis").set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))


def draw_levels(data: Data) -> Figure:
    """Draw coverage and negative log-likelihood of every model over texture."""
    texture, confidence = data["texture"], float(data["confidence"])
    figure = Figure(figsize=(WIDTH, 5.6), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    top.axhspan(confidence - COVERAGE_BAND, min(confidence + COVERAGE_BAND, 1), color="#eceff3", lw=0)
    top.axhline(confidence, color=GREY, lw=1, ls="--")
    names = looks(data["names"])
    for look, covered, nll, counted in zip(
        names, data["coverage"], data["nll"], data["counted"].astype(bool)
    ):
        for ax, values in ((top, covered), (bottom, nll)):
            ax.plot(texture, values, color=look.colour, lw=1, alpha=0.3)
            few = ~counted
            ax.plot(texture[few], values[few], look.marker, color=look.colour, alpha=0.35, ms=4, mfc="white")
            ax.plot(texture, np.where(counted, values, np.nan), label=look.label, **_line(look))
    shown = np.where(data["counted"], data["coverage"], np.nan)
    top.set(xscale="log", ylabel=f"share inside {100 * confidence:.0f} % intervals")
    top.set_ylim(max(0.0, min(0.8, np.nanmin(shown, initial=1.0) - 0.03)), 1.0)
    _percent(top, "y")
    bottom.set(xlabel=TEXTURE_LABEL, ylabel="negative log-likelihood  [nat]")
    legend_above(figure, bottom)
    return figure


def draw_pit(data: Data) -> Figure:
    """Draw the PIT histogram of every model as steps, 1 where the model is right."""
    figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
    ax = figure.subplots()
    ax.axhline(1, color=GREY, lw=1, ls="--")
    for look, density in zip(looks(data["names"]), data["density"]):
        deviation = np.abs(density - 1).max()
        label = f"{look.label}: off by up to {100 * deviation:.0f} %"
        ax.stairs(density, data["edges"], baseline=None, color=look.colour, ls=look.dash, lw=1.8, label=label)
    ax.set(xlim=(0, 1), xlabel="place in the model's own distribution", ylabel="share of errors / due share")
    # a model that is far off would flatten the others; its label tells by how much it leaves the figure
    ax.set_ylim(0, 1.04 * np.clip(data["density"].max(), 1.3, HIGHEST_DENSITY))
    legend_above(figure, ax)
    return figure


def draw_sparsification(data: Data) -> Figure:
    """Draw the error of what stays over the share removed, one panel a statistic."""
    statistics = data["statistics"]
    figure = Figure(figsize=(WIDTH, 4.4), layout="constrained")
    axes = figure.subplots(1, len(statistics), squeeze=False, sharey=True)[0]
    for k, (ax, statistic) in enumerate(zip(axes, statistics)):
        ax.axhline(1, color=GREY, lw=1, ls="--", label="at random")
        for look, curves in zip(looks(data["names"]), data["curves"]):
            ax.plot(data["removed"], curves[k], label=look.label, **_line(look, markers=False))
        ax.plot(data["removed"], data["oracle"][0, k], color=GREY, lw=1.4, label="by the true error")
        ax.set(xlim=(0, 1), xlabel="share of components removed")
        least = " · ".join(
            f"{look.label} {ause[k]:.2f}" for look, ause in zip(looks(data["names"]), data["ause"])
        )
        ax.set_title(f"{statistic} of |z|", fontsize=9.5)
        ax.annotate(
            f"AUSE: {least}",
            (0, -0.2),
            xycoords="axes fraction",
            fontsize=7.5,
            va="top",
            color=INK,
            wrap=True,
        )
        _percent(ax, "x")
    axes[0].set_ylabel("error of what stays / error of all")
    # a curve of gross errors that rises first is cut: what matters is below 1
    axes[0].set_ylim(0, float(np.clip(1.05 * data["curves"].max(), 1.05, 1.5)))
    legend_above(figure, axes[0], 4)
    return figure


def draw_bias(data: Data) -> Figure:
    """Draw the share of errors that fall short, and the signed error's median and mean, over texture."""
    texture, enough = data["texture"], data["counts"] >= 1e-3 * data["counts"].sum()
    figure = Figure(figsize=(WIDTH, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.25])

    def draw(ax: Axes, name: str, colour: str, marker: str, label: str | None = None) -> None:
        values = data[name]
        ax.plot(texture[~enough], values[~enough], marker, color=colour, alpha=0.35, ms=4, mfc="white")
        solid = np.where(enough, values, np.nan)
        ax.plot(texture, solid, color=colour, marker=marker, ms=4.5, mec="white", mew=0.6, label=label)

    left.axhline(0.5, color=GREY, lw=1, ls="--")
    draw(left, "negative", BLUE, "o")
    reach = max(0.1, 1.15 * float(np.abs(data["negative"][enough] - 0.5).max(initial=0)))
    left.set(xscale="log", xlabel=TEXTURE_LABEL, ylabel="share that falls short")
    left.set_ylim(max(0, 0.5 - reach), min(1, 0.5 + reach))
    _percent(left, "y")
    size = np.where(enough, data["median_magnitude"], np.nan)
    right.fill_between(texture, -size, size, color=PALE, lw=0, label="± median of |z|")
    right.axhline(0, color=GREY, lw=1, ls="--")
    draw(right, "median", BLUE, "o", "median of the signed error")
    draw(right, "mean", VERMILION, "^", "mean, capped at ±100 px")
    right.set(xscale="log", xlabel=TEXTURE_LABEL, ylabel="signed error  [px]  (− falls short)")
    right.set_yscale("symlog", linthresh=0.01, linscale=0.5)
    right.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, handlelength=1.5, columnspacing=1.0)
    return figure


def draw_eigenbasis(data: Data) -> Figure:
    """Draw what pooling gains, and the K-S distance, over t2/t1."""
    edges = data["ratio_edges"]
    centres = 0.5 * (edges[1:] + edges[:-1])
    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    height = data["counts"] / np.diff(edges)
    for ax in (left, right):
        ax.stairs(
            height / max(height.max(), 1),
            edges,
            fill=True,
            color="#eceff3",
            transform=ax.get_xaxis_transform(),
        )
        ax.set(xlabel="t₂/t₁", xlim=(0, 1))
    left.axhline(0, color=GREY, lw=1, ls="--")
    left.plot(centres, data["nll"][1] - data["nll"][0], color=BLUE, marker="o", ms=4.5, mec="white")
    left.set_ylabel("NLL with pooling − as it is  [nat]")
    reach = max(0.02, 1.2 * float(np.nanmax(np.abs(data["nll"][1] - data["nll"][0]), initial=0)))
    left.set_ylim(-reach, reach)
    for values, name, colour, marker, dash in zip(
        data["ks"], data["names"], (BLUE, VERMILION), "o^", ("-", "--")
    ):
        right.plot(centres, values, dash, color=colour, marker=marker, ms=4.5, mec="white", label=str(name))
    right.set_ylabel("K-S distance of |z|")
    right.set_ylim(0, 1.25 * max(0.05, float(np.nanmax(data["ks"], initial=0))))
    right.legend(loc="upper right")
    return figure
