"""`flowlik reproduce`: the paper end to end in the virtual environment, with a report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.calibration import (
    SMOOTHING_NAT,
    ErrorSketch,
    Task,
    gather,
    index_form,
    merge_all,
    schedule_index,
    sketch_blocks,
    split_blocks,
)
from flowlik.camera import Array, Pinhole
from flowlik.commands.calibrate import BEST_FAMILY, add_evidence, fit_families, with_goodness
from flowlik.commands.plans import FAMILIES_SHOWN, METHODS, QUICK, Flight, Plan
from flowlik.datasets.base import Sequence
from flowlik.datasets.tartanair import TartanAir
from flowlik.egomotion import Estimator, KnownDepth, lcmsac, mle, ransac
from flowlik.evaluation.baselines import opencv_pnp
from flowlik.evaluation.drift import relative_pose_errors
from flowlik.evaluation.evidence import table
from flowlik.evaluation.motion_records import trajectory_records, true_trajectory
from flowlik.features import features_of, measure_features
from flowlik.flow import flow_method
from flowlik.flow.base import FlowMethod
from flowlik.likelihood import FlowLikelihood
from flowlik.model_file import save_likelihood
from flowlik.progress import Progress, no_progress
from flowlik.records import Record, protocol
from flowlik.runs import RunFolder
from flowlik.schedule import Index
from flowlik.simulation import simulate, write_sequence
from flowlik.trajectory import Trajectory, chain

BASELINE = "opencv-pnp"
BLOCK = 10


def reproduce(
    out: Path,
    plan: Plan = QUICK,
    command: str = "flowlik reproduce --quick",
    progress: Progress = no_progress,
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
    """
    run = RunFolder(out, command, asdict(plan), seed=plan.calibration[0].seed)
    methods = [flow_method(name) for name in METHODS]
    camera = Pinhole.from_fov(plan.width, plan.height, plan.fov_deg)

    sketches: dict[str, list[list[ErrorSketch]]] = {method.name: [] for method in methods}
    for flight in plan.calibration:
        seeing = [method for method in methods if method.name in flight.methods]
        tasks = [Task(m, keep=index_form(m).covariates, pixels=plan.dense_pixels) for m in seeing]
        for method, blocks in zip(seeing, _sketch(run, plan, flight, camera, tasks, progress)):
            sketches[method.name].append(blocks)
    models = {}
    for method in progress(iter(methods), "fits", len(methods)):
        models[method.name] = _calibrate(run, plan, method, sketches[method.name])

    for flight in plan.held_out:
        indices = [(Index(), models[method.name]["index"].schedule.index) for method in methods]
        tasks = [Task(m, i, pixels=plan.dense_pixels) for m, i in zip(methods, indices)]
        found = iter(_sketch(run, plan, flight, camera, tasks, progress))
        for method in methods:
            _evaluate(run, plan, flight, method, models[method.name], next(found), next(found))
        _fly(run, plan, flight, camera, methods, models, progress)
    _add_ratios(run, plan)
    run.finish()
    return run


def _dataset(plan: Plan, flight: Flight) -> str:
    return f"{plan.world}-{flight.label}"


def _sequence(run: RunFolder, plan: Plan, flight: Flight, camera: Pinhole) -> Sequence:
    """Flight that renders on demand or, where the plan is cached, as it stands on disk."""
    frames = flight.pairs + 1
    sequence = simulate(plan.world, flight.trajectory, frames, flight.speed_mps, flight.seed, camera)
    if not plan.cached:
        return sequence
    return TartanAir(write_sequence(sequence, run.begin() / "flights" / flight.label))


def _sketch(
    run: RunFolder, plan: Plan, flight: Flight, camera: Pinhole, tasks: list[Task], progress: Progress
) -> list[list[ErrorSketch]]:
    """Blocks of sketches of a flight, a list for each task and each of its indices."""
    blocks = split_blocks(_sequence(run, plan, flight, camera), flight.seed, BLOCK)
    sketched = progress(sketch_blocks(blocks, tasks), _dataset(plan, flight), len(blocks))
    return gather(sketched, len(blocks))


