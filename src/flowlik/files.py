"""Files: written whole or not at all, read with one clear line when they are not what they should be."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError


@contextmanager
def atomic_write(path: Path | str, mode: str = "w") -> Iterator[IO[Any]]:
    r"""Open a file for writing that appears under its name only once it is complete.

    The contents go to a hidden file beside it, renamed at the end. If the block raises (or the run is
    interrupted) that file is removed, and one that stood there before is left as it was. Missing
    folders are made.

    Parameters
    ----------
    path : Path or str
        File to write.
    mode : {"w", "wb"}
        Text (UTF-8, ``\n``) or binary.

    Yields
    ------
    file
        The open file.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    if mode not in ("w", "wb"):
        raise ValueError(f"mode must be 'w' or 'wb', not {mode!r}")
    path = Path(path)
    partial = path.with_name(f".{path.name}.{uuid4().hex}.part")
    text = mode == "w"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file: IO[Any] = partial.open(mode, encoding="utf-8" if text else None, newline="\n" if text else None)
    except OSError as error:
        raise DataError(f"{path}: cannot be written ({error.strerror})") from error
    try:
        with file:
            yield file
        partial.replace(path)
    except BaseException:
        with suppress(OSError):
            partial.unlink()
        raise


def write_json(path: Path | str, value: Any) -> None:
    """Write a value as indented JSON, whole or not at all.

    Raises
    ------
    ValueError
        If the value holds NaN or infinity, which JSON does not have.
    """
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
    with atomic_write(path) as file:
        file.write(text + "\n")


def read_json(path: Path | str) -> Any:
    """Read a JSON file strictly: NaN and Infinity are refused.

    Raises
    ------
    DataError
        If the file is missing, unreadable, or not JSON.
    """

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is not JSON")

    text = read_text(path)
    try:
        return json.loads(text, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: not valid JSON ({error})") from error


def read_text(path: Path | str) -> str:
    """Read a UTF-8 text file.

    Raises
    ------
    DataError
        If the file is missing, unreadable, or not text.
    """
    path = Path(path)
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: not a text file") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error


def read_table(path: Path | str, columns: int, layout: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read rows of finite numbers separated by white space; empty lines and ``#`` comments are skipped.

    Parameters
    ----------
    path : Path or str
        Text file.
    columns : int
        Numbers in each row.
    layout : str
        What a row holds, in words, for the error message.

    Returns
    -------
    rows : array (N, columns)
        The numbers, N ≥ 1.
    lines : int array (N,)
        Line in the file of each row, from 1.

    Raises
    ------
    DataError
        Naming file and line if a row has another number of columns, a word, NaN or infinity; or if
        there is no row at all.
    """
    rows, lines = [], []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if len(words) != columns:
            raise DataError(f"{path}, line {number}: {len(words)} columns, but expected {layout}")
        rows.append(numbers(words, f"{path}, line {number}"))
        lines.append(number)
    if not rows:
        raise DataError(f"{path}: empty, but expected rows of {layout}")
    return np.array(rows), np.array(lines)


def numbers(words: list[str], where: str) -> list[float]:
    """Words as finite numbers; a DataError that begins with ``where`` names the first one that is not."""
    values = []
    for word in words:
        try:
            value = float(word)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise DataError(f"{where}: {word!r} is not a finite number")
        values.append(value)
    return values
