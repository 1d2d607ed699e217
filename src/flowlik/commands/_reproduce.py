"""`flowlik reproduce`: the paper end to end in the virtual environment, with a report."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from flowlik.calibration import (
    BOOTSTRAP_BLOCKS,
    SMOOTHING_NAT,
    ErrorSketch,
    Task,
    gather,
    index_form,
    measured_pairs,
    merge_all,
    schedule_index,
    sketch_blocks,
    split_blocks,
    spread_pairs,
    with_shared_errors,
)
from flowlik.calibration.shared_errors import Pairs
from flowlik.commands._calibrate import fit_families
from flowlik.commands._evidence import add_evidence, with_goodness
from flowlik.commands._reproduce_flights import BLOCK, add_ratios, flight_sequence, fly
from flowlik.commands.options import BEST_FAMILY
from flowlik.commands.plans import FAMILIES_SHOWN, METHODS, PAPER, QUICK, Flight, Plan
from flowlik.datasets.base import ImageSequence
from flowlik.evaluation.likelihood import table_arrays
from flowlik.flow import PRESETS
from flowlik.flow.base import FlowMethod
from flowlik.geometry.camera import Pinhole
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import save_likelihood
from flowlik.likelihood.schedule import Index
from flowlik.report import finish
from flowlik.results.runs import RunFolder
from flowlik.support.progress import Progress, no_progress

SHARED_PAIRS = 3
"""Of every calibration flight, for what errors share."""


def reproduce(
    out: Path,
    plan: Plan = QUICK,
    command: str = "flowlik reproduce --quick",
    progress: Progress = no_progress,
    map: Callable[..., Iterable[Any]] = map,
) -> RunFolder:
    """Simulate, calibrate Farnebäck and Lucas-Kanade, evaluate on other flights, and fly on those.

    Calibration and held-out flights share neither world nor trajectory nor, in one of them, speed.

    Parameters
    ----------
    out : Path
        Run folder: report, figures, metrics, and the models in ``models/``.
    plan : Plan
        What to simulate.
    command : str
        Command line that repeats the run.
    progress : Progress
        Told how far it is.
    map : callable
        Where flights are sketched, tables fitted and figures drawn: the built-in one, or that of
        `flowlik.calibration.executor`. The results are the same.

    Raises
    ------
    DataError
        If the folder holds something else, or cannot be written to.
    CalibrationError
        If a worker of the map dies.
    """
    run = RunFolder(out, command, asdict(plan), seed=plan.calibration[0].seed)
    methods = [PRESETS[PAPER.get(name, name)] for name in METHODS]
    camera = Pinhole.from_fov(plan.width, plan.height, plan.fov_deg)

    models = _calibrated(run, plan, methods, camera, progress, map)
    for flight in plan.held_out:
        indices = [(Index(), models[method.name]["index"].schedule.index) for method in methods]
        tasks = [Task(m, i, pixels=plan.dense_pixels) for m, i in zip(methods, indices)]
        sequence = flight_sequence(run, plan, flight, camera)
        most = BOOTSTRAP_BLOCKS // len(tasks)
        found = _sketch(sequence, plan, flight, tasks, progress, most, map)
        for method in methods:
            _evaluate(run, plan, flight, method, models[method.name], found.pop(0), found.pop(0))
        fly(run, plan, flight, camera, methods, models, progress)
    add_ratios(run, plan)
    finish(run, map)
    return run


def _calibrated(
    run: RunFolder,
    plan: Plan,
    methods: list[FlowMethod],
    camera: Pinhole,
    progress: Progress,
    map: Callable[..., Iterable[Any]],
) -> dict[str, dict[str, FlowLikelihood]]:
    """Models of every method by name; the sketches behind them are gone with this call."""
    sketches: dict[str, list[list[ErrorSketch]]] = {method.name: [] for method in methods}
    pairs: dict[str, Pairs] = {method.name: [] for method in methods}
    most = max(2, BOOTSTRAP_BLOCKS // len(plan.calibration))
    for flight in plan.calibration:
        seeing = [method for method in methods if method.name in flight.methods]
        tasks = [Task(m, keep=index_form(m).covariates, pixels=plan.dense_pixels) for m in seeing]
        sequence = flight_sequence(run, plan, flight, camera)
        spread = spread_pairs(sequence, SHARED_PAIRS, flight.seed)
        for task, blocks in zip(tasks, _sketch(sequence, plan, flight, tasks, progress, most, map)):
            sketches[task.method.name].append(blocks)
            pairs[task.method.name] += measured_pairs(spread, task.method, task.texture, task.signals, map)
    names = [method.name for method in methods]
    kept = [sketches.pop(name) for name in names]
    fitted = map(_fit, [plan] * len(names), methods, kept, [pairs.pop(name) for name in names])
    models = {}
    for found, method, flights in zip(progress(fitted, "fits", len(names)), methods, kept):
        models[method.name] = _keep(run, plan, method, flights, found)
    return models


def _sketch(
    sequence: ImageSequence,
    plan: Plan,
    flight: Flight,
    tasks: list[Task],
    progress: Progress,
    most: int,
    map: Callable[..., Iterable[Any]],
) -> list[list[ErrorSketch]]:
    """At most so many blocks of sketches of a flight, a list for each task and each of its indices."""
    blocks = split_blocks(sequence, flight.seed, BLOCK)
    sketched = progress(sketch_blocks(blocks, tasks, map), plan.dataset(flight), len(blocks))
    return gather(sketched, len(blocks), most)


def _fit(
    plan: Plan, method: FlowMethod, flights: list[list[ErrorSketch]], pairs: Pairs
) -> dict[str, FlowLikelihood]:
    """Likelihoods of every family over texture, by family, and ``"index"``: the best over a learned index.

    What flies, the index and ``"lcm"``, knows what errors share.
    """
    blocks = [block for flight in flights for block in flight]
    provenance: dict[str, object] = {
        "world": plan.world,
        "data": ", ".join(f.label for f in plan.calibration if method.name in f.methods),
        "sensor": "default",
    }
    models = fit_families(blocks, method, provenance, FAMILIES_SHOWN, SMOOTHING_NAT)
    index = schedule_index("index", flights, index_form(method))
    over = [block.over(index) for block in blocks]
    best = fit_families(over, method, provenance, (BEST_FAMILY,), SMOOTHING_NAT)
    shared = {"index": best[BEST_FAMILY], "lcm": models["lcm"]}
    return {**models, **{name: with_shared_errors(model, pairs) for name, model in shared.items()}}


def _keep(
    run: RunFolder,
    plan: Plan,
    method: FlowMethod,
    flights: list[list[ErrorSketch]],
    models: dict[str, FlowLikelihood],
) -> dict[str, FlowLikelihood]:
    """Evidence in sample of a method's likelihoods, and the files of those that fly."""
    blocks = [block for flight in flights for block in flight]
    over = [block.over(models["index"].schedule.index) for block in blocks]
    run.save("table", method.name, table_arrays(merge_all(blocks), models["lcm"]))
    dataset = f"{plan.world}-calibration"
    _add_evidence(run, [blocks, over], list(models.values()), dataset, method, plan, "in sample")
    for name, file in (("index", method.name), ("lcm", f"{method.name}-lcm")):
        save_likelihood(with_goodness(models[name], run.records), run.path / "models" / f"{file}.json")
    return models


def _evaluate(
    run: RunFolder,
    plan: Plan,
    flight: Flight,
    method: FlowMethod,
    models: dict[str, FlowLikelihood],
    by_texture: list[ErrorSketch],
    by_index: list[ErrorSketch],
) -> None:
    """Evidence on a held-out flight of the families over texture, and of the best over the index."""
    shown = list(models.values())
    _add_evidence(run, [by_texture, by_index], shown, plan.dataset(flight), method, plan, "held-out")


def _add_evidence(
    run: RunFolder,
    kinds: list[list[ErrorSketch]],
    models: list[FlowLikelihood],
    dataset: str,
    method: FlowMethod,
    plan: Plan,
    split: str,
) -> None:
    label, seed = f"{method.name}-{dataset}", plan.calibration[0].seed
    add_evidence(run, kinds, models, dataset, label, seed, plan.counting, split=split)
