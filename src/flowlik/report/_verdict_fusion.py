"""Verdict on a fused flight."""

from __future__ import annotations

from flowlik.report._judgements import (
    FEW,
    MANY,
    Cell,
    Verdict,
    few,
    percent_range,
)
from flowlik.report._tables import format_value
from flowlik.report.names import data_name
from flowlik.results.records import Record


def of_fusion(records: list[Record]) -> Verdict:
    """Verdict on a flight that was fused with an IMU and GPS."""
    value = {r.metric: float(r.value or 0.0) for r in records}
    first = next(r for r in records if r.metric == "flow_factor_fraction")
    units = (("attitude", "deg", "deg"), ("velocity", "mps", "m/s"), ("position", "m", "m"))
    known = ", ".join(
        f"{part} to {format_value(value[f'{part}_sigma_median_{unit}'])} {shown}"
        for part, unit, shown in units
    )
    sentences = [f"It says that it knows its {known} (standard deviations of all axes together, medians)."]
    if "position_rms_m" in value:
        sentences.append(
            f"It was off by {format_value(value['position_rms_m'])} m and "
            f"{format_value(value['attitude_rms_deg'])} deg (root mean square)."
        )
    if "gps_alarms" in value:
        sentences.append(
            "GPS does not agree with IMU and flow; see the warnings."
            if value["gps_alarms"]
            else "GPS agrees with IMU and flow."
        )
    lost = 1 - value["flow_factor_fraction"]
    rows = [("frames without flow", (Cell(f"{100 * lost:.1f} %", few(lost)),))]
    limits = [f"frames: good up to {FEW:.0%}, fair up to {MANY:.0%}"]
    if "ellipsoid_coverage_90" in value:
        # not graded: errors of one flight stay for long
        rows.append(("90 % regions hold", (Cell(percent_range([value["ellipsoid_coverage_90"]])),)))
    for sensor, label in (("flow", "flow"), ("gps", "GPS")):
        shares = [value.get(f"information_share_{sensor}_{part}") for part, _, _ in units]
        if None not in shares:
            text = ", ".join(f"{100 * share:.0f} %" for share in shares if share is not None)
            rows.append((f"of {label}: attitude, velocity, position", (Cell(text),)))
    return Verdict(
        f"Where is the body, and how well is it known? {data_name(str(first.dataset))}",
        tuple(sentences), ("",), tuple(rows), tuple(limits),
    )  # fmt: skip
