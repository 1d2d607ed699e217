"""Tidy records: every figure is one number with its unit and the protocol that made it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from flowlik.errors import DataError
from flowlik.support.files import read_json, write_json

FILE_KEYS = (
    "dataset",
    "flow",
    "family",
    "schedule",
    "estimator",
    "metric",
    "value",
    "unit",
    "count",
    "seed",
    "protocol",
)


@dataclass(frozen=True)
class Record:
    """One figure.

    Parameters
    ----------
    metric : str
        What it measures, such as ``drift_percent``.
    value : float or None
        The number. None, or a value that is not finite (kept as None), means there is none; the
        protocol says why.
    unit : str
        Unit of the number; empty for a pure one.
    dataset, flow, family, schedule, estimator : str or None
        What it was measured on and with; None where a key does not apply.
    count : int or None
        How many items it was measured over.
    seed : int or None
        Seed of the random generator.
    protocol : str
        How it was measured: ``key=value; …``, see `protocol`.
    """

    metric: str
    value: float | None
    unit: str
    dataset: str | None = None
    flow: str | None = None
    family: str | None = None
    schedule: str | None = None
    estimator: str | None = None
    count: int | None = None
    seed: int | None = None
    protocol: str = ""

    def __post_init__(self) -> None:
        # NumPy's scalars become Python's, so that what is read back equals what was written.
        value = None if self.value is None else float(self.value)
        if value is not None and not math.isfinite(value):
            value = None
            object.__setattr__(self, "protocol", "; ".join(filter(None, [self.protocol, "value=not-finite"])))
        object.__setattr__(self, "value", value)
        for key in ("count", "seed"):
            number = getattr(self, key)
            object.__setattr__(self, key, None if number is None else int(number))

    @property
    def notes(self) -> dict[str, str]:
        """Values of the protocol by their keys, as `protocol` joins them."""
        return dict(part.strip().split("=", 1) for part in self.protocol.split(";") if "=" in part)

    @property
    def reason(self) -> str:
        """Why a record has no value, as its protocol says."""
        parts = self.notes
        if parts.get("counted", "").startswith("0 of ") and "levels" in parts:
            return f"no value: too little data, no texture level has {parts['levels']}"
        why = parts.get("reason") or parts.get("value") or self.protocol
        return f"no value: {why}" if why else "no value was recorded"


def protocol(**keys: object) -> str:
    """Join keys and values as ``key=value; …``, in the order given; a key whose value is None is left out.

    Raises
    ------
    ValueError
        If a value contains ``;`` or ``=``.
    """
    parts = []
    for key, value in keys.items():
        if value is None:
            continue
        text = _text(value)
        if ";" in text or "=" in text:
            raise ValueError(f"protocol value of {key} must not contain ';' or '=': {text!r}")
        parts.append(f"{key}={text}")
    return "; ".join(parts)


def write_records(path: Path | str, records: Iterable[Record]) -> None:
    """Write records as a JSON list (``metrics.json``), whole or not at all."""
    write_json(path, [{key: row[key] for key in FILE_KEYS} for row in map(asdict, records)])


def read_records(path: Path | str) -> list[Record]:
    """Read the records of a ``metrics.json``.

    Raises
    ------
    DataError
        If the file is missing, not JSON, or holds anything but records.
    """
    rows = read_json(path)
    if not isinstance(rows, list):
        raise DataError(f"{path}: not a list of records")
    return [_record(row, f"{path}, record {number}") for number, row in enumerate(rows)]


def select(records: Iterable[Record], **keys: object) -> list[Record]:
    """Pick the records whose fields equal all the values given, in order.

    Raises
    ------
    ValueError
        If a key is not a field of a record.
    """
    unknown = set(keys) - set(FILE_KEYS)
    if unknown:
        raise ValueError(f"a record has no field {', '.join(sorted(unknown))}")
    return [record for record in records if all(getattr(record, key) == keys[key] for key in keys)]


def _record(row: Any, where: str) -> Record:
    if not isinstance(row, dict) or set(row) != set(FILE_KEYS):
        raise DataError(f"{where}: expected the keys {', '.join(FILE_KEYS)}")
    for field in fields(Record):
        if not _fits(row[field.name], str(field.type)):
            raise DataError(f"{where}: {field.name} must be {field.type}, not {row[field.name]!r}")
    return Record(**row)


def _fits(value: object, kind: str) -> bool:
    """Whether a JSON value is of the type that a field's annotation names."""
    if value is None:
        return kind.endswith("None")
    if isinstance(value, bool):
        return False
    if kind.startswith("str"):
        return isinstance(value, str)
    return isinstance(value, Integral if kind.startswith("int") else Real)


def _text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.12g}" if isinstance(value, float) else str(value)
