"""Truth of things that move by themselves, in a world of closed form."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets.next_frame import Visibility
from flowlik.geometry.camera import Pinhole
from flowlik.simulation import IDEAL_SENSOR, Flight, SimulatedSequence
from tests.simulation.flight.moving import MovingWorld

K = 3


@pytest.fixture(scope="module")
def sequence() -> SimulatedSequence:
    """Flight forward and to the left, turning, past two moving squares at 20 frames/s."""
    steps = np.arange(6.0)[:, None]
    turns = Rotation.from_rotvec(steps * [0.004, 0.02, -0.01])
    poses = RigidTransform.from_components(steps * [-0.03, 0.01, 0.1], turns)
    camera = Pinhole.from_fov(320, 180, 80.0)
    return SimulatedSequence(MovingWorld(), Flight.of(poses, 20.0), camera, IDEAL_SENSOR)


def test_every_body_is_seen(sequence: SimulatedSequence) -> None:
    counts = [(sequence.frame(K).movers == body).sum() for body in (-1, 0, 1)]
    assert min(counts) > 500 and np.isinf(sequence.depth(K)).sum() > 500


def test_flow_of_moving_things_is_their_own(sequence: SimulatedSequence) -> None:
    """Points are carried along by hand, body by body, and projected by OpenCV."""
    camera, world, frame = sequence.camera, sequence.world, sequence.frame(K)
    pixels, labels = camera.pixel_grid(), frame.movers.ravel()
    T_c_n = sequence.T_n_c(K + 1).inv()
    for body in (-1, 0, 1):
        mine = (labels == body) & np.isfinite(frame.depth.ravel())
        points_n = sequence.T_n_c(K).apply(camera.rays(pixels[mine]) * frame.depth.ravel()[mine, None])
        if body >= 0:
            before, after = (world.mover_poses(k / 20.0)[body] for k in (K, K + 1))
            points_n = after.apply(before.inv().apply(points_n))
        ends, _ = cv2.projectPoints(
            np.ascontiguousarray(points_n), T_c_n.rotation.as_rotvec(), T_c_n.translation, camera.K, None
        )
        flow = sequence.flow(K).reshape(-1, 2)[mine]
        np.testing.assert_allclose(flow, ends[:, 0] - pixels[mine], atol=1e-6)
    # it is not the flow of the static world
    still = SimulatedSequence(_Frozen(K), Flight.of(sequence.poses, 20.0), camera, IDEAL_SENSOR)
    own = np.linalg.norm(sequence.flow(K) - still.flow(K), axis=-1)
    assert own[frame.movers == 0].min() > 1 and own[frame.movers < 0].max() == 0


def test_next_image_warped_by_the_true_flow_is_this_image(sequence: SimulatedSequence) -> None:
    image, later = (sequence.image(k).astype(np.float32) for k in (K, K + 1))
    ends = (sequence.camera.pixel_grid().reshape(*image.shape, 2) + sequence.flow(K)).astype(np.float32)
    warped = cv2.remap(later, ends[..., 0], ends[..., 1], cv2.INTER_CUBIC)
    for body in (-1, 0, 1):
        seen = (sequence.frame(K).movers == body).astype(np.uint8) * np.isfinite(sequence.depth(K))
        compared = (cv2.erode(seen.astype(np.uint8), np.ones((7, 7))) > 0) & sequence.visible(K)
        assert compared.sum() > 200
        assert np.median(np.abs(warped - image)[compared]) <= 1.2
        assert np.median(np.abs(later - image)[compared]) > 1.5


def test_classes_of_visibility(sequence: SimulatedSequence) -> None:
    camera, classes, flow = sequence.camera, sequence.visibility(K), sequence.flow(K)
    assert classes.dtype == np.uint8
    sky = np.isinf(sequence.depth(K))
    np.testing.assert_array_equal((classes & Visibility.SKY) > 0, sky)
    ends = camera.pixel_grid().reshape(flow.shape) + flow
    np.testing.assert_array_equal((classes & Visibility.OUT_OF_VIEW) > 0, ~camera.contains(ends))
    seen = classes & ~np.uint8(Visibility.SKY)
    np.testing.assert_array_equal(sequence.visible(K), seen == Visibility.VISIBLE)

    # a wall pixel is hidden if a square covers its end, well away from the square's edges
    later = sequence.frame(K + 1).movers
    covering = cv2.erode((later >= 0).astype(np.uint8), np.ones((5, 5))) > 0
    free = cv2.dilate((later >= 0).astype(np.uint8), np.ones((5, 5))) == 0
    inside = camera.contains(ends) & (sequence.frame(K).movers < 0) & ~sky
    u, v = np.rint(np.where(inside[..., None], ends, 0)).astype(int).transpose(2, 0, 1)
    hidden, open_ = inside & covering[v, u], inside & free[v, u]
    assert hidden.sum() > 50
    assert (seen[hidden] == Visibility.OCCLUDED).all()
    edge = cv2.dilate(sky.astype(np.uint8), np.ones((7, 7))) > 0
    assert (seen[open_ & ~edge] == Visibility.VISIBLE).all()
    # the inner part of the squares themselves is found again at the depth to which they moved
    for body in (0, 1):
        inner = cv2.erode((sequence.frame(K).movers == body).astype(np.uint8), np.ones((9, 9))) > 0
        assert (classes[inner] == Visibility.VISIBLE).mean() > 0.9


def test_time_moves_things_even_if_the_camera_stands_still() -> None:
    poses = RigidTransform.from_translation(np.zeros((3, 3)))
    camera = Pinhole.from_fov(160, 90, 80.0)
    sequence = SimulatedSequence(MovingWorld(), Flight.of(poses, 10.0), camera, IDEAL_SENSOR)
    assert sequence.image(0).tobytes() != sequence.image(1).tobytes()
    flow, movers = sequence.flow(0), sequence.frame(0).movers
    np.testing.assert_allclose(flow[movers < 0], 0, atol=1e-12)
    # 0.3 m to the right at 8 m
    np.testing.assert_allclose(flow[movers == 0], [[camera.fx * 0.3 / 8, 0]] * (movers == 0).sum(), atol=1e-9)


def test_the_worlds_clock_begins_with_the_first_frame(sequence: SimulatedSequence) -> None:
    flight = Flight(sequence.poses, 1e9 + np.arange(6) / 20, 20.0)
    late = SimulatedSequence(MovingWorld(), flight, sequence.camera, IDEAL_SENSOR)
    assert late.timestamp(1) == 1e9 + 0.05
    np.testing.assert_allclose(late.flow(K), sequence.flow(K), atol=1e-3)


class _Frozen(MovingWorld):
    """The same world seen at one time, in which nothing moves any more."""

    def __init__(self, k: int) -> None:
        object.__setattr__(self, "seed", k)

    def mover_poses(self, time_s):
        return None

    def render(self, T_n_c, camera, time_s=0.0):
        return MovingWorld().render(T_n_c, camera, self.seed / 20.0)
