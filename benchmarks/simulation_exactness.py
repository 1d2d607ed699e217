"""Is the truth true? Depth against planes and another ray caster, flow against OpenCV's projection."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.geometry.camera import Pinhole
from flowlik.simulation import PAPER_CAMERA, SimulatedSequence
from flowlik.simulation.render import Daylight, Instances, Material, Prototype, Scene, Surface, placed, quad

# the oracle is the tests' own
sys.path.append(str(Path(__file__).parents[1]))


def plane_depth_error() -> tuple[float, int]:
    """Largest relative error of depth on a ground plane 1 to 165 m away, and the pixels on it."""
    ground = quad([(-900, 2, 900), (900, 2, 900), (900, 2, -900), (-900, 2, -900)], 0)
    instances = Instances.of([(0, placed(np.zeros(3)))])
    scene = Scene.of([Prototype(ground)], instances, [Material((Surface(0.3),))], Daylight(), 0)
    worst, count = 0.0, 0
    for angles in ([0.3, -0.25, 0.1], [2.0, -0.1, -0.3]):
        pose = RigidTransform.from_components([3.0, 0.3, -20], Rotation.from_euler("YXZ", angles))
        depth = scene.render(pose, PAPER_CAMERA, samples=0).depth
        rays = PAPER_CAMERA.rays(PAPER_CAMERA.pixel_grid()) @ pose.rotation.as_matrix().T
        expected = (1.7 / rays[:, 1]).reshape(depth.shape)
        near = (expected > 1) & (expected < 165)
        worst = max(worst, float(np.abs(depth[near] / expected[near] - 1).max()))
        count += int(near.sum())
    return worst, count


def flow_error(sequence: SimulatedSequence, k: int) -> tuple[float, int]:
    """Largest difference [px] from OpenCV's reprojection over flow that ends in the image, and its count."""
    camera, frame = sequence.camera, sequence.frame(k)
    points_n = sequence.T_n_c(k).apply(camera.rays(camera.pixel_grid()) * frame.depth.reshape(-1, 1))
    here, there = sequence.mover_poses(k), sequence.mover_poses(k + 1)
    if frame.movers is not None and here is not None and there is not None:
        labels = frame.movers.ravel()
        for m in np.unique(labels[labels >= 0]):
            points_n[labels == m] = there[m].apply(here[m].inv().apply(points_n[labels == m]))
    T_c_n = sequence.T_n_c(k + 1).inv()
    flow = sequence.flow(k).reshape(-1, 2)
    ends_in_image = camera.contains(camera.pixel_grid() + flow) & np.isfinite(frame.depth.ravel())
    projected, _ = cv2.projectPoints(
        np.ascontiguousarray(points_n[ends_in_image]),
        T_c_n.rotation.as_rotvec(), T_c_n.translation, camera.K, None,
    )  # fmt: skip
    expected = projected[:, 0] - camera.pixel_grid()[ends_in_image]
    return float(np.abs(flow[ends_in_image] - expected).max()), int(ends_in_image.sum())


def embree_agreement(scene: Scene, poses: RigidTransform, camera: Pinhole) -> list[float]:
    """Share of pixels within 1e-4 of Embree's depth, a pose each; pixels that only one hits count against."""
    from tests.simulation.render.embree import agreement, cast

    shares = []
    for pose in poses:
        depth = scene.render(pose, camera, samples=0).depth
        shares.append(agreement(depth, cast(scene.drawn_triangles(pose, camera), pose, camera)))
    return shares
