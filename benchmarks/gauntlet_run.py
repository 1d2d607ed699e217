"""One clip of the gauntlet: measured once for each flow, its motions found by everyone, judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.comparison.baselines import Pnp, opencv_essential
from flowlik.egomotion import Epipolar, Estimator, KnownDepth, Residual, lcmsac, ransac
from flowlik.flow import flow_method
from flowlik.flow.base import DenseFlow, FlowMethod
from flowlik.image.sampling import sample_inverse_depth
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood
from flowlik.measurement.measurements import Measurements, measure, stratified_pixels
from flowlik.odometry.odometry import Odometry
from flowlik.support.arrays import Array
from flowlik.support.files import atomic_write
from gauntlet_clips import Clip
from gauntlet_judge import Verdict, of_motion, of_rival
from gauntlet_scenarios import SCENARIOS

FLOWS = ("lucas-kanade", "dis", "farneback")
OURS = ("lcmsac", "ransac")
RIVALS = ("opencv", "poselib")
RADIUS_PX = 0.5
"""Inliers' radius of RANSAC and rivals."""

DENSE_PIXELS = 1000

ARRAYS = ("pixels", "flow", "R_i_e", "t")
SIGNAL = "signal-"


class Task(NamedTuple):
    """One clip, and who is judged on it."""

    scenario: str
    seed: int
    pairs: int
    flows: tuple[str, ...]
    estimators: tuple[str, ...]
    cache: Path


Cell = tuple[str, str, str, str]
"""Scenario, flow, residual, estimator."""


def run(task: Task) -> dict[Cell, list[Verdict]]:
    """Verdicts of the judged motions of a clip."""
    scenario = SCENARIOS[task.scenario]
    clip = scenario.make(task.seed, task.pairs, task.cache)
    found: dict[Cell, list[Verdict]] = {}
    for flow in task.flows:
        likelihood = load_likelihood(flow)
        measured = measurements(clip, likelihood, task.seed, task.cache)
        depths = depths_at(clip, measured) if "depth" in scenario.residuals else None
        for residual in scenario.residuals:
            told = depths if residual == "depth" else None
            for name in task.estimators:
                verdicts = judged(clip, likelihood, measured, told, name, task.seed)
                found[task.scenario, flow, residual, name] = verdicts
    return found


def measurements(clip: Clip, likelihood: FlowLikelihood, seed: int, cache: Path) -> list[Measurements]:
    """Measurements into every frame after the first, from the cache where they are kept there."""
    assert likelihood.method is not None
    method = flow_method(likelihood.method)
    path = cache / "measured" / f"{clip.pictures}-{len(clip)}-{method.name}.npz"
    if not path.is_file():
        found = [measured_pair(clip, k, method, likelihood, seed) for k in range(1, len(clip))]
        with atomic_write(path, "wb") as file:
            np.savez(file, **packed(found))
        return found
    with np.load(path) as data:
        return unpacked(dict(data), likelihood)


def measured_pair(
    clip: Clip, k: int, method: FlowMethod, likelihood: FlowLikelihood, seed: int
) -> Measurements:
    """Measurements into frame k, as odometry makes them but for the number of a dense method's pixels."""
    previous, current = clip.image(k - 1), clip.image(k)
    pixels = None
    if isinstance(method, DenseFlow):
        pixels = stratified_pixels(previous.shape, DENSE_PIXELS, np.random.default_rng(seed + k))
    return measure(previous, current, method, likelihood.texture, pixels, likelihood.signals)


def packed(found: list[Measurements]) -> dict[str, Array]:
    """Measurements as arrays, one after the other."""
    arrays = {name: np.concatenate([getattr(m, name) for m in found]) for name in ARRAYS}
    signals = {SIGNAL + name: np.concatenate([m.signals[name] for m in found]) for name in found[0].signals}
    counts = {"counts": np.array([len(m) for m in found]), "lost": np.array([m.lost for m in found])}
    return {**arrays, **signals, **counts}


def unpacked(arrays: dict[str, Array], likelihood: FlowLikelihood) -> list[Measurements]:
    """Inverse of `packed`."""
    ends = np.cumsum(arrays.pop("counts"))
    lost = arrays.pop("lost")
    parts = {name: np.split(values, ends[:-1]) for name, values in arrays.items()}
    return [
        Measurements(
            *(parts[name][k] for name in ARRAYS), likelihood.texture, dict(likelihood.method or {}),
            {name.removeprefix(SIGNAL): parts[name][k] for name in parts if name.startswith(SIGNAL)},
            int(lost[k]),
        )
        for k in range(len(ends))
    ]  # fmt: skip


