"""`flowlik calibrate`: data sets with truth to a likelihood with its evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from flowlik.calibration import (
    ErrorSketch,
    Task,
    gather,
    merge_all,
    split_blocks,
)
from flowlik.calibration import (
    calibrate as fit_likelihood,
)
from flowlik.commands.sketching import Execution, sketch_for_run
from flowlik.datasets import open_sequence
from flowlik.evaluation import evidence
from flowlik.evaluation.goodness import outside_range
from flowlik.families import FAMILIES, error_family
from flowlik.flow import describe, flow_method, method_label
from flowlik.flow.base import FlowMethod
from flowlik.likelihood import FlowLikelihood
from flowlik.model_file import save_likelihood
from flowlik.progress import Progress, no_progress
from flowlik.records import Record, select
from flowlik.runs import RunFolder


def calibrate(
    data: Sequence[Path],
    method: str,
    out: Path,
    family: str = "lcm",
    format: str | None = None,
    seed: int = 0,
    command: str = "flowlik calibrate",
    progress: Progress = no_progress,
    execution: Execution = Execution(),  # noqa: B008
) -> RunFolder:
    """Calibrate a flow method on sequences with true flow.

    Parameters
    ----------
    data : sequence of Path
        Folders of sequences.
    method : str
        A flow method's name, as `flowlik.flow_method` takes it.
    out : Path
        Run folder; the model is ``models/<method>.json``, with the method's `method_label`.
    family : str
        Family of the saved model; all are fitted, for comparison.
    format : str, optional
        Data format; guessed by default.
    seed : int
        Seed of pixels and reservoirs.
    command : str
        Command line that repeats the run.
    progress : Progress
        Told how far it is.
    execution : Execution
        Where to measure, and whether to keep the sketches.

    Returns
    -------
    RunFolder
        With the records of the fit on the very data it was made from.
    """
    flow = flow_method(method)
    label = method_label(describe(flow))
    error_family(family)
    run = RunFolder(out, command, {"data": [str(d) for d in data], "method": method, "family": family}, seed)
    sequences = [open_sequence(folder, format) for folder in data]
    blocks = [block for sequence in sequences for block in split_blocks(sequence, seed)]
    names = ", ".join(sequence.name for sequence in sequences)
    found = sketch_for_run(
        run, blocks, [Task(flow)], f"errors of {label}", execution, progress, dataset=names, flow=label
    )
    sketches = [sketch for kind in gather(found, len(blocks)) for sketch in kind]
    fitted = fit_families(sketches, flow, {"data": names, "seed": seed})
    models = {family: fitted[family], **fitted}
    add_evidence(run, sketches, models, names, label=label, seed=seed, split="calibration")
    run.save("table", label, evidence.table(merge_all(sketches), models[family]))
    save_likelihood(with_goodness(models[family], run.records), run.path / "models" / f"{label}.json")
    run.finish()
    return run


def fit_families(
    sketches: Sequence[ErrorSketch], method: FlowMethod, provenance: dict[str, object]
) -> dict[str, FlowLikelihood]:
    """Likelihoods of every family on the same sketches, by name."""
    return {
        name: fit_likelihood(sketches, family, method, provenance=provenance)
        for name, family in FAMILIES.items()
    }


def with_goodness(likelihood: FlowLikelihood, records: Sequence[Record]) -> FlowLikelihood:
    """Likelihood whose file tells how well it fits the data it was calibrated on."""
    name = method_label(likelihood.method or {})
    own = select(records, family=likelihood.family.name, flow=name)
    return replace(likelihood, goodness={**likelihood.goodness, **{r.metric: r.value for r in own}})


def add_evidence(
    run: RunFolder,
    blocks: Sequence[ErrorSketch],
    models: Mapping[str, FlowLikelihood],
    dataset: str,
    label: str,
    seed: int | None,
    least_components: int = 100_000,
    least_frames: int = 30,
    **keys: object,
) -> None:
    """Add to a run the records and figures of models on one population of errors.

    The first model is the one drawn in detail.
    """
    merged = merge_all(blocks)
    for model in models.values():
        run.records += evidence.goodness_records(
            blocks, model, dataset, seed, least_components, least_frames, **keys
        )
    main = next(iter(models.values()))
    run.save("error-over-texture", label, evidence.error_over_texture(merged, main))
    run.save("goodness", label, evidence.goodness(merged, models, least_components, least_frames))
    run.save("coverage", label, evidence.reliability(merged, models))
    shown = evidence.distributions(merged, main)
    if len(shown["level_edges"]):
        run.save("distributions", label, shown)
    if message := evidence.outside_warning(outside_range(merged, main), dataset):
        run.warn(message)
