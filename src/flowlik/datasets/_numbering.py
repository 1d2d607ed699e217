"""Frames by number: the number in an image's name says which poses, times and depth are its own."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError

LONGEST_GAP = 100_000
"""Frames that may be missing between two images; more are other numbers, such as times."""


@dataclass(frozen=True, eq=False)
class Numbered:
    """Image files in the order of their numbers.

    Attributes
    ----------
    files : list of Path
        A file a frame; of a frame that is missing, the file that should be there.
    numbers : int array (N,)
        Its number, increasing: by one, where missing frames stand in the list.
    """

    files: list[Path]
    numbers: NDArray[np.int64]

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.files)

    def rows(self, count: int, what: str, path: Path) -> NDArray[np.int64]:
        """Row (N,) of each frame in a table that has one row a frame and no numbers.

        A table with a row for every number counts from frame 0; one with as many rows as there are numbers
        from the first image to the last begins with the first image.

        Parameters
        ----------
        count : int
            Rows of the table.
        what : str
            What they are, in the plural, for errors.
        path : Path
            The table's file, for errors.

        Raises
        ------
        DataError
            If the table is of neither kind.
        """
        first, last = int(self.numbers[0]), int(self.numbers[-1])
        if count > last:
            return self.numbers
        if count == last - first + 1:
            return self.numbers - first
        expected = " or ".join(str(n) for n in sorted({len(self), last - first + 1, last + 1}))
        images = f"{len(self)} images numbered {first} to {last}"
        raise DataError(f"{path}: {count} {what} for the {images}, expected {expected}")

    def find(self, keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Row (N,) of each frame in a table with frame numbers, increasing, and whether it has one (N,).

        Of a frame that has none, the row is another's.
        """
        rows = np.minimum(np.searchsorted(keys, self.numbers), len(keys) - 1)
        return rows, keys[rows] == self.numbers


def numbered(files: Iterable[Path], pattern: str, shape: str, gaps: bool = False) -> Numbered:
    """Sort image files by the number in their names, which must be consecutive.

    Parameters
    ----------
    files : iterable of Path
        Files of one folder, at least one.
    pattern : str
        Regular expression that a whole name fits, with one group: the digits.
    shape : str
        How the files are named, in words, for errors.
    gaps : bool
        Let files be missing in between: they stand in the list too, and are missed when they are read.

    Raises
    ------
    DataError
        If a name does not fit, two files have one number, or images are missing between others.
    """
    found: dict[int, tuple[Path, int, int]] = {}
    for path in sorted(files):
        match = re.fullmatch(pattern, path.name)
        if match is None or len(match[1]) > 18:
            raise DataError(f"{path}: images must be named by frame number ({shape})")
        number = int(match[1])
        if number in found:
            raise DataError(f"{path}: frame {number} is also {found[number][0].name}; keep one of them")
        found[number] = path, *match.span(1)
    for a, b in pairwise(sorted(found)):
        if b - a > (LONGEST_GAP if gaps else 1):
            hint = "" if gaps else " (--skip-bad-frames goes on over them)"
            first, second = found[a][0], found[b][0]
            raise DataError(
                f"{first.parent}: images are missing between {first.name} and {second.name}{hint}"
            )
    path, start, end = found[min(found)]
    numbers = np.arange(min(found), max(found) + 1)
    absent = (path.name[:start], end - start, path.name[end:])
    files = [
        found[n][0] if n in found else path.with_name(f"{absent[0]}{n:0{absent[1]}d}{absent[2]}")
        for n in map(int, numbers)
    ]
    return Numbered(files, numbers)
