"""Figures of ego-motion: trajectories and per-frame errors."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flowlik.report._style import INK, WIDTH, Data, looks

Array = NDArray[np.float64]


def _widest_axes(positions: Array) -> tuple[int, int]:
    """Find the two axes of largest extent, in order; x and z where extents tie."""
    extent = np.nanmax(positions, axis=0) - np.nanmin(positions, axis=0)
    first, second = sorted((0, 2, 1), key=lambda axis: -round(float(extent[axis]), 9))[:2]
    return min(first, second), max(first, second)


def draw_trajectories(data: Data) -> Figure:
    """Draw a top view of all trajectories and, where the truth is known, their position errors over time.

    Frames that could not be solved are crosses.
    """
    positions, timestamps = data["positions"].astype(np.float64), data["timestamps"]
    unit, truth = str(data["unit"]), data.get("truth")
    unsolved = data.get("unsolved", np.zeros(positions.shape[:2], bool))
    figure = Figure(figsize=(WIDTH, 4.8), layout="constrained")
    panels = figure.subplots(1, 2 if truth is not None else 1, squeeze=False)[0]
    a, b = _widest_axes(truth if truth is not None else positions.reshape(-1, 3))
    top = panels[0]
    if truth is not None:
        top.plot(truth[:, a], truth[:, b], color=INK, lw=3.4, alpha=0.3, label="truth")
        _draw_ends(top, truth[:, (a, b)], INK)
    for look, path, lost in zip(looks(data["names"]), positions, unsolved):
        top.plot(path[:, a], path[:, b], color=look.colour, lw=1.5, label=look.label)
        _draw_ends(top, path[:, (a, b)], look.colour)
        top.plot(path[lost, a], path[lost, b], "x", color=look.colour, ms=5, zorder=5)
        if truth is not None:
            error = np.linalg.norm(path - truth, axis=1)
            seconds = timestamps - timestamps[0]
            last = error[np.isfinite(error)][-1] if np.isfinite(error).any() else np.nan
            panels[1].plot(
                seconds, error, color=look.colour, lw=1.5, label=f"{look.label}: {last:.3g} {unit} at the end"
            )
            panels[1].plot(seconds[lost], error[lost], "x", color=look.colour, ms=5, zorder=5)
    top.set(xlabel=f"{'xyz'[a]}  [{unit}]", ylabel=f"{'xyz'[b]}  [{unit}]")
    top.set_aspect("equal", adjustable="datalim")
    top.set_title(f"path in the {'xyz'[a]}–{'xyz'[b]} plane (○ start, ■ end)", fontsize=9.5)
    top.legend(loc="best")
    if truth is not None:
        panels[1].set(xlabel="time  [s]", ylabel=f"position error  [{unit}]")
        # room for the legend above the curves
        entries = min(len(positions), 12)
        panels[1].set_ylim(0, panels[1].get_ylim()[1] / (1 - 0.05 * max(entries, 4)))
        panels[1].set_title("distance to the true position", fontsize=9.5)
        panels[1].legend(loc="upper left")
    return figure


def _draw_ends(ax: Axes, path: Array, colour: str) -> None:
    known = path[np.isfinite(path).all(axis=1)]
    if len(known):
        ax.plot(*known[0], "o", ms=7, mfc="white", mec=colour, mew=1.6, zorder=4)
        ax.plot(*known[-1], "s", ms=6, mfc=colour, mec="white", mew=0.8, zorder=4)


def draw_frame_errors(data: Data) -> Figure:
    """Draw per-frame translation and rotation errors: over time, and how often each size occurs."""
    seconds = data["timestamps"] - data["timestamps"][0]
    figure = Figure(figsize=(WIDTH, 5.6), layout="constrained")
    axes = figure.subplots(2, 2, width_ratios=[1.5, 1])
    for row, (key, unit) in enumerate((("translation", "m"), ("rotation", "deg"))):
        over_time, cumulative = axes[row]
        for look, error in zip(looks(data["names"]), np.where(data[key] > 0, data[key], np.nan)):
            _draw_series(over_time, seconds, error, look.colour)
            ordered = np.sort(error[np.isfinite(error)])
            share = (np.arange(len(ordered)) + 1) / max(len(ordered), 1) * 100
            median = f"median {np.median(ordered):.2g} {unit}" if len(ordered) else "none"
            cumulative.plot(ordered, share, color=look.colour, label=f"{look.label}: {median}")
        over_time.set(yscale="log", ylabel=f"{key} error  [{unit}]")
        cumulative.axhline(50, color="#9aa1ab", lw=0.9, ls="--", zorder=0)
        cumulative.set(
            xscale="log", ylim=(0, 101), ylabel="frames below  [%]", xlabel=f"{key} error  [{unit}]"
        )
        cumulative.legend(loc="upper left", fontsize=8)
    axes[0, 0].set_title("every frame (dots) and their running median (line)", fontsize=9.5)
    axes[0, 1].set_title("share of frames with a smaller error", fontsize=9.5)
    axes[1, 0].set_xlabel("time  [s]")
    return figure


def _draw_series(ax: Axes, seconds: Array, error: Array, colour: str) -> None:
    ax.plot(seconds, error, ".", color=colour, alpha=0.35, ms=4, mew=0)
    reach = max(len(error) // 50, 2)
    windows = [error[max(k - reach, 0) : k + reach + 1] for k in range(len(error))]
    running = [np.nanmedian(w) if np.isfinite(w).any() else np.nan for w in windows]
    ax.plot(seconds, running, color=colour, lw=1.7)
