from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import EgoMotion, Status, lcmsac, ransac
from flowlik.errors import DataError, ModelError
from flowlik.flow import Farneback, LucasKanade
from flowlik.flow.base import DenseFlow
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import exp_se3, h, inverse_range, scaled
from flowlik.image.depth import ImplausibleDepthWarning
from flowlik.image.texture import TextureDefinition, derivatives
from flowlik.measurement.features import features_of, measure_features
from flowlik.odometry.loop import measure_sequence, run_odometry
from flowlik.odometry.odometry import Odometry
from flowlik.odometry.scale import Length, scale_source, true_distance
from flowlik.support.threads import map_ahead
from tests.helpers import lcm_likelihood, textured_image

CAMERA = Pinhole.from_fov(96, 72, 90.0)
DEPTH = np.random.default_rng(0).uniform(3, 15, (72, 96))
IMAGE = textured_image((72, 96))
TWISTS = (
    (0.01, 0.02, -0.01, 0.1, -0.05, 0.3),
    (-0.02, 0.01, 0.015, 0.05, 0.1, 0.25),
    (0.0, -0.02, 0.01, -0.1, 0.0, 0.4),
)
MOTIONS = [exp_se3(np.array(xi)) for xi in TWISTS]


def frame(k: int) -> np.ndarray:
    """Image of frame k, which its first pixel tells."""
    image = IMAGE.copy()
    image[0, 0] = k
    return image


@dataclass(frozen=True)
class ExactFlow(DenseFlow):
    """Flow of known motions from frame to frame; none from the frame `lost`."""

    name: ClassVar[str] = "exact"
    twists: tuple[tuple[float, ...], ...] = TWISTS
    lost: int = -1

    def dense(self, previous, current):
        k = int(previous[0, 0])
        pixels = CAMERA.pixel_grid()
        flow = h(
            exp_se3(np.array(self.twists[k])), CAMERA, pixels, inverse_range(CAMERA, pixels, DEPTH.ravel())
        )
        return np.full((72, 96, 2), np.nan) if k == self.lost else flow.reshape(72, 96, 2)


class Frames:
    """ImageSequence of the exact flow, with poses."""

    name = "frames"
    camera = CAMERA

    def __len__(self):
        return len(TWISTS) + 1

    def image(self, k):
        return frame(k)

    def timestamp(self, k):
        return 0.1 * k

    def T_n_c(self, k):
        return poses(MOTIONS)[k]

    def depth(self, k):
        if k == len(TWISTS):
            raise DataError("frames: no depth of the last frame")
        return DEPTH


def poses(motions):
    """Poses that motions T_k_prev chain to, from the identity."""
    chain = [RigidTransform.identity()]
    for T in motions:
        chain.append(chain[-1] * T.inv())
    return chain


def assert_same(found, expected, atol=1e-6):
    assert len(found) == len(expected)
    for a, b in zip(found, expected):
        np.testing.assert_allclose(a.as_matrix(), b.as_matrix(), atol=atol)


# the epipolar residual is refined from the previous motion to where steps gain nothing, not to the exact one
@pytest.fixture(params=[ransac(), lcmsac(lcm_likelihood())], ids=lambda e: e.name)
def estimator(request):
    return request.param


def test_known_depth_chains_to_the_true_poses(estimator):
    odometry = Odometry(CAMERA, ExactFlow(), estimator)
    first, *motions = [odometry.step(frame(k), 0.1 * k, DEPTH) for k in range(4)]
    assert (first.status, first.solved) == (Status.TOO_FEW, False)
    np.testing.assert_array_equal(first.T_k_prev.as_matrix(), np.eye(4))
    assert all(m.solved and m.scale_known for m in motions)
    assert_same([m.T_k_prev for m in motions], MOTIONS)
    assert_same(odometry.poses, poses(MOTIONS))
    assert odometry.timestamps == pytest.approx([0, 0.1, 0.2, 0.3])


def test_the_epipolar_residual_takes_its_scale_from_the_distance(estimator):
    odometry = Odometry(CAMERA, ExactFlow(), estimator)
    for k in range(4):
        distance = np.linalg.norm(MOTIONS[k - 1].translation) if k else None
        motion = odometry.step(frame(k), 0.1 * k, distance_m=distance)
    assert motion.scale_known
    assert_same(odometry.poses, poses(MOTIONS), atol=2e-3)


def test_without_a_distance_steps_have_unit_length(estimator):
    odometry = Odometry(CAMERA, ExactFlow(), estimator)
    motion = [odometry.step(frame(k), k) for k in range(2)][1]
    assert not motion.scale_known
    assert_same([motion.T_k_prev], [scaled(MOTIONS[0], 1.0)], atol=1e-3)


