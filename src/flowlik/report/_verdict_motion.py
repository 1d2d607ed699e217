"""Verdicts on one image pair, and on a camera's motion."""

from __future__ import annotations

from flowlik.report._judgements import (
    FEW,
    HONEST,
    MANY,
    NEARLY,
    Cell,
    Verdict,
    counted,
    curves_of,
    few,
    graded_coverage,
    leaning,
    percent_range,
)
from flowlik.report._tables import format_value
from flowlik.report.names import data_name, model_name, name_of
from flowlik.results.records import Record


def of_pair(records: list[Record]) -> Verdict:
    """Verdict on the flow of one image pair."""
    first = {r.metric: r for r in records}
    value = {metric: float(r.value or 0.0) for metric, r in first.items()}
    r = first["half_width_e1_median_px"]
    name = name_of(str(r.flow))
    model = model_name(str(r.family), r.schedule)
    outside = value.get("outside_fraction", 0.0)
    best, worst = (f"{value[f'half_width_e{k}_median_px']:.2g}" for k in (1, 2))
    level = r.notes.get("confidence", "0.9")
    sentences = [
        f"Half of the vectors of {name} are known to ±{best} px along their best direction and to "
        f"±{worst} px along their worst ({100 * float(level):g} % intervals, {model} model).",
        f"{100 * value.get('within_half_px_fraction', 0.0):.0f} % of components are known to half a pixel.",
    ]
    rows = [("outside the calibrated range", (Cell(f"{100 * outside:.1f} %", few(outside)),))]
    limits = [f"outside: good up to {FEW:.0%}, fair up to {MANY:.0%}"]
    if "coverage_90" in value:
        cell = graded_coverage([value["coverage_90"]])
        sentences[1] = (
            f"Of the 90 % intervals, {cell.text} hold the true flow: {leaning([value['coverage_90']])}."
        )
        rows.insert(0, ("90 % intervals hold", (cell,)))
        limits.insert(0, f"intervals: good {percent_range(HONEST)}, fair {percent_range(NEARLY)}")
    return Verdict(
        title=f"How far can this flow be trusted? {name}, {r.dataset}",
        sentences=tuple(sentences),
        columns=(name,),
        rows=tuple(rows),
        limits=tuple(limits),
        coverage=curves_of(
            [r for r in records if r.metric.startswith("coverage_") and r.metric[9:].isdigit()], [model]
        )
        if "coverage_90" in value
        else {},
    )


def of_gauntlet(records: list[Record]) -> Verdict:
    """Verdict on how often motions are surely wrong, of every estimator over all situations."""
    rates = [r for r in records if r.metric == "grossly_wrong_rate"]
    situations = list(dict.fromkeys(str(r.dataset) for r in rates))
    rows = []
    for who in dict.fromkeys(str(r.estimator) for r in rates):
        values = [float(r.value or 0.0) for r in rates if r.estimator == who]
        often, mean = sum(value > FEW for value in values), sum(values) / len(values)
        rows.append((name_of(who), (Cell(f"{100 * mean:.1f} %"), Cell(f"{often} of {len(values)}"))))
    return Verdict(
        f"How often is a motion surely wrong? {counted(len(situations), 'situation')}",
        ("Grossly wrong is what lies beyond twice the radius of a motion's own 99.9 % region.",),
        ("grossly wrong, mean of all cells", f"cells above {FEW:.0%}"), tuple(rows),
    )  # fmt: skip


def of_motion(records: list[Record]) -> Verdict:
    """Verdict on motions, of one odometry or of several."""
    data = list(dict.fromkeys(str(r.dataset) for r in records if r.dataset))
    who = list(dict.fromkeys(str(r.estimator) for r in records if r.estimator))
    value = {r.metric: r for r in records if len(who) < 2}
    sentences = []
    unsolved = value.get("unsolved_fraction")
    if unsolved is not None and unsolved.value is not None:
        count = unsolved.count or 0
        lost = round(unsolved.value * count)
        sentences.append(
            f"All {count} motions were solved from the images." if not lost
            else f"{count - lost} of {count} motions were solved from the images; the others are predicted."
        )  # fmt: skip
    if "t_err_percent" in value or "drift_percent" in value:
        parts = [
            f"{label} is {format_value(value[metric].value)} {unit}"
            for metric, label, unit in (
                ("t_err_percent", "KITTI's translation error", "%"),
                ("drift_percent", "the drift at the end", "% of the path"),
                ("rpe_rot_median_deg", "the median rotation error of a frame", "deg"),
            )
            if metric in value
        ]
        text = ", ".join(parts)
        sentences.append(f"{text[0].upper()}{text[1:]}.")
    elif len(who) == 1:
        sentences.append(
            "There is no true trajectory to hold it against; covariance.csv says how uncertain it is."
        )
    rows: list[tuple[str, tuple[Cell, ...]]] = []
    limits = [f"good up to {FEW:.0%}, fair up to {MANY:.0%}"]
    for metric, label in (
        ("unsolved_fraction", "frames not solved"), ("outside_fraction", "outside the calibrated range"),
    ):  # fmt: skip
        if (r := value.get(metric)) is not None:
            rows.append((label, (Cell(f"{100 * float(r.value or 0):.1f} %", few(float(r.value or 0))),)))
    columns = [name_of(who[0])] if len(who) == 1 else []
    if len(who) > 1:
        metric = "t_err_percent" if any(r.metric == "t_err_percent" for r in records) else "drift_percent"
        columns, limits = data, []
        for name in who:
            by_data = {str(r.dataset): r for r in records if r.metric == metric and str(r.estimator) == name}
            if by_data:
                cells = (
                    Cell(f"{format_value(by_data[d].value)} %") if d in by_data else Cell() for d in data
                )
                rows.append((name_of(name), tuple(cells)))
        sentences.append(
            "The table has KITTI's translation error of each; intervals stand in the results below."
            if metric == "t_err_percent"
            else "The table has the drift at the end, as a share of the path."
        )
    place = data_name(data[0]) if len(data) == 1 else counted(len(data), "sequence")
    return Verdict(
        f"Where did the camera go? {place}", tuple(sentences), tuple(columns), tuple(rows),
        tuple(limits) if rows else (),
    )  # fmt: skip
