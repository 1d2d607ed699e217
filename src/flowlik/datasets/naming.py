"""Order of image files by their names: numbers as numbers, fractions as fractions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError

_DECIMAL = re.compile(r"(?<![0-9.])([0-9]+)\.([0-9]+)(?![0-9.])")


def in_order(files: Iterable[Path]) -> list[Path]:
    """Image files of one folder in the order of their names.

    Numbers count as numbers (``2.png`` before ``10.png``), and a name before the same name with more
    (``a.jpg`` before ``a (1).jpg``). Of two numbers with a point between them the second is a fraction
    (``12.05.png`` before ``12.1.png``), unless the names were written by counting: then some second number
    ends in 0 and none begins with it (``1.9.png`` before ``1.10.png``).

    Raises
    ------
    DataError
        If two names differ in nothing that orders them, such as ``1.png`` and ``01.jpg``.
    """
    files = list(files)
    second = [match[2] for path in files for match in _DECIMAL.finditer(path.stem) if len(match[2]) > 1]
    counted = any(s[-1] == "0" for s in second) and not any(s[0] == "0" for s in second)
    keyed = sorted((_key(path.stem, not counted), path.name, path) for path in files)
    for (a, first, _), (b, _, path) in pairwise(keyed):
        if a == b:
            raise DataError(f"{path}: in the order of names this is also {first}; keep one of them")
    return [path for _, _, path in keyed]


def counted(files: Sequence[Path]) -> NDArray[np.int64] | None:
    """Numbers (N,) by which files in order were counted in even steps, where some may be missing.

    None if their names hold no such numbers: others, such as times, or one of more digits than 18.
    """
    found = [re.findall(r"[0-9]{1,18}", path.stem) for path in files]
    if not found or len({len(row) for row in found}) != 1:
        return None
    for column in zip(*found, strict=True):
        numbers = np.array([int(n) for n in column])
        steps = np.diff(numbers)
        if not steps.any():
            continue
        least = steps.min()
        even = least > 0 and not (steps % least).any()
        return numbers if even and (least == 1 or 2 * np.sum(steps != least) <= len(steps)) else None
    return None


def places(files: Sequence[Path]) -> NDArray[np.int64]:
    """Place (N,) of each of some files in order, from 0: where numbers are missing, places are left free."""
    numbers = counted(files)
    if numbers is None:
        return np.arange(len(files))
    return np.asarray((numbers - numbers[0]) // np.diff(numbers).min())


def last_number(path: Path) -> int | None:
    """Last whole number of up to 18 digits in a file's name, or None."""
    found = re.findall(r"[0-9]+", path.stem)
    return int(found[-1]) if found and len(found[-1]) <= 18 else None


def _key(stem: str, fractions: bool) -> list[tuple[Fraction, str]]:
    """Text and numbers in turn, each comparable with its like."""
    pattern = r"((?<![0-9.])[0-9]+\.[0-9]+(?![0-9.])|[0-9]+)" if fractions else r"([0-9]+)"
    parts = re.split(pattern, stem)
    return [(Fraction(part) if i % 2 else Fraction(0), "" if i % 2 else part) for i, part in enumerate(parts)]
