"""What a run answers, in two sentences and one small table, from its records and from nothing else."""

from __future__ import annotations

from collections.abc import Sequence

from flowlik.report._judgements import (
    FITS,
    FITS_ROUGHLY,
    HONEST,
    NEARLY,
    Cell,
    Verdict,
    counted,
    curves_of,
    grade,
    graded_coverage,
    interval_of,
    leaning,
    percent_range,
)
from flowlik.report._tables import format_value
from flowlik.report._verdict_fusion import of_fusion
from flowlik.report._verdict_motion import of_gauntlet, of_motion, of_pair
from flowlik.report.names import LEARNED, PAPERS, data_name, model_name, name_of
from flowlik.results.records import Record

REFERENCES = {"rpe_trans_ratio_to_ransac": "RANSAC", "rpe_trans_ratio_to_opencv": "OpenCV"}
COMPARED = (LEARNED, PAPERS, "Gaussian")

GLOSSARY = {
    "interval": "how far a model says that an error reaches; a 90 % interval should hold 90 % of errors",
    "coverage": "the share that it does hold: less is too bold, more is too cautious",
    "misfit": "K-S, the largest gap between the modelled and the measured distribution; 0 is perfect",
    "in sample": "tried on the very data that the model was calibrated on; unseen: on other data",
    "learned, paper's": "two models of the error: over several signs in the images, or over texture alone",
}


def verdict_of(records: Sequence[Record], command: str = "") -> Verdict:
    """Verdict on a run, of what its records tell: models, the flow of a pair, or a motion."""
    known = [r for r in records if r.value is not None]
    metrics = {r.metric for r in known}
    if "grossly_wrong_rate" in metrics:
        return of_gauntlet(known)
    if "flow_factor_fraction" in metrics:
        return of_fusion(known)
    if "half_width_e1_median_px" in metrics:
        return of_pair(known)
    models = [
        r
        for r in known
        if r.metric.startswith("coverage_") and r.family and not r.estimator and not _beside(r)
    ]
    if models:
        return _of_models(known, models)
    if metrics & {"unsolved_fraction", "t_err_percent", "drift_percent"}:
        return of_motion(known)
    return Verdict(f"Results of {' '.join(command.split()[:2])}" if command else "Results")


def _split(record: Record) -> str:
    return record.notes.get("split", "")


def _beside(record: Record) -> bool:
    """Whether a record is of the model before a calibration without truth, or of errors in fit."""
    return record.notes.get("model") == "before" or record.notes.get("motions") == "in fit"


def _of_models(records: list[Record], models: list[Record]) -> Verdict:
    unseen = [r for r in models if _split(r) != "in sample"]
    shown = unseen or models
    flows = list(dict.fromkeys(str(r.flow) for r in shown))
    data = list(dict.fromkeys(str(r.dataset) for r in shown))
    found: dict[str, dict[str, list[float]]] = {}
    for r in shown:
        if r.metric == "coverage_90":
            name = model_name(str(r.family), r.schedule)
            found.setdefault(name, {}).setdefault(str(r.flow), []).append(float(r.value or 0.0))
    main = LEARNED if LEARNED in found else next(iter(found))
    compared = [name for name in dict.fromkeys([main, *COMPARED]) if name in found]
    rows = [
        (
            f"90 % intervals hold, {name}",
            tuple(graded_coverage(found[name][flow]) if flow in found[name] else Cell() for flow in flows),
        )
        for name in compared
    ]
    limits = [f"intervals: good {percent_range(HONEST)}, fair {percent_range(NEARLY)}"]
    misfits = [r for r in records if r.metric == "ks_median" and str(r.dataset) in data]
    for name in compared:
        if of_model := [r for r in misfits if _is_of(r, name)]:
            rows.append((f"misfit (K-S), {name}", tuple(_misfit(of_model, flow) for flow in flows)))
    if misfits:
        limits.append(f"misfit: good up to {FITS:g}, fair up to {FITS_ROUGHLY:g}")
    ratios = [r for r in records if r.metric in REFERENCES and _estimator_of(r, main)]
    for metric, reference in REFERENCES.items():
        chosen = {str(r.flow): r for r in ratios if r.metric == metric}
        if chosen:
            cells = tuple(_ratio(chosen[flow]) if flow in chosen else Cell() for flow in flows)
            rows.append((f"motion error over {reference}'s", cells))
    if ratios:
        limits.append("motion error: good clearly below 1, fair not clear, poor clearly above")
    everything = [value for of_flow in found[main].values() for value in of_flow]
    noun = "unseen flight" if any(_split(r) == "held-out" for r in shown) else "data set"
    where = counted(len(data), noun) if unseen else "the calibration data itself (in sample)"
    others = [
        f"{_own(name)} {percent_range([v for of_flow in found[name].values() for v in of_flow])}"
        for name in compared
        if name != main
    ]
    beside = f" ({', '.join(others)})" if others else ""
    sentences = [
        f"On {where}, the 90 % intervals of the {main} model held {percent_range(everything)} of errors: "
        f"{leaning(everything)}{beside}."
    ]
    if ratios:
        sentences.append(_motion_sentence(ratios, flows, main))
    if not unseen:
        sentences.append("How it does on other data, `flowlik evaluate` tells.")
    asked = counted(len(flows), "flow") if len(flows) > 1 else name_of(flows[0])
    place = counted(len(data), noun) if len(data) > 1 else data_name(data[0])
    return Verdict(
        title=f"Can these error bars be trusted? {asked}, {place}",
        sentences=tuple(sentences),
        columns=tuple(name_of(flow) for flow in flows),
        rows=tuple(rows),
        limits=tuple(limits),
        coverage=curves_of(shown, compared),
        in_sample=not unseen,
    )


def _own(model: str) -> str:
    return (
        f"the {model}" if model == PAPERS else f"the {model} one's" if model == LEARNED else f"the {model}'s"
    )


def _is_of(record: Record, model: str) -> bool:
    return bool(record.family) and model_name(str(record.family), record.schedule) == model


def _estimator_of(record: Record, model: str) -> bool:
    """Whether a ratio is of LCMSAC, which is what is recommended, with this model."""
    return str(record.estimator).startswith("lcmsac") and _is_of(record, model)


def _misfit(records: list[Record], flow: str) -> Cell:
    values = [float(r.value or 0.0) for r in records if str(r.flow) == flow]
    if not values:
        return Cell()
    low, high = (f"{value:.2f}" for value in (min(values), max(values)))
    worst = max(values)
    return Cell(low if low == high else f"{low} to {high}", grade(worst <= FITS, worst <= FITS_ROUGHLY))


def _ratio(record: Record) -> Cell:
    interval = interval_of(record)
    if interval is None:
        return Cell(format_value(record.value))
    low, high = interval
    return Cell(f"{record.value:.2f} ({low:.2f} … {high:.2f})", grade(high < 1, low <= 1))


def _motion_sentence(ratios: list[Record], flows: list[str], model: str) -> str:
    said = []
    for metric, reference in REFERENCES.items():
        of_flow = {str(r.flow): r for r in ratios if r.metric == metric}
        parts = []
        for flow in flows:
            if flow in of_flow:
                cell = _ratio(of_flow[flow])
                unclear = ", not clear" if cell.grade == "fair" else ""
                value = cell.text.partition(" (")[0]
                interval = cell.text.partition(" (")[2].rstrip(")")
                parts.append(f"{value} ({name_of(flow)}, {interval}{unclear})")
        if parts:
            said.append(f"{' and '.join(parts)} of {reference}'s")
    return f"With it, a frame's motion error was {', and '.join(said)}."
