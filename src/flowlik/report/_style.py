"""One look for all figures: fonts, colours of families and estimators, deterministic files."""

from __future__ import annotations

import io
import math
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flowlik.report.names import names_of

Data = Mapping[str, NDArray[Any]]
T = TypeVar("T")

DPI = 160
WIDTH = 10.0  # inches: 1600 px
COLOURS = 128  # of a PNG

INK, GREY, PALE = "#1b1f24", "#6b7280", "#d5d9e0"
BLUE, VERMILION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#AA4499"
SKY, OCHRE, WINE = "#56B4E9", "#E69F00", "#882255"
SPARE = ("#44AA99", "#999933", "#332288", "#CC6677", "#117733", "#DDCC77")

TEXTURE_LABEL = "texture $t$  [intensity²/px²]"

RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 10.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "#e8eaee",
    "grid.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "legend.fontsize": 9.0,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "legend.handlelength": 3.0,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "figure.facecolor": "white",
    "figure.constrained_layout.h_pad": 0.08,
    "figure.constrained_layout.w_pad": 0.08,
    "svg.fonttype": "path",
    "svg.hashsalt": "flowlik",
    "image.interpolation": "nearest",
}


@dataclass(frozen=True)
class Look:
    """How one family or estimator appears in every figure.

    Parameters
    ----------
    label : str
        Its name for a reader.
    colour : str
        Its colour, safe for colour-blind readers.
    marker : str
        Its marker, so that colour is never the only difference.
    dash : str
        Its line style.
    """

    label: str
    colour: str
    marker: str
    dash: str = "-"


# The Gaussian and RANSAC share a colour, as do the learned model and LCMSAC with it: one density at work.
LOOKS = {
    "paper's": ("o", BLUE, "-"),
    "learned": ("D", WINE, "-"),
    "log-logistic": ("s", GREEN, "--"),
    "Gaussian": ("^", VERMILION, "-."),
    "GLC over texture": ("P", SKY, ":"),
    "Laplace": ("v", SKY, "--"),
    "Student-t": ("P", OCHRE, "--"),
    "RANSAC": ("^", VERMILION, "-."),
    "OpenCV": ("s", OCHRE, ":"),
    "LCMSAC": ("o", BLUE, "-"),
    "LCMSAC, paper's": ("o", BLUE, "-"),
    "LCMSAC, learned": ("D", WINE, "-"),
    "maximum likelihood": ("D", PURPLE, "-"),
    "maximum likelihood, paper's": ("o", SKY, "--"),
    "maximum likelihood, learned": ("D", PURPLE, "--"),
    "nominal": ("o", BLUE, "-"),
    "self-calibrated": ("D", PURPLE, "-"),
    "boresight": ("s", GREEN, "-"),
    "truth": ("", INK, "-"),
}
"""Marker, colour and line of each name of `flowlik.report.names` that has its own."""


def looks(names: Iterable[str]) -> list[Look]:
    """Look of what models or estimators are called in the data: that of the name that a reader knows."""
    return looks_of(names_of([str(name) for name in names]))


def looks_of(labels: Iterable[str]) -> list[Look]:
    """Look of every reader's name: its own where it has one, else the next spare colour."""
    spare = iter(range(10**6))

    def look(label: str) -> Look:
        if label in LOOKS:
            marker, colour, dash = LOOKS[label]
            return Look(label, colour, marker, dash)
        k = next(spare)
        return Look(label, SPARE[k % len(SPARE)], "vPX*<>"[k % 6], "--")

    return [look(label) for label in labels]


def legend_above(figure: Figure, ax: Axes, columns: int = 3, **keys: Any) -> None:
    """Put the legend of some axes above the whole figure, where it hides no curve."""
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=min(columns, max(len(labels), 1)), **keys
    )


_LOCK = threading.RLock()


@contextmanager
def styled() -> Iterator[None]:
    """Hold the library's plot style; matplotlib's settings are global, hence the lock."""
    with _LOCK, mpl.rc_context(RC):
        yield


@dataclass(frozen=True)
class Rendered:
    """One figure as files.

    Parameters
    ----------
    png : bytes
        PNG of at most 128 colours, a third of the size of one of all; equal data give equal bytes.
    svg : bytes
        The same as SVG; empty if none was wanted.
    """

    png: bytes
    svg: bytes = b""


def render_with(draw: Callable[[T], Figure], data: T, svg: bool = False) -> Rendered:
    """Draw a figure in the library's style and encode it as PNG, and as SVG if wanted."""
    from PIL import Image

    png, vector = io.BytesIO(), io.BytesIO()
    with styled():
        figure = draw(data)
        figure.set_dpi(DPI)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        if svg:
            # the layout is found once: savefig would draw everything twice
            figure.set_layout_engine("none")
            FigureCanvasSVG(figure).print_svg(vector, metadata={"Date": None})
    few = picture.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(png, "PNG", optimize=True)
    return Rendered(png.getvalue(), vector.getvalue())


def axes_at(figure: Figure, left: float, top: float, width: float, height: float) -> Axes:
    """Axes at a place given in inches from the figure's top-left corner."""
    W, H = figure.get_size_inches()
    return figure.add_axes((left / W, 1 - (top + height) / H, width / W, height / H))


def bare(ax: Axes) -> Axes:
    """Axes without ticks, grid or frame, for images and keys."""
    ax.set_xticks([])
    ax.set_yticks([])
    ax.grid(False)
    ax.set_frame_on(False)
    return ax


def nice(value: float, steps: tuple[float, ...] = (1, 2, 5)) -> float:
    """Largest round number (a step × 10^k) not above a value; 1 if the value is not positive."""
    if not 0 < value < math.inf:
        return 1.0
    decade = 10.0 ** math.floor(math.log10(value))
    return max((s * decade for s in steps if s * decade <= value * (1 + 1e-9)), default=decade)


def grouped(value: float) -> str:
    """Three significant digits of a number of any size, without exponent where it stays readable."""
    return f"{value:,.0f}".replace(",", " ") if 1000 <= abs(value) < 1e7 else f"{value:.3g}"
