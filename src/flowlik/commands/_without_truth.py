"""`flowlik calibrate --without-truth`: a sequence's own images to a likelihood of its flow's errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.commands._reading import read_data
from flowlik.commands.options import TruthlessOptions
from flowlik.datasets.base import ImageSequence
from flowlik.egomotion import lcmsac, ransac
from flowlik.errors import DataError, MissingFieldError, ModelError
from flowlik.evaluation.motion.split_half import direction_noise_mrad, rotation_noise_mdeg
from flowlik.flow import coded, describe, flow_method, method_label
from flowlik.flow.base import FlowMethod
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.families import error_family
from flowlik.likelihood.likelihood import Errors, FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood, save_likelihood
from flowlik.likelihood.shipped import shipped
from flowlik.report import finish
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder
from flowlik.self_supervision import (
    LEVELS,
    Calibrated,
    MotionErrors,
    Pass,
    Reading,
    SeenPair,
    by_fifths,
    learn_without_truth,
    predicted_and_found,
    seen_pairs,
    self_calibrated,
    spread_firsts,
    truthless_signals,
)
from flowlik.support.progress import Progress, no_progress
from flowlik.support.threads import map_ahead


def calibrate_without_truth(
    data: Sequence[Path],
    method: str,
    out: Path,
    options: TruthlessOptions = TruthlessOptions(),
    *,
    command: str = "flowlik calibrate",
    progress: Progress = no_progress,
) -> RunFolder:
    """Calibrate a flow method on sequences of one camera without true flow: by their own motions.

    Parameters
    ----------
    data : sequence of Path
        Folders of sequences.
    method : str
        A flow method's name, as `flowlik.flow_method` takes it.
    out : Path
        Run folder; the model is ``models/<method>-<residual>.json``, with the method's `method_label`.
    options : TruthlessOptions
        How; the run records them.
    command : str
        Command line that repeats the run.
    progress : Progress
        Told how far it is.

    Returns
    -------
    RunFolder
        With what the start and the model say of blocks of pairs that were held out.

    Raises
    ------
    CalibrationError
        If there is too little data, or all of it is alike.
    ModelError
        If flow method, family or start are unknown, or the start is for another method.
    DataError
        If a sequence cannot be read, or the options do not fit together or the data.
    """
    flow = coded(flow_method(method), options.flow_png)
    error_family(options.family)
    label = method_label(describe(flow))
    start = _start(options.model, flow, label)
    config = {"data": [str(folder) for folder in data], "method": method, **options.asdict()}
    run = RunFolder(out, command, config, options.seed)
    sequences = [read_data(folder, options, run, flow) for folder in data]
    residual = _residual(sequences, options.residual)
    if start is not None and residual == "depth":
        start.check_components()
    if options.self_calibrate and (residual == "depth" or len(sequences) > 1):
        raise DataError("--self-calibrate refines the camera of one sequence, where depth is unknown")
    pairs = _measured(sequences, flow, residual, start, options, progress)
    camera, note = "nominal", ""
    if options.self_calibrate:
        estimator = ransac() if start is None else lcmsac(start)
        pairs, found = self_calibrated(pairs, flow, estimator, options.seed)
        names = zip(found.settings.names, found.values, found.sigma)
        camera, note = "self-calibrated", ", ".join(f"{n} {v:+.4g} ± {s:.2g}" for n, v, s in names)
    provenance: dict[str, Any] = {
        "data": ", ".join(sequence.name for sequence in sequences), "seed": options.seed, **options.images,
        "camera": f"{camera} ({note})" if note else camera,
    }  # fmt: skip
    done = learn_without_truth(
        pairs, flow, start, family=options.family, seed=options.seed, provenance=provenance,
        map=lambda work, items: progress(map_ahead(work, items), "motions of both halves, pairs", len(items)),
    )  # fmt: skip
    for message in done.warnings:
        run.warn(message)
    keys = {"residual": residual, "camera": camera, **options.images}
    _add_evidence(run, done, provenance["data"], label, options.seed, keys)
    save_likelihood(done.likelihood, run.begin() / "models" / f"{label}-{residual}.json")
    finish(run)
    return run


def _start(model: Path | None, flow: FlowMethod, label: str) -> FlowLikelihood | None:
    """Model to begin with: the one given, the one that ships for the method, or none."""
    if model is None and label not in shipped():
        return None
    found = load_likelihood(label if model is None else model)
    if found.method != describe(flow):
        if model is None:
            return None
        raise ModelError(f"{model}: is for the flow {found.method}, not {describe(flow)}")
    name = label if model is None else model.stem
    return replace(found, provenance={**found.provenance, "name": name})


def _residual(sequences: Sequence[ImageSequence], asked: str | None) -> Errors:
    """Residual that is asked for, or known depth if all data have it."""
    if asked not in (None, "depth", "epipolar"):
        raise DataError(f"unknown residual {asked!r}: known are depth, epipolar")
    if asked is not None:
        return cast(Errors, asked)
    try:
        for sequence in sequences:
            sequence.depth(0)
    except MissingFieldError:
        return "epipolar"
    return "depth"


def _measured(
    sequences: Sequence[ImageSequence],
    flow: FlowMethod,
    residual: Errors,
    start: FlowLikelihood | None,
    options: TruthlessOptions,
    progress: Progress,
) -> list[SeenPair]:
    texture = TextureDefinition() if start is None else start.texture
    signals = truthless_signals(flow, residual, start)
    most = max(1, options.pairs // len(sequences))
    pairs: list[SeenPair] = []
    for sequence in sequences:
        firsts = spread_firsts(sequence, most)
        seen = seen_pairs(sequence, firsts, flow, texture, signals, residual == "depth", options.seed)
        pairs += progress(seen, f"flow of {sequence.name}, pairs", len(firsts))
    return pairs


def _add_evidence(
    run: RunFolder, done: Calibrated, dataset: str, label: str, seed: int, keys: dict[str, Any]
) -> None:
    """Records and figure of the start and of the model, on the pairs held out, each by its own motions."""
    models = {"after": (done.likelihood, done.last)}
    if done.start is not None:
        models = {"before": (done.start, done.first), **models}
    errors = {name: found.of(done.held_out) for name, (_, found) in models.items()}
    for name, (likelihood, found) in models.items():
        base = Record(
            "", None, "", dataset, label, likelihood.family.name, likelihood.schedule.name, seed=seed
        )
        told = {"model": name, "split": "held-out blocks of pairs", "halves": "64 px chessboard", **keys}
        for fit, own in (("out of fit", False), ("in fit", True)):
            reading = Reading.of(likelihood, found.of(done.held_out, own))
            note = protocol(**told, motions=fit)
            run.records += [
                replace(base, metric=metric, value=value, unit="nat" if metric == "nll" else "",
                        count=reading.components, protocol=note)
                for metric, value in reading.values().items()
            ]  # fmt: skip
        run.records += _noise(base, found, done.held_out, told)
    amount = Record(
        "independent_pairs", done.independent_pairs, "", dataset, label, count=len(done.last.solved),
        seed=seed, protocol=protocol(**keys),
    )  # fmt: skip
    run.records += [amount, _solved(done.last, dataset, label, seed, keys)]
    run.save("without-truth", label, _figure(models, errors))


def _noise(base: Record, found: Pass, held_out: list[int], told: dict[str, Any]) -> list[Record]:
    """Noise of the halves' motions on the pairs held out."""
    halves = [found.motions[k] for k in found.solved if k in set(held_out)]
    first, second = (RigidTransform.concatenate([pair[i].T_k_prev for pair in halves]) for i in (0, 1))
    note, count = protocol(**told), len(halves)
    return [
        replace(base, metric=metric, value=noise(first, second), unit=unit, estimator="lcmsac", count=count,
                protocol=note)
        for metric, noise, unit in (
            ("split_half_direction_mrad", direction_noise_mrad, "mrad"),
            ("split_half_rotation_mdeg", rotation_noise_mdeg, "0.001 deg"),
        )
    ]  # fmt: skip


def _solved(found: Pass, dataset: str, label: str, seed: int, keys: dict[str, Any]) -> Record:
    asked = len(found.motions)
    note = protocol(**keys, **{name.replace(" ", "_"): count for name, count in found.statuses.items()})
    share = 1 - len(found.solved) / asked
    return Record("unsolved_fraction", share, "", dataset, label, count=asked, seed=seed, protocol=note)


def _figure(
    models: dict[str, tuple[FlowLikelihood, Pass]], errors: dict[str, list[MotionErrors]]
) -> dict[str, Any]:
    sizes = [predicted_and_found(likelihood, errors[name]) for name, (likelihood, _) in models.items()]
    return {
        "names": np.array(list(models)),
        "predicted": np.stack([predicted for predicted, _ in sizes]),
        "found": np.stack([found for _, found in sizes]),
        "levels": np.array(LEVELS),
        "by_size": np.stack([by_fifths(model, errors[name]) for name, (model, _) in models.items()]),
        "by_texture": np.stack(
            [by_fifths(model, errors[name], "texture") for name, (model, _) in models.items()]
        ),
    }
