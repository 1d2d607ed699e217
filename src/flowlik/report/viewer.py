"""Viewing a run in rerun, live or recorded; extra ``viz``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Protocol
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from flowlik.datasets.base import ImageSequence
from flowlik.egomotion import EgoMotion, Estimator
from flowlik.errors import DataError
from flowlik.flow.base import Image
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.measurement.measurements import Measurements
from flowlik.odometry.odometry import Odometry
from flowlik.odometry.trajectory_covariance import ChainedErrors, world_covariance
from flowlik.support.arrays import Array
from flowlik.support.extras import extra

CONFIDENCE = 0.9
MOST_ELLIPSES = 400
CORNERS = 24
LONGEST_PX = 40.0
INLIER, OUTLIER, KNOWN, UNKNOWN = (70, 200, 120), (230, 80, 60), (90, 170, 255), (255, 170, 60)


class Viewer(Protocol):
    """Is told of every image pair and every pose."""

    def pair(
        self, time_s: float, image: Image, m: Measurements, likelihood: FlowLikelihood, confidence: float
    ) -> None:
        """Show an image, its flow, and the regions that hold the flow's error with a confidence."""
        ...

    def motion(self, time_s: float, robot: Odometry) -> None:
        """Show inliers, trajectory and covariance after an odometry's step."""
        ...

    def close(self) -> None:
        """Finish."""
        ...


class _NoViewer:
    """Shows nothing."""

    def pair(
        self, time_s: float, image: Image, m: Measurements, likelihood: FlowLikelihood, confidence: float
    ) -> None:
        """Show nothing."""

    def motion(self, time_s: float, robot: Odometry) -> None:
        """Show nothing."""

    def close(self) -> None:
        """Do nothing."""


