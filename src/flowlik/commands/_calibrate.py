"""`flowlik calibrate`: data sets with truth to a likelihood with its evidence."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flowlik.calibration import (
    BOOTSTRAP_BLOCKS,
    FLOW_INDEX,
    Block,
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
from flowlik.commands._evidence import add_evidence, with_goodness
from flowlik.commands._reading import read_data
from flowlik.commands._sketching import sketch_for_run
from flowlik.commands.options import CalibrateOptions
from flowlik.commands.standard_flights import DENSE_PIXELS, Flown, check_options, standard_flights
from flowlik.evaluation.likelihood import little_data_warning, table_arrays
from flowlik.flow import coded, describe, flow_method, method_label
from flowlik.flow.base import FlowMethod
from flowlik.likelihood.families import FAMILIES, error_family
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import save_likelihood
from flowlik.likelihood.schedule import Index
from flowlik.report import finish
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
        Folders of sequences; each counts alike when an index is learned. None with `options.standard`.
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
    check_options(data, options)
    flow = coded(flow_method(method), options.flow_png)
    error_family(options.family)
    check_schedule(options.schedule)
    config = {"data": [str(folder) for folder in data], "method": method, **options.asdict()}
    run = RunFolder(out, command, config, options.seed)
    if not options.standard:
        sequences = [read_data(folder, options, run, flow) for folder in data]
        flown = [Flown(sequence, split_blocks(sequence, options.seed)) for sequence in sequences]
        names = ", ".join(sequence.name for sequence in sequences)
        _calibrate_on(run, flown, names, flow, options, progress)
        finish(run)
        return run
    flights = standard_flights(options.cache, options.share, options.kitti_poses, run.warn, progress)
    names = ", ".join(flight.sequence.name for flight in flights["calibration"])
    chosen, others = _calibrate_on(run, flights["calibration"], names, flow, options, progress)
    for split in ("validation", "held out"):
        found = [p[0] for p in _populations(run, flights[split], flow, options, progress, split)]
        blocks = [block for part in found for block in part if block.total]
        kinds = [blocks, [block.over(chosen.schedule.index) for block in blocks]]
        name = f"{method_label(describe(flow))}-{split.replace(' ', '-')}"
        dataset = f"standard flights, {split}"
        add_evidence(run, kinds, [chosen, *others], dataset, name, options.seed, split=split)
    finish(run)
    return run


def _calibrate_on(
    run: RunFolder,
    flown: Sequence[Flown],
    names: str,
    flow: FlowMethod,
    options: CalibrateOptions,
    progress: Progress,
) -> tuple[FlowLikelihood, list[FlowLikelihood]]:
    """Calibrate, add the evidence in sample, and save the model; returns it and the paper's beside it."""
    family, schedule, seed = options.family, options.schedule, options.seed
    label = method_label(describe(flow))
    provenance: dict[str, object] = {"data": names, "seed": seed, **options.images}
    keys = {"split": "in sample", **options.images}
    populations = _populations(run, flown, flow, options, progress)
    by_texture, by_flow = ([block for p in populations if p for block in p[kind]] for kind in (0, 1))
    # each fit takes seconds to a minute: whoever waits is told of it
    models = fit_families(by_texture, flow, provenance, progress=progress)
    shown = "standard flights" if options.standard else names
    if message := little_data_warning(merge_all(by_texture), shown):
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
    add_evidence(run, [by_texture, blocks], [chosen, *others], shown, label, seed, **keys)
    bands = None
    if schedule != "constant":
        rng, smoothing = np.random.default_rng(seed), chosen.goodness["fit"]["smoothing"]
        bands = bootstrap(blocks, chosen.family, chosen.schedule, rng, BAND_REPLICATES, smoothing)
    run.save("table", label, table_arrays(merge_all(blocks), chosen, bands))
    chosen = with_shared_errors(chosen, _spread(flown, flow, chosen, options, progress))
    save_likelihood(with_goodness(chosen, run.records), run.path / "models" / f"{label}.json")
    papers = [models["lcm"]] if "lcm" in models and (schedule, family) != ("texture", "lcm") else []
    return chosen, papers


def _populations(
    run: RunFolder,
    flown: Sequence[Flown],
    flow: FlowMethod,
    options: CalibrateOptions,
    progress: Progress,
    split: str = "",
) -> list[list[list[ErrorSketch]]]:
    """Of every sequence its blocks over texture, and over flow."""
    # signals cost more flow, and flow on disk may have none
    keep = index_form(flow).covariates if options.schedule == "index" else ()
    pixels = DENSE_PIXELS if options.standard else None
    task, label = Task(flow, (Index(), FLOW_INDEX), keep, pixels=pixels), method_label(describe(flow))
    most = max(2, BOOTSTRAP_BLOCKS // len(flown))
    populations = []
    for number, (sequence, blocks) in enumerate(flown):
        found = sketch_for_run(
            run, blocks, [task], f"{label} on {sequence.name}, blocks of pairs", options, progress,
            f"sketches-{split.replace(' ', '-')}{number}", dataset=sequence.name, flow=label,
        )  # fmt: skip
        populations.append(gather(found, len(blocks), most))
    return populations


def _spread(
    flown: Sequence[Flown],
    flow: FlowMethod,
    chosen: FlowLikelihood,
    options: CalibrateOptions,
    progress: Progress,
) -> Pairs:
    """Errors of pairs from all over the sequences, for what errors share; of standard flights all pairs."""
    count = max(2, SHARED_PAIRS // len(flown))
    spread: list[Block] = []
    for sequence, blocks in flown:
        spread += blocks if options.standard else spread_pairs(sequence, count, options.seed)
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
