"""The picture of one image pair: where, and in which direction, its flow can be trusted."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from flowlik.report._hue import SPARSE, dot_size, draw_flow, draw_wheel, flow_scale, washed
from flowlik.report._style import GREY, INK, WIDTH, Data, axes_at, bare, nice

_MARGIN, _GAP, _TITLE, _KEY = 0.12, 0.14, 0.34, 1.2
_CROSSES = 480  # about as many over the whole image, whatever its shape
_TALLEST = 6.6  # inches
WIDTH_COLOURS = ("#0b3c8c", "#1f7fc4", "#35b0a7", "#d9a441", "#d1552b", "#8c1c3a")
"""From what is known well, dark and blue, to what is not, red; none is as bright as the image."""

Array = NDArray[np.float64]


def draw_uncertainty(data: Data) -> Figure:
    """Draw error crosses over the image, their key, maps of both half-widths and the flow in hue."""
    image, flow, half_width = (np.asarray(data[k], dtype=np.float64) for k in ("image", "flow", "half_width"))
    H, W = image.shape
    full = WIDTH - 2 * _MARGIN
    main, small = min(full, _TALLEST * W / H), min((full - 2 * _GAP) / 3, 0.5 * _TALLEST * W / H)
    key_top = _TITLE + main * H / W + 0.1
    maps_top = key_top + _KEY + _TITLE
    figure = Figure(figsize=(WIDTH, maps_top + small * H / W + _MARGIN))
    percent = f"{100 * float(data['confidence']):g} %"
    norm, cmap, scale = _width_scale(half_width), _width_map(), flow_scale(flow)

    ax = axes_at(figure, (WIDTH - main) / 2, _TITLE, main, main * H / W)
    magnification, arrow_scale = draw_bars(ax, data)
    ax.set_title(
        f"Where flow can be trusted, and in which direction: {percent} error bars, × {magnification:g}"
    )

    _draw_cross_key(axes_at(figure, _MARGIN, key_top, 5.3, _KEY), arrow_scale)
    _draw_colour_bar(figure, axes_at(figure, 5.75, key_top + 0.36, 2.6, 0.17), norm, cmap)
    draw_wheel(axes_at(figure, WIDTH - 1.3, key_top + 0.26, 0.88, 0.88), scale, unknown=False)

    lefts = WIDTH / 2 + (np.arange(3) - 1) * (small + _GAP) - small / 2
    axes = [axes_at(figure, left, maps_top, small, small * H / W) for left in lefts]
    names = "along $e_1$ (most texture)", "along $e_2$ (least texture)"
    for k, name in enumerate(names):
        _draw_map(axes[k], image, half_width[..., k], norm, cmap)
        axes[k].set_title(f"{percent} half-width {name}", fontsize=9)
    draw_flow(axes[2], flow, scale, image)
    axes[2].set_title("flow: direction as hue, length as saturation", fontsize=9)
    return figure


def draw_bars(ax: Axes, data: Data) -> tuple[float, float]:
    """Draw the error bars over the image; return how many times they and the flow are magnified."""
    H, W = data["image"].shape
    norm = _width_scale(np.asarray(data["half_width"], dtype=np.float64))
    found = _draw_crosses(ax, data, norm, _width_map())
    _draw_length_bar(ax, W, H)
    return found


def _width_map() -> Colormap:
    return LinearSegmentedColormap.from_list("half-width", WIDTH_COLOURS)


def _width_scale(half_width: Array) -> LogNorm:
    known = half_width[np.isfinite(half_width) & (half_width > 0)]
    if not known.size:
        return LogNorm(0.1, 10)
    low, high = np.quantile(known, [0.02, 0.98])
    return LogNorm(float(low), float(max(high, 3 * low)))


def _grid(known: NDArray[np.bool_], step: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pixel (v, u) drawn in every cell of a regular grid: its centre, or its first feature if sparse."""
    H, W = known.shape
    if known.mean() >= SPARSE:
        v, u = np.meshgrid(np.arange(step / 2, H, step), np.arange(step / 2, W, step), indexing="ij")
        v, u = v.astype(np.intp).ravel(), u.astype(np.intp).ravel()
        return v[known[v, u]], u[known[v, u]]
    v, u = np.nonzero(known)
    cell = (v // step).astype(np.int64) * (W + 1) + (u // step).astype(np.int64)
    first = np.unique(cell, return_index=True)[1]
    return v[first], u[first]


def _draw_crosses(ax: Axes, data: Data, norm: LogNorm, cmap: Colormap) -> tuple[float, float]:
    """Draw crosses and flow; return how many times either is magnified."""
    image, flow, half_width = (np.asarray(data[k], dtype=np.float64) for k in ("image", "flow", "half_width"))
    H, W = image.shape
    bare(ax).imshow(washed(image, 0.5), cmap="gray", vmin=0, vmax=255)
    ax.set(xlim=(-0.5, W - 0.5), ylim=(H - 0.5, -0.5), autoscale_on=False)
    step = max(float(np.sqrt(H * W / _CROSSES)), 1.0)
    known = np.isfinite(half_width).all(axis=-1) & np.isfinite(data["angle"])
    v, u = _grid(known, step)
    if not u.size:
        ax.text(W / 2, H / 2, "no flow to draw", ha="center", va="center")
        return 1.0, 1.0
    centre, widths, angle = (
        np.stack([u, v], axis=-1).astype(np.float64),
        half_width[v, u],
        data["angle"][v, u],
    )
    cap = 0.47 * step
    magnification = nice(0.6 * cap / float(np.median(widths)))
    arrow_scale = _draw_vectors(ax, centre, flow[v, u], step)
    e1 = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    axes_e = np.stack([e1, e1[:, ::-1] * [-1, 1]], axis=1)  # (N, 2, 2): e1, e2 as rows
    drawn, largest = magnification * widths, widths.max(axis=1)
    cut = drawn > cap
    bars, heads = _bars(centre, axes_e, drawn, cap), _heads(centre, axes_e, cut, cap)
    size = np.concatenate([np.repeat(largest, 2), np.repeat(largest, 2 * cut.sum(axis=1))])
    # Small crosses last: a well known direction is never hidden under a neighbour's large bar.
    order = np.argsort(-size, kind="stable")
    pieces = [*bars, *heads]
    lines = [pieces[k] for k in order]
    for width, colours in ((3.4, "white"), (1.7, cmap(norm(size[order])))):
        ax.add_collection(LineCollection(lines, linewidths=width, colors=colours, capstyle="round", zorder=3))
    return magnification, arrow_scale


def _bars(centre: Array, axes_e: Array, lengths: Array, cap: float) -> Array:
    """Segments (2N, 2, 2) of both bars of every cross, cut at the cap [px]."""
    reach = np.minimum(lengths, cap)[..., None] * axes_e
    ends = np.stack([centre[:, None] - reach, centre[:, None] + reach], axis=2)
    return np.asarray(ends.reshape(-1, 2, 2))


def _heads(centre: Array, axes_e: Array, cut: NDArray[np.bool_], cap: float) -> Array:
    """Arrow heads (M, 3, 2) at both ends of every bar that the cap [px] has cut."""
    along, origin = axes_e[cut], np.repeat(centre[:, None], 2, axis=1)[cut]
    across, size = along[:, ::-1] * [-1, 1], 0.28 * cap
    heads = []
    for sign in (-1, 1):
        tip = origin + sign * cap * along
        back = tip - sign * size * along
        heads.append(np.stack([back + 0.7 * size * across, tip, back - 0.7 * size * across], axis=1))
    return np.asarray(np.stack(heads, axis=1).reshape(-1, 3, 2))


def _draw_vectors(ax: Axes, centre: Array, flow: Array, step: float) -> float:
    lengths = np.linalg.norm(flow, axis=-1)
    usable = np.isfinite(lengths)
    if not usable.any():
        return 1.0
    scale = nice(0.9 * step / max(float(np.quantile(lengths[usable], 0.8)), 1e-6))
    drawn = scale * lengths[usable]
    # A few wild vectors would cover the picture: they keep their direction and are cut in length.
    shown = scale * flow[usable] * np.minimum(1, 1.6 * step / np.maximum(drawn, 1e-9))[:, None]
    ax.quiver(
        *centre[usable].T,
        *shown.T,
        angles="xy",
        scale_units="xy",
        scale=1,
        units="inches",
        width=0.008,
        headwidth=5,
        headlength=6,
        headaxislength=5,
        minlength=0,
        color=INK,
        alpha=0.55,
        zorder=2,
    )
    return scale


def _draw_length_bar(ax: Axes, W: int, H: int) -> None:
    length, em = nice(W / 8), W / 75
    x, y = 1.5 * em, H - 2.2 * em
    back = Rectangle(
        (x - 0.7 * em, y - 1.3 * em), length + 5.4 * em, 2.6 * em, color="white", alpha=0.88, lw=0
    )
    ax.add_patch(back).set_zorder(4)
    ax.plot([x, x + length], [y, y], color=INK, lw=3, solid_capstyle="butt", zorder=5)
    ax.text(x + length + 0.7 * em, y, f"{length:g} px", va="center", fontsize=8.5, zorder=5)


def _draw_map(ax: Axes, image: Array, half_width: Array, norm: LogNorm, cmap: Colormap) -> None:
    known = np.isfinite(half_width)
    bare(ax)
    if known.mean() >= SPARSE:
        ax.imshow(half_width, norm=norm, cmap=cmap.with_extremes(bad="0.82"))
        return
    ax.imshow(washed(image), cmap="gray", vmin=0, vmax=255)
    v, u = np.nonzero(known)
    size = dot_size(ax, max(u.size, 1))
    ax.scatter(u, v, s=size, c=half_width[known], norm=norm, cmap=cmap, edgecolors="white", linewidths=0.3)


def _draw_cross_key(ax: Axes, arrow_scale: float) -> None:
    """Explain the crosses: what their two bars, arrow heads and thin arrows mean."""
    bare(ax).set(xlim=(0, 5.3), ylim=(_KEY, 0), autoscale_on=False)
    cmap = _width_map()
    kinds = (
        (0.1, 0.1, 0.2, "short bars:\nflow is known\nboth ways"),
        (0.08, 0.3, 0.75, "one long bar:\nknown across it,\nnot along it"),
        (0.3, 0.3, 0.97, "long bars:\nnot known\neither way"),
    )
    for k, (across, along, shade, label) in enumerate(kinds):
        x, y = 0.32 + 1.8 * k, 0.47
        for dx, dy in ((across, 0), (0, along)):
            ax.plot([x - dx, x + dx], [y - dy, y + dy], color=cmap(shade), lw=2.4)
        ax.text(x + 0.16 + across, y, label, fontsize=8.5, va="center", linespacing=1.25)
    note = f"ends with arrow heads: longer than drawn  ·  thin arrows: flow × {arrow_scale:g}, long ones cut"
    ax.text(0, 1.02, note, fontsize=8, va="center", color=GREY)


def _draw_colour_bar(figure: Figure, ax: Axes, norm: LogNorm, cmap: Colormap) -> None:
    bar = figure.colorbar(ScalarMappable(norm, cmap), cax=ax, extend="both", orientation="horizontal")
    low, high = float(norm.vmin or 0.1), float(norm.vmax or 10)
    steps = (1, 2, 5) if high < 300 * low else (1,)
    bar.set_ticks([m * 10.0**k for k in range(-6, 6) for m in steps if low <= m * 10.0**k <= high])
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.minorticks_off()
    ax.grid(False)
    ax.set_title(
        "half-width  [px]; of a cross, the larger one", fontsize=8.5, fontweight="normal", loc="center"
    )
