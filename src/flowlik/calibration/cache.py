"""Saved sketches: an interrupted calibration goes on where it stopped."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from collections.abc import Sequence as Seq
from itertools import accumulate
from pathlib import Path
from typing import Any

from flowlik.calibration._sketch_file import LAYOUT, load_sketch, save_sketch
from flowlik.calibration.sketch import ErrorSketch
from flowlik.calibration.tasks import Block, Task
from flowlik.errors import DataError
from flowlik.flow.base import describe
from flowlik.likelihood.schedule import index_values
from flowlik.support.files import read_json, write_json
from flowlik.support.versions import versions

PLAN = "plan.json"


def first_sketches(tasks: Seq[Task]) -> list[int]:
    """Place of each task's first sketch among those of a block."""
    return list(accumulate((len(task.indices) for task in tasks[:-1]), initial=0))


class SketchCache:
    """A folder with the sketches of blocks, one file each, and ``plan.json``: what they are sketches of.

    Nothing is written until the first block has been measured.

    Parameters
    ----------
    folder : Path
        Folder; made when needed.
    begin : callable, optional
        Called before each writing, such as `RunFolder.begin`.

    Attributes
    ----------
    warnings : list of str
        A line for each damaged file; its block is measured again.
    resumed : dict
        Counts of ``blocks``, ``pairs`` and ``components`` that were read and not measured.
    """

    def __init__(self, folder: Path, begin: Callable[[], object] = lambda: None) -> None:
        self.folder, self.begin = Path(folder), begin
        self.warnings: list[str] = []
        self.resumed = {"blocks": 0, "pairs": 0, "components": 0}

    def open(self, blocks: Seq[Block], tasks: Seq[Task]) -> None:
        """Take up a plan: blocks, and tasks to sketch of each.

        Raises
        ------
        DataError
            If the folder holds the sketches of another plan.
        """
        self._expected = [ErrorSketch.empty(i, task.covariates) for task in tasks for i in task.indices]
        self._plan, self._firsts = _plan(blocks, tasks), first_sketches(tasks)
        if not self.folder.is_dir() or not any(self.folder.iterdir()):
            return
        path = self.folder / PLAN
        theirs = read_json(path) if path.is_file() else None
        if theirs != self._plan:
            theirs = theirs if isinstance(theirs, dict) else {}
            differing = [key for key in self._plan if theirs.get(key) != self._plan[key]]
            raise DataError(
                f"{self.folder}: sketches of another calibration (other {', '.join(differing) or 'keys'}); "
                "repeat that one, delete this folder, or choose another --out"
            )

    def has(self, block: int) -> bool:
        """Whether all sketches of a block have been saved."""
        return all(path.is_file() for path in self._paths(block))

    def load(self, block: int) -> list[ErrorSketch] | None:
        """Sketches of a block; None, and a warning, if a file is damaged."""
        try:
            sketches = [load_sketch(path) for path in self._paths(block)]
        except DataError as error:
            self.warnings.append(f"{error}; measured again")
            return None
        for sketch, expected, path in zip(sketches, self._expected, self._paths(block)):
            if (sketch.index, sketch.columns) != (expected.index, expected.columns):
                self.warnings.append(f"{path}: over another index or other covariates; measured again")
                return None
        self.resumed["blocks"] += 1
        self.resumed["pairs"] += sketches[0].pairs
        self.resumed["components"] += sum(sketches[i].total for i in self._firsts)
        return sketches

    def save(self, block: int, sketches: Seq[ErrorSketch]) -> None:
        """Write the sketches of a block."""
        self.begin()
        if not (self.folder / PLAN).is_file():
            write_json(self.folder / PLAN, self._plan)
        for sketch, path in zip(sketches, self._paths(block)):
            save_sketch(sketch, path)

    def remove(self) -> None:
        """Delete plan and sketches, also half-written ones, and the folder unless it holds something else."""
        if not self.folder.is_dir():
            return
        for pattern in ("block-*.npz", ".block-*.part", f".{PLAN}.*.part", PLAN):
            for path in self.folder.glob(pattern):
                path.unlink()
        if not any(self.folder.iterdir()):
            self.folder.rmdir()

    def _paths(self, block: int) -> list[Path]:
        return [self.folder / f"block-{block:06d}-{i:02d}.npz" for i in range(len(self._expected))]


def _plan(blocks: Seq[Block], tasks: Seq[Task]) -> Any:
    """What decides the sketches of blocks, as plain JSON: data, tasks, seeds, versions.

    Of each sequence the first image and the number of frames stand for its content.
    """
    sequences = list({id(block.sequence): block.sequence for block in blocks}.values())
    number = {id(sequence): i for i, sequence in enumerate(sequences)}
    installed = versions()
    values = {
        "data": [[s.name, len(s), zlib.crc32(s.image(0).tobytes()) if len(s) else 0] for s in sequences],
        "method": [describe(task.method) for task in tasks],
        "texture": [task.texture.describe() for task in tasks],
        "pixels": [task.pixels for task in tasks],
        "indices": [[index_values(index) for index in task.indices] for task in tasks],
        "covariates": [list(task.covariates) for task in tasks],
        "blocks": [[number[id(block.sequence)], *block.firsts] for block in blocks],
        "seeds": [block.seed for block in blocks],
        "layout": LAYOUT,
        "versions": {
            k: v for k, v in installed.items() if k in ("flowlik", "numpy") or k.startswith("opencv")
        },
    }
    return json.loads(json.dumps(values))
