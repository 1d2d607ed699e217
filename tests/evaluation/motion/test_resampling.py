import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.evaluation.motion import errors_by_length, errors_by_speed, kitti_errors, t_err_interval
from flowlik.geometry.trajectory import Trajectory, chain


def drive(noise, count=301, metres=1.0, seed=0):
    """A straight drive and the same with random directions (rotation vector [rad] of each step)."""
    rng = np.random.default_rng(seed)
    step = RigidTransform.from_translation([0, 0, -metres])
    turns = Rotation.from_rotvec(noise * rng.standard_normal((count - 1, 3)))
    poses = chain(list(RigidTransform.from_rotation(turns) * step))
    times = np.arange(count) / 10
    return Trajectory(times, poses), Trajectory(times, chain([step] * (count - 1)))


def test_a_constant_error_has_an_interval_of_no_width():
    _, truth = drive(0.0)
    wrong = Trajectory(truth.timestamps, chain([RigidTransform.from_translation([0.01, 0, -1.0])] * 300))
    value = kitti_errors(wrong, truth).t_err_percent
    interval = t_err_interval(wrong, truth, np.random.default_rng(0), replicates=20)
    assert (interval.low, interval.high) == pytest.approx((value, value))


def test_intervals_cover_what_other_drives_give():
    values = [kitti_errors(*drive(1e-3, seed=seed)).t_err_percent for seed in range(40)]
    estimated, truth = drive(1e-3, seed=100)
    interval = t_err_interval(estimated, truth, np.random.default_rng(0), replicates=60)
    assert interval.low < np.median(values) < interval.high
    spread = np.quantile(values, 0.975) - np.quantile(values, 0.025)
    assert 0.4 < (interval.high - interval.low) / spread < 2.5


def test_a_short_path_has_no_interval():
    estimated, truth = drive(1e-3, count=50)
    with pytest.raises(DataError, match="no segment"):
        t_err_interval(estimated, truth, np.random.default_rng(0))


def test_errors_by_length_and_speed_average_to_the_whole():
    estimated, truth = drive(1e-3)
    errors = kitti_errors(estimated, truth)
    for rows in (errors_by_length(errors.segments), errors_by_speed(errors.segments, truth)):
        counts = np.array([row[3] for row in rows])
        assert counts.sum() == len(errors.segments)
        assert np.average([row[1] for row in rows], weights=counts) == pytest.approx(errors.t_err_percent)
    assert [row[0] for row in errors_by_length(errors.segments)] == [100, 200]
    # a segment of 100 m ends at the first frame beyond: 101 steps of 0.1 s
    assert {row[0] for row in errors_by_speed(errors.segments, truth)} == {9.0}