def _calibrate(
    run: RunFolder, plan: Plan, method: FlowMethod, flights: list[list[ErrorSketch]]
) -> dict[str, FlowLikelihood]:
    """Likelihoods of every family over texture, by family, and ``"index"``: the best over a learned index."""
    blocks = [block for flight in flights for block in flight]
    provenance: dict[str, object] = {
        "world": plan.world,
        "data": ", ".join(f.label for f in plan.calibration if method.name in f.methods),
        "sensor": "default",
    }
    models = fit_families(blocks, method, provenance, FAMILIES_SHOWN, SMOOTHING_NAT)
    dataset = f"{plan.world}-calibration"
    _add_evidence(run, blocks, models, dataset, method, plan, "calibration")
    run.save("table", method.name, table(merge_all(blocks), models["lcm"]))
    index = schedule_index("index", flights, index_form(method))
    over = [block.over(index) for block in blocks]
    best = fit_families(over, method, provenance, (BEST_FAMILY,), SMOOTHING_NAT)
    _add_evidence(run, over, best, dataset, method, plan, "calibration")
    folder = run.path / "models"
    save_likelihood(with_goodness(best[BEST_FAMILY], run.records), folder / f"{method.name}.json")
    save_likelihood(with_goodness(models["lcm"], run.records), folder / f"{method.name}-lcm.json")
    return {**models, "index": best[BEST_FAMILY]}


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
    over_texture = {name: model for name, model in models.items() if name != "index"}
    dataset = _dataset(plan, flight)
    _add_evidence(run, by_texture, over_texture, dataset, method, plan, "held-out")
    _add_evidence(run, by_index, {BEST_FAMILY: models["index"]}, dataset, method, plan, "held-out")


def _add_evidence(
    run: RunFolder,
    blocks: list[ErrorSketch],
    models: dict[str, FlowLikelihood],
    dataset: str,
    method: FlowMethod,
    plan: Plan,
    split: str,
) -> None:
    schedule = next(iter(models.values())).schedule.name
    label = f"{method.name}-{dataset}" + ("-index" if schedule == "index" else "")
    seed = plan.calibration[0].seed
    add_evidence(
        run, blocks, models, dataset, label, seed, plan.least_components, plan.least_frames, split=split
    )


def _fly(
    run: RunFolder,
    plan: Plan,
    flight: Flight,
    camera: Pinhole,
    methods: list[FlowMethod],
    models: dict[str, dict[str, FlowLikelihood]],
    progress: Progress,
) -> None:
    """Ego-motion with known depth on a held-out flight, all estimators on the same measurements."""
    sequence, dataset = _sequence(run, plan, flight, camera), _dataset(plan, flight)
    truth = true_trajectory(sequence, flight.pairs + 1)
    assert truth is not None
    for method in methods:
        lcm, best = models[method.name]["lcm"], models[method.name]["index"]
        estimators = (
            ransac(),
            lcmsac(lcm),
            mle(lcm),
            replace(lcmsac(best), name="lcmsac-index"),
            replace(mle(best), name="mle-index"),
        )
        steps: dict[str, list[RigidTransform]] = {
            name: [] for name in (*(e.name for e in estimators), BASELINE)
        }
        unsolved = dict.fromkeys(steps, 0)
        pairs = progress(_residuals(sequence, method, best), f"{method.name} on {dataset}", flight.pairs)
        for k, residual in enumerate(pairs):
            for name, motion in _motions(residual, estimators, seed=k).items():
                unsolved[name] += motion is None
                steps[name].append(RigidTransform.identity() if motion is None else motion)
        trajectories = {name: Trajectory(truth.timestamps, chain(moves)) for name, moves in steps.items()}
        for name, trajectory in trajectories.items():
            keys = {"residual": "depth", "gate": "none", "features": features_of(method), "scale": "depth"}
            note = {"dataset": dataset, "flow": method.name, "estimator": name, **_density(name)}
            errors = trajectory_records(trajectory, truth, **note, seed=flight.seed, **keys)
            # the flights are too short for the KITTI metric
            run.records += [record for record in errors if record.value is not None]
            run.records.append(
                Record(
                    "unsolved_fraction",
                    unsolved[name] / flight.pairs,
                    "",
                    **note,
                    count=flight.pairs,
                    seed=flight.seed,
                    protocol=protocol(**keys, unsolved="counted as no motion"),
                )
            )
        _save_figures(run, f"{method.name}-{dataset}", trajectories, truth)
        if method.name == "farneback":
            run.save("flow-sequence", f"{method.name}-{dataset}", _flow_sequence(sequence, method))


