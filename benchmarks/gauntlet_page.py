"""What is shown of the gauntlet: the tables of a page of the documentation, and the report's heat map.

    python benchmarks/gauntlet_page.py RUN PAGE

puts the tables of a run between the marks of a page, as `gauntlet.py --docs PAGE` does at its end.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from flowlik.results import Record, read_records, select
from gauntlet_run import OURS, RIVALS
from gauntlet_scenarios import SCENARIOS
from gauntlet_table import residual_of

GOAL = 0.01
SHOWN = ("grossly_wrong_rate", "outside_999_rate", "solved_fraction")
FLOW_HEADS = {"lucas-kanade": "LK", "dis": "DIS", "farneback": "FB"}
RESIDUAL_HEADS = {"depth": "depth", "epipolar": "one camera"}
COLUMN_HEADS = [f"{flow}, {kind}" for kind in RESIDUAL_HEADS.values() for flow in FLOW_HEADS.values()]
BEGIN, END = "<!-- gauntlet: begin -->", "<!-- gauntlet: end -->"


def pooled(records: list[Record], metric: str, **keys: str) -> float | None:
    """A rate over all that is claimed in the cells of some keys, `residual` among them; None of nothing."""
    wrong = claims = 0.0
    residual = keys.pop("residual")
    chosen = [r for r in select(records, **keys) if residual_of(r) == residual]
    counts = {
        (r.dataset, r.flow): r.count * (r.value or 0.0) for r in select(chosen, metric="claimed_fraction")
    }
    for r in select(chosen, metric=metric):
        count = counts[r.dataset, r.flow]
        wrong, claims = wrong + count * (r.value or 0.0), claims + count
    return wrong / claims if claims else None


def markdown(records: list[Record]) -> str:
    """Tables of the page `when-not-to-trust`: ours cell by cell, and grossly wrong beside the rivals'."""
    names = [name for name in SCENARIOS if any(r.dataset == name for r in records)]
    estimators = [name for name in (*OURS, *RIVALS) if any(r.estimator == name for r in records)]
    values = {(r.dataset, r.flow, residual_of(r), r.estimator, r.metric): r.value for r in records}
    counts = [r.count for r in records if r.count is not None]
    said = f"{min(counts)} to {max(counts)} motions a cell, seed {records[0].seed} and on."
    missing = [scenario.shows for name, scenario in SCENARIOS.items() if name not in names]
    said += f" Not run: {'; '.join(missing)}." if missing else ""
    lines = [said, "", _row("", *COLUMN_HEADS), _row("---", *["---"] * len(COLUMN_HEADS))]
    for name in names:
        cells = [_cell(values, name, flow, kind) for kind in RESIDUAL_HEADS for flow in FLOW_HEADS]
        lines.append(_row(SCENARIOS[name].shows, *cells))
    heads = [f"{who}, {RESIDUAL_HEADS[kind]}" for kind in RESIDUAL_HEADS for who in estimators]
    lines += ["", _row("", *heads), _row("---", *["---"] * len(heads))]
    for name in names:
        rates = [
            pooled(records, "grossly_wrong_rate", dataset=name, estimator=who, residual=kind)
            for kind in RESIDUAL_HEADS for who in estimators
        ]  # fmt: skip
        lines.append(_row(SCENARIOS[name].shows, *(_percent(rate) for rate in rates)))
    aimed = [r for r in records if SCENARIOS[str(r.dataset)].goal]
    rates = [
        pooled(aimed, "grossly_wrong_rate", estimator=who, residual=kind)
        for kind in RESIDUAL_HEADS for who in estimators
    ]  # fmt: skip
    lines.append(_row("**all that have a goal**", *(_percent(rate) for rate in rates)))
    return "\n".join(lines)


def write_docs(page: Path, records: list[Record]) -> None:
    """Put the tables between the marks of a page.

    Raises
    ------
    ValueError
        If the page has no such marks.
    """
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        raise ValueError(f"{page}: no place between {BEGIN} and {END}")
    page.write_text(f"{before}{BEGIN}\n{markdown(records)}\n{END}{after}", encoding="utf-8")


def heat_map(records: list[Record]) -> dict[str, np.ndarray]:
    """Arrays of the report's heat map: rates of grossly wrong motions, scenario by flow and residual."""
    names = [name for name in SCENARIOS if any(r.dataset == name for r in records)]
    estimators = [name for name in (*OURS, *RIVALS) if any(r.estimator == name for r in records)]
    rates = np.full((len(estimators), len(names), len(COLUMN_HEADS)), np.nan)
    for r in select(records, metric="grossly_wrong_rate"):
        column = list(RESIDUAL_HEADS).index(residual_of(r)) * len(FLOW_HEADS)
        column += list(FLOW_HEADS).index(str(r.flow))
        place = estimators.index(str(r.estimator)), names.index(str(r.dataset)), column
        rates[place] = np.nan if r.value is None else r.value
    return {
        "situations": np.array(names), "columns": np.array(COLUMN_HEADS),
        "estimators": np.array(estimators), "rates": rates,
    }  # fmt: skip


def _cell(values: dict[tuple, float | None], name: str, flow: str, kind: str) -> str:
    """Grossly wrong / outside 99.9 % · solved, of the recommended estimator; bold beyond the goal."""
    of = [values.get((name, flow, kind, OURS[0], m)) for m in SHOWN]
    if (name, flow, kind, OURS[0], SHOWN[-1]) not in values:
        return ""
    gross, outside, solved = (_percent(value) for value in of)
    missed = of[0] is not None and of[0] > GOAL and SCENARIOS[name].goal
    return f"{f'**{gross}**' if missed else gross} / {outside} · {solved}"


def _percent(rate: float | None) -> str:
    if rate is None:
        return "–"
    return "100" if rate == 1 else "0" if rate == 0 else f"{100 * rate:.1f}"


def _row(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("page", type=Path)
    options = parser.parse_args()
    write_docs(options.page, read_records(options.run / "metrics.json"))


if __name__ == "__main__":
    main()
