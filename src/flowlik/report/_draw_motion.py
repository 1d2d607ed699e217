"""Figures of ego-motion: trajectories and per-frame errors."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flowlik.report._style import INK, WIDTH, Data, legend_above, looks

Array = NDArray[np.float64]


def _widest_axes(positions: Array) -> tuple[int, int]:
    """Find the two axes of largest extent, in order; x and z where extents tie."""
    extent = np.nanmax(positions, axis=0) - np.nanmin(positions, axis=0)
    first, second = sorted((0, 2, 1), key=lambda axis: -round(float(extent[axis]), 9))[:2]
    return min(first, second), max(first, second)


def draw_trajectories(data: Data) -> Figure:
    """Draw a top view of all trajectories and, where the truth is known, how far they stray from it.

    Frames that could not be solved are crosses.
    """
    positions, timestamps = data["positions"].astype(np.float64), data["timestamps"]
    unit, truth = str(data["unit"]), data.get("truth")
    unsolved = data.get("unsolved", np.zeros(positions.shape[:2], bool))
    figure = Figure(figsize=(WIDTH, 4.6), layout="constrained")
    panels = figure.subplots(1, 3 if truth is not None else 1, squeeze=False)[0]
    a, b = _widest_axes(truth if truth is not None else positions.reshape(-1, 3))
    plane = f"{'xyz'[a]}–{'xyz'[b]} plane"
    if truth is not None:
        panels[0].plot(truth[:, a], truth[:, b], color=INK, lw=3.4, alpha=0.3, label="truth")
        _draw_ends(panels[0], truth[:, (a, b)], INK)
    for look, path, lost in zip(looks(data["names"]), positions, unsolved):
        drawn, label = [(panels[0], path[:, (a, b)])], look.label
        if truth is not None:
            error = np.linalg.norm(path - truth, axis=1)
            last = error[np.isfinite(error)][-1] if np.isfinite(error).any() else np.nan
            label = f"{look.label}: {last:.2g} {unit} off at the end"
            drawn += [
                (panels[1], (path - truth)[:, (a, b)]),
                (panels[2], np.stack([timestamps - timestamps[0], error], axis=1)),
            ]
        for ax, line in drawn:
            ax.plot(*line.T, look.dash, color=look.colour, lw=1.5, label=label)
            ax.plot(*line[lost].T, "x", color=look.colour, ms=5, zorder=5)
        for ax, line in drawn[:2]:
            _draw_ends(ax, line, look.colour)
    for ax in panels[:2]:
        ax.set(xlabel=f"{'xyz'[a]}  [{unit}]", ylabel=f"{'xyz'[b]}  [{unit}]")
        ax.set_aspect("equal", adjustable="datalim")
    panels[0].set_title(f"path in the {plane} (○ start, ■ end)", fontsize=9.5)
    legend_above(figure, panels[0], 2)
    if truth is not None:
        panels[1].set_title("deviation from the true path", fontsize=9.5)
        panels[2].set(xlabel="time  [s]", ylabel=f"distance  [{unit}]")
        panels[2].set_ylim(bottom=0)
        panels[2].set_title("distance to the true position", fontsize=9.5)
    return figure


def _draw_ends(ax: Axes, path: Array, colour: str) -> None:
    known = path[np.isfinite(path).all(axis=1)]
    if len(known):
        ax.plot(*known[0], "o", ms=7, mfc="white", mec=colour, mew=1.6, zorder=4)
        ax.plot(*known[-1], "s", ms=6, mfc=colour, mec="white", mew=0.8, zorder=4)


def draw_frame_errors(data: Data) -> Figure:
    """Draw per-frame translation and rotation errors: over time, and how often each size occurs."""
    seconds, names = data["timestamps"] - data["timestamps"][0], looks(data["names"])
    figure = Figure(figsize=(WIDTH, 6.0), layout="constrained")
    axes = figure.subplots(2, 2, width_ratios=[1.5, 1])
    medians: list[list[str]] = [[] for _ in names]
    for row, (key, unit) in enumerate((("translation", "m"), ("rotation", "deg"))):
        over_time, cumulative = axes[row]
        for k, (look, error) in enumerate(zip(names, np.where(data[key] > 0, data[key], np.nan))):
            _draw_series(over_time, seconds, error, look.colour)
            ordered = np.sort(error[np.isfinite(error)])
            share = (np.arange(len(ordered)) + 1) / max(len(ordered), 1) * 100
            medians[k].append(f"{np.median(ordered):.2g} {unit}" if len(ordered) else "none")
            cumulative.plot(ordered, share, look.dash, color=look.colour)
        over_time.set(yscale="log", ylabel=f"{key} error  [{unit}]")
        cumulative.axhline(50, color="#9aa1ab", lw=0.9, ls="--", zorder=0)
        cumulative.set(
            xscale="log", ylim=(0, 101), ylabel="frames below  [%]", xlabel=f"{key} error  [{unit}]"
        )
    axes[0, 0].set_title("every frame (dots) and their running median (line)", fontsize=9.5)
    axes[0, 1].set_title("share of frames with a smaller error", fontsize=9.5)
    axes[1, 0].set_xlabel("time  [s]")
    for look, both in zip(names, medians):
        axes[0, 1].plot([], [], look.dash, color=look.colour, label=f"{look.label}: {', '.join(both)}")
    legend_above(figure, axes[0, 1], 2, title="medians")
    return figure


def _draw_series(ax: Axes, seconds: Array, error: Array, colour: str) -> None:
    ax.plot(seconds, error, ".", color=colour, alpha=0.35, ms=4, mew=0)
    reach = max(len(error) // 50, 2)
    windows = [error[max(k - reach, 0) : k + reach + 1] for k in range(len(error))]
    running = [np.nanmedian(w) if np.isfinite(w).any() else np.nan for w in windows]
    ax.plot(seconds, running, color=colour, lw=1.7)
