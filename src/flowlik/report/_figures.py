"""Checks, draws and captions the figures of a run."""

from __future__ import annotations

import string
from typing import Any

import numpy as np

from flowlik.errors import DataError
from flowlik.report._kinds import FIGURES
from flowlik.report._style import Data, Rendered, render_with


def check(kind: str, data: Data) -> None:
    """Check that a kind of figure is known and that its arrays are there with shapes that agree.

    Parameters
    ----------
    kind : str
        A key of `FIGURES`.
    data : mapping of str to ndarray
        Its arrays.

    Raises
    ------
    DataError
        Naming the first array that is missing or does not fit.
    """
    if kind not in FIGURES:
        raise DataError(f"no figure of kind {kind!r}: known are {', '.join(FIGURES)}")
    spec = FIGURES[kind]
    missing = [name for name in spec.required if name not in data]
    if missing:
        raise DataError(f"figure {kind} lacks {', '.join(missing)}")
    shapes = dict(spec.required) | {name: shape for name, shape in spec.optional.items() if name in data}
    lengths: dict[str, int] = {}
    for name, shape in shapes.items():
        actual, letters = np.shape(data[name]), shape.split()
        fits = len(actual) == len(letters) and all(_bind(s, n, lengths) for s, n in zip(letters, actual))
        if not fits or 0 in actual:
            raise DataError(f"figure {kind}: {name} has shape {actual}, expected ({', '.join(letters)})")


def _bind(letter: str, length: int, lengths: dict[str, int]) -> bool:
    """Whether a length agrees with its letter, which it defines where it comes first."""
    if letter.isdigit():
        return length == int(letter)
    base, plus, _ = letter.partition("+")
    length -= 1 if plus else 0
    return lengths.setdefault(base, length) == length


def render(kind: str, data: Data, svg: bool = False) -> Rendered:
    """Draw a figure as PNG, and as SVG if wanted.

    Parameters
    ----------
    kind : str
        A key of `FIGURES`.
    data : mapping of str to ndarray
        Its arrays, as the kind's ``required`` and ``optional`` say.
    svg : bool
        Whether to draw it as SVG too.

    Returns
    -------
    Rendered
        The figure's files; equal data give equal bytes.

    Raises
    ------
    DataError
        If the data does not fit the kind.
    """
    check(kind, data)
    try:
        return render_with(FIGURES[kind].draw, data, svg)
    except (ValueError, TypeError, IndexError) as error:
        raise DataError(f"figure {kind} cannot be drawn: {' '.join(str(error).split())}") from error


def caption(kind: str, data: Data) -> str:
    """How to read a figure, with the scalars of its data filled in."""
    template = FIGURES[kind].caption
    names = {name for _, name, _, _ in string.Formatter().parse(template) if name}
    values: dict[str, Any] = {name: np.asarray(data[name]).item() for name in names}
    return template.format(**values)