class _RerunViewer:
    """Shows in rerun what it is told, live or into a file.

    Entities: ``image``, ``image/flow`` (arrows), ``image/error`` (ellipses with the half-widths of the
    model's 90 % regions as axes; blue where both are within 1 px, orange elsewhere), ``image/inliers``
    (green an inlier, red not), ``world/camera``, ``world/trajectory``, ``world/covariance`` (90 % ellipsoid
    of the position).

    Parameters
    ----------
    live : bool
        Open the viewer, or use one that runs.
    path : Path, optional
        Record to this file (.rrd).
    url : str, optional
        Live in the viewer at this address, such as ``rerun+http://127.0.0.1:9876/proxy``.

    Raises
    ------
    MissingExtraError
        If rerun is not installed.
    DataError
        If the file cannot be written.
    """

    def __init__(self, live: bool, path: Path | None = None, url: str | None = None) -> None:
        rr: Any = extra("rerun", "viewing")
        self._rr = rr
        self._recording = rr.RecordingStream("flowlik", recording_id=uuid4())
        self._errors: ChainedErrors | None = None
        self._shown_s = 0.0
        self._ellipsoids: list[tuple[Array, Array, Array]] = []
        sinks = []
        try:
            if live and url is None:
                self._recording.spawn(connect=False)
            if live:
                sinks.append(rr.GrpcSink() if url is None else rr.GrpcSink(url))
            if path is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
                sinks.append(rr.FileSink(str(path)))
            self._recording.set_sinks(*sinks)
        except (OSError, RuntimeError) as error:
            reason = " ".join(str(error).split())[:200]
            raise DataError(
                f"the rerun viewer or its file {path or ''} cannot be opened ({reason})"
            ) from error
        self._log("world", rr.ViewCoordinates.RDF, static=True)

    def pair(
        self, time_s: float, image: Image, m: Measurements, likelihood: FlowLikelihood, confidence: float
    ) -> None:
        """Show an image, its flow, and the regions that hold the flow's error with a confidence."""
        rr = self._rr
        self._at(time_s)
        self._log("image", rr.Image(image, color_model="L"))
        shown = _spread(len(m), MOST_ELLIPSES)
        some = m.select(shown)
        ends = some.pixels + some.flow
        # rerun puts the origin at the corner of the first pixel, flowlik at its centre
        self._log("image/flow", rr.Arrows2D(origins=some.pixels + 0.5, vectors=some.flow, colors=[KNOWN]))
        if likelihood.residual == "epipolar":
            return  # it knows errors across lines alone, and no ellipse
        half_width = likelihood.bound(likelihood.coordinate(some), confidence)
        known = half_width.max(axis=1) <= 1.0
        colours = np.where(known[:, None], KNOWN, UNKNOWN).astype(np.uint8)
        strips = _ellipses(ends + 0.5, half_width, some.R_i_e)
        self._log("image/error", rr.LineStrips2D(strips, colors=colours, radii=0.3))

    def motion(self, time_s: float, robot: Odometry) -> None:
        """Show inliers, trajectory and covariance after an odometry's step."""
        rr = self._rr
        self._at(time_s)
        step = robot.last
        if self._errors is None:
            self._errors = ChainedErrors(persistence=robot.persistence)
        if step is not None:
            self._inliers(robot.estimator, step)
            self._errors = self._errors.after(step.motion, time_s - self._shown_s)
        self._shown_s = time_s
        T = robot.poses[-1]
        camera = robot.camera
        self._log(
            "world/camera",
            rr.Transform3D(translation=T.translation, quaternion=rr.Quaternion(xyzw=T.rotation.as_quat())),
        )
        self._log(
            "world/camera/view",
            rr.Pinhole(image_from_camera=camera.K, width=camera.width, height=camera.height),
        )
        positions = np.array([pose.translation for pose in robot.poses])
        self._log("world/trajectory", rr.LineStrips3D([positions], colors=[KNOWN]))
        covariance = world_covariance(T, self._errors.pose)[3:, 3:]
        if np.isfinite(covariance).all():
            half_sizes, R = _ellipsoid(covariance)
            quaternion = Rotation.from_matrix(R).as_quat()
            self._ellipsoids.append((T.translation, half_sizes, quaternion))
            centers, sizes, turns = map(np.array, zip(*self._ellipsoids))
            self._log(
                "world/covariance",
                rr.Ellipsoids3D(centers=centers, half_sizes=sizes, quaternions=turns, colors=[UNKNOWN]),
            )

    def close(self) -> None:
        """Wait until everything is written."""
        self._recording.flush()
        self._recording.disconnect()

    def _inliers(self, estimator: Estimator, step: Any) -> None:
        if not step.motion.solved:
            return
        inlier = estimator.inliers(step.residual, step.motion.T_k_prev).max(axis=1, keepdims=True)
        colours = np.where(inlier, INLIER, OUTLIER).astype(np.uint8)
        pixels = step.residual.measurements.pixels + 0.5
        self._log("image/inliers", self._rr.Points2D(pixels, colors=colours, radii=1.0))

    def _at(self, time_s: float) -> None:
        self._rr.set_time("time", duration=float(time_s), recording=self._recording)

    def _log(self, entity: str, what: Any, static: bool = False) -> None:
        self._rr.log(entity, what, static=static, recording=self._recording)


def viewer(live: bool, path: Path | None) -> Viewer:
    """Viewer of what is asked for; one that shows nothing where nothing is."""
    return _RerunViewer(live, path) if live or path is not None else _NoViewer()


def watched_by(
    shown: Viewer, motions: Iterable[EgoMotion], sequence: ImageSequence, robot: Odometry
) -> Iterator[EgoMotion]:
    """Pass motions of an odometry on, showing each."""
    for k, motion in enumerate(motions, start=1):
        if not isinstance(shown, _NoViewer) and robot.last is not None:
            time_s = sequence.timestamp(k)
            likelihood = robot.estimator.likelihood
            shown.pair(time_s, sequence.image(k - 1), robot.last.measurements, likelihood, CONFIDENCE)
            shown.motion(time_s, robot)
        yield motion
    shown.close()


def _ellipses(centers: Array, half_width: Array, R_i_e: Array) -> Array:
    """Closed outlines (N, CORNERS, 2) of ellipses with half-axes (N, 2) along the columns of R_i_e."""
    angle = np.linspace(0, 2 * np.pi, CORNERS)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    local = circle[None] * np.minimum(half_width, LONGEST_PX)[:, None]
    return centers[:, None] + np.einsum("nij,nkj->nki", R_i_e, local)


def _ellipsoid(covariance: Array) -> tuple[Array, Array]:
    """Half-axes (3,) and their directions (3, 3), a rotation, of the 90 % region of a position."""
    values, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    return np.sqrt(np.maximum(values, 0) * chi2.ppf(CONFIDENCE, 3)), axes


def _spread(count: int, most: int) -> NDArray[np.intp]:
    """At most so many numbers below ``count``, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.intp))
