import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.simulation import IDEAL_SENSOR, Flight, PlanesWorld, Sensor, SimulatedSequence
from flowlik.simulation._base import Frame
from flowlik.simulation.flight._sensor import displayed, motion_blurred, noisy, point_spread, vignetted
from flowlik.simulation.flight._trajectories import training
from tests.simulation.flight.moving import MovingWorld

CAMERA = Pinhole(120, 80, 100.0, 100.0, 59.5, 39.5)


def moved_by(length_px: float, period_px: float, angle: float = 0.0) -> tuple[Frame, RigidTransform]:
    """A grating on a wall, and a motion that shifts it along its normal while the shutter is open."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    phase = 2 * np.pi / period_px * (np.cos(angle) * (u - 59.5) + np.sin(angle) * (v - 39.5))
    frame = Frame((0.5 + 0.3 * np.cos(phase)).astype(np.float32), np.full(u.shape, 10.0))
    shift_m = 10.0 * length_px / 100.0 * np.array([np.cos(angle), np.sin(angle), 0])
    return frame, RigidTransform.from_translation(shift_m[None])


@pytest.mark.parametrize("level", [0.02, 0.2, 0.8])
def test_noise_is_that_of_electrons(level: float) -> None:
    light = np.full((300, 300), level, np.float32)
    electrons = 1e4 * noisy(light, 1e4, 5.0, np.random.default_rng(0)).astype(np.float64)
    variance = 1e4 * level + 5.0**2
    low, high = chi2.ppf([1e-4, 1 - 1e-4], electrons.size - 1) * variance / (electrons.size - 1)
    assert low < electrons.var(ddof=1) < high
    assert abs(electrons.mean() - 1e4 * level) < 4 * np.sqrt(variance / electrons.size)


@pytest.mark.parametrize(
    ("grey", "low", "high"), [(30, 1.4, 2.0), (60, 1.2, 1.6), (128, 1.1, 1.4), (220, 1.0, 1.3)]
)
def test_noise_in_grey_levels_is_that_of_real_cameras(grey: int, low: float, high: float) -> None:
    light = np.full((200, 200), (grey / 255) ** 2.2, np.float32)
    sensor = replace(IDEAL_SENSOR, full_well_e=Sensor().full_well_e, read_noise_e=Sensor().read_noise_e)
    camera = Pinhole.from_fov(200, 200, 90.0)
    signal = sensor.signal(light, camera)
    assert signal.mean() == pytest.approx(grey, abs=0.2)
    assert low < signal.std() < high


def test_response_shows_middle_grey_where_displays_do() -> None:
    grey = displayed(np.array([[0.0, 0.18, 1.0, 3.0, -1.0]], np.float32), 2.2)[0]
    np.testing.assert_allclose(grey, [0, 117, 255, 255, 0], atol=0.1)
    np.testing.assert_allclose(displayed(np.array([[0.3]], np.float32), 1.0), 0.3 * 255, rtol=1e-6)


def test_ideal_sensor_is_response_and_rounding_alone() -> None:
    light = np.random.default_rng(0).uniform(-0.1, 1.2, (80, 120)).astype(np.float32)
    image = IDEAL_SENSOR.expose(light, CAMERA, seed=3, k=5, time_s=0.7)
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(image, np.rint(255 * np.clip(light, 0, 1) ** np.float32(1 / 2.2)))


def test_point_spread_is_a_gaussian() -> None:
    light = np.random.default_rng(0).uniform(0, 1, (40, 50)).astype(np.float32)
    expected = gaussian_filter(light.astype(np.float64), 0.8, mode="nearest")
    np.testing.assert_allclose(point_spread(light, 0.8), expected, atol=0.002)


def test_vignetting_takes_its_share_in_the_corner_and_nothing_in_the_middle() -> None:
    camera = Pinhole(121, 81, 100.0, 100.0, 60.0, 40.0)
    seen = vignetted(np.ones((81, 121), np.float32), camera, 0.3)
    assert seen[40, 60] == 1
    np.testing.assert_allclose(seen[[0, 0, -1, -1], [0, -1, 0, -1]], 0.7, rtol=1e-6)
    assert (np.diff(seen[40, 60:]) < 0).all()
    # the corner's own loss at a wide angle is the lens's cos^4
    wide = Pinhole(121, 81, 60.0, 60.0, 60.0, 40.0)
    cosine = 1 / np.linalg.norm(wide.rays(wide.pixel_grid()), axis=1).reshape(81, 121)
    np.testing.assert_allclose(
        vignetted(np.ones((81, 121), np.float32), wide, 1 - cosine[0, 0] ** 4), cosine**4, rtol=1e-5
    )


def test_exposure_steps_have_their_spread_and_depend_on_seed_and_time_alone() -> None:
    sensor = Sensor(gain=0.7, gain_sd=0.05, gamma_sd=0.01, hold_s=0.1)
    steps = np.array([sensor.exposure_at(3, 0.1 * i) for i in range(2000)])
    for values, mean, sd in zip(np.log(steps).T, np.log([0.7, 2.2]), (0.05, 0.01)):
        low, high = chi2.ppf([1e-4, 1 - 1e-4], 1999) * sd**2 / 1999
        assert low < values.var(ddof=1) < high
        assert abs(values.mean() - mean) < 4 * sd / np.sqrt(2000)
        assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 0.1
    assert sensor.exposure_at(3, 0.31) == sensor.exposure_at(3, 0.39) == tuple(steps[3])
    assert sensor.exposure_at(4, 0.31) != tuple(steps[3])
    assert Sensor(gain_sd=0, gamma_sd=0).exposure_at(3, 0.31) == (1.0, 2.2)


def test_exposure_changes_the_whole_image() -> None:
    light = np.full((80, 120), 0.2, np.float32)
    bright, dark = (replace(IDEAL_SENSOR, gain=gain).signal(light, CAMERA) for gain in (1.0, 0.5))
    np.testing.assert_allclose(dark, bright * 0.5 ** (1 / 2.2), rtol=1e-5)


def test_noise_differs_between_frames_eyes_and_seeds_and_repeats_itself() -> None:
    light, sensor = np.full((80, 120), 0.2, np.float32), Sensor()
    calls = [{}, {"k": 1}, {"eye": 1}, {"seed": 1}, {"seed": 1, "k": 1}]
    images = [sensor.expose(light, CAMERA, **call).tobytes() for call in calls]
    assert len(set(images)) == len(calls)
    assert sensor.expose(light, CAMERA, seed=1, k=1).tobytes() == images[-1]


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.4])
@pytest.mark.parametrize("length_px", [0.5, 1.5, 3.0, 7.0])
def test_a_grating_fades_as_it_must_and_stays_where_it_is(length_px: float, angle: float) -> None:
    period_px = 16.0
    frame, motion = moved_by(length_px, period_px, angle)
    blurred = motion_blurred(frame, CAMERA, motion)
    inner = (slice(8, -8), slice(8, -8))
    expected = 0.5 + np.sinc(length_px / period_px) * (frame.radiance - 0.5)
    np.testing.assert_allclose(blurred[inner], expected[inner], atol=0.004)


def test_without_motion_nothing_is_blurred() -> None:
    frame, motion = moved_by(0.0, 5.0)
    np.testing.assert_array_equal(motion_blurred(frame, CAMERA, motion), frame.radiance)


def test_movers_are_blurred_along_their_own_motion() -> None:
    frame, motion = moved_by(4.0, 8.0)
    movers = np.full(frame.depth.shape, -1, np.int16)
    movers[:, 60:] = 0
    frame = Frame(frame.radiance, frame.depth, movers)
    still = RigidTransform.identity().as_matrix()
    motions = RigidTransform.from_matrix(np.stack([still, motion.as_matrix()[0]]))
    blurred = motion_blurred(frame, CAMERA, motions)
    np.testing.assert_array_equal(blurred[:, :60], frame.radiance[:, :60])
    assert np.abs(blurred[:, 64:-8] - frame.radiance[:, 64:-8]).max() > 0.05


def sharp_blurred_and_oracle(world, poses, camera, exposure_s, k):
    """Images of frame k without motion blur, blurred along its flow, and averaged over 16 sub-frames."""
    settings = ((0.0, 0), (exposure_s, 0), (exposure_s, 16))
    sensors = [replace(IDEAL_SENSOR, exposure_s=time_s, subframes=count) for time_s, count in settings]
    return [SimulatedSequence(world, Flight.of(poses), camera, s).image(k).astype(float) for s in sensors]


def rms(values) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("k", [0, 5, 11])
def test_blur_along_the_flow_is_nearly_that_of_many_subframes(camera: Pinhole, k: int) -> None:
    sharp, blurred, oracle = sharp_blurred_and_oracle(
        PlanesWorld(), training(12, speed_mps=24.0), camera, 1 / 120, k
    )
    assert rms(sharp - oracle) > 5
    assert rms(blurred - oracle) < 0.3 * rms(sharp - oracle)
    assert abs(np.mean(blurred - oracle)) < 0.2


def test_blur_of_moving_things_is_that_of_many_subframes(camera: Pinhole) -> None:
    drifting = RigidTransform.from_translation(np.linspace([0, 0, 0], [-0.2, 0, 0.5], 7))
    world = MovingWorld()
    sharp, blurred, oracle = sharp_blurred_and_oracle(world, drifting, camera, 0.1, 3)
    movers = world.render(drifting[3], camera, 0.05).movers
    for label in (0, 1):
        inside = cv2.erode((movers == label).astype(np.uint8), np.ones((9, 9))) > 0
        assert inside.sum() > 80
        assert rms((sharp - oracle)[inside]) > 1.5
        # rounding of both alone makes 0.4
        assert rms((blurred - oracle)[inside]) < 0.4 * rms((sharp - oracle)[inside])


def test_same_bytes_for_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    frame, motion = moved_by(3.3, 9.0, 0.7)
    blurred = []
    for threads in (1, 2, 3):
        monkeypatch.setattr("flowlik.support.threads.THREADS", threads)
        blurred.append(motion_blurred(frame, CAMERA, motion).tobytes())
    assert len(set(blurred)) == 1


def test_the_default_sensor_costs_little_beside_rendering() -> None:
    camera = Pinhole.from_fov(640, 360, 120.0)
    sequence = SimulatedSequence(PlanesWorld(), Flight.of(training(3)), camera)
    sequence.image(0)
    spent_s = []
    for _ in range(5):
        start = time.process_time()
        sequence.image(0)
        spent_s.append(time.process_time() - start)
    # some 0.02 s of processor time here; the bound is for slow machines
    assert min(spent_s) < 0.2


@pytest.mark.parametrize(
    "bad",
    [{"psf_sigma_px": -1}, {"read_noise_e": np.nan}, {"full_well_e": 0}, {"full_well_e": np.inf},
     {"gamma": 0}, {"vignetting": 1.0}, {"exposure_s": -1}, {"gain": 0}, {"hold_s": 0}, {"subframes": -1}],
)  # fmt: skip
def test_impossible_sensors_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(DataError, match="impossible"):
        Sensor(**bad)