class Told:
    """A scale source that tells what it is given for each frame."""

    name = "told"

    def __init__(self, *lengths):
        self.lengths = (None, *lengths)

    def length(self, k, m, camera, T_k_prev, likelihood):
        assert np.linalg.norm(T_k_prev.translation) == pytest.approx(1.0)
        return self.lengths[k]


def test_a_length_that_is_not_told_or_not_believed_is_never_claimed(estimator):
    lengths = [np.linalg.norm(T.translation) for T in MOTIONS]
    told = Told(Length(lengths[0], 0.01 * lengths[0]), None, Length(110 * lengths[2], 4e-5))
    odometry = Odometry(CAMERA, ExactFlow(), estimator, scale=told)
    _, first, untold, wrong = [odometry.step(frame(k), k) for k in range(4)]
    assert (first.scale_known, first.length_predicted) == (True, False)
    assert np.linalg.norm(first.T_k_prev.translation) == pytest.approx(lengths[0])
    t = first.T_k_prev.translation / lengths[0]
    assert np.sqrt(t @ first.covariance[3:, 3:] @ t) >= 0.01 * lengths[0] * (1 - 1e-9)
    for motion in (untold, wrong):
        assert motion.solved and not motion.predicted
        assert (motion.scale_known, motion.length_predicted) == (False, True)
        assert np.linalg.norm(motion.T_k_prev.translation) == pytest.approx(lengths[0], rel=0.01)
        t = motion.T_k_prev.translation / np.linalg.norm(motion.T_k_prev.translation)
        assert np.sqrt(t @ motion.covariance[3:, 3:] @ t) > 0.04 * lengths[0]
    assert "told tells no length" in untold.reason
    assert "not expected" in wrong.reason


def test_an_unsolved_frame_repeats_the_previous_motion_and_says_so(estimator):
    odometry = Odometry(CAMERA, ExactFlow(lost=1), estimator)
    _, _, lost, after = [odometry.step(frame(k), k, DEPTH) for k in range(4)]
    assert (lost.status, lost.solved) == (Status.TOO_FEW, False)
    assert lost.excluded["no flow"] > 1000
    np.testing.assert_array_equal(lost.information, 0)
    assert (lost.predicted, after.predicted) == (True, False)
    # one motion seen: the next may be anything of its size
    sigma = np.sqrt(np.diag(lost.covariance))
    assert (sigma >= 0.99 * np.repeat([MOTIONS[0].rotation.magnitude(), 0.3], 3)).all()
    assert np.trace(after.covariance) < 0.1 * np.trace(lost.covariance)
    assert after.solved
    assert_same(odometry.poses, poses([MOTIONS[0], MOTIONS[0], MOTIONS[2]]))


def test_an_ambiguous_motion_is_repeated_without_information():
    class Doubtful:
        """Estimator that finds the first motion, then says it does not know."""

        likelihood = ransac().likelihood
        found = iter([Status.SOLVED, Status.AMBIGUOUS])

        def estimate(self, residual, seed, start=None):
            status = next(self.found)
            motion = MOTIONS[0 if status is Status.SOLVED else 2]
            return EgoMotion(motion, np.eye(6), np.eye(6), status, "doubt")

    odometry = Odometry(CAMERA, ExactFlow(), Doubtful())
    _, solved, doubtful = [odometry.step(frame(k), k, DEPTH) for k in range(3)]
    np.testing.assert_array_equal(solved.information, np.eye(6))
    assert (doubtful.status, doubtful.reason) == (Status.AMBIGUOUS, "doubt")
    np.testing.assert_array_equal(doubtful.information, 0)
    assert_same(odometry.poses, poses([MOTIONS[0], MOTIONS[0]]))


def test_the_same_seed_gives_the_same_poses(estimator):
    runs = []
    for _ in range(2):
        odometry = Odometry(CAMERA, ExactFlow(), estimator, seed=3)
        runs.append([odometry.step(frame(k), k, DEPTH).T_k_prev.as_matrix() for k in range(4)])
    np.testing.assert_array_equal(runs[0], runs[1])


@pytest.mark.parametrize("timestamp", [0.0, -1.0, float("nan")])
def test_time_must_advance(estimator, timestamp):
    odometry = Odometry(CAMERA, ExactFlow(), estimator)
    odometry.step(frame(0), 0.0, DEPTH)
    with pytest.raises(DataError, match="time does not advance"):
        odometry.step(frame(1), timestamp, DEPTH)
    odometry.step(frame(1), 0.1, DEPTH)  # the refused image left no trace
    assert_same(odometry.poses, poses(MOTIONS[:1]))


