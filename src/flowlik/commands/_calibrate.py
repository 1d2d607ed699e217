"""`flowlik calibrate`: data sets with truth to a likelihood with its evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from flowlik.calibration import (
    BOOTSTRAP_BLOCKS,
    FLOW_INDEX,
    ErrorSketch,
    Task,
    bootstrap,
    check_schedule,
    executor,
    fit_likelihood,
    gather,
    index_form,
    measured_pairs,
    merge_all,
    schedule_index,
    split_blocks,
    spread_pairs,
    with_shared_errors,
)
from flowlik.calibration.shared_errors import Pairs
from flowlik.commands._reading import read_data
from flowlik.commands._sketching import sketch_for_run
from flowlik.commands.options import CalibrateOptions
from flowlik.datasets.base import ImageSequence
from flowlik.evaluation.likelihood import (
    Counting,
    bias_records,
    blocks_over,
    figures,
    little_data_warning,
    model_records,
    outside_range,
    outside_warning,
    table_arrays,
)
from flowlik.flow import coded, describe, flow_method, method_label
from flowlik.flow.base import FlowMethod
from flowlik.likelihood.families import FAMILIES, error_family
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import save_likelihood
from flowlik.likelihood.schedule import Index
from flowlik.report import finish
from flowlik.results.records import Record, select
from flowlik.results.runs import RunFolder
from flowlik.support.progress import Progress, no_progress

BAND_REPLICATES = 12
SHARED_PAIRS = 60


def calibrate(
    data: Sequence[Path],
    method: str,
    out: Path,
    options: CalibrateOptions = CalibrateOptions(),
    *,
    command: str = "flowlik calibrate",
    progress: Progress = no_progress,
) -> RunFolder:
    """Calibrate a flow method on sequences with true flow.

    Parameters
    ----------
    data : sequence of Path
        Folders of sequences; each counts alike when an index is learned.
    method : str
        A flow method's name, as `flowlik.flow_method` takes it.
    out : Path
        Run folder; the model is ``models/<method>.json``, with the method's `method_label`.
    options : CalibrateOptions
        How; the run records them.
    command : str
        Command line that repeats the run.
    progress : Progress
        Told how far it is.

    Returns
    -------
    RunFolder
        With the records of the fits on the very data they were made from.

    Raises
    ------
    CalibrationError
        If family or schedule are unknown, or there is too little data.
    ModelError
        If the flow method is unknown.
    DataError
        If a sequence cannot be read or lacks its truth, or the options do not fit together.
    """
    flow = coded(flow_method(method), options.flow_png)
    family, schedule, seed = options.family, options.schedule, options.seed
    label = method_label(describe(flow))
    error_family(family)
    check_schedule(schedule)
    config = {"data": [str(folder) for folder in data], "method": method, **options.asdict()}
    run = RunFolder(out, command, config, seed)
    sequences = [read_data(folder, options, run, flow) for folder in data]
    names = ", ".join(sequence.name for sequence in sequences)
    provenance: dict[str, object] = {"data": names, "seed": seed, **options.images}
    keys = {"split": "in sample", **options.images}
    populations = _populations(run, sequences, flow, options, progress)
    by_texture, by_flow = ([block for p in populations if p for block in p[kind]] for kind in (0, 1))
    # each fit takes seconds to a minute: whoever waits is told of it
    models = fit_families(by_texture, flow, provenance, progress=progress)
    if message := little_data_warning(merge_all(by_texture), names):
        run.warn(message)
    if schedule == "texture":
        chosen, blocks = models[family], by_texture
        others = [model for name, model in models.items() if name != family]
    else:
        index = schedule_index(schedule, [p[0] for p in populations if p], index_form(flow))
        blocks = by_flow if schedule == "flow" else [block.over(index) for block in by_texture]
        constant = schedule == "constant"
        chosen = fit_likelihood(blocks, error_family(family), flow, provenance=provenance, constant=constant)
        others = list(models.values())
    add_evidence(run, [by_texture, blocks], [chosen, *others], names, label, seed, **keys)
    bands = None
    if schedule != "constant":
        rng, smoothing = np.random.default_rng(seed), chosen.goodness["fit"]["smoothing"]
        bands = bootstrap(blocks, chosen.family, chosen.schedule, rng, BAND_REPLICATES, smoothing)
    run.save("table", label, table_arrays(merge_all(blocks), chosen, bands))
    chosen = with_shared_errors(chosen, _spread(sequences, flow, chosen, options, progress))
    save_likelihood(with_goodness(chosen, run.records), run.path / "models" / f"{label}.json")
    finish(run)
    return run


def _populations(
    run: RunFolder,
    sequences: Sequence[ImageSequence],
    flow: FlowMethod,
    options: CalibrateOptions,
    progress: Progress,
) -> list[list[list[ErrorSketch]]]:
    """Of every sequence its blocks over texture, and over flow."""
    # signals cost more flow, and flow on disk may have none
    keep = index_form(flow).covariates if options.schedule == "index" else ()
    task, label = Task(flow, (Index(), FLOW_INDEX), keep), method_label(describe(flow))
    most = max(2, BOOTSTRAP_BLOCKS // len(sequences))
    populations = []
    for number, sequence in enumerate(sequences):
        blocks = split_blocks(sequence, options.seed)
        found = sketch_for_run(
            run, blocks, [task], f"{label} on {sequence.name}, blocks of pairs", options, progress,
            f"sketches-{number}", dataset=sequence.name, flow=label,
        )  # fmt: skip
        populations.append(gather(found, len(blocks), most))
    return populations


def _spread(
    sequences: Sequence[ImageSequence],
    flow: FlowMethod,
    chosen: FlowLikelihood,
    options: CalibrateOptions,
    progress: Progress,
) -> Pairs:
    """Errors of pairs from all over the sequences, for what errors share."""
    count = max(2, SHARED_PAIRS // len(sequences))
    spread = [block for sequence in sequences for block in spread_pairs(sequence, count, options.seed)]
    with executor(options.executor, options.workers, options.scheduler) as block_map:
        return measured_pairs(
            spread, flow, chosen.texture, chosen.signals,
            lambda work, *items: progress(block_map(work, *items), "what errors share", len(spread)),
        )  # fmt: skip


def fit_families(
    sketches: Sequence[ErrorSketch],
    method: FlowMethod,
    provenance: dict[str, object],
    names: Sequence[str] = tuple(FAMILIES),
    smoothing: float | None = None,
    progress: Progress = no_progress,
) -> dict[str, FlowLikelihood]:
    """Likelihoods of families on the same sketches, by name.

    Raises
    ------
    ModelError
        If a family is unknown.
    CalibrationError
        If there is too little data, or a fit fails.
    """
    return {
        name: fit_likelihood(sketches, error_family(name), method, provenance=provenance, smoothing=smoothing)
        for name in progress(names, "families fitted", len(names))
    }


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
