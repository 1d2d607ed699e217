"""Files: written whole or not at all, read with one clear line when they are not what they should be."""

from __future__ import annotations

import errno
import io
import json
import math
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any
from uuid import uuid4

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flowlik.errors import DataError

FULL = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EROFS, errno.EIO)
"""What a file system says when it takes no more."""

MAX_TEXT_BYTES = 2**29
MAX_NPZ_BYTES = 2**31
"""Unpacked size of an npz file; one that claims more is taken for damage before memory is asked for."""


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
        If the place cannot be written to, or is full.
    ValueError
        If the mode is another.
    """
    if mode not in ("w", "wb"):
        raise ValueError(f"mode must be 'w' or 'wb', not {mode!r}")
    path = Path(path)
    partial = path.with_name(f".{path.name}.{uuid4().hex}.part")
    text = mode == "w"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # the name of a folder need not be text: its odd bytes are written as escapes, which JSON reads back
        file: IO[Any] = (
            partial.open(mode, encoding="utf-8", errors="backslashreplace", newline="\n")
            if text
            else partial.open(mode)
        )
    except OSError as error:
        raise DataError(f"{path}: cannot be written ({error.strerror})") from error
    try:
        with file:
            yield file
        partial.replace(path)
    except BaseException as error:
        with suppress(OSError):
            partial.unlink()
        if isinstance(error, OSError) and error.errno in FULL:
            raise DataError(f"{path}: cannot be written ({error.strerror})") from error
        raise


def write_npz(path: Path | str, arrays: Mapping[str, ArrayLike]) -> None:
    """Write arrays to a compressed npz file, whole or not at all.

    It is made in memory first: numpy's own writer, closed by a full disk, prints a traceback as it is freed.

    Raises
    ------
    DataError
        If the place cannot be written to, or is full.
    """
    contents: Any = {name: np.asarray(value) for name, value in arrays.items()}
    made = io.BytesIO()
    np.savez_compressed(made, **contents)
    with atomic_write(path, "wb") as file:
        file.write(made.getbuffer())


def write_json(path: Path | str, value: Any) -> None:
    """Write a value as indented JSON, whole or not at all.

    Raises
    ------
    ValueError
        If the value holds NaN or infinity, which JSON does not have.
    DataError
        If the place cannot be written to.
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
    text = read_text(path)
    try:
        return json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: not valid JSON ({error})") from error


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not JSON")


def read_text(path: Path | str) -> str:
    """Read a UTF-8 text file.

    Raises
    ------
    DataError
        If the file is missing, unreadable, or not text.
    """
    path = Path(path)
    try:
        if path.stat().st_size > MAX_TEXT_BYTES:
            raise DataError(f"{path}: a text file of more than {MAX_TEXT_BYTES >> 20} MiB is not read")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: not a text file") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error


def printable(name: str) -> str:
    """Return the name of a file as text: what in it is not UTF-8 becomes an escape, as in JSON."""
    return name.encode("utf-8", "backslashreplace").decode("utf-8")


def read_npz(path: Path | str) -> dict[str, NDArray[Any]]:
    """Read all arrays of an npz file, without pickled objects and only as much as the file holds.

    Raises
    ------
    DataError
        If the file is missing, damaged, holds objects, or claims more than `MAX_NPZ_BYTES`.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > MAX_NPZ_BYTES:
                raise DataError(f"{path}: claims more than {MAX_NPZ_BYTES >> 20} MiB, damaged?")
            return {m.filename.removesuffix(".npy"): _read_member(archive, m) for m in members}
    except DataError:
        raise
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from error
    except Exception as error:  # zip, zlib and NumPy's parser of headers raise a dozen kinds
        raise DataError(f"{path}: not a readable npz file ({type(error).__name__})") from error


def mapped_npy(path: Path | str) -> Any:
    """Content of a npy file, mapped: a header that promises more than the file holds asks for no memory.

    Raises
    ------
    DataError
        If it cannot be read as one.
    """
    try:
        return np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # NumPy's parser of headers raises a dozen kinds
        raise DataError(f"{path}: not a readable .npy file (truncated or of another kind)") from error


def _read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    """One array, after its header has been held against the size of the member."""
    with archive.open(member) as file:
        version = np.lib.format.read_magic(file)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else _header_2_0
        shape, _, dtype = header(file)
    if dtype.hasobject or dtype.itemsize * math.prod(shape) > member.file_size:
        raise ValueError("a header that does not fit its array")
    with archive.open(member) as file:
        return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


def _header_2_0(file: Any) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    return np.lib.format.read_array_header_2_0(file)


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


def read_csv(path: Path | str, columns: int, layout: str) -> Iterator[tuple[str, list[str]]]:
    """Rows of words with commas between: where each stands, for messages, and its words, but ``#`` lines.

    Raises
    ------
    DataError
        If the file is missing, has no rows, or a row has fewer columns.
    """
    empty = True
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        words = [word.strip() for word in line.split(",")]
        if len(words) < columns:
            raise DataError(f"{path}, line {number}: {len(words)} columns, but expected {layout}")
        empty = False
        yield f"{path}, line {number}", words
    if empty:
        raise DataError(f"{path}: empty, but expected rows of {layout}")


def numbers(words: list[str], where: str) -> list[float]:
    """Words as finite numbers; ``where`` begins the message of an error.

    Raises
    ------
    DataError
        If one is not; names the first.
    """
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
