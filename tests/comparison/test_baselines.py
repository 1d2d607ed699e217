import dataclasses
import sys

import numpy as np
import pytest

from flowlik.comparison.baselines import PNP, Pnp, opencv_essential, opencv_pnp, poselib_relative, sweep
from flowlik.egomotion import Epipolar, KnownDepth, ransac
from flowlik.errors import DataError, MissingExtraError
from tests.helpers import CAMERA, lcm_likelihood, make_scene, random_motion, tangent_error

MODEL = lcm_likelihood()


def scene_of(seed, **keywords):
    rng = np.random.default_rng(seed)
    return make_scene(random_motion(rng), rng, **keywords)


@pytest.mark.parametrize("outliers", [0.0, 0.2])
@pytest.mark.parametrize("baseline", [opencv_pnp, opencv_essential, poselib_relative])
def test_exact_flow_gives_the_exact_motion(baseline, outliers):
    if baseline is poselib_relative:
        pytest.importorskip("poselib")
    scene = scene_of(3, outliers=outliers)
    residual = scene.known_depth if baseline is opencv_pnp else scene.epipolar
    T = baseline(residual)
    error = tangent_error(T, scene.T)
    if baseline is not opencv_pnp:
        assert np.linalg.norm(T.translation) == pytest.approx(1)
        error[3:] = T.translation - scene.T.translation / np.linalg.norm(scene.T.translation)
    np.testing.assert_allclose(error, 0, atol=1e-4)


def test_no_motion_from_too_little_or_from_noise():
    scene = scene_of(4, n=60, outliers=1.0)
    few = scene.measurements.select(np.arange(3))
    assert opencv_pnp(KnownDepth.of(few, CAMERA, scene.depth[:3])) is None
    assert opencv_essential(Epipolar.of(few, CAMERA)) is None


def test_poselib_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "poselib", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'flowlik\[baselines\]'"):
        poselib_relative(scene_of(5, n=10).epipolar)


def test_our_ransac_is_no_straw_man():
    """Its median error is within 5 % of that of OpenCV's RANSAC with refinement, on the same points."""
    errors = []
    for seed in range(30):
        scene = scene_of(seed, n=600, likelihood=MODEL, outliers=0.1)
        motions = (ransac().estimate(scene.known_depth, seed).T_k_prev, opencv_pnp(scene.known_depth))
        errors.append([np.linalg.norm(tangent_error(T, scene.T)[3:]) for T in motions])
    ours, opencv = np.median(errors, axis=0)
    assert ours <= 1.05 * opencv


@pytest.mark.parametrize("name", PNP)
@pytest.mark.parametrize("gate", [None, 1.0])
def test_every_rival_finds_the_motion_among_outliers(name, gate):
    if name.startswith("poselib"):
        pytest.importorskip("poselib")
    # a Huber loss keeps what gross errors pull at
    scene = scene_of(7, n=600, outliers=0.0 if name == "poselib-huber" else 0.2)
    T = Pnp(name, 0.5, gate)(scene.known_depth)
    np.testing.assert_allclose(tangent_error(T, scene.T), 0, atol=2e-3)


def test_a_gate_leaves_points_out():
    scene = scene_of(8, n=300)
    weak = scene.measurements.t[:, 1] < 30
    flow = scene.measurements.flow + 20 * weak[:, None]
    wrong = KnownDepth.of(dataclasses.replace(scene.measurements, flow=flow), CAMERA, scene.depth)
    T = Pnp("opencv-ransac", 0.5, 30.0)(wrong)
    np.testing.assert_allclose(tangent_error(T, scene.T), 0, atol=1e-4)
    assert Pnp("opencv-ransac", 0.5, 1e9)(wrong) is None


def test_a_sweep_finds_the_radius_that_suits_the_noise():
    scenes = [scene_of(seed, n=300, likelihood=MODEL, outliers=0.2) for seed in range(6)]
    pairs = [(scene.known_depth, scene.T) for scene in scenes]
    radii = (0.01, 0.5, 30.0)
    assert sweep(Pnp(), pairs, radii) == Pnp(radius_px=0.5)


def test_an_unknown_rival_is_refused():
    with pytest.raises(DataError, match="opencv-magsac"):
        Pnp("opencv")
