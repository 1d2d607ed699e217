"""Calibrated likelihoods that ship with flowlik: each a model file with its provenance.

``NAME.json`` is the best (a learned index), ``NAME-lcm.json`` the paper's Laplace-Cauchy mixture over
texture; NAME is that of a flow method. ``NAME-epipolar.json`` is of errors across epipolar lines alone: what
NAME gives where these are asked for (`serving`).
`benchmarks/ship_models.py` and `benchmarks/ship_epipolar.py` make them.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path


def shipped() -> dict[str, Path]:
    """Files of the shipped models by name, in alphabetical order."""
    folder = Path(str(files(__name__)))
    return {path.stem: path for path in sorted(folder.glob("*.json"), key=lambda path: path.stem)}


def serving(name: str, residual: str | None) -> str:
    """Name of the shipped model that a name stands for, where errors of one residual are asked for.

    ``"epipolar"`` gives the table of errors across epipolar lines, if there is one; else the name stays.
    """
    across = f"{name}-epipolar"
    return across if residual == "epipolar" and across in shipped() else name
