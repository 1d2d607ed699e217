"""What `flowlik simulate --imu --gps --spoof` writes is read back, with its truth."""

import csv
from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import RigidTransform

from flowlik.commands import simulate
from flowlik.commands.options import SimulateOptions
from flowlik.datasets import open_sequence, read_euroc_imu, read_gps, read_tartanair_imu
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.pose_table import read_euroc_poses
from flowlik.simulation import SmoothMotion, gps_model, imu_model, simulate_gps, simulate_imu, spoofing

OPTIONS = SimulateOptions(
    trajectory="training",
    frames=12,
    seed=4,
    camera=Pinhole.from_fov(32, 18, 100.0),
    imu="adis16448:rate_hz=240,position_c_m=0.1/0/0.05,rotation_c_i_rad=0.1/0.2/0.3,time_offset_s=0.004",
    gps="coloured:rate_hz=60,position_c_m=0/-0.1/0",
    spoof=("ramp:onset_s=0.1,rate_mps=2",),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return simulate("planes", tmp_path_factory.mktemp("inertial") / "flight", OPTIONS)


@pytest.fixture(scope="module")
def motion(folder):
    sequence = open_sequence(folder)
    times_s = np.array([sequence.timestamp(k) for k in range(12)])
    return SmoothMotion(RigidTransform.concatenate([sequence.T_n_c(k) for k in range(12)]), times_s)


def test_both_layouts_hold_the_same_measurements(folder, motion):
    model = imu_model(OPTIONS.imu)
    imu, euroc, tartanair = simulate_imu(motion, model, 4), read_euroc_imu(folder), read_tartanair_imu(folder)
    np.testing.assert_allclose(euroc.times_s, imu.times_s, atol=1e-9)
    np.testing.assert_allclose(euroc.angular_rate_radps, imu.angular_rate_radps, atol=1e-6)
    np.testing.assert_allclose(euroc.specific_force_mps2, imu.specific_force_mps2, atol=1e-3)
    assert euroc.noise.gyroscope_noise_density == model.gyroscope_noise_density
    np.testing.assert_allclose(euroc.T_b_i.as_matrix(), model.T_c_i.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(tartanair.times_s, euroc.times_s, atol=1e-9)
    R_c_i = euroc.T_b_i.rotation
    np.testing.assert_allclose(
        tartanair.angular_rate_radps, R_c_i.apply(euroc.angular_rate_radps), atol=1e-12
    )
    turned = R_c_i.apply(euroc.specific_force_mps2)
    np.testing.assert_allclose(tartanair.specific_force_mps2, turned, atol=1e-12)
    np.testing.assert_array_equal(np.load(folder / "imu/cam_time.npy"), motion.times_s)


def test_the_true_states_are_those_of_the_imu(folder, motion):
    truth = read_euroc_poses(folder / "state_groundtruth_estimate0" / "data.csv")
    T_n_i = motion.at(np.clip(truth.times_s, 0, motion.end_s)).poses * read_euroc_imu(folder).T_b_i
    np.testing.assert_allclose(truth.poses.as_matrix(), T_n_i.as_matrix(), atol=1e-6)


def test_positions_and_the_onset_of_spoofing(folder, motion):
    expected = simulate_gps(motion, gps_model(OPTIONS.gps), 4, [spoofing(OPTIONS.spoof[0])])
    fixes = read_gps(folder)
    np.testing.assert_allclose(fixes.positions_n_m, expected.positions_n_m, atol=1e-6)
    np.testing.assert_allclose(fixes.sigma_m, 1.5)
    with (folder / "gps0/truth.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["spoofed"]) for row in rows] == expected.spoofed.tolist()
    np.testing.assert_allclose([float(row["spoofed_x_m"]) for row in rows], expected.spoofed_m[:, 0])
    np.testing.assert_allclose(
        [float(row["z_n_m"]) for row in rows], expected.true_positions_n_m[:, 2], atol=1e-6
    )
    settings = yaml.safe_load((folder / "gps0/sensor.yaml").read_text())
    assert settings["spoofing"] == [{"kind": "ramp", "onset_s": 0.1, "rate_mps": 2.0, "heading_deg": 90.0}]
    assert settings["seed"] == 4 and settings["correlation_time_s"] == 60.0


def test_the_same_call_goes_on_and_another_is_refused(folder):
    before = (folder / "imu0/data.csv").read_bytes()
    assert simulate("planes", folder, OPTIONS) == folder
    assert (folder / "imu0/data.csv").read_bytes() == before
    with pytest.raises(DataError, match="holds gps0 of other settings"):
        simulate("planes", folder, replace(OPTIONS, spoof=()))
    with pytest.raises(DataError, match="holds imu0 of other settings"):
        simulate("planes", folder, replace(OPTIONS, imu=None))


def test_no_frame_is_rendered_for_sensors_that_cannot_be(tmp_path):
    with pytest.raises(DataError, match="spoofing is of a GPS"):
        simulate("planes", tmp_path / "out", SimulateOptions(spoof=("jump:onset_s=1,distance_m=3",)))
    with pytest.raises(DataError, match="at least 6 frames"):
        simulate("planes", tmp_path / "out", SimulateOptions(frames=5, imu="ideal"))
    assert not (tmp_path / "out").exists()