def depths_at(clip: Clip, measured: list[Measurements]) -> list[Array]:
    """Depths (N,) [m] told of the vectors into every frame after the first."""
    with np.errstate(divide="ignore"):
        return [1 / sample_inverse_depth(clip.depth(k), m.pixels) for k, m in enumerate(measured)]


def judged(
    clip: Clip, likelihood: FlowLikelihood, measured: list[Measurements], depths: list[Array] | None,
    name: str, seed: int,
) -> list[Verdict]:  # fmt: skip
    """Verdicts on one estimator's motions."""
    told: list[Array] | list[None] = depths if depths is not None else [None] * len(measured)
    pairs = zip(measured, told)
    of = _ours(clip, likelihood, pairs, name, seed) if name in OURS else _rivals(clip, pairs, name)
    metric = depths is not None
    return [verdict(clip.truth(k), metric) for k, verdict in enumerate(of, 1) if clip.judged[k]]


Verdicts = Iterator[Callable[[RigidTransform, bool], Verdict]]
Pairs = Iterator[tuple[Measurements, Array | None]]


def _ours(clip: Clip, likelihood: FlowLikelihood, pairs: Pairs, name: str, seed: int) -> Verdicts:
    """Motions that users of the odometry get, each to be compared with a truth."""
    estimator: Estimator = ransac(RADIUS_PX) if name == "ransac" else lcmsac(likelihood)
    odometry = Odometry(clip.camera, flow_method(likelihood.method or {}), estimator, seed)
    odometry.begin(clip.timestamp(0))
    for k, (m, depth) in enumerate(pairs, 1):
        motion = odometry.advance(m, depth, timestamp=clip.timestamp(k))
        yield lambda truth, metric, motion=motion: of_motion(motion, truth, metric)


def _rivals(clip: Clip, pairs: Pairs, name: str) -> Verdicts:
    """Motions of another library, with the inverse of its normal equations."""
    for m, depth in pairs:
        residual: Residual = (
            Epipolar.of(m, clip.camera) if depth is None else KnownDepth.of(m, clip.camera, depth)
        )
        T = solve(name, residual)
        C = np.zeros((6, 6)) if T is None else inverse_normal_equations(residual, T)
        yield lambda truth, metric, T=T, C=C: of_rival(T, C, truth, metric)


def solve(name: str, residual: Residual) -> RigidTransform | None:
    """Motion by OpenCV or PoseLib; None where there is none."""
    if isinstance(residual, KnownDepth):
        return Pnp("opencv-ransac" if name == "opencv" else "poselib-truncated", RADIUS_PX)(residual)
    assert isinstance(residual, Epipolar)
    if len(residual) < 5:
        return None
    return opencv_essential(residual, RADIUS_PX) if name == "opencv" else poselib_pose(residual)


def poselib_pose(residual: Epipolar) -> RigidTransform | None:
    """Motion with a unit translation by PoseLib, after a hundred samples at least and not its thousand."""
    import poselib

    m, c = residual.measurements, residual.camera
    camera = {"model": "PINHOLE", "width": c.width, "height": c.height, "params": [c.fx, c.fy, c.cx, c.cy]}
    options = {"max_epipolar_error": RADIUS_PX, "min_iterations": 100}
    pose, _ = poselib.estimate_relative_pose(m.pixels, m.pixels + m.flow, camera, camera, options, {})
    t, R = np.asarray(pose.t), np.asarray(pose.R)
    if not (np.isfinite(R).all() and np.linalg.norm(t) > 0):
        return None
    return RigidTransform.from_components(t / np.linalg.norm(t), Rotation.from_matrix(R))


def inverse_normal_equations(residual: Residual, T: RigidTransform) -> Array:
    """Covariance (6, 6) of least squares on the inliers, whose mean square is the errors' variance."""
    errors = residual.at(T.as_matrix()[:3], lcm_index())
    z = errors.z.reshape(len(residual.measurements), -1)
    near = np.repeat(np.linalg.norm(z, axis=1) <= RADIUS_PX, z.shape[1])
    J, freedoms = errors.J[near] @ errors.basis, errors.basis.shape[1]
    if near.sum() <= freedoms:
        return np.full((6, 6), np.nan)
    variance = float(np.sum(errors.z[near] ** 2) / (near.sum() - freedoms))
    return np.asarray(errors.basis @ np.linalg.pinv(J.T @ J) @ errors.basis.T * variance)


@lru_cache(maxsize=1)
def lcm_index():  # type: ignore[no-untyped-def]
    """An index that every measurement has: of texture alone."""
    return ransac().likelihood.schedule.index
