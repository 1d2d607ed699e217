"""The gauntlet: truth of its clips against OpenCV's projection, and the counting of wrong motions."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2, kstest

import gauntlet_judge as judge
from flowlik.egomotion import EgoMotion, Status
from flowlik.geometry.motion import exp_se3
from gauntlet_clips import CAMERA
from gauntlet_scenarios import SCENARIOS
from gauntlet_scene import Scene, natural_textures, plane, turn

SIMULATED = ("forest", "fig8", "drive")
AT_EVENTS = ("black", "white", "grey", "frozen", "cut", "dropped", "exposure")
OTHER_IMAGES = (*AT_EVENTS, "low-light", "half-covered", "standstill-blink", "defocus", "jpeg", "border")
OTHER_TOLD = ("depth-noise", "depth-holes", "depth-shift", "focal")
STATIC_SHARE = {"vehicle": 0.3, "rail": 0.6, "rolling-shutter": 0.0}
ORDINARY = [n for n in SCENARIOS if n not in (*SIMULATED, *OTHER_IMAGES, *OTHER_TOLD)]
TRUTH = RigidTransform.from_components([0.02, -0.01, 0.1], Rotation.from_rotvec([0.01, -0.02, 0.005]))


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("gauntlet")


def differences(clip, k, T):
    """Grey levels (H, W) by which frame k - 1 differs from frame k at where OpenCV projects its points."""
    v, u = np.mgrid[: clip.camera.height, : clip.camera.width].astype(np.float64)
    rays = np.linalg.inv(clip.camera.K) @ np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
    points = (clip.depth(k - 1).ravel() * rays).T
    ends, _ = cv2.projectPoints(points, T.rotation.as_rotvec(), T.translation, clip.camera.K, None)
    ends = ends.reshape(*u.shape, 2).astype(np.float32)
    seen = cv2.remap(clip.image(k).astype(np.float32), ends, None, cv2.INTER_CUBIC, borderValue=np.nan)
    difference = np.abs(seen - clip.image(k - 1))
    return difference[np.isfinite(difference)]


@pytest.mark.parametrize("name", ORDINARY)
def test_true_motion_and_depth_take_one_frame_to_the_next(name, cache):
    clip = SCENARIOS[name].make(3, 6, cache)
    for k in (1, 5):
        share = STATIC_SHARE.get(name, 0.85)
        right = differences(clip, k, clip.truth(k)) < 8
        wrong = differences(clip, k, exp_se3(np.array([0, 0.01, 0.02, 0, 0, 0])) * clip.truth(k)) < 8
        assert right.mean() > share
        assert right.mean() > wrong.mean() + 0.2 * share


def test_rows_of_a_rolling_shutter_are_true_in_the_middle_alone(cache):
    clip = SCENARIOS["rolling-shutter"].make(0, 12, cache)
    away = np.abs(np.mgrid[: CAMERA.height, : CAMERA.width][0] - CAMERA.height // 2)

    def wrong(rows):
        seen = replace(clip, depth=lambda k: np.where(rows, clip.depth(k), np.nan))
        return np.mean([np.median(differences(seen, k, clip.truth(k))) for k in range(1, 13)])

    assert wrong(away < 3) < 3
    assert wrong(away > 90) > 1.4 * wrong(away < 3)


def test_a_plane_is_seen_through_its_homography():
    normal, distance = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0]), 4.0
    scene = Scene([plane(normal, distance, 0.012)], natural_textures(0))
    T_n_c = RigidTransform.from_components([0.1, 0.05, 0.2], turn(3, -2, 5))
    first, _ = scene.view(CAMERA, RigidTransform.identity())
    second, depth = scene.view(CAMERA, T_n_c)
    R, t = T_n_c.inv().rotation.as_matrix(), T_n_c.inv().translation
    H = CAMERA.K @ (R + np.outer(t, normal) / distance) @ np.linalg.inv(CAMERA.K)
    warped = cv2.warpPerspective(
        first, H, (CAMERA.width, CAMERA.height), flags=cv2.INTER_CUBIC, borderValue=np.nan
    )
    known = np.isfinite(warped)
    assert known.mean() > 0.5
    assert np.median(np.abs(warped - second)[known]) < 2
    # of the plane seen from the second camera
    n2, d2 = R @ normal, distance + (R @ normal) @ t
    rays = np.linalg.inv(CAMERA.K) @ np.array([37.0, 91.0, 1.0])
    assert depth[91, 37] == pytest.approx(d2 / (n2 @ rays), rel=1e-9)


@pytest.mark.parametrize("name", [n for n in SCENARIOS if n not in SIMULATED])
def test_as_many_motions_are_judged_as_asked_for(name, cache):
    clip = SCENARIOS[name].make(3, 6, cache)
    assert not clip.judged[0]
    assert clip.judged.sum() >= 6
    assert len(clip.poses) == len(clip)
    assert clip.image(len(clip) - 1).shape == (clip.camera.height, clip.camera.width)


@pytest.mark.parametrize("name", ["pan-0.1", "pan-3", "roll", "standstill", "standstill-blink"])
def test_where_nothing_moves_the_truth_has_no_translation(name, cache):
    clip = SCENARIOS[name].make(1, 4, cache)
    assert np.linalg.norm(clip.truth(2).translation) < judge.NONE


def test_a_turn_on_the_spot_is_judged_with_the_frames_after_it(cache):
    clip = SCENARIOS["turn-in-drive"].make(0, 24, cache)
    turned = [clip.truth(k).rotation.magnitude() > 1e-4 for k in range(1, len(clip))]
    moved = [np.linalg.norm(clip.truth(k).translation) > 0.05 for k in range(1, len(clip))]
    assert all(np.array(turned) != np.array(moved))
    assert clip.judged[1:][turned].all()
    assert clip.judged[1:].sum() < len(turned)


def drawn(metric, count=4000):
    """Estimates whose errors are of the covariance that they state."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 6)) * np.repeat([0.002, 0.004], 3)[:, None]
    C = A @ A.T
    for xi in rng.multivariate_normal(np.zeros(6), C, count):
        T = exp_se3(xi).inv() * TRUTH
        if metric:
            yield T, C
        else:
            length = np.linalg.norm(T.translation)
            d = T.translation / length
            across = np.eye(6)
            across[3:, 3:] -= np.outer(d, d)
            factor = np.repeat([1, 1 / length], 3)
            yield (
                RigidTransform.from_components(d, T.rotation),
                across @ (C * np.outer(factor, factor)) @ across.T,
            )


