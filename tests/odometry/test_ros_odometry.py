"""ROS bags: images in, odometry with covariance out."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.datasets import open_sequence
from flowlik.datasets._lens_models import KannalaBrandt
from flowlik.egomotion import Status
from flowlik.errors import DataError, MissingExtraError, MissingFieldError
from flowlik.geometry.trajectory import Trajectory, chain
from flowlik.odometry.ros_odometry import (
    R_LINK_OPTICAL,
    _has_scale,
    _ros_pose,
    bag_notes,
    read_odometry_bag,
    write_odometry_bag,
)
from flowlik.odometry.trajectory_covariance import trajectory_covariance
from flowlik.support.extras import extra
from tests.odometry.test_trajectory_covariance import check_spread, sampled_poses, steps

H, W = 48, 64


def image(k):
    rng = np.random.default_rng(k)
    return rng.integers(0, 255, (H, W, 3), np.uint8)


def grey(k):
    return cv2.cvtColor(image(k), cv2.COLOR_BGR2GRAY)


def write_bag(path, encoding="bgr8", topics=("/cam/image_raw",), info=True, plugin="MCAP", damage=None):
    """A bag of four colour images a topic, as a camera driver leaves it; `info` may change its camera."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = store.types

    def header(k):
        stamp = kinds["builtin_interfaces/msg/Time"](100 + k, 500_000_000)
        return kinds["std_msgs/msg/Header"](stamp, "cam")

    with rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[plugin]) as writer:
        for topic in topics:
            compressed = encoding == "jpeg"
            kind = f"sensor_msgs/msg/{'CompressedImage' if compressed else 'Image'}"
            connection = writer.add_connection(topic, kind, typestore=store)
            for k in range(4):
                if compressed:
                    data = cv2.imencode(".png", image(k))[1].ravel()
                    message = kinds[kind](header(k), encoding, data)
                else:
                    pixels = {"bgr8": image(k), "rgb8": image(k)[..., ::-1], "mono8": grey(k)[..., None]}
                    padded = np.zeros((H, W * pixels[encoding].shape[2] + 8), np.uint8)
                    padded[:, :-8] = pixels[encoding].reshape(H, -1)
                    message = kinds[kind](header(k), H, W, encoding, 0, padded.shape[1], padded.ravel())
                if damage and k == 2:
                    damage(message)
                writer.write(connection, 10**9 * (200 + k), store.serialize_cdr(message, kind))
        if info:
            roi = kinds["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
            K, R = np.array([50.0, 0, 31, 0, 51, 23, 0, 0, 1]), np.eye(3).ravel()
            P = np.array([45.0, 0, 30, 0, 0, 45, 22, 0, 0, 0, 1, 0])
            kind = "sensor_msgs/msg/CameraInfo"
            message = kinds[kind](
                header(0), H, W, "plumb_bob", np.array([-0.1, 0, 0, 0, 0.0]), K, R, P, 0, 0, roi
            )
            for name, value in ({} if info is True else info).items():
                setattr(message, name, np.array(value, float) if isinstance(value, list) else value)
            connection = writer.add_connection("/cam/camera_info", kind, typestore=store)
            writer.write(connection, 10**9 * 200, store.serialize_cdr(message, kind))
    return path


@pytest.mark.parametrize("encoding", ["bgr8", "rgb8", "mono8", "jpeg"])
@pytest.mark.parametrize("plugin", ["MCAP", "SQLITE3"])
def test_images_of_a_bag(tmp_path, encoding, plugin):
    sequence = open_sequence(write_bag(tmp_path / "bag", encoding, info=False, plugin=plugin))
    assert len(sequence) == 4
    for k in (0, 3, 1, 2):
        np.testing.assert_array_equal(sequence.image(k), grey(k))
        assert sequence.timestamp(k) == 100.5 + k
    with pytest.raises(DataError, match="no camera"):
        _ = sequence.camera


def test_a_single_mcap_file_and_its_camera(tmp_path):
    write_bag(tmp_path / "bag")
    (file,) = (tmp_path / "bag").glob("*.mcap")
    sequence = open_sequence(file)
    assert (sequence.camera.fx, sequence.camera.fy, sequence.camera.cx) == (50.0, 51.0, 31.0)
    assert not np.array_equal(sequence.image(1), grey(1))  # the lens distorts
    given = open_sequence(file, camera="60,31.5,23.5")
    assert given.camera.fx == 60
    np.testing.assert_array_equal(given.image(1), grey(1))


def test_a_rectified_topic_has_the_projection_matrix(tmp_path):
    sequence = open_sequence(write_bag(tmp_path / "bag", topics=("/cam/image_rect",)))
    assert (sequence.camera.fx, sequence.camera.cy) == (45.0, 22.0)
    np.testing.assert_array_equal(sequence.image(1), grey(1))


@pytest.mark.parametrize(
    ("info", "message"),
    [
        ({"distortion_model": "fov"}, "distortion model 'fov' is not known, known are none, plumb_bob"),
        ({"distortion_model": ""}, "distortion coefficients, but no distortion model"),
        ({"distortion_model": "equidistant", "d": []}, "0 distortion coefficients, expected 4"),
        ({"d": [0.1, 0.2]}, "2 distortion coefficients, expected 0, 4, 5, 8, 12, 14"),
        ({"k": [50, 0.31, 31, 0, 51, 23, 0, 0, 1]}, "a skew of 0.31: only cameras without skew are read"),
        ({"width": W // 2}, "made for images of 32 x 48 pixels, these are 64 x 48"),
        ({"k": [50, 0, 64, 0, 51, 46, 0, 0, 1]}, "outside of the image"),
    ],
)
def test_a_camera_that_is_not_known_is_refused(tmp_path, info, message):
    """As a camera file is: one place decides."""
    with pytest.raises(DataError, match=message):
        open_sequence(write_bag(tmp_path / "bag", info=info))


def test_cameras_of_a_bag(tmp_path):
    fisheye = {"distortion_model": "equidistant", "d": [0.05, -0.01, 0.002, -0.0005, 0.0]}
    sequence = open_sequence(write_bag(tmp_path / "fisheye", info=fisheye))
    assert sequence.lens.model == KannalaBrandt((0.05, -0.01, 0.002, -0.0005))
    plain = open_sequence(write_bag(tmp_path / "plain", info={"distortion_model": "", "d": [0.0] * 5}))
    np.testing.assert_array_equal(plain.image(1), grey(1))
    with pytest.raises(MissingFieldError, match="no camera"):
        _ = open_sequence(write_bag(tmp_path / "never", info={"k": [0.0] * 9})).camera
    # "direct" is no rectified topic
    other = open_sequence(write_bag(tmp_path / "direct", topics=("/cam/direct",)))
    assert (other.camera.fx, other.lens.distorts) == (50.0, True)


def test_topics(tmp_path):
    path = write_bag(tmp_path / "bag", topics=("/a/image", "/b/image"))
    with pytest.raises(
        DataError, match="several topics of images, choose one by --topic: /a/image, /b/image"
    ):
        open_sequence(path)
    assert len(open_sequence(path, topic="/b/image")) == 4
    with pytest.raises(DataError, match="no images on /c, but on /a/image, /b/image"):
        open_sequence(path, topic="/c")


def truncated(message):
    message.data = message.data[:100]


def huge(message):
    message.height, message.width, message.step = 2**20, 2**20, 2**22


def unknown(message):
    message.encoding = "32FC1"


@pytest.mark.parametrize(
    ("damage", "error"),
    [(truncated, "100 bytes, but"), (huge, "impossible size"), (unknown, "encoding '32FC1' is not read")],
)
def test_bad_images(tmp_path, damage, error):
    sequence = open_sequence(write_bag(tmp_path / "bag", damage=damage))
    assert sequence.image(1).shape == (H, W)
    with pytest.raises(DataError, match=error):
        sequence.image(2)


def test_files_that_are_no_bags(tmp_path):
    pytest.importorskip("rosbags")
    for name, content in [("a.mcap", b"\x89MCAP0\r\n" + bytes(200)), ("b.bag", b"#ROSBAG V2.0\n" + bytes(90)),
                          ("c.db3", b"SQLite format 3\0" + bytes(200)), ("d.mcap", b"")]:  # fmt: skip
        (tmp_path / name).write_bytes(content)
        with pytest.raises(DataError, match=f"{name}: not a readable ROS bag"):
            open_sequence(tmp_path / name)
    write_bag(tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").write_text("a: [1")
    with pytest.raises(DataError, match="not a readable ROS bag"):
        open_sequence(tmp_path / "bag")


def test_odometry_comes_back_as_it_went(tmp_path):
    pytest.importorskip("rosbags")
    motions = steps()
    trajectory = Trajectory(1.7e9 + np.arange(7) / 32, chain(m.T_k_prev for m in motions))
    path = write_odometry_bag(tmp_path / "odometry", trajectory, motions)
    assert write_odometry_bag(path, trajectory, motions) == path  # a run may be repeated
    assert sorted(p.name for p in path.iterdir()) == ["metadata.yaml", "odometry.mcap"]
    read, covariance = read_odometry_bag(path)
    np.testing.assert_allclose(read.timestamps, trajectory.timestamps, atol=1e-6)
    np.testing.assert_allclose(read.poses.as_matrix(), trajectory.poses.as_matrix(), atol=1e-12)
    expected = trajectory_covariance(trajectory.timestamps, motions).poses
    np.testing.assert_allclose(covariance, expected, atol=1e-15, rtol=1e-9)
    (tmp_path / "other").mkdir()
    with pytest.raises(DataError, match="something other than a ROS 2 bag"):
        write_odometry_bag(tmp_path / "other", trajectory, motions)


def test_what_ros_reads_is_what_ros_means():
    """Position first, then turns about odom's fixed axes; x forward, y left, z up: held against samples."""
    motions = steps()
    covariance = trajectory_covariance(np.arange(7.0), motions).poses[-1]
    pose, fixed = _ros_pose(chain(m.T_k_prev for m in motions)[-1], covariance)
    link = RigidTransform.from_rotation(R_LINK_OPTICAL)
    others = link * sampled_poses(motions) * link.inv()
    turns = (others.rotation * pose.rotation.inv()).as_rotvec()
    check_spread(np.hstack([others.translation - pose.translation, turns]), fixed)
    ahead, _ = _ros_pose(RigidTransform.from_translation([1.0, 2.0, 3.0]), covariance)
    np.testing.assert_allclose(ahead.translation, [3.0, -1.0, -2.0])


def test_a_twist_is_the_motion_over_its_time(tmp_path):
    pytest.importorskip("rosbags")
    from flowlik.datasets.ros_topic import opened

    motions = steps(2)
    trajectory = Trajectory(np.arange(3) / 10, chain(m.T_k_prev for m in motions))
    with opened(write_odometry_bag(tmp_path / "odometry", trajectory, motions)) as reader:
        messages = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()]
    assert [m.child_frame_id for m in messages] == ["camera_link"] * 3
    np.testing.assert_array_equal(np.reshape(messages[0].twist.covariance, (6, 6)), 1e6 * np.eye(6))
    assert not any(vars_of(messages[0].twist.twist))
    linear, p = messages[2].twist.twist.linear, -10 * motions[1].T_k_prev.translation
    np.testing.assert_allclose([linear.x, linear.y, linear.z], [p[2], -p[0], -p[1]], atol=1e-9)
    C = motions[1].covariance
    np.testing.assert_allclose(
        messages[2].twist.covariance[0], 100 * C[5, 5], rtol=1e-9
    )  # x is the camera's z


def test_without_the_extra_one_line_names_it(monkeypatch, tmp_path):
    monkeypatch.setattr("flowlik.support.extras.import_module", _refuse)
    with pytest.raises(
        MissingExtraError, match=r"^reading a ROS bag needs rosbags: pip install 'flowlik\[ros\]'$"
    ):
        (tmp_path / "a.mcap").write_bytes(b"a")
        open_sequence(tmp_path / "a.mcap")
    with pytest.raises(MissingExtraError, match=r"pip install 'flowlik\[viz\]'$"):
        extra("rerun", "viewing")


def _refuse(name):
    raise ModuleNotFoundError(name)


def vars_of(twist):
    return [getattr(part, axis) for part in (twist.linear, twist.angular) for axis in "xyz"]


def odometry_messages(path):
    from flowlik.datasets.ros_topic import opened

    with opened(path) as reader:
        return [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()]


def as_the_usual_filter_takes(covariance):
    """Variances as robot_localization reads them: sizes, and at least 1e-9."""
    return np.maximum(np.abs(np.reshape(covariance, (6, 6)).diagonal()), 1e-9)


def unscaled_steps(count=6):
    return [replace(m, scale_known=False) for m in steps(count)]


def test_without_a_scale_no_pose_goes_out_in_metres(tmp_path):
    pytest.importorskip("rosbags")
    motions = unscaled_steps()
    trajectory = Trajectory(np.arange(7) / 10, chain(m.T_k_prev for m in motions))
    metric = odometry_messages(write_odometry_bag(tmp_path / "metric", trajectory, steps()))
    for name, unscaled in (("turns", False), ("units", True)):
        messages = odometry_messages(
            write_odometry_bag(tmp_path / name, trajectory, motions, unscaled=unscaled)
        )
        for message, known in zip(messages, metric):
            p, q = message.pose.pose.position, message.pose.pose.orientation
            q_known = known.pose.pose.orientation
            assert [q.x, q.y, q.z, q.w] == [q_known.x, q_known.y, q_known.z, q_known.w]
            variances = as_the_usual_filter_takes(message.pose.covariance)
            twist_variances = as_the_usual_filter_takes(message.twist.covariance)
            expected = as_the_usual_filter_takes(known.pose.covariance)
            np.testing.assert_array_equal(variances[3:], expected[3:])
            assert vars_of(message.twist.twist)[3:] == vars_of(known.twist.twist)[3:]
            if unscaled:
                assert [p.x, p.y, p.z] == [getattr(known.pose.pose.position, axis) for axis in "xyz"]
                np.testing.assert_array_equal(variances, expected)
            else:
                assert [p.x, p.y, p.z] == vars_of(message.twist.twist)[:3] == [0, 0, 0]
                assert (variances[:3] == 1e6).all() and (twist_variances[:3] == 1e6).all()
                covariance = np.reshape(message.pose.covariance, (6, 6))
                assert not covariance[:3, 3:].any() and not covariance[3:, :3].any()
    read, covariance = read_odometry_bag(tmp_path / "turns")
    np.testing.assert_allclose(
        read.poses.rotation.as_matrix(), trajectory.poses.rotation.as_matrix(), atol=1e-12
    )
    assert np.isnan(covariance[1:, 3:]).all() and np.isfinite(covariance[1:, :3, :3]).all()
    assert "no scale, so that only turns are told" in bag_notes(motions)[0]
    assert "in steps of length 1, not in metres" in bag_notes(motions, unscaled=True)[0]
    assert bag_notes(steps()) == []


def test_a_covariance_that_is_not_determined_is_a_large_variance(tmp_path):
    pytest.importorskip("rosbags")
    motions = steps()
    motions[2] = replace(motions[2], covariance=np.full((6, 6), np.nan))
    trajectory = Trajectory(np.arange(7) / 10, chain(m.T_k_prev for m in motions))
    messages = odometry_messages(write_odometry_bag(tmp_path / "bag", trajectory, motions))
    for k, message in enumerate(messages):
        pose, twist = map(as_the_usual_filter_takes, (message.pose.covariance, message.twist.covariance))
        assert (pose == 1e6).all() == (k >= 3)
        assert (twist == 1e6).all() == (k in (0, 3))
        assert np.isfinite(message.pose.covariance).all()
    (note,) = bag_notes(motions)
    assert "not determined at frame 3, and poses are unknown from there (variance 1e6)" in note
    _, covariance = read_odometry_bag(tmp_path / "bag")
    assert [np.isnan(c).all() for c in covariance] == [k >= 3 for k in range(7)]


def test_a_standstill_needs_no_scale():
    still = replace(steps(1)[0], T_k_prev=RigidTransform.identity(), status=Status.STILL, scale_known=False)
    assert _has_scale([still, *steps(2)])
    assert not _has_scale([still, *unscaled_steps(1)])
    assert _has_scale([*steps(2), *(replace(m, length_predicted=True) for m in unscaled_steps(1))])
