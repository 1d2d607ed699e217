"""Figures that show images: the flow sequence."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flowlik.report._hue import SPARSE, draw_flow, draw_wheel, flow_scale
from flowlik.report._style import WIDTH, Data, axes_at, bare

_MOST_FRAMES = 5
_LEFT, _KEY, _GAP, _TOP = 0.4, 1.35, 0.06, 0.3


def draw_sequence(data: Data) -> Figure:
    """Draw frames, their true flow and their estimated flow, one column a frame."""
    n, H, W = data["images"].shape
    shown = np.unique(np.linspace(0, n - 1, min(n, _MOST_FRAMES)).round().astype(int))
    true_flow, flow = data["true_flow"][shown], data["flow"][shown]
    scale = flow_scale(true_flow, flow)
    width = min((WIDTH - _LEFT - _KEY) / len(shown) - _GAP, 3.6)
    height = width * H / W
    total = _LEFT + len(shown) * (width + _GAP) + _KEY
    figure = Figure(figsize=(total, _TOP + 3 * (height + _GAP) + 0.05))
    for column, k in enumerate(shown):
        left = _LEFT + column * (width + _GAP)
        axes = [axes_at(figure, left, _TOP + row * (height + _GAP), width, height) for row in range(3)]
        bare(axes[0]).imshow(data["images"][k], cmap="gray", vmin=0, vmax=255)
        axes[0].set_title(f"frame {k}", loc="center", fontsize=9.5, fontweight="normal", pad=4)
        draw_flow(axes[1], true_flow[column], scale, data["images"][k])
        draw_flow(axes[2], flow[column], scale, data["images"][k])
    for row, label in enumerate(("image", "true flow", "estimated flow")):
        y = 1 - (_TOP + row * (height + _GAP) + height / 2) / figure.get_size_inches()[1]
        figure.text(
            0.2 / total, y, label, rotation=90, ha="center", va="center", fontsize=min(10, 6.5 * height)
        )
    side = min(_KEY - 0.25, 1.4 * height)
    middle = _TOP + height * 2 + _GAP * 1.5
    unknown = bool(np.isnan(true_flow).any() or (np.isnan(flow).any() and np.isfinite(flow).mean() >= SPARSE))
    draw_wheel(axes_at(figure, total - _KEY + 0.12, middle - side / 2, side, side), scale, unknown)
    return figure
