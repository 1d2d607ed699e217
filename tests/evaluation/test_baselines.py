import builtins

import numpy as np
import pytest

from flowlik.egomotion import Epipolar, KnownDepth, ransac
from flowlik.errors import FlowlikError
from flowlik.evaluation.baselines import opencv_essential, opencv_pnp, poselib_relative
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
    original = builtins.__import__

    def without(name, *args, **keywords):
        if name == "poselib":
            raise ImportError
        return original(name, *args, **keywords)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(FlowlikError, match=r"pip install 'flowlik\[baselines\]'"):
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
