"""A model that follows a drive: it finds the size of the errors, and leaves a model alone that is right."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flowlik.egomotion import EgoMotion, Epipolar, Status, lcmsac
from flowlik.egomotion.result import unsolved
from flowlik.errors import ModelError
from flowlik.likelihood.model_file import load_likelihood
from flowlik.odometry import Adaptation, Adapted, adapting
from flowlik.odometry.odometry import Step
from tests.helpers import CAMERA, random_motion
from tests.self_supervision.scenes import seen_pair

MODEL = load_likelihood("lucas-kanade-11-epipolar")
QUICK = Adaptation(memory_frames=30.0, prior_frames=5.0)


def step(rng, factor: float = 1.0, model=MODEL) -> Step:
    """A frame whose errors across its lines are drawn from a model, times a factor."""
    T = random_motion(rng, 1.0, 0.6)
    m = seen_pair(rng, 300, T).measurements
    at = Epipolar.of(m, CAMERA).at(unit(T), model.schedule.index)
    wanted = factor * model.sample(at.x, rng)
    m = replace(m, flow=m.flow + (wanted - at.z)[:, None] * at.directions)
    motion = EgoMotion(T, np.zeros((6, 6)), np.zeros((6, 6)), Status.SOLVED)
    return Step(m, CAMERA, motion, Epipolar.of(m, CAMERA))


def unit(T):
    matrix = T.as_matrix()[:3]
    return np.column_stack([matrix[:, :3], matrix[:, 3] / np.linalg.norm(matrix[:, 3])])


def nll(likelihood, frames) -> float:
    """Score of errors across the lines of the true motions."""
    at = [f.residual.at(unit(f.motion.T_k_prev), likelihood.schedule.index) for f in frames]
    return -np.mean(np.concatenate([likelihood.log_prob(e.z, e.x) for e in at]))


def followed(factor: float, frames: int = 40, seed: int = 0, settings=QUICK) -> Adapted:
    adapted, rng = Adapted(MODEL, settings), np.random.default_rng(seed)
    for _ in range(frames):
        adapted = adapted.updated(step(rng, factor))
    return adapted


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_the_size_of_the_errors_is_found(factor):
    adapted = followed(factor)
    rng = np.random.default_rng(1)
    later = [step(rng, factor) for _ in range(8)]
    x = np.concatenate([f.residual.at(unit(f.motion.T_k_prev), MODEL.schedule.index).x for f in later])
    a, b = adapted.moved
    # the model itself has the worth of five frames beside some thirty
    assert 0.7 < np.median(a + b * (x - np.log(0.1))) / np.log(factor) < 1.3
    assert nll(MODEL, later) - nll(adapted.likelihood, later) > 0.1


def test_on_a_drive_like_the_calibrations_it_is_no_worse():
    rng = np.random.default_rng(2)
    later = [step(rng) for _ in range(20)]
    for seed in (3, 4):
        adapted = followed(1.0, seed=seed, settings=Adaptation())
        np.testing.assert_allclose(adapted.moved, 0, atol=0.05)
        assert nll(adapted.likelihood, later) < nll(MODEL, later) + 0.002


def test_it_goes_no_further_than_it_may_and_forgets():
    adapted = followed(0.05, frames=60)
    assert adapted.moved[0] == -np.log(QUICK.most)
    rng = np.random.default_rng(5)
    for _ in range(120):
        adapted = adapted.updated(step(rng))
    assert abs(adapted.moved[0]) < 0.2


def test_frames_without_a_motion_tell_nothing():
    adapted, frame = Adapted(MODEL), step(np.random.default_rng(0))
    for status in (Status.STILL, Status.DEGENERATE, Status.AMBIGUOUS, Status.TOO_FEW):
        assert adapted.updated(frame._replace(motion=unsolved(status, ""))) is adapted
    few = frame.measurements.select(np.arange(300) < 99)
    assert adapted.updated(frame._replace(residual=Epipolar.of(few, CAMERA))) is adapted


def test_a_frame_is_judged_by_those_before_it_alone():
    rng = np.random.default_rng(6)
    frames = [step(rng, 0.5) for _ in range(3)]
    robot, seen = SimpleNamespace(estimator=lcmsac(MODEL), last=None), []

    def flying():
        for frame in frames:
            seen.append(robot.estimator.likelihood)
            robot.last = frame
            yield frame.motion

    assert list(adapting(flying(), robot)) == [f.motion for f in frames]
    assert seen[0] is MODEL
    expected = Adapted(MODEL)
    for frame, likelihood in zip(frames, seen):
        assert likelihood.schedule.index == expected.likelihood.schedule.index
        expected = expected.updated(frame)
    assert robot.estimator.name == "lcmsac"


def test_a_moved_index_has_the_same_table():
    index = MODEL.schedule.index
    m = step(np.random.default_rng(7)).measurements
    normal = np.tile([0.6, 0.8], (len(m), 1))
    np.testing.assert_allclose(index.moved(0.3, 1.1).along(m, normal), 0.3 + 1.1 * index.along(m, normal))
    MODEL.bound(0.0, 0.9)
    other = MODEL.with_index(index.moved(0.3))
    assert other.compiled is MODEL.compiled
    assert other.bound(0.3, 0.9) == MODEL.bound(0.3, 0.9)
    assert other.schedule.index != index


def test_a_model_over_texture_is_refused():
    with pytest.raises(ModelError, match=r"learned index.*over texture"):
        Adapted(load_likelihood("lucas-kanade-lcm"))
