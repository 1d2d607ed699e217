"""`flowlik evaluate`: whether a model tells the truth on other data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flowlik.calibration import Task, gather, merge_all, split_blocks
from flowlik.commands._evidence import add_evidence
from flowlik.commands._reading import read_data
from flowlik.commands._sketching import sketch_for_run
from flowlik.commands.options import EvaluateOptions
from flowlik.errors import DataError
from flowlik.evaluation.likelihood import Counting, kept_for_eigenbasis, little_data_warning
from flowlik.flow import coded, confirmed_method, method_label
from flowlik.likelihood.model_file import load_likelihood
from flowlik.report import finish
from flowlik.results.runs import RunFolder
from flowlik.support.progress import Progress, no_progress

COUNTING = Counting(10_000, 1)


def evaluate(
    model: Path,
    data: Sequence[Path],
    out: Path,
    options: EvaluateOptions = EvaluateOptions(),
    *,
    command: str = "flowlik evaluate",
    progress: Progress = no_progress,
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
    options : EvaluateOptions
        How; the run records them.
    command : str
        Command line that repeats the run.
    progress : Progress
        Told how far it is.

    Raises
    ------
    DataError
        If a sequence cannot be read, lacks its truth, or has no errors to evaluate.
    ModelError
        If there is no such model, or it is for another method than the one given.
    """
    likelihood = load_likelihood(model)
    flow = coded(confirmed_method(likelihood.method or {}, options.method), options.flow_png)
    likelihood.check_components()
    index = likelihood.schedule.index
    config = {"model": str(model), "data": [str(folder) for folder in data], **options.asdict()}
    run = RunFolder(out, command, config, options.seed)
    for number, folder in enumerate(data):
        sequence = read_data(folder, options, run, flow)
        blocks = split_blocks(sequence, options.seed)
        task = Task(flow, (index,), kept_for_eigenbasis(index), likelihood.texture)
        found = sketch_for_run(
            run, blocks, [task], f"errors on {sequence.name}, blocks of pairs", options, progress,
            f"sketches-{number}", dataset=sequence.name, flow=method_label(likelihood.method or {}),
        )  # fmt: skip
        sketches = [s for kind in gather(found, len(blocks)) for s in kind]
        if not any(s.total for s in sketches):
            raise DataError(f"{sequence.name}: no errors to evaluate (one image, no texture or no truth?)")
        label = f"{method_label(likelihood.method or {})}-{sequence.name.replace('/', '-')}"
        keys = {"split": "evaluation", **options.images}
        add_evidence(run, [sketches], [likelihood], sequence.name, label, options.seed, COUNTING, **keys)
        if message := little_data_warning(merge_all(sketches), sequence.name):
            run.warn(message)
    finish(run)
    return run
