"""Figures of a fused flight: innovations over their bounds, biases, what each sensor contributed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flowlik.report._style import BLUE, GREY, INK, PALE, VERMILION, WIDTH, Data, legend_above, looks

BOUND = 1.96
NIS_HONEST, NIS_BOUND_95 = 3.0, 7.815
STYLES = ((PALE, "-", 5.0), (VERMILION, "--", 1.6), (BLUE, ":", 1.8))


def draw_innovations(data: Data) -> Figure:
    """Draw each axis' innovations within their 95 % bounds, their NIS, and the test of a ramp."""
    seconds, statistic = data["timestamps"], data.get("statistic")
    panels = 5 if statistic is not None else 4
    figure = Figure(figsize=(WIDTH, 1.55 * panels), layout="constrained")
    axes = figure.subplots(panels, 1, sharex=True)
    for k, ax in enumerate(axes[:3]):
        reach = BOUND * data["sigma"][:, k]
        ax.fill_between(seconds, -reach, reach, color=PALE, lw=0, label="95 % bound")
        ax.plot(seconds, data["innovations"][:, k], ".", color=BLUE, ms=4, label="innovation")
        ax.set_ylabel(f"{'xyz'[k]}  [m]")
    axes[3].plot(seconds, data["nis"], ".", color=BLUE, ms=4)
    axes[3].axhline(NIS_HONEST, color=GREY, lw=1)
    axes[3].axhline(NIS_BOUND_95, color=GREY, lw=1, ls="--")
    axes[3].set_ylabel("NIS")
    if statistic is not None:
        axes[4].plot(seconds, statistic, color=INK)
        axes[4].axhline(float(data["threshold"]), color=VERMILION, ls="--")
        axes[4].set_ylabel("ramp statistic")
    if "alarm" in data:
        time, first, last = data["alarm"]
        for ax in axes:
            ax.axvspan(first, max(last, first + 0.02), color=VERMILION, alpha=0.2, lw=0)
            ax.axvline(time, color=VERMILION, lw=1.2)
    axes[-1].set_xlabel("time  [s]")
    legend_above(figure, axes[0], 2)
    return figure


def draw_biases(data: Data) -> Figure:
    """Draw the biases of gyroscope and accelerometer with their 95 % intervals."""
    seconds, values, sigma = data["timestamps"], data["values"], data["sigma"]
    figure = Figure(figsize=(WIDTH, 4.8), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    colours = [look.colour for look in looks(["x", "y", "z"])]
    rows = ((axes[0], 0, "gyroscope  [deg/s]", np.rad2deg(1.0)), (axes[1], 3, "accelerometer  [m/s²]", 1.0))
    for ax, first, label, factor in rows:
        for k, colour in enumerate(colours):
            value, reach = factor * values[:, first + k], factor * BOUND * sigma[:, first + k]
            ax.fill_between(seconds, value - reach, value + reach, color=colour, alpha=0.2, lw=0)
            ax.plot(seconds, value, color=colour, label="xyz"[k])
        ax.set_ylabel(label)
    axes[-1].set_xlabel("time  [s]")
    legend_above(figure, axes[0], 3)
    return figure


def draw_contributions(data: Data) -> Figure:
    """Draw the stated deviations with all sensors, and without each."""
    seconds = data["timestamps"]
    figure = Figure(figsize=(WIDTH, 3.8), layout="constrained")
    axes = figure.subplots(1, 3)
    parts = (("attitude", "deg", np.rad2deg(1.0)), ("velocity", "m/s", 1.0), ("position", "m", 1.0))
    for ax, (part, unit, factor) in zip(axes, parts):
        for k, (name, sigma) in enumerate(zip(data["names"], data[part])):
            colour, dash, width = STYLES[k % len(STYLES)]
            ax.plot(seconds, factor * sigma, dash, color=colour, lw=width, label=str(name))
        ax.set(xlabel="time  [s]", ylabel=f"{part}  [{unit}]")
        if data[part].max() > 30 * data[part].min() > 0:
            ax.set_yscale("log")
        else:
            ax.set_ylim(bottom=0)
    legend_above(figure, axes[0], 3)
    return figure
