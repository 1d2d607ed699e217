"""Odometry: ego-motion a frame at a time, as a robot calls it, and the loop over a sequence."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.camera import Array, Pinhole
from flowlik.datasets.base import Sequence
from flowlik.egomotion import EgoMotion, Epipolar, Estimator, KnownDepth, Residual, Status
from flowlik.egomotion.result import unsolved
from flowlik.errors import DataError
from flowlik.flow.base import DenseFlow, FlowMethod, Image, check_pair, method_for_pair
from flowlik.measurements import Measurements, measure, stratified_pixels
from flowlik.texture import TextureDefinition

DENSE_PIXELS = 4000

ResidualKind = Literal["depth", "epipolar"]
ScaleSource = Literal["truth-norm", "none"]


def measure_features(
    previous: Image,
    current: Image,
    method: FlowMethod,
    texture: TextureDefinition,
    seed: int = 0,
    signals: Iterable[str] = (),
) -> Measurements:
    """Measure at a method's own corners, or at 4000 stratified pixels of a dense one."""
    pixels = None
    if isinstance(method, DenseFlow):
        pixels = stratified_pixels(previous.shape, DENSE_PIXELS, np.random.default_rng(seed))
    return measure(previous, current, method, texture, pixels, signals)


def features_of(method: FlowMethod) -> str:
    """Feature choice as a protocol names it."""
    return f"stratified-{DENSE_PIXELS}" if isinstance(method, DenseFlow) else "corners"


class Odometry:
    """Ego-motion from one image to the next, chained to a pose.

    Parameters
    ----------
    camera : Pinhole
        Camera of all images.
    method : FlowMethod
        Flow.
    estimator : Estimator
        RANSAC, LCMSAC or maximum likelihood.
    seed : int
        Seed of pixels and samples; frame k uses (seed, k).

    Attributes
    ----------
    poses : list of RigidTransform
        ``T_n_c`` of every frame so far; the first camera frame is {n}.
    """

    def __init__(self, camera: Pinhole, method: FlowMethod, estimator: Estimator, seed: int = 0) -> None:
        self.camera, self.method, self.estimator, self.seed = camera, method, estimator, seed
        self.poses: list[RigidTransform] = []
        self.timestamps: list[float] = []
        self._image: Image | None = None
        self._depth: Array | None = None
        self._previous_motion = RigidTransform.identity()

    def step(
        self, image: Image, timestamp: float, depth: Array | None = None, distance_m: float | None = None
    ) -> EgoMotion:
        """Take the next image and return the motion since the one before.

        Where a motion cannot be solved its status says so, the motion returned is the previous one
        repeated, with no information, and the trajectory goes on from there.

        Parameters
        ----------
        image : uint8 array (H, W)
            Grey image.
        timestamp : float
            Its time [s], later than the one before.
        depth : array (H, W), optional
            Depth [m] along z of this image, used at the next step. With it the residual is of known
            depth; without it, epipolar.
        distance_m : float, optional
            Length of the motion since the previous image [m], which gives the epipolar residual its
            scale; without it each step has unit length.

        Returns
        -------
        EgoMotion
            Motion ``T_k_prev``; at the first image the identity, with status TOO_FEW.

        Raises
        ------
        DataError
            If the image does not fit the camera, or time does not advance.
        """
        check_pair(image, image)
        size = f"{self.camera.width}x{self.camera.height}"
        for name, array in (("image", image), ("depth map", image if depth is None else depth)):
            if array.shape != (self.camera.height, self.camera.width):
                raise DataError(f"{name} of {array.shape[1]}x{array.shape[0]} for a camera of {size}")
        last = self.timestamps[-1] if self.timestamps else -np.inf
        if not last < timestamp < np.inf:
            raise DataError(f"time does not advance: {timestamp} s after {last} s")
        previous, known_depth = self._image, self._depth
        self._image, self._depth = image, depth
        self.timestamps.append(timestamp)
        if previous is None:
            self.poses.append(RigidTransform.identity())
            return unsolved(Status.TOO_FEW, "the first image has none before it")
        k = len(self.poses)
        likelihood = self.estimator.likelihood
        signals = likelihood.schedule.index.signals
        m = measure_features(previous, image, self.method, likelihood.texture, self.seed + k, signals)
        residual: Residual = (
            Epipolar.of(m, self.camera) if known_depth is None else KnownDepth.of(m, self.camera, known_depth)
        )
        rng = np.random.default_rng([self.seed, k])
        # the previous motion is a guess, unless it has no direction
        moving = np.any(self._previous_motion.translation) or residual.metric
        start = self._previous_motion if k > 1 and moving else None
        motion = self.estimator.estimate(residual, seed=rng, start=start)
        if not motion.solved:
            motion = replace(motion, T_k_prev=self._previous_motion, information=np.zeros((6, 6)))
        elif not motion.scale_known and distance_m is not None:
            motion = replace(motion, T_k_prev=scaled(motion.T_k_prev, distance_m), scale_known=True)
        self._previous_motion = motion.T_k_prev
        self.poses.append(self.poses[-1] * motion.T_k_prev.inv())
        return motion


def scaled(T_k_prev: RigidTransform, distance_m: float) -> RigidTransform:
    """Return the motion with a translation of the given length [m]; a zero translation stays zero."""
    length = float(np.linalg.norm(T_k_prev.translation))
    factor = distance_m / length if length > 0 else 0.0
    return RigidTransform.from_components(T_k_prev.translation * factor, T_k_prev.rotation)


def true_distance(sequence: Sequence, k: int) -> float:
    """Length [m] of the true motion from frame k - 1 to k: the scale source ``truth-norm``."""
    return float(np.linalg.norm(sequence.T_n_c(k).translation - sequence.T_n_c(k - 1).translation))


def run_odometry(
    sequence: Sequence,
    odometry: Odometry,
    residual: ResidualKind,
    scale: ScaleSource = "none",
    frames: int | None = None,
) -> Iterator[EgoMotion]:
    """Loop over a sequence; afterwards ``odometry.poses`` holds the trajectory.

    Parameters
    ----------
    sequence : Sequence
        Images, with depth for the residual of known depth, and poses for the scale ``truth-norm``.
    odometry : Odometry
        Fresh odometry.
    residual : {"depth", "epipolar"}
        Which residual.
    scale : {"truth-norm", "none"}
        Where the epipolar residual's scale comes from.
    frames : int, optional
        Only the first so many frames.

    Yields
    ------
    EgoMotion
        Of every frame after the first.

    Raises
    ------
    DataError
        If the sequence lacks a field asked for.
    """
    count = len(sequence) if frames is None else min(frames, len(sequence))
    method = odometry.method
    for k in range(count):
        if k > 0:
            odometry.method = method_for_pair(method, sequence, k - 1)
        # the last frame's depth is never used, and data sets may lack it
        depth = sequence.depth(k) if residual == "depth" and k < count - 1 else None
        distance = true_distance(sequence, k) if scale == "truth-norm" and k > 0 else None
        motion = odometry.step(sequence.image(k), sequence.timestamp(k), depth, distance)
        if k > 0:
            yield motion
    odometry.method = method
