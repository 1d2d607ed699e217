import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets.base import lacks
from flowlik.egomotion import EgoMotion, Status
from flowlik.evaluation.motion import status_records, trajectory_records, true_trajectory
from flowlik.geometry.trajectory import Trajectory
from flowlik.results.records import Record, select

METRICS = ["drift_percent", "t_err_percent", "r_err_deg_per_100m", "t_err_offset_removed_percent"]
METRICS += ["rpe_trans_median_m", "rpe_rot_median_deg"]


def drive(frames: int, step_m: float = 1.0, sideways_m: float = 0.0, scale: float = 1.0) -> Trajectory:
    """Straight ahead, with a constant error of each step."""
    positions = np.outer(np.arange(frames), [sideways_m, 0, step_m * scale])
    return Trajectory(np.arange(frames) / 10, RigidTransform.from_translation(positions))


def values(estimated, truth, **keys):
    return {record.metric: record for record in trajectory_records(estimated, truth, "data", **keys)}


class Poses:
    """A sequence of poses, or none."""

    def __init__(self, trajectory=None):
        self.trajectory = trajectory

    def T_n_c(self, k):
        if self.trajectory is None:
            raise lacks("poses", "poses")
        return self.trajectory.poses[k]

    def timestamp(self, k):
        return k / 10


def test_truth_of_a_sequence():
    truth = true_trajectory(Poses(drive(20)), 5)
    assert len(truth) == 5
    np.testing.assert_array_equal(truth.positions, drive(5).positions)
    np.testing.assert_array_equal(truth.timestamps, np.arange(5) / 10)
    assert true_trajectory(Poses(), 5) is None


def test_a_perfect_estimate_has_no_error():
    truth = drive(150)
    records = values(
        truth, truth, flow="f", family="lcm", schedule="texture", estimator="e", seed=2, scale="s"
    )
    assert list(records) == METRICS
    for record in records.values():
        assert record.value == pytest.approx(0, abs=1e-9)
        key = (record.dataset, record.flow, record.family, record.schedule, record.estimator, record.seed)
        assert key == ("data", "f", "lcm", "texture", "e", 2)
        assert record.protocol.startswith("align=none; scale=s; frames=150")
    assert records["t_err_percent"].count == 5  # first frames 0, 10, … 40 hold a segment of 100 m
    assert records["rpe_trans_median_m"].count == 149


def test_a_wrong_scale_is_drift():
    records = values(drive(150, scale=1.02), drive(150))
    assert records["drift_percent"].value == pytest.approx(2)
    assert records["t_err_percent"].value == pytest.approx(2, rel=0.02)
    assert records["r_err_deg_per_100m"].value == pytest.approx(0, abs=1e-9)
    assert records["rpe_trans_median_m"].value == pytest.approx(0.02)


def test_a_constant_offset_of_direction_is_removed():
    records = values(drive(150, sideways_m=0.01), drive(150))
    assert records["t_err_percent"].value == pytest.approx(1, rel=0.02)
    assert records["t_err_offset_removed_percent"].value == pytest.approx(0, abs=0.02)
    assert "offset_mrad=10.00 0.00" in records["t_err_offset_removed_percent"].protocol


def test_a_rotation_error():
    turned = Trajectory(
        np.arange(150) / 10,
        RigidTransform.from_components(
            drive(150).positions, Rotation.from_rotvec(np.outer(np.arange(150), [0, 0, np.deg2rad(0.1)]))
        ),
    )
    records = values(turned, drive(150))
    assert records["rpe_rot_median_deg"].value == pytest.approx(0.1)
    assert records["r_err_deg_per_100m"].value == pytest.approx(10, rel=0.02)


@pytest.mark.parametrize(
    ("step_m", "reason"), [(1.0, "holds no segment of 100 m"), (0.1, "no step of the true path is longer")]
)
def test_what_a_short_path_does_not_allow_is_null_with_its_reason(step_m, reason):
    records = values(drive(20, step_m), drive(20, step_m))
    assert [name for name in METRICS if records[name].value is None] == METRICS[1:4]
    assert "holds no segment of 100 m" in records["t_err_percent"].protocol
    assert reason in records["t_err_offset_removed_percent"].protocol


def test_shares_of_frames_not_solved_and_components_outside():
    def motion(status, components, outside):
        return EgoMotion(
            RigidTransform.identity(), np.eye(6), np.eye(6), status, components=components, outside=outside
        )

    motions = [
        motion(Status.SOLVED, 100, 0.2),
        motion(Status.STILL, 0, 0.0),
        motion(Status.DEGENERATE, 50, 0.4),
        motion(Status.TOO_FEW, 0, 0.0),
    ]
    base = Record("x", 0.0, "1/s", "data", estimator="e", protocol="a=b")
    unsolved, outside = status_records(motions, base)
    assert (unsolved.metric, unsolved.value, unsolved.unit, unsolved.count) == (
        "unsolved_fraction",
        0.5,
        "",
        4,
    )
    assert unsolved.protocol == "a=b; statuses=1 degenerate, 1 solved, 1 still, 1 too few"
    assert outside.value == pytest.approx(0.3)
    assert select([unsolved, outside], dataset="data", estimator="e") == [unsolved, outside]
