"""Evidence of models on one population of errors: records and figures of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flowlik.calibration import ErrorSketch, merge_all
from flowlik.evaluation.likelihood import (
    Counting,
    bias_records,
    blocks_over,
    figures,
    model_records,
    outside_range,
    outside_warning,
)
from flowlik.flow import method_label
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.results.records import Record, select
from flowlik.results.runs import RunFolder


def with_goodness(likelihood: FlowLikelihood, records: Sequence[Record]) -> FlowLikelihood:
    """Likelihood whose file tells how well it fits the data it was calibrated on."""
    name = method_label(likelihood.method or {})
    schedule = likelihood.schedule.name
    own = select(records, family=likelihood.family.name, flow=name, schedule=schedule)
    return replace(likelihood, goodness={**likelihood.goodness, **{r.metric: r.value for r in own}})


def add_evidence(
    run: RunFolder,
    kinds: Sequence[Sequence[ErrorSketch]],
    models: Sequence[FlowLikelihood],
    dataset: str,
    label: str,
    seed: int | None,
    counting: Counting = Counting(),
    **keys: object,
) -> None:
    """Add to a run the records and figures of models on one population of errors.

    The population's blocks are given over each index that a model has. The first model is the one drawn in
    detail.

    Raises
    ------
    CalibrationError
        If there are no blocks over a model's index.
    """
    main = models[0]
    merged = merge_all(blocks_over(kinds, main))
    for model in models:
        run.records += model_records(blocks_over(kinds, model), model, dataset, seed, counting, **keys)
    drawn = figures(kinds, {f"{m.family.name} · {m.schedule.name}": m for m in models}, counting)
    flow = method_label(main.method) if main.method else None
    if select(run.records, metric="negative_share", dataset=dataset, flow=flow):
        del drawn["bias"]  # it is the flow's, whatever the schedule
    else:
        run.records += bias_records(merged, dataset, flow, seed, **keys)
    for kind, arrays in drawn.items():
        run.save(kind, label, arrays)
    if message := outside_warning(outside_range(merged, main), dataset):
        run.warn(message)
