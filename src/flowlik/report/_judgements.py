"""Judgements of a run's figures by stated limits, and what they are made into."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from flowlik.report.names import model_name
from flowlik.results.records import Record

HONEST, NEARLY = (0.85, 0.95), (0.80, 0.98)
"""Shares that a 90 % interval may hold to be called good, and fair."""
FITS, FITS_ROUGHLY = 0.05, 0.15
"""Misfits (median K-S) up to which a model is called good, and fair."""
FEW, MANY = 0.01, 0.10
"""Shares of frames or components left unexplained up to which a run is called good, and fair."""
ABOUT_RIGHT = 0.03


@dataclass(frozen=True)
class Cell:
    """One judgement: its text, and ``good``, ``fair``, ``poor`` or nothing."""

    text: str = "–"
    grade: str = ""


@dataclass(frozen=True)
class Verdict:
    """What stands first in a report.

    Attributes
    ----------
    title : str
        The question.
    sentences : tuple of str
        The answer, a sentence each.
    columns : tuple of str
        Heads of the table's columns after the first.
    rows : tuple of (str, tuple of Cell)
        What was judged, and a judgement a column.
    limits : tuple of str
        What the grades mean, for each kind of judgement in the table.
    coverage : dict of str to list of (float, float)
        Promised and observed shares of intervals, of each population, by the name of a model.
    in_sample : bool
        Whether all was tried on the data of the calibration itself.
    """

    title: str
    sentences: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, tuple[Cell, ...]], ...] = ()
    limits: tuple[str, ...] = ()
    coverage: dict[str, list[list[tuple[float, float]]]] = field(default_factory=dict)
    in_sample: bool = False


def graded_coverage(values: Sequence[float]) -> Cell:
    """Judgement of what 90 % intervals hold, by the value that is farthest from 90 %."""
    within = [all(low <= value <= high for value in values) for low, high in (HONEST, NEARLY)]
    return Cell(percent_range(values), grade(*within))


def percent_range(values: Sequence[float]) -> str:
    """``79 to 87 %`` of shares, or one number where they round to the same."""
    low, high = (f"{100 * value:.0f}" for value in (min(values), max(values)))
    return f"{low} %" if low == high else f"{low} to {high} %"


def leaning(values: Sequence[float], promised: float = 0.9) -> str:
    """Whether intervals are too bold, too cautious, or about right."""
    low, high = min(values) - promised, max(values) - promised
    bold, cautious = low < -ABOUT_RIGHT, high > ABOUT_RIGHT
    if bold and cautious:
        return "too bold here, too cautious there"
    if bold:
        return "too bold" if high < -ABOUT_RIGHT else "about right to too bold"
    return "too cautious" if cautious and low > ABOUT_RIGHT else (
        "about right to too cautious" if cautious else "about right"
    )  # fmt: skip


def interval_of(record: Record) -> tuple[float, float] | None:
    """The 95 % interval that a record's protocol gives, if any."""
    low, dots, high = record.notes.get("interval_95", "").partition(" … ")
    return (float(low), float(high)) if dots else None


def grade(good: bool, fair: bool) -> str:
    """Judgement of two tests."""
    return "good" if good else "fair" if fair else "poor"


def counted(number: int, noun: str) -> str:
    """Number with its noun."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def curves_of(records: list[Record], names: list[str]) -> dict[str, list[list[tuple[float, float]]]]:
    """Promised and observed shares of each population, by model."""
    curves: dict[str, dict[tuple[object, object], list[tuple[float, float]]]] = {}
    for r in records:
        name, level = model_name(str(r.family), r.schedule), r.metric.removeprefix("coverage_")
        if name in names and level.isdigit():
            by_population = curves.setdefault(name, {})
            by_population.setdefault((r.flow, r.dataset), []).append((int(level) / 100, float(r.value or 0)))
    return {name: [sorted(curve) for curve in curves[name].values()] for name in names}


def few(share: float) -> str:
    """Judgement of a share that should be small."""
    return grade(share <= FEW, share <= MANY)
