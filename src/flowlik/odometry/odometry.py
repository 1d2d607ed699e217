"""Odometry: ego-motion a frame at a time, as a robot calls it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import EgoMotion, Epipolar, Estimator, KnownDepth, Residual, Status
from flowlik.egomotion.result import of_rotation, unsolved
from flowlik.errors import DataError
from flowlik.flow.base import FlowMethod, Image, check_pair
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import scaled
from flowlik.image.depth import check_depth_z
from flowlik.likelihood.over_time import Persistence
from flowlik.measurement.features import measure_features
from flowlik.measurement.measurements import Measurements
from flowlik.odometry._constant_velocity import ConstantVelocity
from flowlik.odometry._lengths import Length, LengthModel, with_length
from flowlik.odometry.boresight import Boresight
from flowlik.odometry.scale import Norm, ScaleSource, Unscaled
from flowlik.odometry.self_calibration import Intrinsics, SelfCalibration
from flowlik.support.arrays import Array


class Step(NamedTuple):
    """What an odometry saw and said of one frame."""

    measurements: Measurements
    camera: Pinhole
    motion: EgoMotion
    residual: Residual


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
    scale : ScaleSource, optional
        Where the length of a motion comes from without depth; by default every motion has unit length.
        Where it tells none, or one that is not believed, a motion has the length expected after those
        before, and says so.
    self_calibration : SelfCalibration, optional
        Refine the camera's intrinsics from its images; by default they stay as given.
    boresight : bool
        Turn motions into the frame of the reference that `step` is told of, by what past frames say.

    Attributes
    ----------
    poses : list of RigidTransform
        ``T_n_c`` of every frame so far; the first camera frame is {n}.
    intrinsics : list of Intrinsics
        What is known of the camera after every frame, where it is refined.
    last : Step or None
        Measurements of the last frame, as a pinhole camera would have made them, and what came of them.
    """

    def __init__(
        self,
        camera: Pinhole,
        method: FlowMethod,
        estimator: Estimator,
        seed: int = 0,
        scale: ScaleSource | None = None,
        self_calibration: SelfCalibration | None = None,
        boresight: bool = False,
    ) -> None:
        self.camera, self.method, self.estimator, self.seed = camera, method, estimator, seed
        self.scale = scale or Unscaled()
        self.intrinsics: list[Intrinsics] = []
        if self_calibration is not None:
            self.intrinsics.append(Intrinsics.prior(camera, self_calibration))
        self.boresight = Boresight.none() if boresight else None
        self.last: Step | None = None
        self.poses: list[RigidTransform] = []
        self.timestamps: list[float] = []
        self._image: Image | None = None
        self._depth: Array | None = None
        self._usable: NDArray[np.bool_] | None = None
        self._model = ConstantVelocity()
        self._lengths = LengthModel()

    @property
    def persistence(self) -> Persistence | None:
        """How errors of its motions stay; None without depth, or where the likelihood does not know it."""
        over_time = self.estimator.likelihood.shared_errors.over_time
        metric = self.last is not None and self.last.residual.metric
        return over_time.full if metric and over_time is not None else None

    def step(
        self,
        image: Image,
        timestamp: float,
        depth: Array | None = None,
        distance_m: float | None = None,
        reference_m: Array | None = None,
        usable: NDArray[np.bool_] | None = None,
    ) -> EgoMotion:
        """Take the next image and return the motion since the one before.

        Where a motion cannot be solved its status says why; what is returned is then a prediction, said so:
        the previous motion, without information, with the covariance of a motion model
        (`flowlik.odometry._constant_velocity`). The trajectory goes on from there. Where a rotation alone
        explains the flow, the rotation is the images' and the translation the model's, as uncertain as it is
        long. Of two motions that a plane leaves open it is the one nearer to the motion before.

        Parameters
        ----------
        image : uint8 array (H, W)
            Grey image.
        timestamp : float
            Its time [s], later than the one before.
        depth : array (H, W), optional
            Depth [m] along z of this image in floats, used at the next step. With it the residual is of
            known depth; without it, epipolar. Depth that is hardly in metres is warned of.
        distance_m : float, optional
            Length of the motion since the previous image [m], which gives the epipolar residual its
            scale; without it the scale source is asked.
        reference_m : array (3,), optional
            The reference's move since the previous image [m], in its own frame at that time: used by the
            boresight of the frames after this one.
        usable : bool array (H, W), optional
            Pixels of this image and of the next that are of the scene: not under a mask, not beyond a lens.

        Returns
        -------
        EgoMotion
            Motion ``T_k_prev``; at the first image the identity, with status TOO_FEW.

        Raises
        ------
        DataError
            If image or depth do not fit the camera, depth is not in floats, or time does not advance.
        """
        check_frame(self.camera, image, depth)
        if self._image is None:
            self.begin(timestamp)
            motion = unsolved(Status.TOO_FEW, "the first image has none before it")
        else:
            likelihood, seed = self.estimator.likelihood, self.seed + len(self.poses)
            m = measure_features(
                self._image, image, self.method, likelihood.texture, seed, likelihood.signals, self._usable
            )
            motion = self.advance(m, self._depth, distance_m, reference_m, timestamp)
        self._image, self._depth, self._usable = image, depth, usable
        return motion

    def begin(self, timestamp: float) -> None:
        """Take the time [s] of the first frame, whose camera frame is {n}.

        Raises
        ------
        DataError
            If it is not a finite number.
        """
        self._take_time(timestamp)
        self.poses.append(RigidTransform.identity())

    def advance(
        self,
        m: Measurements,
        depth: Array | None = None,
        distance_m: float | None = None,
        reference_m: Array | None = None,
        timestamp: float | None = None,
    ) -> EgoMotion:
        """Take the measurements between the last image and the next, made elsewhere.

        Parameters
        ----------
        m : Measurements
            As the estimator's likelihood needs them.
        depth : array (H, W), optional
            Depth [m] along z of the last image.
        distance_m, reference_m
            As `step` takes them.
        timestamp : float, optional
            Time [s] of the next image; without it none is kept.

        Raises
        ------
        DataError
            If time does not advance.
        """
        if timestamp is not None:
            self._take_time(timestamp)
        if not self.poses:
            self.poses.append(RigidTransform.identity())
        k = len(self.poses)
        completed = self._model.completed(self._measured(m, k, depth), self.scale.name == "none")
        motion = self._with_length(completed, k, distance_m)
        self._model = self._model.after(motion)
        if self.boresight is not None:
            turned = self.boresight.applied(motion.T_k_prev)
            if reference_m is not None and motion.status is Status.SOLVED:
                self.boresight = self.boresight.updated(motion.T_k_prev, reference_m)
            motion = replace(motion, T_k_prev=turned)
        self.poses.append(self.poses[-1] * motion.T_k_prev.inv())
        return motion

    def _take_time(self, timestamp: float) -> None:
        last = self.timestamps[-1] if self.timestamps else -np.inf
        if not last < timestamp < np.inf:
            raise DataError(f"time does not advance: {timestamp} s after {last} s")
        self.timestamps.append(timestamp)

    def _measured(self, m: Measurements, k: int, depth: Array | None) -> EgoMotion:
        """Motion of a frame, and what it says about the intrinsics."""
        intrinsics = self.intrinsics[-1] if self.intrinsics else None
        raw, camera = m, self.camera
        if intrinsics is not None:
            m, camera = intrinsics.rectified(m), intrinsics.camera
        residual: Residual = Epipolar.of(m, camera) if depth is None else KnownDepth.of(m, camera, depth)
        # the previous motion saves five-point samples, unless it has no direction
        previous = self._model.last
        moving = not residual.metric and previous is not None and np.any(previous.translation)
        start = previous if moving else None
        motion = self.estimator.estimate(residual, seed=np.random.default_rng([self.seed, k]), start=start)
        if intrinsics is not None:
            if motion.status is Status.SOLVED and not residual.metric:
                evidence = intrinsics.evidence(raw, motion.T_k_prev.as_matrix()[:3], self.estimator)
                unknown = intrinsics.motion_covariance(evidence)
                motion = replace(motion, covariance=motion.covariance + unknown)
                intrinsics = intrinsics.updated(evidence)
            self.intrinsics.append(intrinsics)
        self.last = Step(m, camera, motion, residual)
        return motion

    def _with_length(self, motion: EgoMotion, k: int, distance_m: float | None) -> EgoMotion:
        """Give the motion the length that is told, or the one that is expected where none is."""
        if motion.status is Status.STILL:  # flow that is missed looks still too: no length is learned of it
            self._lengths = self._lengths.skipped()
        if (motion.scale_known and motion.solved) or motion.status is Status.STILL:
            return motion
        if distance_m is None and self.scale.name == "none":
            return motion
        estimated = motion.solved or motion.alternative is not None
        told = Length(distance_m) if distance_m is not None else self._told(motion, estimated, k)
        if estimated:
            return self._lengthened(motion, told)
        if told is None:
            self._lengths = self._lengths.skipped()
            return replace(motion, length_predicted=not motion.scale_known)
        self._lengths = self._lengths.updated(told.metres, told.sigma_m)
        found = replace(motion, T_k_prev=scaled(motion.T_k_prev, told.metres), scale_known=True)
        if motion.predicted:
            return found
        # the rotation is the images', the direction anything
        return replace(found, covariance=of_rotation(motion.covariance, told.metres**2))

    def _lengthened(self, motion: EgoMotion, told: Length | None) -> EgoMotion:
        """Give a motion that was estimated, and its alternative, a length."""
        before = self._lengths
        motion, self._lengths = with_length(motion, told, before, self.scale.name)
        if motion.alternative is None:
            return motion
        return replace(motion, alternative=with_length(motion.alternative, told, before, self.scale.name)[0])

    def _told(self, motion: EgoMotion, estimated: bool, k: int) -> Length | None:
        """What the scale source tells of a motion; of one that was not estimated only where it needs none."""
        if self.last is None or not (estimated or isinstance(self.scale, Norm)):
            return None
        m, camera = self.last.measurements, self.last.camera
        return self.scale.length(k, m, camera, motion.T_k_prev, self.estimator.likelihood)


def check_frame(camera: Pinhole, image: Image, depth: Array | None) -> None:
    """Check that an image, and its depth [m] if it is given, are a camera's.

    Raises
    ------
    DataError
        If the image is not grey uint8, depth is not in floats, or they do not fit the camera.
    """
    check_pair(image, image)
    size = f"{camera.width}x{camera.height}"
    for name, array in (("image", image), ("depth map", image if depth is None else depth)):
        if array.shape != (camera.height, camera.width):
            raise DataError(f"{name} of {array.shape[1]}x{array.shape[0]} for a camera of {size}")
    if depth is not None:
        check_depth_z(depth)
