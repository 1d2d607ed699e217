"""Records and tables of the gauntlet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from flowlik.results.records import Record, protocol
from gauntlet_judge import GROSSLY, Verdict
from gauntlet_run import OURS, RIVALS, Cell

NEAR_DEG, NEAR_M = 1.0, 0.005

COLUMNS = (
    ("grossly_wrong_rate", "gross %", 100, ".1f"),
    ("outside_999_rate", "out %", 100, ".1f"),
    ("claimed_fraction", "claim %", 100, ".0f"),
    ("solved_fraction", "solved %", 100, ".0f"),
    ("solved_of_rivals_fraction", "of rival", 100, ".0f"),
    ("region_50", "in 50", 100, ".0f"),
    ("region_90", "in 90", 100, ".0f"),
    ("rotation_median_deg", "rot deg", 1, ".3f"),
    ("translation_median_m", "mm", 1e3, ".1f"),
    ("direction_median_deg", "dir deg", 1, ".2f"),
)
"""Metric, heading, factor and format of the printed table."""


def records_of(found: Mapping[Cell, list[Verdict]], seed: int) -> Iterator[Record]:
    """Records of every cell: scenario as dataset, flow, estimator; the residual in the protocol."""
    for (scenario, flow, residual, estimator), verdicts in found.items():
        covariance, metric = "own" if estimator in OURS else "normal-equations", residual == "depth"
        note = protocol(residual=residual, covariance=covariance)
        values = figures(verdicts, metric)
        rivals = [found.get((scenario, flow, residual, name), []) for name in RIVALS]
        if estimator in OURS and any(rivals):
            values["solved_of_rivals_fraction"] = (solved_of_best(verdicts, rivals, metric), "")
        for name, (value, unit) in values.items():
            yield Record(
                name, value, unit, scenario, flow, estimator=estimator, count=len(verdicts), seed=seed,
                protocol=note,
            )  # fmt: skip


def figures(verdicts: list[Verdict], metric: bool) -> dict[str, tuple[float, str]]:
    """Figures of a cell with their units: rates are over what claims something, errors over all."""
    radii, squared, freedoms, solved, rotation, translation = (np.array(c) for c in zip(*verdicts))
    claims, moved = freedoms > 0, ("translation_median_m", "m") if metric else ("direction_median_deg", "deg")
    values = {
        "grossly_wrong_rate": (_share(radii[claims] > GROSSLY), ""),
        "outside_999_rate": (_share(radii[claims] > 1), ""),
        "claimed_fraction": (_share(claims), ""),
        "solved_fraction": (_share(solved.astype(bool)), ""),
        "rotation_median_deg": (_median(rotation), "deg"),
        moved[0]: (_median(translation), moved[1]),
    }
    own = solved.astype(bool) & claims
    for share in (0.5, 0.9):
        inside = squared[own] <= chi2.ppf(share, freedoms[own])
        values[f"region_{100 * share:.0f}"] = (_share(inside), "")
    return values


def solved_of_best(verdicts: list[Verdict], rivals: list[list[Verdict]], metric: bool) -> float:
    """Share solved of the motions that the best rival finds within 1 degree, with depth also 5 mm."""

    def near(v: Verdict) -> bool:
        # where there is no direction the rotation alone is judged
        away = np.nan_to_num(v.translation)
        return bool(v.rotation_deg <= NEAR_DEG and away <= (NEAR_M if metric else NEAR_DEG))

    best = max(([near(v) for v in rival] for rival in rivals), key=sum)
    return _share(np.array([v.solved for v, easy in zip(verdicts, best) if easy], dtype=bool))


def table(records: list[Record]) -> str:
    """Printed table: a line a cell."""
    rows: dict[tuple[str, ...], dict[str, float | None]] = {}
    for r in records:
        key = str(r.dataset), residual_of(r), str(r.flow), str(r.estimator)
        rows.setdefault(key, {})[r.metric] = r.value
    lines = ["".join(f"{h:<16}" for h in ("scenario", "residual", "flow", "estimator"))]
    lines[0] += "".join(f"{head:>9}" for _, head, _, _ in COLUMNS)
    for key, values in rows.items():
        cells = (_text(values.get(metric), factor, form) for metric, _, factor, form in COLUMNS)
        lines.append("".join(f"{word:<16}" for word in key) + "".join(f"{cell:>9}" for cell in cells))
    return "\n".join(lines)


def residual_of(record: Record) -> str:
    """Residual that a record's protocol names."""
    return record.notes["residual"]


def _text(value: float | None, factor: float, form: str) -> str:
    return "-" if value is None else format(factor * value, form)


def _share(of: NDArray[np.bool_]) -> float:
    """Share that is true; NaN of nothing."""
    return float(np.mean(of)) if len(of) else np.nan


def _median(values: NDArray[np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan
