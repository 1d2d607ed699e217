"""Figures of a calibration: errors over texture, look-up table, fit and its goodness."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from flowlik.report._style import (
    BLUE,
    GREY,
    INK,
    PALE,
    TEXTURE_LABEL,
    VERMILION,
    WIDTH,
    Data,
    grouped,
    legend_above,
    looks,
)

Array = NDArray[np.float64]


def _magnitude_quantile(edges: Array, counts: Array, q: float) -> Array:
    """Quantile of |z| in every texture column, interpolated in ln |z| within its bin; NaN if empty."""
    total = counts.sum(axis=1, keepdims=True)
    cdf = np.concatenate([np.zeros_like(total), np.cumsum(counts, axis=1)], axis=1) / np.maximum(total, 1)
    log_edges = np.log(np.maximum(edges, 1e-12))
    value = [np.interp(q, row, log_edges) if n else np.nan for row, n in zip(cdf, total[:, 0])]
    return np.exp(value)


def draw_error_over_texture(data: Data) -> Figure:
    """Draw the counts of |z| over texture with the quantiles of every texture column."""
    texture, error, counts = data["texture_edges"], data["error_edges"], data["counts"].astype(np.float64)
    figure = Figure(figsize=(WIDTH, 5.2), layout="constrained")
    ax = figure.subplots()
    ax.grid(False)
    ax.set(xscale="log", yscale="log", xlabel=TEXTURE_LABEL, ylabel="error magnitude |z|  [px]")
    low = np.maximum(texture, texture[texture > 0].min() / 2)
    high = np.maximum(error, error[error > 0].min() / 2)
    norm = LogNorm(1, max(float(counts.max(initial=1)), 10))
    mesh = ax.pcolormesh(
        low, high, np.where(counts > 0, counts, np.nan).T, norm=norm, cmap="Blues", rasterized=True
    )
    centres = np.sqrt(low[:-1] * low[1:])
    enough = counts.sum(axis=1) >= 100
    for q, dash, label in ((0.5, "-", "median of |z|"), (0.9, "--", "90 % of |z| lie below")):
        ax.plot(
            centres,
            np.where(enough, _magnitude_quantile(high, counts, q), np.nan),
            dash,
            color=INK,
            label=label,
        )
    if "bound_90" in data:
        label = "the model's own 90 % bound"
        ax.plot(data["bound_texture"], data["bound_90"], "-.", color=VERMILION, lw=2.2, label=label)
    rows, columns = np.flatnonzero(counts.sum(axis=0)), np.flatnonzero(counts.sum(axis=1))
    if rows.size:
        ax.set(xlim=(low[columns[0]], low[columns[-1] + 1]), ylim=(high[rows[0]], high[rows[-1] + 1]))
    legend_above(figure, ax)
    figure.colorbar(mesh, ax=ax, label="components in the bin", pad=0.01, aspect=30)
    return figure


COORDINATES = {"texture": TEXTURE_LABEL, "flow": "length of the flow vector  [px]"}
INDEX_LABEL = r"predicted error scale $e^x$  [px]"
_SYMBOLS = {"beta": r"$\beta$", "gamma": r"$\gamma$", "lambda": r"$\lambda$", "w_L": "$w_L$", "w_l": "$w_L$"}


def draw_table(data: Data) -> Figure:
    """Draw the family's parameters over the schedule's coordinate, one panel a parameter."""
    knots, values, names, units = data["knots"], data["values"], data["names"], data["units"]
    P = len(names)
    coordinate = COORDINATES.get(str(data.get("coordinate", "texture")), INDEX_LABEL)
    columns = min(P, 3)
    rows = -(-P // columns)
    figure = Figure(figsize=(WIDTH, 3.2 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True).ravel()
    for k, (name, unit) in enumerate(zip(names, units)):
        ax, value = axes[k], values[:, k]
        if "counts" in data:
            _draw_population(ax, data["edges"], data["counts"])
        if "low" in data:
            ax.fill_between(knots, data["low"][:, k], data["high"][:, k], color=BLUE, alpha=0.25, lw=0)
        ax.plot(knots, value, color=BLUE, marker="o", ms=4.5, mec="white", mew=0.7)
        positive = bool((value > 0).all())
        ax.set(xscale="log", yscale="log" if positive and value.max() > 30 * value.min() else "linear")
        symbol = _SYMBOLS.get(str(name), str(name))
        unit = str(unit).strip()
        ax.set(title=symbol, ylabel=f"{symbol}  [{unit if unit not in ('', '1') else 'no unit'}]")
        ax.set_xlim(knots.min() / 1.6, knots.max() * 1.6)
    for ax in axes[max(P - columns, 0) : P]:
        ax.set_xlabel(coordinate)
        ax.tick_params(labelbottom=True)
    for ax in axes[P:]:
        ax.set_visible(False)
    return figure


def _draw_population(ax: Axes, edges: Array, counts: Array) -> None:
    """Shade how many components each coordinate has, as a share of the panel's height."""
    height = np.append(counts, counts[-1]) / max(float(counts.max(initial=0)), 1.0)
    ax.fill_between(edges, height, step="post", color="#eceff3", lw=0, transform=ax.get_xaxis_transform())


def _central(z: Array, density: Array, mass: float) -> float:
    """Half-range of |z| [px] that holds a mass of a binned density."""
    share = np.nan_to_num(density) * np.gradient(z)
    order = np.argsort(np.abs(z))
    cumulative = np.cumsum(share[order])
    if not cumulative[-1] > 0:
        return float(np.abs(z).max())
    inside = int(np.searchsorted(cumulative / cumulative[-1], mass))
    return float(np.abs(z)[order][min(inside, len(z) - 1)])


