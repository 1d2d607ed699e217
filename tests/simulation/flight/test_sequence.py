import hashlib
import json
import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets.next_frame import true_flow
from flowlik.errors import DataError, MissingFieldError
from flowlik.geometry.camera import Pinhole
from flowlik.simulation import IDEAL_SENSOR, Flight, PlanesWorld, Sensor, SimulatedSequence, simulate
from flowlik.simulation.flight._trajectories import straight


def depth_smooth(depth: NDArray[np.float64]) -> NDArray[np.bool_]:
    """No depth edge (ratio above 1.1 in the 3x3) within 10 px."""
    kernel = np.ones((3, 3))
    edge = (cv2.dilate(depth, kernel) > 1.1 * cv2.erode(depth, kernel)).astype(np.uint8)
    return cv2.dilate(edge, np.ones((21, 21))) == 0


def eigenvalues(image: NDArray[np.uint8]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eigenvalues of the structure tensor, Scharr / 32 and mean over 5x5, independent of the library."""
    dx, dy = (cv2.Scharr(image, cv2.CV_64F, *order) / 32 for order in ((1, 0), (0, 1)))
    xx, xy, yy = (cv2.blur(product, (5, 5)) for product in (dx * dx, dx * dy, dy * dy))
    mean, spread = (xx + yy) / 2, np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    return mean + spread, mean - spread


def test_flow_is_the_reprojection_by_opencv(training_noisy: SimulatedSequence) -> None:
    sequence, k = training_noisy, 57
    camera = sequence.camera
    pixels = camera.pixel_grid()
    points_n = sequence.T_n_c(k).apply(camera.rays(pixels) * sequence.depth(k).reshape(-1, 1))
    T_c_n = sequence.T_n_c(k + 1).inv()
    ends, _ = cv2.projectPoints(
        np.ascontiguousarray(points_n), T_c_n.rotation.as_rotvec(), T_c_n.translation, camera.K, None
    )
    in_front = T_c_n.apply(points_n)[:, 2] > 0
    flow = sequence.flow(k).reshape(-1, 2)
    assert np.isnan(flow[~in_front]).all()
    np.testing.assert_allclose(flow[in_front], (ends[:, 0] - pixels)[in_front], atol=1e-6)


def test_sky_moves_with_the_rotation_alone_and_points_behind_have_no_flow() -> None:
    camera = Pinhole.from_fov(8, 6, 90.0)
    turn = Rotation.from_rotvec([0, 0.1, 0])
    motion = RigidTransform.from_components([0.5, 0, -2.0], turn)
    depth = np.full((6, 8), np.inf)
    depth[0, 0], depth[0, 1], depth[0, 2] = 1.0, np.nan, 0.0
    flow = true_flow(camera, depth, motion)
    expected = camera.v2p(turn.apply(camera.rays(camera.pixel_grid()))) - camera.pixel_grid()
    np.testing.assert_allclose(flow.reshape(-1, 2)[3:], expected[3:], atol=1e-12)
    assert np.isnan(flow[0, :3]).all()


@pytest.mark.parametrize("k", [0, 90, 180])
def test_next_image_warped_by_the_true_flow_is_this_image(straight_ideal: SimulatedSequence, k: int) -> None:
    sequence = straight_ideal
    image, later = sequence.image(k).astype(np.float32), sequence.image(k + 1).astype(np.float32)
    ends = (sequence.camera.pixel_grid().reshape(*image.shape, 2) + sequence.flow(k)).astype(np.float32)
    warped = cv2.remap(later, ends[..., 0], ends[..., 1], cv2.INTER_CUBIC)
    compared = sequence.visible(k) & depth_smooth(sequence.depth(k))
    assert compared.mean() > 0.3
    assert np.median(np.abs(warped - image)[compared]) <= 1.2
    assert np.median(np.abs(later - image)[compared]) > 3


def test_lucas_kanade_shows_no_half_pixel_bias(camera: Pinhole) -> None:
    """LK falls short along the motion, so a fixed offset is what flights to and fro have in common."""
    there = RigidTransform.from_translation(np.linspace([-0.75, 0.3, 20], [0.75, -0.3, 20.5], 13))
    biases = []
    for poses in (there, there[::-1]):
        sequence, errors = SimulatedSequence(PlanesWorld(), Flight.of(poses), camera, IDEAL_SENSOR), []
        for k in range(0, 12, 3):
            image, later = sequence.image(k), sequence.image(k + 1)
            wanted = sequence.visible(k) & depth_smooth(sequence.depth(k)) & (eigenvalues(image)[1] > 20)
            starts = camera.pixel_grid().reshape(*image.shape, 2)[wanted].astype(np.float32)[:, None]
            ends, _, _ = cv2.calcOpticalFlowPyrLK(image, later, starts, None, winSize=(21, 21))
            errors.append((ends - starts)[:, 0] - sequence.flow(k)[wanted])
        error = np.concatenate(errors)
        tracked = error[np.linalg.norm(error, axis=1) < 1]
        assert len(tracked) > 10_000
        assert (np.abs(np.median(tracked, axis=0)) < 0.04).all()
        biases.append(np.median(tracked, axis=0))
    assert (np.abs(np.mean(biases, axis=0)) < 0.01).all()


def test_texture_spreads_over_many_decades(training_noisy: SimulatedSequence) -> None:
    ideal = SimulatedSequence(
        PlanesWorld(), Flight.of(training_noisy.poses), training_noisy.camera, IDEAL_SENSOR
    )
    for sequence in (training_noisy, ideal):
        t1, t2 = np.stack([eigenvalues(sequence.image(k)) for k in range(0, 400, 50)], axis=1)
        assert np.quantile(t2, 0.05) < 0.3 and np.quantile(t2, 0.99) > 150
        assert np.quantile(t1, 0.999) > 1000
        counts, _ = np.histogram(
            np.log10(np.maximum(np.concatenate([t1, t2]), 1e-9)), np.arange(-1, 3.5, 0.5)
        )
        assert (counts > 0.005 * t1.size).all()
        # the aperture problem: an edge without a second direction
        assert ((t1 > 100) & (t2 < 5)).mean() > 0.005


def test_visible_is_the_definition_pixel_by_pixel(straight_ideal: SimulatedSequence) -> None:
    sequence, k = straight_ideal, 90
    camera, depth, later = sequence.camera, sequence.depth(k), sequence.depth(k + 1)
    motion = sequence.T_n_c(k + 1).inv() * sequence.T_n_c(k)
    visible = sequence.visible(k)
    assert 0.5 < visible.mean() < 0.98
    for u, v in np.random.default_rng(0).integers(0, [camera.width, camera.height], (300, 2)):
        point = motion.apply(camera.rays(np.array([u, v], float)) * depth[v, u])
        end = camera.v2p(point)
        expected = bool(camera.contains(end))
        if expected:
            columns, rows = ({int(np.floor(x)), int(np.ceil(x))} for x in end)
            around = np.array([later[r, c] for r in rows for c in columns])
            expected = bool((np.abs(point[2] / around - 1) <= 0.02).all())
        assert visible[v, u] == expected


def test_frames_are_the_same_however_they_are_reached(camera: Pinhole) -> None:
    first, second = (simulate("planes", "curve", frames=4, camera=camera) for _ in range(2))
    forth = [first.image(k).tobytes() for k in (0, 1, 2)]
    back = [second.image(k).tobytes() for k in (2, 1, 0)]
    assert forth == back[::-1] and len(set(forth)) == 3
    assert pickle.loads(pickle.dumps(first)).image(1).tobytes() == forth[1]


@pytest.mark.parametrize("world", ["planes", "grid"])
def test_a_sequence_is_sent_without_what_was_built(camera: Pinhole, world: str) -> None:
    sequence = simulate(world, "curve", frames=4, camera=camera)
    expected = sequence.image(1).tobytes()
    data = pickle.dumps(sequence)
    assert len(data) < 20_000
    first, second = pickle.loads(data), pickle.loads(data)
    assert first.world is second.world
    assert first.image(1).tobytes() == expected


def _image_bytes(sequence: SimulatedSequence, k: int) -> bytes:
    return sequence.image(k).tobytes()


def test_process_pools_render_after_this_process_has(straight_ideal: SimulatedSequence) -> None:
    here = _image_bytes(straight_ideal, 7)
    with ProcessPoolExecutor(1) as pool:
        assert pool.submit(_image_bytes, straight_ideal, 7).result(timeout=60) == here


def test_depth_handed_out_may_be_written_to(straight_ideal: SimulatedSequence) -> None:
    straight_ideal.depth(0)[:] = 0
    assert straight_ideal.depth(0).min() > 0
    assert not straight_ideal.frame(0).radiance.flags.writeable


def test_time_and_length(straight_ideal: SimulatedSequence) -> None:
    assert len(straight_ideal) == 200
    assert straight_ideal.timestamp(30) == pytest.approx(0.5)
    with pytest.raises(DataError, match="no frame 200, there are 200 frames"):
        straight_ideal.flow(199)
    with pytest.raises(DataError, match="no frame -1"):
        straight_ideal.image(-1)


@pytest.mark.parametrize(
    ("position", "message"),
    [([0, 2.4, 5.0], "frame 1 .* is 0.10 m from a surface"), ([0, 9.0, 5.0], "outside the world")],
)
def test_poses_too_near_or_outside_are_refused(position: list[float], message: str) -> None:
    poses = RigidTransform.from_translation([[0, 0, 0], position])
    with pytest.raises(DataError, match=message):
        SimulatedSequence(PlanesWorld(), Flight.of(poses))


def test_one_pose_is_not_a_sequence_of_poses() -> None:
    with pytest.raises(DataError, match="array of at least one pose"):
        Flight.of(RigidTransform.identity())


def test_poses_that_are_not_finite_are_refused() -> None:
    poses = RigidTransform.from_translation([[0, 0, 0], [0, 0, np.nan]])
    with pytest.raises(DataError, match="pose of frame 1 is not finite"):
        Flight.of(poses)


@pytest.mark.parametrize("frames_per_second", [0.0, np.nan])
def test_an_impossible_frame_rate_is_refused(frames_per_second: float) -> None:
    with pytest.raises(DataError, match=f"frame rate {frames_per_second} must be positive"):
        Flight.of(straight(3), frames_per_second)
    with pytest.raises(DataError, match=f"frame rate {frames_per_second} must be positive"):
        Flight(straight(3), np.arange(3.0), frames_per_second)


@pytest.mark.parametrize(
    ("times_s", "message"),
    [([0.0, 1.0], "2 timestamps for 3 poses"), ([0.0, 1.0, 1.0], "times must increase")],
)
def test_impossible_times_are_refused(times_s: list[float], message: str) -> None:
    with pytest.raises(DataError, match=message):
        Flight(straight(3), np.array(times_s), 60.0)


def test_a_part_of_a_flight_keeps_its_times() -> None:
    whole = Flight(straight(9), 5.0 + np.arange(9) / 7, 7.0, "there", 2.0)
    part = whole.part(2).part(1, 4)
    np.testing.assert_array_equal(part.times_s, whole.times_s[3:7])
    np.testing.assert_array_equal(part.poses.as_matrix(), whole.poses.as_matrix()[3:7])
    assert (part.clock_start_s, part.frames_per_second, part.name, part.speed_mps) == (5.0, 7.0, "there", 2.0)


@pytest.mark.parametrize(
    ("baseline_m", "message"),
    [(-0.1, "baseline -0.1 m must be positive"), (15.9, "frame 0 .* is 0.10 m from a surface")],
)
def test_impossible_baselines_are_refused(baseline_m: float, message: str) -> None:
    with pytest.raises(DataError, match=message):
        SimulatedSequence(PlanesWorld(rectangles=0), Flight.of(straight(3)), baseline_m=baseline_m)


def test_configuration_hash_is_that_of_the_settings(camera: Pinhole) -> None:
    sequence = SimulatedSequence(PlanesWorld(), Flight.of(straight(3)), camera)
    settings = {
        "world": {"name": "planes", "seed": 0, "rectangles": 70, "samples": 8},
        "sensor": asdict(Sensor()),
        "camera": asdict(camera),
    }
    text = json.dumps(settings, sort_keys=True, separators=(",", ":"))
    assert sequence.configuration_hash == hashlib.sha256(text.encode()).hexdigest()
    assert sequence.provenance["configuration_sha256"] == sequence.configuration_hash
    others = [
        SimulatedSequence(PlanesWorld(samples=4), Flight.of(straight(3)), camera),
        SimulatedSequence(PlanesWorld(), Flight.of(straight(3)), camera, Sensor(gamma=2.0)),
        SimulatedSequence(PlanesWorld(), Flight.of(straight(3))),
    ]
    assert len({sequence.configuration_hash, *(other.configuration_hash for other in others)}) == 4
    flown_otherwise = SimulatedSequence(PlanesWorld(), Flight.of(straight(4)), camera, seed=3)
    assert flown_otherwise.configuration_hash == sequence.configuration_hash
    assert flown_otherwise.provenance["poses_sha256"] != sequence.provenance["poses_sha256"]


def test_hovering_sees_the_same_and_its_flow_is_zero(camera: Pinhole) -> None:
    sequence = simulate("planes", "hover", frames=9, camera=camera, sensor=IDEAL_SENSOR)
    assert sequence.image(0).tobytes() == sequence.image(8).tobytes()
    assert np.abs(sequence.flow(3)).max() < 1e-10
    assert sequence.visible(3).all()
    noisy = simulate("planes", "hover", frames=9, camera=camera)
    difference = noisy.image(0).astype(float) - noisy.image(1)
    assert 1 < difference.std() < 4


def test_exposure_steps_change_brightness_from_hold_to_hold(camera: Pinhole) -> None:
    sensor = replace(IDEAL_SENSOR, gain_sd=0.05)
    sequence = simulate("planes", "hover", frames=14, camera=camera, sensor=sensor)
    means = np.array([sequence.image(k).mean() for k in range(14)])
    # 60 frames/s and 0.1 s: the gain stays for six frames
    assert np.ptp(means[:6]) == np.ptp(means[6:12]) == np.ptp(means[12:]) == 0
    assert len({means[0], means[6], means[12]}) == 3


def test_right_camera_sees_what_the_left_one_does_shifted_by_the_disparity(camera: Pinhole) -> None:
    baseline_m = 0.4
    sequence = SimulatedSequence(
        PlanesWorld(), Flight.of(straight(60)[50:]), camera, IDEAL_SENSOR, baseline_m=baseline_m
    )
    depth, pixels = sequence.depth(2), camera.pixel_grid().reshape(camera.height, camera.width, 2)
    ends = (pixels - np.stack([camera.fx * baseline_m / depth, 0 * depth], axis=-1)).astype(np.float32)
    warped, found = (
        cv2.remap(image.astype(np.float32), ends[..., 0], ends[..., 1], cv2.INTER_CUBIC, borderValue=-1)
        for image in (sequence.right_image(2), sequence.right_depth(2))
    )
    seen = (np.abs(found / depth - 1) < 0.01) & camera.contains(ends)
    assert seen.mean() > 0.7
    compared = seen & depth_smooth(depth)
    left = sequence.image(2)
    assert np.median(np.abs(warped - left)[compared]) <= 1.2
    assert np.median(np.abs(sequence.right_image(2).astype(float) - left)[compared]) > 3


def test_without_a_baseline_there_is_no_right_image(straight_ideal: SimulatedSequence) -> None:
    with pytest.raises(MissingFieldError, match="right image"):
        straight_ideal.right_image(0)


def test_noise_of_the_two_cameras_is_independent(camera: Pinhole) -> None:
    sequence = SimulatedSequence(PlanesWorld(), Flight.of(straight(3)), camera, baseline_m=1e-6)
    ideal = SimulatedSequence(
        PlanesWorld(), Flight.of(straight(3)), camera, replace(Sensor(), full_well_e=None)
    )
    noise = [image.astype(float) - ideal.image(1) for image in (sequence.image(1), sequence.right_image(1))]
    assert min(part.std() for part in noise) > 0.8
    assert abs(np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]) < 0.05
