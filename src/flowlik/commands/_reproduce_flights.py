"""Held-out flights of `flowlik reproduce`: ego-motion with known depth by every estimator, and its errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.commands._pictures import uncertainty_picture
from flowlik.commands.options import BEST_FAMILY
from flowlik.commands.plans import METHODS, Flight, Plan
from flowlik.comparison.baselines import opencv_pnp
from flowlik.datasets.base import ImageSequence
from flowlik.datasets.tartanair import TartanAir
from flowlik.egomotion import Estimator, KnownDepth, lcmsac, mle, ransac
from flowlik.evaluation.motion import relative_pose_errors, trajectory_records, true_trajectory
from flowlik.flow.base import FlowMethod
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.trajectory import Trajectory, chain
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.measurement.features import features_of
from flowlik.measurement.measurements import measure
from flowlik.odometry.loop import measure_sequence
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder
from flowlik.simulation import simulate, write_sequence
from flowlik.support.arrays import Array
from flowlik.support.progress import Progress

BASELINE = "opencv-pnp"
REFERENCES = {"ransac": "rpe_trans_ratio_to_ransac", BASELINE: "rpe_trans_ratio_to_opencv"}
BLOCK = 10
"""Image pairs of a block, for sketches and for the bootstrap."""
SHOWN_LEVEL = 0.9


def flight_sequence(run: RunFolder, plan: Plan, flight: Flight, camera: Pinhole) -> ImageSequence:
    """Flight that renders on demand or, where the plan is cached, as it stands on disk.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    frames = flight.pairs + 1
    sequence = simulate(plan.world, flight.trajectory, frames, flight.speed_mps, flight.seed, camera)
    if not plan.cached:
        return sequence
    return TartanAir(write_sequence(sequence, run.begin() / "flights" / flight.label))


def fly(
    run: RunFolder,
    plan: Plan,
    flight: Flight,
    camera: Pinhole,
    methods: list[FlowMethod],
    models: dict[str, dict[str, FlowLikelihood]],
    progress: Progress,
) -> None:
    """Ego-motion with known depth on a held-out flight, all estimators on the same measurements.

    Raises
    ------
    DataError
        If the flight, or its folder, is no sequence with depth.
    """
    sequence: Any = flight_sequence(run, plan, flight, camera)
    if not plan.cached:
        sequence = _Kept(sequence)
    dataset = plan.dataset(flight)
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
        # the pair that begins at frame k has the seed k
        pairs = measure_sequence(sequence, method, best, seed=-1, depth=True)
        for pair in progress(pairs, f"{method.name} on {dataset}", flight.pairs):
            assert pair.depth is not None
            residual = KnownDepth.of(pair.measurements, sequence.camera, pair.depth)
            for name, motion in _motions(residual, estimators, seed=pair.k - 1).items():
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
        if flight == plan.held_out[0]:
            run.save("uncertainty", f"{method.name}-{dataset}", _uncertainty(sequence, method, best))


class _Kept:
    """A short flight of which each frame is rendered once, whoever asks for it."""

    def __init__(self, inner: ImageSequence) -> None:
        self._inner = inner
        self._frames = [(inner.image(k), inner.depth(k)) for k in range(len(inner))]

    def __len__(self) -> int:
        return len(self._inner)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def image(self, k: int) -> NDArray[np.uint8]:
        return self._frames[k][0]

    def depth(self, k: int) -> Array:
        return self._frames[k][1]


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


def _uncertainty(
    sequence: ImageSequence, method: FlowMethod, likelihood: FlowLikelihood
) -> dict[str, NDArray[Any]]:
    """Error bars of one pair in the middle of a flight."""
    k = len(sequence) // 2
    images = sequence.image(k), sequence.image(k + 1)
    m = measure(*images, method, likelihood.texture, signals=likelihood.signals)
    half_width = likelihood.bound(likelihood.coordinate(m), SHOWN_LEVEL)
    return uncertainty_picture(images[0], m, half_width, SHOWN_LEVEL)


def _flow_sequence(sequence: ImageSequence, method: FlowMethod) -> dict[str, NDArray[Any]]:
    """Three frames of the paper's Fig. 3: image, true flow, measured flow."""
    frames = np.linspace(0, len(sequence) - 2, 3).astype(int)
    images = np.stack([sequence.image(k) for k in frames])
    measured = [method.measure(sequence.image(k), sequence.image(k + 1))[1] for k in frames]
    return {
        "images": images,
        "true_flow": np.stack([sequence.flow(k) for k in frames]).astype(np.float32),
        "flow": np.stack(measured).reshape(*images.shape, 2).astype(np.float32),
    }


def add_ratios(run: RunFolder, plan: Plan) -> None:
    """Median translation errors of a frame over RANSAC's and OpenCV's, pooled over held-out flights."""
    rng = np.random.default_rng(plan.calibration[0].seed)
    for method in METHODS:
        flights = [
            np.load(run.path / "data" / f"frame-errors--{method}-{plan.dataset(f)}.npz")
            for f in plan.held_out
        ]
        names = [str(name) for name in flights[0]["names"]]
        errors = dict(zip(names, np.concatenate([flight["translation"] for flight in flights], axis=1)))
        for reference, metric in REFERENCES.items():
            for name in (name for name in names if name != reference):
                ratio = _ratio(errors[name], errors[reference], rng, reference)
                keys: dict[str, Any] = {"flow": method, "estimator": name, "seed": run.seed, **_density(name)}
                flown = f"{plan.world}-held-out"
                run.records.append(replace(ratio, metric=metric, dataset=flown, **keys))


def _ratio(errors: Array, reference: Array, rng: np.random.Generator, name: str) -> Record:
    """Ratio of median errors with its interval, of no estimator yet."""
    low, high = _ratio_interval(errors, reference, rng)
    note = protocol(
        reference=name, residual="depth", gate="none", bootstrap=f"blocks of {BLOCK} frames",
        interval_95=f"{low:.3f} … {high:.3f}",
    )  # fmt: skip
    value = float(np.median(errors) / np.median(reference))
    return Record("", value, "", count=len(errors), protocol=note)


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