def _residuals(sequence: Sequence, method: FlowMethod, likelihood: FlowLikelihood) -> Iterator[KnownDepth]:
    signals = likelihood.signals
    for k in range(len(sequence) - 1):
        m = measure_features(sequence.image(k), sequence.image(k + 1), method, likelihood.texture, k, signals)
        yield KnownDepth.of(m, sequence.camera, sequence.depth(k))


def _motions(
    residual: KnownDepth, estimators: tuple[Estimator, ...], seed: int
) -> dict[str, RigidTransform | None]:
    solved = {e.name: e.estimate(residual, seed) for e in estimators}
    motions = {name: m.T_k_prev if m.solved else None for name, m in solved.items()}
    return {**motions, BASELINE: opencv_pnp(residual)}


def _save_figures(run: RunFolder, label: str, trajectories: dict[str, Trajectory], truth: Trajectory) -> None:
    names = np.array(list(trajectories))
    errors = [relative_pose_errors(t, truth) for t in trajectories.values()]
    positions = np.array([truth.poses[0].apply(t.positions) for t in trajectories.values()])
    run.save(
        "trajectories", label,
        {"names": names, "positions": positions, "timestamps": truth.timestamps, "truth": truth.positions,
         "unit": np.array("m")},
    )  # fmt: skip
    run.save(
        "frame-errors", label,
        {"names": names, "translation": np.array([e.translation_m for e in errors]),
         "rotation": np.array([e.rotation_deg for e in errors]), "timestamps": truth.timestamps[1:]},
    )  # fmt: skip


def _flow_sequence(sequence: Sequence, method: FlowMethod) -> dict[str, NDArray[Any]]:
    """Three frames of the paper's Fig. 3: image, true flow, measured flow."""
    frames = np.linspace(0, len(sequence) - 2, 3).astype(int)
    images = np.stack([sequence.image(k) for k in frames])
    measured = [method.measure(sequence.image(k), sequence.image(k + 1))[1] for k in frames]
    return {
        "images": images,
        "true_flow": np.stack([sequence.flow(k) for k in frames]).astype(np.float32),
        "flow": np.stack(measured).reshape(*images.shape, 2).astype(np.float32),
    }


def _add_ratios(run: RunFolder, plan: Plan) -> None:
    """Median per-frame translation error of every estimator over RANSAC's, pooled over held-out flights."""
    rng = np.random.default_rng(plan.calibration[0].seed)
    for method in METHODS:
        flights = [
            np.load(run.path / "data" / f"frame-errors--{method}-{_dataset(plan, f)}.npz")
            for f in plan.held_out
        ]
        names = list(flights[0]["names"])
        errors = np.concatenate([flight["translation"] for flight in flights], axis=1)
        reference = errors[names.index("ransac")]
        for name, row in zip(names, errors):
            if name == "ransac":
                continue
            low, high = _ratio_interval(row, reference, rng)
            note = protocol(
                reference="ransac", residual="depth", gate="none", bootstrap=f"blocks of {BLOCK} frames",
                interval_95=f"{low:.3f} … {high:.3f}",
            )  # fmt: skip
            value = float(np.median(row) / np.median(reference))
            run.records.append(
                Record(
                    "rpe_trans_ratio_to_ransac",
                    value,
                    "",
                    dataset=f"{plan.world}-held-out",
                    flow=method,
                    estimator=str(name),
                    **_density(str(name)),
                    count=len(row),
                    seed=run.seed,
                    protocol=note,
                )
            )


def _density(estimator: str) -> dict[str, str]:
    """Family and schedule behind an estimator's name."""
    if estimator in ("lcmsac", "mle"):
        return {"family": "lcm", "schedule": "texture"}
    if estimator in ("lcmsac-index", "mle-index"):
        return {"family": BEST_FAMILY, "schedule": "index"}
    return {"family": "gaussian", "schedule": "constant"}


def _ratio_interval(errors: Array, reference: Array, rng: np.random.Generator) -> tuple[float, float]:
    blocks = np.arange(len(errors) // BLOCK * BLOCK).reshape(-1, BLOCK)
    draws = blocks[rng.integers(len(blocks), size=(1000, len(blocks)))].reshape(1000, -1)
    low, high = np.percentile(
        np.median(errors[draws], axis=1) / np.median(reference[draws], axis=1), [2.5, 97.5]
    )
    return float(low), float(high)
