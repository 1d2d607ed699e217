"""Statistics of pictures, pooled over a set, as records and as one figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import naturalness
from flowlik.report._style import BLUE, GREEN, GREY, INK, PURPLE, SPARE, VERMILION, WIDTH, styled
from flowlik.results.records import Record, protocol
from simulation_pictures import OURS, REAL, RENDERED, PictureSet

Array = NDArray[np.float64]

QUANTILES = (5, 25, 50, 75, 95, 99)
GRADIENT_EDGES = np.linspace(-80, 80, 81)
LEVELS = np.geomspace(1e-2, 1e5, 141)
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, *SPARE)


@dataclass(frozen=True)
class Statistics:
    """What is measured of one set: arrays over rings, gradient bins and texture levels, and numbers."""

    pictures: PictureSet
    count: int
    spectrum: tuple[Array, Array]
    gradient_density: Array
    t1_below: Array
    t2_below: Array
    numbers: dict[str, tuple[float | None, str]]


def measure(pictures: PictureSet) -> Statistics:
    """Pool every statistic over the pictures of a set."""
    spectra, slopes, greys, gradients, t1, t2, shares, flow = [], [], [], [], [], [], [], []
    frequency = np.empty(0)
    for picture in pictures.pictures():
        frequency, amplitude = naturalness.amplitude_spectrum(picture.image)
        spectra.append(amplitude)
        slopes.append(naturalness.spectral_slope(picture.image))
        greys.append(picture.image.ravel())
        gradients.append(naturalness.gradients(picture.image))
        for levels, values in zip((t1, t2), naturalness.texture_levels(picture.image)):
            levels.append(values)
        if picture.depth is not None:
            shares.append(naturalness.depth_edge_share(picture.depth))
        if picture.flow_px is not None:
            flow.append(picture.flow_px)
    gradient, t1_all, t2_all, grey = (np.concatenate(values) for values in (gradients, t1, t2, greys))
    numbers: dict[str, tuple[float | None, str]] = {
        "spectral_slope": (float(np.median(slopes)), ""),
        "grey_sd": (float(grey.std()), "grey levels"),
        **{f"grey_{q}": (float(np.percentile(grey, q)), "grey levels") for q in (1, 50, 99)},
        "gradient_sd": (float(np.sqrt(np.mean(gradient**2))), "grey levels/px"),
        "gradient_kurtosis": (naturalness.kurtosis(gradient), ""),
        "texture_t2_above_3": (float(np.mean(t2_all > 3)), ""),
        "depth_edge_share": (float(np.mean(shares)) if shares else None, ""),
        "flow_median_px": (float(np.median(np.concatenate(flow))) if flow else None, "px"),
    }
    for name, values in (("t1", t1_all), ("t2", t2_all)):
        for q, value in zip(QUANTILES, np.percentile(values, QUANTILES)):
            numbers[f"texture_{name}_{q}"] = (float(value), "intensity^2/px^2")
    return Statistics(
        pictures,
        len(slopes),
        (frequency, np.exp(np.mean(np.log(spectra), axis=0))),
        np.histogram(gradient, GRADIENT_EDGES)[0] / (len(gradient) * np.diff(GRADIENT_EDGES)),
        _below(t1_all),
        _below(t2_all),
        numbers,
    )


def _below(values: Array) -> Array:
    return np.searchsorted(np.sort(values), LEVELS) / len(values)


def records(statistics: Statistics) -> list[Record]:
    """One record a number; the protocol says what kind of pictures they are and where flow comes from."""
    pictures = statistics.pictures
    note = protocol(kind=pictures.kind, flow=pictures.flow, edges="depth ratio above 1.1 in 3x3, within 5 px")
    return [
        Record(metric, value, unit, dataset=pictures.name, count=statistics.count, protocol=note)
        for metric, (value, unit) in statistics.numbers.items()
    ]


SHOWN = {
    "spectral_slope": "slope",
    "grey_1": "grey 1 %",
    "grey_50": "50 %",
    "grey_99": "99 %",
    "gradient_sd": "gradient",
    "gradient_kurtosis": "kurtosis",
    "texture_t1_50": "t1 50 %",
    "texture_t2_50": "t2 50 %",
    "texture_t2_95": "t2 95 %",
    "texture_t2_above_3": "t2 > 3",
    "depth_edge_share": "near edges",
    "flow_median_px": "flow px",
}


def table(statistics: Sequence[Statistics]) -> str:
    """Lines of a Markdown table, a set a row."""
    lines = [f"| set | {' | '.join(SHOWN.values())} |", "| --- |" + " ---: |" * len(SHOWN)]
    for row in statistics:
        values = (row.numbers[metric][0] for metric in SHOWN)
        cells = ["–" if value is None else f"{value:.3g}" for value in values]
        lines.append(f"| {row.pictures.name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def figure(statistics: Sequence[Statistics]) -> Figure:
    """Draw spectra, gradients and texture: ours in colour over the range of the real pictures."""
    real = [s for s in statistics if s.pictures.kind == REAL]
    rendered = [s for s in statistics if s.pictures.kind == RENDERED]
    ours = [s for s in statistics if s.pictures.kind == OURS]
    drawing = Figure(figsize=(WIDTH, 8.2), layout="constrained")
    spectrum, gradient, major, minor = drawing.subplots(2, 2).ravel()
    middles = (GRADIENT_EDGES[1:] + GRADIENT_EDGES[:-1]) / 2
    frequencies = np.geomspace(0.01, 0.5, 60)

    def amplitude(s: Statistics) -> Array:
        return np.exp(np.interp(np.log(frequencies), *np.log(s.spectrum)))

    panels = (
        (spectrum, frequencies, amplitude),
        (gradient, middles, lambda s: np.where(s.gradient_density > 0, s.gradient_density, np.nan)),
        (major, LEVELS, lambda s: s.t1_below),
        (minor, LEVELS, lambda s: s.t2_below),
    )
    for ax, x, y in panels:
        if real:
            range_ = np.stack([np.nan_to_num(y(s), nan=1e-9) for s in real])
            label = f"{len(real)} sets of photographs, range"
            ax.fill_between(
                x, range_.min(axis=0), range_.max(axis=0), color=GREY, alpha=0.25, lw=0, label=label
            )
            ax.plot(x, np.median(range_, axis=0), color=INK, lw=2.4, label="and median")
        for k, s in enumerate(rendered):
            ax.plot(x, y(s), color=GREY, lw=1.1, ls=("--", ":", "-.")[k % 3], label=s.pictures.name)
        for colour, s in zip(COLOURS, ours):
            ax.plot(x, y(s), color=colour, lw=1.8, label=s.pictures.name)
    spectrum.set(
        xscale="log", yscale="log", xlabel="frequency  [cycles/px]", ylabel="amplitude  [grey levels]"
    )
    spectrum.set_title("amplitude spectrum")
    gradient.set(yscale="log", ylim=(1e-6, 1), xlabel="derivative  [grey levels/px]", ylabel="density  [px]")
    gradient.set_title("derivatives")
    for ax, name in ((major, "t_1"), (minor, "t_2")):
        ax.set(xscale="log", ylim=(0, 1), xlabel=f"texture ${name}$  [intensity²/px²]", ylabel="share below")
        ax.set_title(f"eigenvalue ${name}$ of the structure tensor")
    spectrum.legend(fontsize=7.5)
    return drawing


def write_figure(path: Path, statistics: Sequence[Statistics]) -> None:
    """Write the figure as PNG."""
    with styled():
        figure(statistics).savefig(path, dpi=110)
