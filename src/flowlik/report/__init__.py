"""Figures, tables and the page of a run, drawn from the small files of its folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flowlik.report._style import Data
    from flowlik.results.runs import RunFolder

__all__ = ["build", "finish", "save_figure"]


def build(run: Path, svg: bool = False, map: Callable[..., Iterable[Any]] = map) -> Path:
    """Draw every figure of a run folder and write its page.

    Parameters
    ----------
    run : Path
        Folder with ``run.json``, ``metrics.json`` and ``data/<kind>--<label>.npz``.
    svg : bool
        Whether to draw the figures as SVG too.
    map : callable
        Where the figures are drawn: the built-in one, or that of a pool of processes.

    Returns
    -------
    Path
        The page, ``run/report.html``; its figures stand in ``run/figures`` as PNG.

    Raises
    ------
    DataError
        If the folder or one of its files is missing, unreadable or of the wrong shape.
    """
    from flowlik.report._page import write_report

    return write_report(Path(run), svg, map)


def finish(run: RunFolder, map: Callable[..., Iterable[Any]] = map) -> Path:
    """Finish a run, draw its page and return the page's path.

    Raises
    ------
    DataError
        As `build`.
    """
    return build(run.finish(), map=map)


def save_figure(kind: str, data: Data, stem: Path) -> tuple[Path, Path]:
    """Draw one figure to ``<stem>.png`` and ``<stem>.svg``.

    Parameters
    ----------
    kind : str
        Kind of figure, such as ``uncertainty``: the part before ``--`` of a file in a run's ``data``.
    data : mapping of str to ndarray
        The arrays that kind requires.
    stem : Path
        Path of the figure without its suffix; its folder is made if missing.

    Returns
    -------
    tuple of Path
        The PNG and the SVG.

    Raises
    ------
    DataError
        If the kind is unknown, an array is missing or its shape does not fit.
    """
    from flowlik.report._figures import render
    from flowlik.report._page import write_figure

    png, vector = write_figure(render(kind, data, svg=True), Path(stem))
    return png, vector
