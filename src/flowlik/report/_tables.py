"""Result tables, made from a run's records and from nothing else."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from flowlik.report._metric_names import METRICS
from flowlik.report.names import model_name, name_of
from flowlik.results.records import Record

KEYS = ("dataset", "flow", "family", "schedule", "estimator", "seed")

GROUPS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("How far the flow can be trusted", ("half_width", "within_half")),
    (
        "How well the error model fits",
        ("nll", "ks_", "coverage_", "pit", "log_score", "outside", "components_"),
    ),
    ("Whether the model knows which errors are large", ("ause", "rank_correlation")),
    ("Bias of the flow itself", ("negative_share", "signed_")),
    ("Textures alike in both directions", ("ks_textures", "nll_gain_of_pooling")),
    (
        "Ego-motion and drift",
        ("drift", "t_err", "r_err", "rpe", "trans", "rot", "unsolved", "error", "ratio"),
    ),
    (
        "Beside IMU and GPS",
        ("flow_factor", "attitude_", "velocity_", "position_", "information_", "nis_", "gps_"),
    ),
    ("Honesty of the stated covariance", ("nees",)),
    (
        "Speed and memory",
        ("frames_per", "components_per", "pairs_per", "peak_memory", "seconds", "runtime", "smoother_"),
    ),
)
OTHER = "Other results"

_WORDS = {
    "ks": "K‑S",
    "nll": "NLL",
    "nees": "NEES",
    "rpe": "relative error",
    "trans": "translation",
    "rot": "rotation",
}


@dataclass(frozen=True)
class Cell:
    """One value of a table: its text, what to say on hovering, and the numbers of its notes."""

    text: str = ""
    hint: str = ""
    notes: tuple[int, ...] = ()


@dataclass(frozen=True)
class Column:
    """One metric of a table, with its unit and the notes that hold for the whole column."""

    label: str
    unit: str
    hint: str
    notes: tuple[int, ...] = ()


@dataclass(frozen=True)
class Row:
    """What was measured (one text a key) and the values."""

    keys: tuple[str, ...]
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class Table:
    """A table of metrics; `common` names what is equal in all rows, `notes` are its protocols."""

    title: str
    keys: tuple[str, ...]
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    common: str
    notes: tuple[str, ...]


def format_value(value: float | None) -> str:
    """Text of a value: four significant digits, thousands in groups, an en dash for none."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0 or 1e-4 <= abs(value) < 1e15:
        digits = 0 if value == 0 else max(0, 3 - math.floor(math.log10(abs(value))))
        text = f"{value:,.{digits}f}".replace(",", "\u202f")
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.3g}"


def format_unit(unit: str) -> str:
    """Write a unit as printed: percent as %, nothing for a pure number."""
    return {"percent": "%", "1": "", "fraction": "", "none": ""}.get(unit, unit)


def tables(records: Iterable[Record]) -> list[Table]:
    """Group records by topic and pivot each group.

    Parameters
    ----------
    records : iterable of Record
        All results of a run.

    Returns
    -------
    list of Table
        Rows are what was measured, columns the metrics; every record stands in exactly one cell.
    """
    grouped: dict[str, list[Record]] = {title: [] for title in [*(t for t, _ in GROUPS), OTHER]}
    for record in records:
        grouped[_group(record.metric)].append(record)
    return [_pivot(title, rows) for title, rows in grouped.items() if rows]


def _group(metric: str) -> str:
    matches = [(len(p), title) for title, prefixes in GROUPS for p in prefixes if metric.startswith(p)]
    return max(matches)[1] if matches else OTHER


def _columns(records: Sequence[Record]) -> list[tuple[str, str]]:
    return list(dict.fromkeys((r.metric, r.unit) for r in records))


def _place(records: Sequence[Record]) -> list[tuple[tuple[object, ...], dict[tuple[str, str], Record]]]:
    """Put every record in a row of its keys whose cell is free, by preference one of the same protocol."""
    rows: list[tuple[tuple[object, ...], dict[tuple[str, str], Record]]] = []
    for record in records:
        key, column = tuple(getattr(record, k) for k in KEYS), (record.metric, record.unit)
        free = [cells for k, cells in rows if k == key and column not in cells]
        alike = [cells for cells in free if any(r.protocol == record.protocol for r in cells.values())]
        if free:
            (alike or free)[0][column] = record
        else:
            rows.append((key, {column: record}))
    return rows


def _pivot(title: str, records: Sequence[Record]) -> Table:
    columns, rows = _columns(records), _place(records)
    notes = list(dict.fromkeys(r.protocol for r in records if r.protocol))
    number = {text: k + 1 for k, text in enumerate(notes)}
    equal = [k for k in range(len(KEYS)) if len({key[k] for key, _ in rows}) == 1]
    fixed = [k for k in equal if rows[0][0][k] is not None]
    shown = [k for k in range(len(KEYS)) if k not in equal]
    shared = {c: {r.protocol for _, cells in rows if (r := cells.get(c))} for c in columns}

    def marks(protocols: set[str]) -> tuple[int, ...]:
        return tuple(number[p] for p in protocols if p) if len(notes) > 1 and len(protocols) == 1 else ()

    def cell(cells: dict[tuple[str, str], Record], column: tuple[str, str]) -> Cell:
        record = cells.get(column)
        if record is None:
            return Cell()
        count = "" if record.count is None else f"over {record.count:,} items".replace(",", "\u202f")
        hint = record.reason if record.value is None else count
        return Cell(
            format_value(record.value), hint, marks({record.protocol}) if len(shared[column]) > 1 else ()
        )

    return Table(
        title=title,
        keys=tuple(KEYS[k] for k in shown),
        columns=tuple(
            Column(
                _label(metric),
                format_unit(unit),
                METRICS.get(metric, ("", ""))[1] or metric,
                marks(shared[metric, unit]),
            )
            for metric, unit in columns
        ),
        rows=tuple(
            Row(tuple(_named(k, key) for k in shown), tuple(cell(cells, c) for c in columns))
            for key, cells in rows
        ),
        common=", ".join(f"{KEYS[k]} {_named(k, rows[0][0])}" for k in fixed),
        notes=tuple(notes),
    )


def _named(k: int, key: tuple[object, ...]) -> str:
    """Reader's name of one key of a row; of the family it is the model's, which says the schedule too."""
    value = key[k]
    if value is None:
        return ""
    if KEYS[k] == "family":
        return model_name(str(value), str(key[KEYS.index("schedule")] or ""))
    return name_of(str(value))


def _label(metric: str) -> str:
    if metric in METRICS:
        return METRICS[metric][0]
    if metric.startswith("coverage_"):
        return f"Coverage of {metric.removeprefix('coverage_')} %"
    words = metric.removesuffix("_percent").removesuffix("_fraction").removesuffix("_mb").replace("_", " ")
    words = " ".join(_WORDS.get(word, word) for word in words.split())
    return words[:1].upper() + words[1:]
