"""Optical flow as colour: hue is direction, saturation is length."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import hsv_to_rgb
from numpy.typing import NDArray

from flowlik.report._style import GREY, INK, bare, nice

UNKNOWN = 0.82  # grey level of a pixel without flow
_STEPS = (1, 1.5, 2, 3, 4, 5, 7)
SPARSE = 0.2  # below this share of known pixels, flow is drawn as dots

Array = NDArray[np.float64]


def flow_scale(*flows: Array) -> float:
    """Flow length [px] drawn in full colour: a round number that hardly any exceed by much.

    Parameters
    ----------
    *flows : ndarray, shape (..., 2)
        Flow [px], NaN where unknown.

    Returns
    -------
    float
        Length [px]; 1 if no flow is known.
    """
    lengths = np.concatenate([np.linalg.norm(f, axis=-1).ravel() for f in flows])
    lengths = lengths[np.isfinite(lengths)]
    return nice(float(np.quantile(lengths, 0.95)), _STEPS) if lengths.size else 1.0


def hue_colours(flow: Array, scale: float) -> Array:
    """Colour of each flow vector.

    Parameters
    ----------
    flow : ndarray, shape (..., 2)
        Flow [px], u right and v down, NaN where unknown.
    scale : float
        Length [px] drawn in full colour; longer vectors look the same.

    Returns
    -------
    ndarray, shape (..., 3)
        RGB in [0, 1]; white for no motion, grey for unknown.
    """
    known = np.asarray(np.isfinite(flow).all(axis=-1))
    u, v = np.moveaxis(np.where(known[..., None], flow, 0.0), -1, 0)
    saturation = np.minimum(np.hypot(u, v) / scale, 1.0)
    hue = np.arctan2(v, u) / (2 * np.pi) % 1.0
    rgb = hsv_to_rgb(np.stack([hue, saturation, 1 - 0.12 * saturation], axis=-1))
    return np.asarray(np.where(known[..., None], rgb, UNKNOWN), dtype=np.float64)


def draw_flow(ax: Axes, flow: Array, scale: float, backdrop: Array | None = None) -> None:
    """Draw flow in hue: an image if dense, dots over a pale backdrop if sparse.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    flow : ndarray, shape (H, W, 2)
        Flow [px], NaN where unknown.
    scale : float
        Length [px] drawn in full colour.
    backdrop : ndarray, shape (H, W), optional
        Grey image behind sparse flow.
    """
    known = np.isfinite(flow).all(axis=-1)
    bare(ax)
    if known.mean() >= SPARSE:
        ax.imshow(hue_colours(flow, scale))
        return
    ax.imshow(
        np.full(known.shape, 255) if backdrop is None else washed(backdrop), cmap="gray", vmin=0, vmax=255
    )
    v, u = np.nonzero(known)
    if u.size:
        size = dot_size(ax, u.size)
        ax.scatter(u, v, s=size, c=hue_colours(flow[v, u], scale), edgecolors=INK, linewidths=0.25)


def dot_size(ax: Axes, count: int) -> float:
    """Area [pt²] of a dot such that `count` of them leave most of the axes free."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    box = ax.get_position()
    area = box.width * box.height * float(np.prod(figure.get_size_inches())) * 72**2
    return float(np.clip(0.15 * area / max(count, 1), 2.0, 30.0))


def washed(image: Array, strength: float = 0.6) -> Array:
    """Image [0, 255] faded towards white, so that what is drawn over it stands out."""
    return np.asarray(255 - (1 - strength) * (255 - image.astype(np.float64)))


def draw_wheel(ax: Axes, scale: float, unknown: bool = True) -> None:
    """Draw the key to the colours: a disc of all flows up to the scale.

    Parameters
    ----------
    ax : Axes
        Square axes.
    scale : float
        Length [px] at the rim.
    unknown : bool
        Whether to explain grey.
    """
    side = np.linspace(-1, 1, 201)
    disc = np.stack(np.meshgrid(side, side), axis=-1)
    radius = np.linalg.norm(disc, axis=-1)
    rgba = np.concatenate([hue_colours(disc, 1.0), (radius <= 1)[..., None].astype(float)], axis=-1)
    bare(ax).imshow(rgba, extent=(-1, 1, 1, -1), interpolation="antialiased")
    ax.annotate(
        "",
        (1, 0),
        (0, 0),
        arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1, "shrinkA": 0, "shrinkB": 0},
    )
    ax.set(xlim=(-1.05, 1.05), ylim=(1.05, -1.05))
    ax.text(0, -1.1, f"flow, rim: ≥ {scale:g} px", fontsize=8.5, ha="center", va="bottom")
    if unknown:
        ax.text(0, 1.12, "grey: unknown", fontsize=8, ha="center", va="top", color=GREY)