@pytest.mark.parametrize(
    ("image", "depth", "message"),
    [
        (IMAGE[:-1], None, "image of 96x71 for a camera of 96x72"),
        (IMAGE, DEPTH[:, :-1], "depth map of 95x72 for a camera of 96x72"),
        (IMAGE.astype(np.float32), None, "grey uint8"),
    ],
)
def test_what_does_not_fit_the_camera_is_refused_at_once(estimator, image, depth, message):
    odometry = Odometry(CAMERA, ExactFlow(), estimator)
    for _ in range(2):
        with pytest.raises(DataError, match=message):
            odometry.step(image, 0.0, depth)
    assert (odometry.poses, odometry.timestamps) == ([], [])
    odometry.step(frame(0), 0.0, DEPTH)
    with pytest.raises(DataError, match=message):
        odometry.step(image, 1.0, depth)
    odometry.step(frame(1), 1.0, DEPTH)
    assert_same(odometry.poses, poses(MOTIONS[:1]))


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_metres_in_floats_give_steps_in_metres(kind):
    odometry = Odometry(CAMERA, ExactFlow(), ransac())
    odometry.step(frame(0), 0.0, DEPTH.astype(kind))
    step = odometry.step(frame(1), 0.1, DEPTH.astype(kind))
    np.testing.assert_allclose(step.T_k_prev.translation, MOTIONS[0].translation, atol=1e-5)


def test_a_sensors_millimetres_are_refused_before_they_are_a_step():
    millimetres = np.rint(1000 * DEPTH)
    with pytest.raises(DataError, match="metres along z in an array of floats, not uint16"):
        Odometry(CAMERA, ExactFlow(), ransac()).step(frame(0), 0.0, millimetres.astype(np.uint16))
    with pytest.warns(ImplausibleDepthWarning, match="millimetres, not metres"):
        Odometry(CAMERA, ExactFlow(), ransac()).step(frame(0), 0.0, millimetres)


def test_a_model_of_another_flow_is_refused():
    odometry = Odometry(CAMERA, ExactFlow(), lcmsac(lcm_likelihood(method={"name": "farneback"})))
    odometry.step(frame(0), 0.0, DEPTH)
    with pytest.raises(ModelError, match="farneback"):
        odometry.step(frame(1), 0.1, DEPTH)


def test_scaled_changes_the_length_alone():
    T = scaled(MOTIONS[0], 2.5)
    assert np.linalg.norm(T.translation) == pytest.approx(2.5)
    np.testing.assert_allclose(np.cross(T.translation, MOTIONS[0].translation), 0, atol=1e-12)
    np.testing.assert_array_equal(T.rotation.as_matrix(), MOTIONS[0].rotation.as_matrix())
    np.testing.assert_array_equal(scaled(RigidTransform.identity(), 2.5).as_matrix(), np.eye(4))


@pytest.mark.parametrize(("residual", "scale"), [("depth", "none"), ("epipolar", "truth-norm")])
def test_the_loop_over_a_sequence_gives_its_poses(estimator, residual, scale):
    odometry = Odometry(CAMERA, ExactFlow(), estimator, scale=scale_source(scale, Frames()))
    motions = list(run_odometry(Frames(), odometry, residual))
    assert len(motions) == 3
    assert_same(odometry.poses, poses(MOTIONS), atol=2e-3)


def test_the_loop_finds_what_steps_find(estimator):
    """Though it measures the next pair while it estimates."""
    frames, robot, loop = Frames(), *(Odometry(CAMERA, ExactFlow(), estimator, seed=3) for _ in range(2))
    for k in range(len(frames)):
        robot.step(frames.image(k), frames.timestamp(k), DEPTH)
    list(run_odometry(frames, loop, "depth"))
    assert loop.timestamps == robot.timestamps
    assert_same(loop.poses, robot.poses, atol=0)


def test_the_loop_ends_after_the_frames_asked_for(estimator):
    odometry = Odometry(CAMERA, ExactFlow(), estimator)
    assert len(list(run_odometry(Frames(), odometry, "depth", frames=2))) == 1
    assert len(odometry.poses) == 2


@pytest.mark.parametrize("map", [map, map_ahead])
@pytest.mark.parametrize("depth", [True, False])
def test_pairs_are_measured_once_for_any_estimators(map, depth):
    model = lcm_likelihood()
    pairs = list(measure_sequence(Frames(), ExactFlow(), model, seed=3, depth=depth, map=map))
    assert [(pair.k, pair.timestamp) for pair in pairs] == [(k, 0.1 * k) for k in (1, 2, 3)]
    for k, pair in enumerate(pairs, 1):
        m = measure_features(frame(k - 1), frame(k), ExactFlow(), model.texture, 3 + k, model.signals)
        np.testing.assert_array_equal(pair.measurements.pixels, m.pixels)
        np.testing.assert_array_equal(pair.measurements.flow, m.flow)
        assert pair.depth is (DEPTH if depth else None)


