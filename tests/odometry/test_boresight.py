import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.geometry.motion import exp_se3
from flowlik.odometry.boresight import Boresight

MOUNTED = Rotation.from_rotvec([0.001, 0.006, 0.0])


def drive(frames, seed=0, outliers=()):
    """Motions of a camera that is turned against the reference, and the reference's moves."""
    rng = np.random.default_rng(seed)
    B = RigidTransform.from_rotation(MOUNTED)
    for k in range(frames):
        T = exp_se3(np.append(rng.normal(0, 0.01, 3), np.array([0, 0, -1.0]) + rng.normal(0, 0.003, 3)))
        move = (B * T * B.inv()).inv().translation
        if k in outliers:
            move = move + np.array([3.0, 0, 0])
        yield T, move, B * T * B.inv()


def test_a_turned_camera_is_turned_back():
    boresight = Boresight.none()
    for T, move, _ in drive(200, outliers=(3, 50, 51)):
        boresight = boresight.updated(T, move)
    # what turns about the direction of motion does not show
    np.testing.assert_allclose(boresight.rotation.as_rotvec()[:2], [0.001, 0.006], atol=6e-4)
    for T, _, expected in drive(5, seed=1):
        away = (boresight.applied(T) * expected.inv()).as_exp_coords()
        assert np.abs(away).max() < 1e-3


def test_it_says_nothing_before_it_has_seen_anything():
    T, move, _ = next(drive(1))
    boresight = Boresight.none()
    np.testing.assert_array_equal(boresight.applied(T).as_matrix(), T.as_matrix())
    assert boresight.updated(T, 0.1 * move) is boresight  # too short a step
    once = boresight.updated(T, move)
    assert 0 < once.rotation.magnitude() < 0.1 * MOUNTED.magnitude()
