import numpy as np
import pytest

from examples import gtsam_fusion
from flowlik.egomotion import EgoMotion, Status
from flowlik.geometry.motion import exp_se3, right_covariance
from tests.helpers import random_motion

gtsam = pytest.importorskip("gtsam")

C = np.diag(np.array([1e-3, 2e-3, 1e-3, 0.01, 0.02, 0.03]) ** 2)
C[0, 4] = C[4, 0] = 5e-6


def test_a_gps_fix_bounds_the_drift():
    chained, fused = gtsam_fusion.main()
    assert fused < chained
    assert fused < 0.5


def test_the_factors_error_is_the_left_tangents():
    rng = np.random.default_rng(0)
    T = random_motion(rng, 30.0, 2.0)
    xi = rng.multivariate_normal(np.zeros(6), C)
    factor = gtsam_fusion.between_factor(gtsam, 0, 1, EgoMotion(T, np.linalg.inv(C), C, Status.SOLVED))
    values = gtsam.Values()
    values.insert(0, gtsam_fusion.pose3(gtsam, random_motion(rng, 80.0, 5.0)))
    values.insert(1, values.atPose3(0).compose(gtsam_fusion.pose3(gtsam, (exp_se3(xi) * T).inv())))
    assert 2 * factor.error(values) == pytest.approx(xi @ np.linalg.solve(C, xi), rel=1e-4)


def test_the_adjoint_is_gtsams():
    T = random_motion(np.random.default_rng(1), 30.0, 2.0)
    turn = gtsam_fusion.pose3(gtsam, T.inv()).AdjointMap()
    np.testing.assert_allclose(right_covariance(T, C), turn @ C @ turn.T, atol=1e-12)