def test_the_loop_refuses_frames_of_another_size():
    class Odd(Frames):
        def image(self, k):
            return frame(k)[: 72 - k]

    with pytest.raises(DataError, match="image of 96x71 for a camera of 96x72"):
        list(measure_sequence(Odd(), ExactFlow(), lcm_likelihood()))


def test_the_loop_refuses_times_that_do_not_advance(estimator):
    class Still(Frames):
        def timestamp(self, k):
            return 0.0

    with pytest.raises(DataError, match="time does not advance"):
        list(run_odometry(Still(), Odometry(CAMERA, ExactFlow(), estimator), "depth"))


def test_the_true_distance_is_between_poses():
    assert true_distance(Frames(), 2) == pytest.approx(np.linalg.norm(MOTIONS[1].translation))


def test_features_are_corners_or_stratified_pixels():
    texture = TextureDefinition()
    previous = textured_image((240, 320))
    dense = measure_features(previous, previous, Farneback(), texture, seed=1)
    assert len(dense) == pytest.approx(4000, rel=0.05)
    np.testing.assert_array_equal(dense.pixels, np.rint(dense.pixels))
    method = LucasKanade()
    sparse = measure_features(previous, previous, method, texture)
    corners = method.measure(previous, previous)[0]
    np.testing.assert_array_equal(sparse.pixels, method.anchors(derivatives(previous), corners))
    assert (features_of(Farneback()), features_of(LucasKanade())) == ("stratified-4000", "corners")


class Scripted:
    """Estimator that says what it is given."""

    likelihood = ransac().likelihood

    def __init__(self, *motions):
        self.motions = iter(motions)

    def estimate(self, residual, seed, start=None):
        return next(self.motions)


def turned_only(T):
    unknown = np.diag([1e-8, 1e-8, 1e-8, np.nan, np.nan, np.nan])
    T = RigidTransform.from_rotation(T.rotation)
    return EgoMotion(T, np.zeros((6, 6)), unknown, Status.DEGENERATE, "a rotation", scale_known=False)


def test_a_rotation_without_parallax_is_kept_with_a_translation_as_uncertain_as_long():
    solved = EgoMotion(MOTIONS[0], np.eye(6), 1e-6 * np.eye(6), Status.SOLVED)
    odometry = Odometry(CAMERA, ExactFlow(), Scripted(solved, turned_only(MOTIONS[2])))
    _, _, kept = [odometry.step(frame(k), k, DEPTH) for k in range(3)]
    assert (kept.predicted, kept.status) == (False, Status.DEGENERATE)
    np.testing.assert_array_equal(kept.T_k_prev.rotation.as_matrix(), MOTIONS[2].rotation.as_matrix())
    np.testing.assert_allclose(kept.T_k_prev.translation, MOTIONS[0].translation)
    length = np.linalg.norm(MOTIONS[0].translation)
    np.testing.assert_allclose(kept.covariance, np.diag([1e-8] * 3 + [length**2] * 3))


def test_a_run_may_begin_with_turns_alone():
    odometry = Odometry(CAMERA, ExactFlow(), Scripted(*(turned_only(T) for T in MOTIONS[:2])))
    motions = [odometry.step(frame(k), k) for k in range(3)][1:]
    for motion, T in zip(motions, MOTIONS):
        np.testing.assert_array_equal(motion.T_k_prev.rotation.as_matrix(), T.rotation.as_matrix())
        # without a scale a step is of length 1
        np.testing.assert_allclose(motion.covariance, np.diag([1e-8] * 3 + [1.0] * 3))


@pytest.mark.parametrize("swapped", [False, True])
def test_of_two_motions_the_one_nearer_to_the_last_goes_on(swapped):
    solved = EgoMotion(MOTIONS[0], np.eye(6), 1e-6 * np.eye(6), Status.SOLVED)
    near, far = (
        EgoMotion(T, np.eye(6), 1e-6 * np.eye(6), Status.AMBIGUOUS, "a plane")
        for T in (MOTIONS[0], MOTIONS[0].inv())
    )
    first, second = (far, near) if swapped else (near, far)
    odometry = Odometry(CAMERA, ExactFlow(), Scripted(solved, replace(first, alternative=second)))
    _, _, motion = [odometry.step(frame(k), k, DEPTH) for k in range(3)]
    assert (motion.status, motion.predicted) == (Status.AMBIGUOUS, False)
    assert motion.T_k_prev is near.T_k_prev
    assert motion.alternative.T_k_prev is far.T_k_prev
    assert motion.alternative.alternative is None
