"""Measurements of a sequence's pairs kept in a folder: rendering costs a hundred times what estimators do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from flowlik.errors import DataError
from flowlik.image.texture import TextureDefinition
from flowlik.measurement.measurements import Measurements
from flowlik.support.files import atomic_write, read_json, read_npz, write_json

ARRAYS = ("pixels", "flow", "R_i_e", "t")
SIGNAL = "signal-"
PLAN = "plan.json"


class PairCache:
    """A folder with one npz file a pair, and `plan.json`: what they are measurements of.

    Parameters
    ----------
    folder : Path
        Folder; made when needed.
    plan : dict
        What decides the measurements, as plain JSON, with ``method`` and ``texture`` among it.

    Raises
    ------
    DataError
        If the folder holds the measurements of another plan.
    """

    def __init__(self, folder: Path, plan: dict[str, Any]) -> None:
        self.folder, self.plan = folder, plan
        path = folder / PLAN
        if not path.is_file():
            write_json(path, plan)
        elif read_json(path) != plan:
            raise DataError(f"{folder}: measurements of something else; choose another --cache")

    def get(self, k: int, make: Callable[[], Measurements]) -> Measurements:
        """Measurements from frame k - 1 to k: read, or made and kept."""
        path = self.folder / f"{k:06d}.npz"
        if path.is_file():
            return self._read(path)
        m = make()
        arrays = {name: getattr(m, name) for name in ARRAYS}
        arrays |= {SIGNAL + name: values for name, values in m.signals.items()}
        with atomic_write(path, "wb") as file:
            np.savez_compressed(file, lost=m.lost, **arrays)
        return m

    def _read(self, path: Path) -> Measurements:
        arrays = read_npz(path)
        return Measurements(
            *(arrays[name] for name in ARRAYS),
            texture=TextureDefinition(**self.plan["texture"]),
            method=self.plan["method"],
            signals={n.removeprefix(SIGNAL): a for n, a in arrays.items() if n.startswith(SIGNAL)},
            lost=int(arrays["lost"]),
        )
