"""Covariances of chained poses, held against samples, and their files."""

import numpy as np
import pytest
from scipy.linalg import sqrtm
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.egomotion import EgoMotion, Status
from flowlik.errors import DataError
from flowlik.geometry.motion import exp_se3
from flowlik.geometry.trajectory import Trajectory, chain
from flowlik.likelihood.over_time import Persistence
from flowlik.odometry.trajectory_covariance import (
    _write_covariance_csv,
    _write_trajectory_npz,
    read_covariance_csv,
    trajectory_covariance,
    world_covariance,
)

SIGMA = np.array([1e-3, 2e-3, 1.5e-3, 0.02, 0.01, 0.03])


def steps(count=6, seed=0):
    """Motions with covariances of their own, as an odometry leaves them."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        T = exp_se3(np.concatenate([rng.normal(0, 0.2, 3), rng.normal(0, 1.0, 3)]))
        root = SIGMA[:, None] * (np.eye(6) + 0.3 * rng.standard_normal((6, 6)))
        found.append(EgoMotion(T, np.eye(6), root @ root.T, Status.SOLVED))
    return found


def sampled_poses(motions, count=4000, seed=1):
    """Last poses of trajectories whose motions have errors drawn from their covariances."""
    rng = np.random.default_rng(seed)
    poses = RigidTransform.from_matrix(np.tile(np.eye(4), (count, 1, 1)))
    for m in motions:
        errors = rng.standard_normal((count, 6)) @ np.linalg.cholesky(m.covariance).T
        poses = poses * (exp_se3(errors) * m.T_k_prev).inv()
    return poses


def check_spread(errors, covariance):
    """Errors (N, 6) have the covariance that is claimed."""
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), np.asarray(errors).T)
    np.testing.assert_allclose(whitened @ whitened.T / len(errors), np.eye(6), atol=0.12)


def test_a_pose_strays_as_its_covariance_says():
    motions = steps()
    covariance = trajectory_covariance(np.arange(7.0), motions).poses[-1]
    last = chain(m.T_k_prev for m in motions)[-1]
    check_spread((last.inv() * sampled_poses(motions)).as_exp_coords(), covariance)


@pytest.mark.parametrize("stays", [Persistence(0.7, 3.0), Persistence(1.6, 1.0)])
def test_a_pose_strays_further_where_errors_stay(stays):
    motion = steps(1)[0]
    motions = [
        EgoMotion(m.T_k_prev, m.information, motion.covariance, m.status) for m in steps(6)
    ]  # fmt: skip
    covariance = trajectory_covariance(np.arange(7.0), motions, stays).poses[-1]
    rng, count = np.random.default_rng(2), 6000
    poses = RigidTransform.from_matrix(np.tile(np.eye(4), (count, 1, 1)))
    # the root that leaves a covariance's own axes where they are
    sigma = np.sqrt(np.diag(motion.covariance))
    root = sigma[:, None] * np.real(sqrtm(motion.covariance / np.outer(sigma, sigma)))
    bias, kept = np.sqrt(stays.share) * rng.standard_normal((count, 6)), np.exp(-1 / stays.memory_s)
    for m in motions:
        white = np.sqrt(stays.variance - stays.share) * rng.standard_normal((count, 6))
        poses = poses * (exp_se3((white + bias) @ root.T) * m.T_k_prev).inv()
        bias = kept * bias + np.sqrt(stays.share * (1 - kept**2)) * rng.standard_normal((count, 6))
    last = chain(m.T_k_prev for m in motions)[-1]
    check_spread((last.inv() * poses).as_exp_coords(), covariance)
    independent = trajectory_covariance(np.arange(7.0), motions).poses[-1]
    assert np.trace(covariance) > 1.5 * np.trace(independent)


def test_nothing_that_stays_is_independence():
    motions = steps()
    found = [trajectory_covariance(np.arange(7.0), motions, p).poses for p in (None, Persistence(0.0, 1.0))]
    np.testing.assert_allclose(*found)


def test_about_the_worlds_axes():
    """What ROS means: the position as it is, and turns about fixed axes."""
    motions = steps()
    covariance = trajectory_covariance(np.arange(7.0), motions).poses[-1]
    last = chain(m.T_k_prev for m in motions)[-1]
    fixed = world_covariance(last, covariance)
    T = sampled_poses(motions)
    turns = (T.rotation * last.rotation.inv()).as_rotvec()
    check_spread(np.hstack([turns, T.translation - last.translation]), fixed)


def test_files(tmp_path):
    motions = steps()
    times = 1.7e9 + np.arange(7) / 30
    covariance = trajectory_covariance(times, motions)
    _write_covariance_csv(tmp_path / "covariance.csv", covariance)
    read = read_covariance_csv(tmp_path / "covariance.csv")
    for name in ("timestamps", "poses", "motions"):
        np.testing.assert_array_equal(getattr(read, name), getattr(covariance, name))
    header = (tmp_path / "covariance.csv").read_text().splitlines()[0].split(",")
    assert len(header) == 2 + 2 * 21
    assert (header[2], header[2 + 20], header[2 + 21]) == ("pose_rx_rx", "pose_tz_tz", "motion_rx_rx")
    trajectory = Trajectory(times, chain(m.T_k_prev for m in motions))
    _write_trajectory_npz(tmp_path / "t.npz", trajectory, covariance)
    arrays = np.load(tmp_path / "t.npz")
    np.testing.assert_array_equal(arrays["T_n_c"], trajectory.poses.as_matrix())
    np.testing.assert_array_equal(arrays["pose_covariance"], covariance.poses)


@pytest.mark.parametrize("damage", ["", "a,b\n1,2\n", "word"])
def test_other_tables_are_refused(tmp_path, damage):
    path = tmp_path / "covariance.csv"
    _write_covariance_csv(path, trajectory_covariance(np.arange(2.0), steps(1)))
    path.write_text(path.read_text().replace("0,0,", "0,word,", 1) if damage == "word" else damage)
    with pytest.raises(DataError, match=r"covariance\.csv: "):
        read_covariance_csv(path)


def test_times_and_motions_must_fit():
    with pytest.raises(DataError, match="expected one more"):
        trajectory_covariance(np.arange(3.0), steps(3))


def test_identity_moves_nothing():
    motion = EgoMotion(RigidTransform.identity(), np.eye(6), np.diag(SIGMA**2), Status.SOLVED)
    covariance = trajectory_covariance(np.arange(4.0), [motion] * 3)
    np.testing.assert_allclose(covariance.poses[-1], 3 * np.diag(SIGMA**2))


def test_the_covariance_of_an_ambiguous_motion_covers_its_alternative():
    other = RigidTransform.from_components([0.3, 0.0, 0.1], Rotation.from_rotvec([0.0, 0.02, 0.0]))
    small = 1e-8 * np.eye(6)
    second = EgoMotion(other, np.zeros((6, 6)), small, Status.AMBIGUOUS, "a plane")
    first = EgoMotion(
        RigidTransform.identity(), np.zeros((6, 6)), small, Status.AMBIGUOUS, "a plane", alternative=second
    )
    found = trajectory_covariance(np.array([0.0, 1.0]), [first])
    step = other.as_exp_coords()
    for C in (found.motions[1], found.poses[1]):
        assert step @ np.linalg.solve(C, step) <= 1.0 + 1e-6
