"""One look for all figures: fonts, colours of families and estimators, deterministic files."""

from __future__ import annotations

import io
import math
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from numpy.typing import NDArray

Data = Mapping[str, NDArray[Any]]

DPI = 160
WIDTH = 10.0  # inches: 1600 px

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
        Its line style, which tells a family's schedule.
    """

    label: str
    colour: str
    marker: str
    dash: str = "-"


# The Gaussian and RANSAC share a colour, as do LCM and LCMSAC: each estimator is its family at work.
LOOKS = {
    "lcm": Look("LCM", BLUE, "o"),
    "laplacecauchy": Look("LCM", BLUE, "o"),
    "loglogistic": Look("log-logistic", GREEN, "s"),
    "gaussian": Look("Gaussian", VERMILION, "^"),
    "laplace": Look("Laplace", SKY, "v"),
    "studentt": Look("Student-t", OCHRE, "P"),
    "glc": Look("GLC", WINE, "D"),
    "ransac": Look("RANSAC", VERMILION, "^"),
    "lcmsac": Look("LCMSAC", BLUE, "o"),
    "mle": Look("MLE", PURPLE, "D"),
    "nominal": Look("nominal", BLUE, "o"),
    "selfcalibrated": Look("self-calibrated", PURPLE, "D"),
    "boresight": Look("boresight", GREEN, "s"),
    "truth": Look("truth", INK, ""),
}


DASHES = {"index": "-", "texture": "--", "flow": ":", "constant": "-."}


def known_look(name: str) -> Look | None:
    """Look of a family or estimator that has one of its own, however its name is spelled.

    A family may be followed by its schedule, as in ``"lcm · index"``.
    """
    family, _, schedule = name.partition(" · ")
    look = LOOKS.get(re.sub(r"[^a-z0-9]", "", family.lower()))
    if look is None or not schedule:
        return look
    return replace(look, label=f"{look.label} · {schedule}", dash=DASHES.get(schedule, "-"))


def looks(names: Iterable[str]) -> list[Look]:
    """Look of every name: its own where it has one, else the next spare colour.

    Parameters
    ----------
    names : iterable of str
        Names of families or estimators, in the order of the figure.

    Returns
    -------
    list of Look
        One a name.
    """
    spare = iter(range(10**6))

    def other(name: str) -> Look:
        k = next(spare)
        return Look(name, SPARE[k % len(SPARE)], "vPX*<>"[k % 6])

    return [known_look(str(name)) or other(str(name)) for name in names]


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
    png, svg : bytes
        The same figure twice; equal data give equal bytes.
    """

    png: bytes
    svg: bytes


def render_with(draw: Callable[[Data], Figure], data: Data) -> Rendered:
    """Draw a figure in the library's style and encode it as PNG and SVG."""
    png, svg = io.BytesIO(), io.BytesIO()
    with styled():
        figure = draw(data)
        figure.set_dpi(DPI)
        # The canvases are asked directly, and the layout found once: savefig would draw everything twice.
        FigureCanvasAgg(figure).print_png(png)
        figure.set_layout_engine("none")
        FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None})
    return Rendered(png.getvalue(), svg.getvalue())


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
