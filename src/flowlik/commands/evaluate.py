"""`flowlik evaluate`: whether a model tells the truth on other data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flowlik.calibration import Task, gather, split_blocks
from flowlik.commands.calibrate import add_evidence
from flowlik.commands.sketching import Execution, sketch_for_run
from flowlik.datasets import open_sequence
from flowlik.errors import DataError
from flowlik.evaluation.likelihood.eigenbasis import kept_for_eigenbasis
from flowlik.flow import confirmed_method, method_label
from flowlik.likelihood.model_file import load_likelihood
from flowlik.report import finish
from flowlik.results.runs import RunFolder
from flowlik.support.progress import Progress, no_progress


def evaluate(
    model: Path,
    data: Sequence[Path],
    out: Path,
    format: str | None = None,
    method: str | None = None,
    seed: int = 0,
    command: str = "flowlik evaluate",
    progress: Progress = no_progress,
    execution: Execution = Execution(),  # noqa: B008
    camera: str | None = None,
) -> RunFolder:
    """Evaluate a model on sequences with true flow: all that `add_evidence` tells.

    Parameters
    ----------
    model : Path
        Model file.
    data : sequence of Path
        Folders of sequences the model was not calibrated on.
    out : Path
        Run folder.
    format : str, optional
        Data format; guessed by default.
    method : str, optional
        May only confirm the model's flow method; must, where that is an object or flow on disk.
    seed : int
        Seed of pixels and of the bootstrap.
    command : str
        Command line that repeats the run.
    progress : Progress
        Told how far it is.
    execution : Execution
        Where to measure, and whether to keep the sketches.
    camera : str, optional
        As `flowlik.open_sequence` takes it, for data without a camera of its own.

    Raises
    ------
    DataError
        If a sequence cannot be read, lacks its truth, or has no errors to evaluate.
    """
    likelihood = load_likelihood(model)
    flow = confirmed_method(likelihood.method or {}, method)
    index = likelihood.schedule.index
    config = {"model": str(model), "data": [str(d) for d in data], "camera": camera}
    run = RunFolder(out, command, config, seed)
    for number, folder in enumerate(data):
        sequence = open_sequence(folder, format, camera)
        blocks = split_blocks(sequence, seed)
        task = Task(flow, (index,), kept_for_eigenbasis(index), likelihood.texture)
        found = sketch_for_run(
            run, blocks, [task], f"errors on {sequence.name}, blocks of pairs", execution, progress,
            f"sketches-{number}", dataset=sequence.name, flow=method_label(likelihood.method or {}),
        )  # fmt: skip
        sketches = [s for kind in gather(found, len(blocks)) for s in kind]
        if not any(s.total for s in sketches):
            raise DataError(f"{sequence.name}: no errors to evaluate (one image, no texture or no truth?)")
        label = f"{method_label(likelihood.method or {})}-{sequence.name.replace('/', '-')}"
        models = {likelihood.family.name: likelihood}
        add_evidence(run, sketches, models, sequence.name, label, seed, 10_000, 1, split="evaluation")
    finish(run)
    return run
