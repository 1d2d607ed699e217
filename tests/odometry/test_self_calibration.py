from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import Epipolar, lcmsac, mle, ransac
from flowlik.evaluation.motion.split_half import truth_distances
from flowlik.flow import flow_method
from flowlik.geometry.camera import Distortion
from flowlik.odometry.odometry import Odometry
from flowlik.odometry.self_calibration import FrameEvidence, Intrinsics, SelfCalibration
from tests.helpers import CAMERA, lcm_likelihood, make_scene, random_motion

MODEL = lcm_likelihood()
SETTINGS = SelfCalibration((("cx", 4.0), ("k1", 0.02)))
TRUE = replace(CAMERA, cx=CAMERA.cx - 4)
DISTORTION = Distortion(-0.015)


def test_distortion_is_opencvs_and_undone():
    points = np.random.default_rng(0).uniform(-0.9, 0.9, (50, 2))
    d = Distortion(-0.05, 0.01)
    rays = np.column_stack([points, np.ones(50)])
    expected, _ = cv2.projectPoints(
        rays, np.zeros(3), np.zeros(3), np.eye(3), np.array([-0.05, 0.01, 0, 0.0])
    )
    np.testing.assert_allclose(d.distort(points), expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(d.undistort(d.distort(points)), points, atol=1e-9)
    np.testing.assert_array_equal(Distortion().undistort(points), points)
    np.testing.assert_array_equal(d.undistort(np.zeros((1, 2))), 0)


def test_a_distance_is_stretched_as_it_is_seen():
    rng, d, step = np.random.default_rng(1), Distortion(-0.05, 0.01), 1e-6
    points, angle = rng.uniform(-0.9, 0.9, (50, 2)), rng.uniform(0, 2 * np.pi, 50)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    along = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    line = d.distort(points + step * along) - d.distort(points - step * along)
    away = d.distort(points + step * normals) - d.distort(points)
    expected = np.abs(line[:, 0] * away[:, 1] - line[:, 1] * away[:, 0]) / np.linalg.norm(line, axis=1) / step
    np.testing.assert_allclose(d.stretch(points, normals), expected, rtol=1e-5)


def as_seen(m, camera=TRUE, lens=DISTORTION):
    """Measurements of the nominal camera as a camera with other intrinsics sees them."""

    def seen(pixels):
        rays = CAMERA.rays(pixels)
        rays[:, :2] = lens.distort(rays[:, :2])
        return camera.v2p(rays)

    begin, end = seen(m.pixels), seen(m.pixels + m.flow)
    return replace(m, pixels=begin, flow=end - begin)


def test_rectified_measurements_are_those_of_a_pinhole():
    scene = make_scene(random_motion(np.random.default_rng(0)), np.random.default_rng(1), n=50)
    known = Intrinsics.prior(CAMERA, SETTINGS)
    known = replace(known, state=np.array([-4.0, -0.015, 0, 0]))
    assert (known.camera, known.distortion) == (TRUE, DISTORTION)
    m = known.rectified(as_seen(scene.measurements))
    expected = CAMERA.rays(scene.measurements.pixels)
    np.testing.assert_allclose(known.camera.rays(m.pixels), expected, atol=1e-9)


def evidence(H, b, excess=1.0):
    return FrameEvidence(H, b, excess, np.zeros((6, len(b))))


@pytest.fixture(scope="module")
def states():
    """Intrinsics after each of forty frames of a camera other than it is thought to be."""
    rng, estimator = np.random.default_rng(2), mle(MODEL)
    states = [Intrinsics.prior(CAMERA, SETTINGS)]
    for k in range(40):
        m = as_seen(make_scene(random_motion(rng, 2.0, 0.5), rng, n=300, likelihood=MODEL).measurements)
        state = states[-1]
        found = estimator.estimate(Epipolar.of(state.rectified(m), state.camera), seed=k)
        states.append(state.updated(state.evidence(m, found.T_k_prev.as_matrix()[:3], estimator)))
    return states


def test_intrinsics_are_found_from_flow_alone(states):
    last, truth = states[-1], np.array([-4.0, -0.015])
    assert last.frames == 40
    assert (np.abs(last.values - truth) < 0.3 * np.abs(truth)).all()
    assert (np.abs(last.values - truth) < 4 * last.sigma).all()


def test_they_become_more_certain_but_never_for_good(states):
    sigmas = np.array([s.sigma for s in states])
    assert (np.diff(sigmas[:20], axis=0) < 0).all()
    still = states[-1].updated(evidence(np.zeros((2, 2)), np.zeros(2)))
    assert (still.sigma > states[-1].sigma).all()
    np.testing.assert_array_equal(still.values, states[-1].values)


def test_slopes_by_the_parameters_are_those_of_the_errors_as_seen():
    """Against differences of an independent formula: distances from the line as OpenCV shows it."""
    rng = np.random.default_rng(5)
    motion = random_motion(rng, 1.0, 0.5)
    m = as_seen(make_scene(motion, rng, n=60, likelihood=MODEL).measurements)
    T = motion.as_matrix()[:3]
    state = replace(Intrinsics.prior(CAMERA, SETTINGS), state=np.array([-3.0, -0.01, 0, 0]))
    z, G = state.linearise(m, T)

    def distances(values):
        K = replace(CAMERA, cx=CAMERA.cx + values[0]).K
        d = np.array([values[1], 0, 0, 0, 0])

        def ideal(p):
            seen = (p - K[:2, 2]) / K[[0, 1], [0, 1]]
            x = seen
            for _ in range(100):
                x = seen / (1 + d[0] * (x**2).sum(axis=1, keepdims=True))
            return x

        begin, end = ideal(m.pixels), ideal(m.pixels + m.flow)
        out = []
        for x1, x2 in zip(begin, end):
            t, moved = T[:, 3], T[:, :3] @ [*x1, 1.0]
            line = np.cross(t, moved)
            n = line[:2] / np.linalg.norm(line[:2])
            distance = line @ [*x2, 1.0] / np.linalg.norm(line[:2])
            foot = x2 - distance * n
            ends = cv2.projectPoints(
                np.array([[*x2, 1], [*foot, 1], [*(foot + 1e-6 * np.array([-n[1], n[0]])), 1]]),
                np.zeros(3), np.zeros(3), K, d,
            )[0][:, 0]  # fmt: skip
            along = (ends[2] - ends[1]) / np.linalg.norm(ends[2] - ends[1])
            seen = ends[0] - ends[1]
            out.append(np.sign(distance) * abs(along[0] * seen[1] - along[1] * seen[0]))
        return np.array(out)

    np.testing.assert_allclose(np.abs(z), np.abs(distances(state.values)), atol=2e-3, rtol=1e-2)
    for i, step in enumerate((0.05, 1e-4)):
        change = step * np.eye(2)[i]
        expected = (distances(state.values + change) - distances(state.values - change)) / (2 * step)
        scale = np.abs(expected).max()
        same = np.sign(z) == np.sign(distances(state.values))
        np.testing.assert_allclose(np.where(same, G[:, i], -G[:, i]), expected, atol=0.02 * scale)


def test_the_filter_is_the_batch_solution_of_its_model():
    """Linear frames: against generalised least squares over all of them at once, noise correlated in time."""
    rng, frames = np.random.default_rng(3), 30
    prior = SETTINGS.prior_variances
    settings = replace(SETTINGS, drift=0.0, trusted=np.inf)
    truth = np.array([-3.0, 0.01])
    state, rows, told = Intrinsics.prior(CAMERA, settings), [], []
    for _ in range(frames):
        A = rng.standard_normal((6, 2)) / np.sqrt(prior)
        H = A.T @ A
        unit = np.sqrt(prior)
        values, vectors = np.linalg.eigh(unit[:, None] * H * unit)
        root = (vectors * np.sqrt(values)) @ vectors.T / unit  # H = root^T root
        u = root @ truth + rng.standard_normal(2)
        state = state.updated(evidence(H, root.T @ u - H @ state.values))
        rows.append(root)
        told.append(u)
    lags = np.abs(np.subtract.outer(np.arange(frames), np.arange(frames)))
    over_time = settings.noise * (lags == 0) + settings.persistent * np.exp(-lags / settings.memory)
    weight = np.kron(np.linalg.inv(over_time), np.eye(2))
    W, u = np.concatenate(rows), np.concatenate(told)
    covariance = np.linalg.inv(W.T @ weight @ W + np.diag(1 / prior))
    np.testing.assert_allclose(state.covariance, covariance, rtol=1e-6)
    np.testing.assert_allclose(state.values, covariance @ W.T @ weight @ u, rtol=1e-6)


def test_a_motion_hangs_on_the_camera_as_its_slopes_say():
    rng, estimator = np.random.default_rng(6), ransac(1.0)
    motion = random_motion(rng, 1.0, 0.5)
    m = make_scene(motion, rng, n=200).measurements
    state = Intrinsics.prior(CAMERA, SETTINGS)

    def found(values):
        at = replace(state, state=np.concatenate([values, np.zeros(2)]))
        return estimator.estimate(Epipolar.of(at.rectified(m), at.camera), start=motion).T_k_prev

    here = found(np.zeros(2))
    slopes = state.evidence(m, here.as_matrix()[:3], estimator).motion_slopes
    for i, step in enumerate((0.3, 0.001)):
        there, back = (found(sign * step * np.eye(2)[i]) for sign in (1, -1))
        moved = (there * back.inv()).as_exp_coords() / (2 * step)
        np.testing.assert_allclose(slopes[:, i], moved, atol=0.03 * np.abs(moved).max())


def test_the_motions_covariance_knows_that_the_camera_is_not_known():
    """Cameras drawn from the prior: by their covariance, motions err no more than with the right camera."""
    rng, estimator, settings = (
        np.random.default_rng(8),
        lcmsac(MODEL),
        SelfCalibration((("cx", 1.0), ("k1", 0.006))),
    )
    distances = {"right": [], "as given": [], "self-calibrated": []}
    for k in range(40):
        true, lens = (
            replace(CAMERA, cx=CAMERA.cx + rng.standard_normal()),
            Distortion(0.006 * rng.standard_normal()),
        )
        motion = random_motion(rng, 1.0, 0.5)
        scene = make_scene(motion, rng, n=300, likelihood=MODEL)
        seen = as_seen(scene.measurements, true, lens)
        odometry = Odometry(CAMERA, flow_method("lucas-kanade"), estimator, k, self_calibration=settings)
        found = {
            "right": estimator.estimate(scene.epipolar, k),
            "as given": estimator.estimate(Epipolar.of(seen, CAMERA), k),
            "self-calibrated": odometry.advance(seen),
        }
        for name, answer in found.items():
            distances[name] += list(truth_distances([answer], [motion]))
    median = {name: np.median(values) for name, values in distances.items()}
    assert median["as given"] > 3 * median["right"]
    assert median["self-calibrated"] < 1.3 * median["right"]


def test_where_images_say_nothing_the_prior_stays():
    """On a straight road every intrinsics explain the flow along the axis: nothing is believed."""
    rng, state = np.random.default_rng(4), Intrinsics.prior(CAMERA, SETTINGS)
    forward = RigidTransform.from_translation([0, 0, -0.5])
    for _ in range(30):
        m = make_scene(forward, rng, n=300, likelihood=MODEL).measurements
        state = state.updated(state.evidence(m, forward.as_matrix()[:3], mle(MODEL)))
    assert (np.abs(state.values) < 2 * np.sqrt(SETTINGS.prior_variances)).all()
    assert state.sigma[0] > 0.5 * 4.0


@pytest.mark.parametrize("inliers", [0, 2])
def test_a_frame_of_hardly_any_inliers_says_nothing_of_the_camera(inliers):
    rng = np.random.default_rng(10)
    motion = random_motion(rng, 2.0, 0.5)
    m = make_scene(motion, rng, n=100).measurements
    lost = replace(m, flow=m.flow + np.where(np.arange(100) < inliers, 0.0, 300.0)[:, None])
    state = Intrinsics.prior(CAMERA, SETTINGS)
    after = state.updated(state.evidence(lost, motion.as_matrix()[:3], lcmsac(MODEL)))
    assert np.isfinite(after.joint).all()
    assert (np.abs(after.values) < 0.1 * np.sqrt(SETTINGS.prior_variances)).all()
    assert (after.sigma > 0.9 * np.sqrt(SETTINGS.prior_variances)).all()


def test_a_frame_of_wrong_tracks_is_hardly_believed(states):
    rng = np.random.default_rng(7)
    motion = random_motion(rng, 2.0, 0.5)
    m = make_scene(motion, rng, n=300, likelihood=MODEL).measurements
    wrong = rng.random(len(m)) < 2 / 3
    torn = replace(m, flow=m.flow + np.where(wrong[:, None], [6.0, 4.0], 0.0))
    state, T = Intrinsics.prior(CAMERA, SETTINGS), motion.as_matrix()[:3]
    good = state.evidence(m, T, mle(MODEL)).excess
    H, b, bad, _ = state.evidence(torn, T, mle(MODEL))
    assert good < 2
    assert bad > 3 * good
    trusting, wary = state.updated(evidence(H, b)), state.updated(evidence(H, b, bad))
    assert (np.abs(wary.values) <= np.abs(trusting.values)).all()
    assert (wary.sigma > trusting.sigma).all()


def test_frames_of_wrong_tracks_that_agree_are_not_as_many_witnesses():
    H, b = np.diag([1.0, 1e4, 1e4]), np.array([-8.0, 0.0, 0.0])
    states = [Intrinsics.prior(CAMERA, SelfCalibration())]
    for _ in range(10):
        states.append(states[-1].updated(evidence(H, b - H @ states[-1].values, 3.0)))
    assert states[10].sigma[0] > 0.7 * states[1].sigma[0]


@pytest.mark.parametrize(
    "lens", [Distortion(-0.3, 0.02), Distortion(-0.2), Distortion(0.1, -0.05), Distortion(0.1)]
)
def test_points_that_no_lens_shows_stay_finite(lens):
    """Tracks are lost far outside the image; beyond the fold of a lens there is no true point."""
    seen = np.array([[1e-3, 0.0], [30.0, -40.0], [1e4, 1e4], [0.0, 0.0]])
    true = lens.undistort(seen)
    assert np.isfinite(true).all()
    radius = np.linalg.norm(true, axis=1)
    assert (radius <= np.minimum(np.linalg.norm(seen, axis=1), lens.fold) * (1 + 1e-12) + 1e-3).all()
    if np.isfinite(lens.fold):
        step = np.array([[lens.fold * (1 + s), 0.0] for s in (-1e-3, 0.0, 1e-3)])
        before, at, after = lens.distort(step)[:, 0]
        assert at > max(before, after)


def test_wrong_tracks_that_slip_alike_do_not_move_the_camera():
    """As along a guard rail: a seventh of the tracks, on one side, off by 1.6 px in one direction."""
    rng, estimator = np.random.default_rng(9), lcmsac(MODEL)
    state = Intrinsics.prior(CAMERA, SelfCalibration())
    for _ in range(30):
        motion = random_motion(rng, 2.0, 0.5)
        m = make_scene(motion, rng, n=600, likelihood=MODEL).measurements
        railing = (m.pixels[:, 0] < 0.25 * CAMERA.width) & (m.pixels[:, 1] > 0.4 * CAMERA.height)
        slipped = replace(m, flow=m.flow + np.where(railing[:, None], [1.5, -0.5], 0.0))
        residual = Epipolar.of(state.rectified(slipped), state.camera)
        found = estimator.estimate(residual, start=motion)
        state = state.updated(state.evidence(slipped, found.T_k_prev.as_matrix()[:3], estimator))
    assert (np.abs(state.values) < 2 * state.sigma).all()
