"""What `flowlik fuse` says of clocks and turns that are not what they were said to be."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.commands._fuse_clocks import report_clocks, told_clocks
from flowlik.commands._fuse_inputs import Sensors
from flowlik.egomotion import EgoMotion, Status
from flowlik.fusion import FusionSettings, TurnOn
from flowlik.results.records import Record
from flowlik.results.runs import RunFolder
from flowlik.simulation.inertial import ImuModel
from tests.fusion.test_time_offset import OFFSET_S, TIMES_S, TURN, flight, measured


def told(tmp_path, turn: np.ndarray, late_s: float, still: bool = False):
    """Warnings and records of a flight whose IMU is said to be turned so, and corrected by so much."""
    poses = flight(0, (1e-5, 1e-5, 1e-5)) if still else flight(0)
    model = ImuModel(200.0, 2e-3, rotation_c_i_rad=tuple(TURN), time_offset_s=OFFSET_S - late_s)
    turns, imu = measured(0, poses, model)
    no = np.zeros((6, 6))
    motions = [EgoMotion(RigidTransform.from_rotation(R), no, no, Status.SOLVED) for R in turns]
    T_b_c = RigidTransform.from_rotation(Rotation.from_rotvec(turn).inv())
    sensors = Sensors(imu, None, FusionSettings(np.array([0, 9.81, 0]), T_b_c), TurnOn(0.01, 0.1))
    run = RunFolder(
        tmp_path / "run", "flowlik fuse", {}, 0, [Record("frames", 1.0, "", "shaken", protocol="a=b")]
    )
    report_clocks(run, told_clocks(TIMES_S, motions, sensors), sensors)
    return run.warnings, {r.metric: r for r in run.records}


def test_what_was_said_is_not_warned_of(tmp_path):
    warnings, records = told(tmp_path, TURN, OFFSET_S)
    assert not warnings
    assert abs(records["imu_time_offset_s"].value) < 1e-3
    assert records["imu_time_offset_low_s"].value < 0 < records["imu_time_offset_high_s"].value


def test_a_late_imu_and_another_turn_are_warned_of(tmp_path):
    warnings, records = told(tmp_path, TURN + np.array([0.2, 0, 0]), 0.0)
    late, turned = warnings
    assert "shaken: by images' rotations the IMU is stamped 23." in late and "--imu-offset 0.023" in late
    assert "the IMU is turned 10." in turned or "the IMU is turned 9." in turned
    assert abs(records["imu_time_offset_s"].value - OFFSET_S) < 2e-3


def test_where_nothing_tells_it_is_said_why(tmp_path):
    warnings, records = told(tmp_path, TURN, 0.0, still=True)
    assert not warnings
    assert records["imu_time_offset_s"].value is None
    assert "too little rotation" in records["imu_time_offset_s"].notes["why"]
