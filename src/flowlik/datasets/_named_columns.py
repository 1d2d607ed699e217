"""Tables whose first row names quantity and unit of each column: ``gyro_x_rad_s`` or ``gyro_x [deg/s]``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from flowlik.errors import DataError
from flowlik.geometry.times import check_times
from flowlik.support.arrays import Array
from flowlik.support.files import numbers, read_csv, read_text

STANDARD_GRAVITY_MPS2 = 9.80665

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "angular rate": {
        "rad_s": 1.0, "radps": 1.0, "rad/s": 1.0,
        "deg_s": np.pi / 180, "degps": np.pi / 180, "deg/s": np.pi / 180,
    },
    "specific force": {
        "m_s2": 1.0, "mps2": 1.0, "m/s2": 1.0, "m/s^2": 1.0, "m/s²": 1.0,
        "g": STANDARD_GRAVITY_MPS2, "mg": 1e-3 * STANDARD_GRAVITY_MPS2,
    },
    "angle": {"deg": 1.0, "rad": 180 / np.pi},
    "length": {"m": 1.0, "mm": 1e-3},
}  # fmt: skip
"""Units by kind, and how many of the kind's own make one: s, rad/s, m/s², degrees, m."""

_BRACKETS = re.compile(r"(.+?)\s*[\[(]\s*(.+?)\s*[\])]$")


def column_names(path: Path | str) -> list[str]:
    """Words of a table's first row that is not empty, without a leading ``#``.

    Raises
    ------
    DataError
        If the file is missing.
    """
    first = next((line for line in read_text(path).splitlines() if line.strip()), "")
    return [word.strip().strip('"') for word in first.lstrip("# ").split(",")]


def read_named_columns(path: Path | str, quantities: Mapping[str, str]) -> dict[str, Array]:
    """Columns of a table by quantity, in seconds, rad/s, m/s², degrees or metres.

    Parameters
    ----------
    path : Path or str
        Table with commas.
    quantities : mapping of str to str
        Kind (a key of `UNITS`) of every quantity; each must be there, and no other column.

    Raises
    ------
    DataError
        If the file is missing or empty, a quantity is missing, double or unknown, or has no unit or one of
        another kind; if a number is not finite or a row has another number of columns; or if times do not
        increase.
    """
    named = column_names(path)
    if named == [""]:
        raise DataError(f"{path}: empty, but expected a row of columns' names with their units")
    found = [_understood(word, quantities, path) for word in named]
    names = [name for name, _ in found]
    missing = [name for name in quantities if name not in names]
    if missing:
        raise DataError(
            f"{path}: no column {missing[0]} with its unit, such as {_example(missing[0], quantities)}"
        )
    if len(set(names)) < len(names):
        raise DataError(f"{path}: column {next(n for n in names if names.count(n) > 1)} stands there twice")
    rows = []
    for where, words in read_csv(path, len(named), ", ".join(named)):
        if [word.strip('"') for word in words] == named:
            continue
        if len(words) != len(named):
            raise DataError(f"{where}: {len(words)} columns, but expected {len(named)}")
        rows.append(numbers(words, where))
    if not rows:
        raise DataError(f"{path}: no row under its names")
    table = np.array(rows)
    columns = {name: table[:, k] * unit for k, (name, unit) in enumerate(found)}
    check_times(columns["time"], str(path))
    return columns


def _understood(word: str, quantities: Mapping[str, str], path: Path | str) -> tuple[str, float]:
    """Quantity and unit of a column's name."""
    plain = word.lower()
    if match := _BRACKETS.match(plain):
        name, unit = match.groups()
    else:
        name = next((q for q in quantities if plain == q or plain.startswith(f"{q}_")), plain)
        unit = plain[len(name) + 1 :]
    if name not in quantities:
        raise DataError(
            f"{path}: unknown column {word!r}; known are {', '.join(quantities)}, each with its unit"
        )
    known = UNITS[quantities[name]]
    if unit not in known:
        what = f"no unit in column {word!r}" if not unit else f"unit {unit!r} of column {word!r} is not read"
        raise DataError(f"{path}: {what}; known are {', '.join(known)}")
    return name, known[unit]


def _example(name: str, quantities: Mapping[str, str]) -> str:
    return f"{name}_{next(iter(UNITS[quantities[name]]))}"
