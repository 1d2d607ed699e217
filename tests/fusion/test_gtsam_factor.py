"""GTSAM's factor against the flow factor's own residual, and its derivatives against differences."""

import sys

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.errors import MissingExtraError
from flowlik.fusion import gtsam_factor
from flowlik.geometry.motion import exp_se3, skew
from flowlik.odometry import FlowFactor
from tests.helpers import random_motion

T_B_C = exp_se3(np.array([0.4, -1.2, 0.7, 0.1, -0.3, 0.2]))
FORMS = ("full", "given-rotation")


def flow_of(form):
    rng = np.random.default_rng(4)
    T = random_motion(rng, 5.0, 0.4)
    root = rng.standard_normal((6, 6)) * np.array([1e-3] * 3 + [0.01] * 3)[:, None]
    C = root @ root.T
    if form == "full":
        return FlowFactor(form, T, C, np.zeros((3, 3)))
    gain = np.linalg.solve(C[:3, :3], C[:3, 3:]).T
    return FlowFactor(form, T, C[3:, 3:] - gain @ C[:3, 3:], gain - skew(T.translation))


def values_of(gtsam, T_k_prev):
    """Two body poses between whose cameras this is the motion."""
    first = random_motion(np.random.default_rng(5), 80.0, 5.0)
    second = first * T_B_C * T_k_prev.inv() * T_B_C.inv()
    values = gtsam.Values()
    for key, pose in enumerate((first, second)):
        values.insert(key, gtsam.Pose3(pose.as_matrix()))
    return values


@pytest.mark.parametrize("form", FORMS)
def test_its_error_is_that_of_the_flow_factor(form):
    gtsam = pytest.importorskip("gtsam")
    flow = flow_of(form)
    factor = gtsam_factor(flow, 0, 1, T_B_C)
    for error in 1e-4 * np.random.default_rng(6).standard_normal((5, 6)):
        T = exp_se3(error) * flow.T_k_prev
        r = flow.residual(T)
        expected = r @ np.linalg.solve(flow.covariance, r)
        assert 2 * factor.error(values_of(gtsam, T)) == pytest.approx(expected, rel=2e-2)


@pytest.mark.parametrize("form", FORMS)
def test_its_derivatives_are_those_of_finite_differences(form):
    gtsam = pytest.importorskip("gtsam")
    flow = flow_of(form)
    factor = gtsam_factor(flow, 0, 1, T_B_C)
    values = values_of(gtsam, exp_se3(np.array([1e-3, 2e-3, -1e-3, 0.01, 0.0, 0.02])) * flow.T_k_prev)
    A, _ = factor.linearize(values).jacobian()

    def whitened(key, step):
        moved = gtsam.Values(values)
        moved.update(key, values.atPose3(key).retract(step))
        return factor.whitenedError(moved)

    differences = [
        (whitened(key, 1e-6 * unit) - whitened(key, -1e-6 * unit)) / 2e-6
        for key in (0, 1)
        for unit in np.eye(6)
    ]
    np.testing.assert_allclose(A, np.transpose(differences), atol=1e-4 * np.abs(A).max())


def test_a_rotation_told_from_elsewhere_moves_the_translation():
    """With the rotation a gyroscope's, the graph finds the translation that the flow factor tells of it."""
    gtsam = pytest.importorskip("gtsam")
    flow = flow_of("given-rotation")
    w = np.array([2e-4, -3e-4, 1e-4])
    R_k_prev = exp_se3(np.concatenate([w, np.zeros(3)])).rotation * flow.T_k_prev.rotation
    graph, values = gtsam.NonlinearFactorGraph(), values_of(gtsam, flow.T_k_prev)
    graph.add(gtsam.PriorFactorPose3(0, values.atPose3(0), gtsam.noiseModel.Isotropic.Sigma(6, 1e-7)))
    told = T_B_C.rotation * R_k_prev.inv() * T_B_C.rotation.inv()
    loose = gtsam.noiseModel.Diagonal.Sigmas(np.array([1e-7] * 3 + [1e3] * 3))
    gyroscope = RigidTransform.from_rotation(told)
    graph.add(gtsam.BetweenFactorPose3(0, 1, gtsam.Pose3(gyroscope.as_matrix()), loose))
    graph.add(gtsam_factor(flow, 0, 1, T_B_C))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    X = [RigidTransform.from_matrix(found.atPose3(key).matrix()) for key in (0, 1)]
    T_k_prev = T_B_C.inv() * X[1].inv() * X[0] * T_B_C
    np.testing.assert_allclose(T_k_prev.translation, flow.translation(R_k_prev), atol=1e-6)


def test_without_gtsam_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with pytest.raises(MissingExtraError, match=r"flowlik\[fusion\]"):
        gtsam_factor(flow_of("full"), 0, 1)