BULK = 0.8
"""Share of the errors that the linear panels show: their tails would hide the middle."""


def draw_distributions(data: Data) -> Figure:
    """Draw empirical and fitted densities by texture level, linear at left and logarithmic at right."""
    levels = data["level_edges"]
    L = len(levels)
    figure = Figure(figsize=(WIDTH, 0.6 + 1.9 * L), layout="constrained")
    axes = figure.subplots(L, 2, squeeze=False)
    for row in range(L):
        z, empirical, fitted = (data[k][row].astype(np.float64) for k in ("z", "empirical", "fitted"))
        for ax, mass, scale in zip(axes[row], (BULK, 0.9995), ("linear", "log")):
            reach = 1.1 * _central(z, empirical, mass)
            near = np.abs(z) <= reach
            if scale == "log":
                # Where bins are empty the logarithm has nothing to show: dots stand only where data is.
                some = near & (empirical > 0)
                ax.plot(z[some], empirical[some], ".", ms=4, color=GREY, label="measured")
                low, high = np.min(empirical[some], initial=1), np.max(empirical[some], initial=1e-9)
                ax.set(yscale="log", ylim=(low / 3, high * 3))
            else:
                ax.fill_between(z[near], empirical[near], color=PALE, lw=0, label="measured")
                ax.set_ylim(0, 1.08 * max(empirical[near].max(initial=1e-9), fitted[near].max(initial=0)))
            ax.plot(z[near], fitted[near], color=BLUE, lw=1.6, label="fitted")
            ax.set_xlim(-reach, reach)
        axes[row, 0].set_title(
            f"texture {grouped(levels[row, 0])} to {grouped(levels[row, 1])}", fontsize=9.5
        )
        axes[row, 0].set_ylabel("density  [1/px]")
    axes[0, 1].set_title("the same, logarithmic", fontsize=9.5)
    legend_above(figure, axes[0, 0])
    for ax in axes[-1]:
        ax.set_xlabel("signed error z  [px]")
    return figure


def draw_goodness(data: Data) -> Figure:
    """Draw the K-S distance of every family over texture, and how many components stand behind it."""
    texture, counted = data["texture"], data["counted"].astype(bool)
    figure = Figure(figsize=(WIDTH, 5.2), layout="constrained")
    ax, strip = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": [4, 1]})
    for look, ks in zip(looks(data["families"]), data["ks"]):
        shown = counted & np.isfinite(ks)
        median = f"median {np.median(ks[shown]):.3f}" if shown.any() else "no counted level"
        ax.plot(texture, ks, color=look.colour, lw=1.2, alpha=0.35)
        ax.plot(
            texture[~counted], ks[~counted], look.marker, color=look.colour, alpha=0.35, ms=4.5, mfc="white"
        )
        solid = np.where(shown, ks, np.nan)
        label = f"{look.label}: {median}"
        ax.plot(
            texture, solid, look.dash, color=look.colour, marker=look.marker, ms=5, mec="white", mew=0.6,
            label=label,
        )  # fmt: skip
    if "floor" in data and np.isfinite(data["floor"]).any():
        median = f"median {np.nanmedian(data['floor']):.3f}"
        label = f"between two samples: {median}"
        ax.fill_between(texture, 0, np.nan_to_num(data["floor"]), color=PALE, lw=0, label=label, zorder=0)
    ax.set(xscale="log", ylabel="K-S distance of |z|")
    ax.set_ylim(0, 1.06 * np.nanmax(data["ks"], initial=0.05))
    legend_above(figure, ax)
    ratio = np.exp(np.median(np.diff(np.log(texture)))) if len(texture) > 1 else 1.5
    width = texture * (np.sqrt(ratio) - 1 / np.sqrt(ratio)) * 0.9
    strip.bar(texture, data["counts"], width=width, color=np.where(counted, "#aeb6c2", "#e3e6eb"))
    strip.set(yscale="log", xlabel=TEXTURE_LABEL, ylabel="components")
    strip.set_ylim(bottom=max(0.5, float(data["counts"].min()) / 3))
    return figure


def draw_coverage(data: Data) -> Figure:
    """Draw the share of errors inside the model's own intervals, against the share promised."""
    nominal = data["nominal"]
    figure = Figure(figsize=(WIDTH, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.25])
    left.plot([0, 1], [0, 1], color=GREY, lw=1, ls="--", label="perfect")
    right.axhline(0, color=GREY, lw=1, ls="--")
    for look, observed in zip(looks(data["names"]), data["observed"]):
        style = {
            "color": look.colour,
            "marker": look.marker,
            "ms": 5,
            "mec": "white",
            "mew": 0.6,
            "ls": look.dash,
            "clip_on": False,
        }
        left.plot(nominal, observed, label=look.label, **style)
        right.plot(nominal, 100 * (observed - nominal), **style)
    left.set(xlabel="promised", ylabel="observed", xlim=(0, 1), ylim=(0, 1), aspect="equal")
    for axis in (left.xaxis, left.yaxis, right.xaxis):
        axis.set_major_formatter(PercentFormatter(1.0, symbol=" %"))
    left.set_title("share of errors inside the interval", fontsize=9.5)
    right.set(xlabel="promised", ylabel="observed − promised  [percentage points]")
    right.set_title("the difference: above 0 too cautious, below too bold", fontsize=9.5)
    legend_above(figure, left, 4)
    return figure