@pytest.mark.parametrize("metric", [True, False])
def test_of_motions_with_errors_as_told_one_in_a_thousand_is_outside(metric):
    found = [judge.distance(T, C, TRUTH, metric) for T, C in drawn(metric)]
    radii, squared, freedoms = np.array(found).T
    assert set(freedoms) == {6 if metric else 5}
    assert kstest(chi2.cdf(squared, freedoms[0]), "uniform").pvalue > 0.01
    # four are expected
    assert 0 < (radii > 1).sum() < 13
    assert not (radii > judge.GROSSLY).any()


def unit(direction, rotation=(0, 0, 0)):
    d = np.asarray(direction, float)
    return RigidTransform.from_components(d / np.linalg.norm(d), Rotation.from_rotvec(rotation))


def spread(rotation, direction, along=0.0, of=(0, 0, 1)):
    """Covariance of a unit motion: standard deviations of rotation, direction and length."""
    d = np.asarray(of, float) / np.linalg.norm(of)
    C = np.diag(np.repeat([rotation**2, direction**2], 3))
    C[3:, 3:] += (along**2 - direction**2) * np.outer(d, d)
    return C


def test_a_reversed_direction_is_half_a_turn_wrong():
    T = unit([0, 0, 1])
    found = judge.distance(T, spread(0.001, 0.01), unit([0, 0, -1]), False)
    assert np.sqrt(found.squared) == pytest.approx(np.pi / 0.01, rel=1e-3)
    assert judge.errors(T, unit([0, 0, -1]), False)[1] == pytest.approx(180)


@pytest.mark.parametrize("degrees", [1, 40, 120, 179])
def test_a_direction_is_judged_by_its_angle(degrees):
    a = np.deg2rad(degrees)
    found = judge.distance(unit([0, 0, 1]), spread(0.001, 0.1), unit([np.sin(a), 0, np.cos(a)]), False)
    assert np.sqrt(found.squared) == pytest.approx(a / 0.1, rel=1e-6)


def test_where_there_is_no_translation_a_claimed_direction_is_wrong():
    still = RigidTransform.identity()
    sure = judge.distance(unit([0, 0, 1]), spread(0.001, 0.01), still, False)
    wide = judge.distance(unit([0, 0, 1]), spread(0.001, 2.0), still, False)
    of_length = judge.distance(unit([0, 0, 1]), spread(0.001, 0.5, along=0.5), still, False)
    nowhere = judge.distance(still, spread(0.001, 0.01), still, False)
    assert sure.radii > judge.GROSSLY
    assert wide.radii < 1 and of_length.radii < 1 and nowhere.radii < 1
    assert nowhere.freedoms == 3


def test_what_is_not_claimed_is_not_judged():
    C = np.diag([1e-6, 1e-6, 1e-6, 1e-6, 1e-6, np.inf])
    far = RigidTransform.from_components([0, 0, 1000], Rotation.identity())
    found = judge.distance(far, C, RigidTransform.identity(), True)
    assert found.freedoms == 5 and found.squared == pytest.approx(0, abs=1e-9)
    assert judge.distance(far, np.full((6, 6), np.nan), TRUTH, True).freedoms == 0
    assert judge.distance(far, np.diag([1e-6] * 3 + [1e6] * 3), TRUTH, True).freedoms == 3


def test_one_of_two_ambiguous_motions_is_enough():
    motion = EgoMotion(unit([1, 0, 0]), np.eye(6), spread(0.001, 0.01, of=(1, 0, 0)), Status.AMBIGUOUS)
    true = unit([0, 0, 1])
    alone = judge.of_motion(motion, true, False)
    assert alone.radii > judge.GROSSLY and not alone.solved
    other = replace(motion, T_k_prev=true, covariance=spread(0.001, 0.01))
    object.__setattr__(motion, "alternative", other)
    both = judge.of_motion(motion, true, False)
    assert both.radii < 1 and both.solved


def test_still_is_an_answer_where_all_stands_still():
    motion = EgoMotion(RigidTransform.identity(), np.zeros((6, 6)), np.full((6, 6), np.nan), Status.STILL)
    assert judge.of_motion(motion, RigidTransform.identity(), False).solved
    assert not judge.of_motion(motion, TRUTH, False).solved
