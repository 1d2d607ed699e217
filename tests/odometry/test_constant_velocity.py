import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.motion import exp_se3
from flowlik.odometry._constant_velocity import REMEMBERED, ConstantVelocity

MEAN = exp_se3(np.array([0.01, 0.0, 0.02, 0.1, 0.0, -0.5]))
SIGMA = np.array([1e-3, 2e-3, 1e-3, 0.01, 0.02, 0.03])


def walk(count, rng):
    motions = [MEAN]
    for _ in range(count - 1):
        motions.append(exp_se3(SIGMA * rng.standard_normal(6)) * motions[-1])
    return motions


def told(motions):
    model = ConstantVelocity()
    for T in motions:
        model = model.update(T, np.zeros((6, 6)))
    return model


def test_nothing_is_predicted_of_nothing():
    T, covariance = ConstantVelocity().predict()
    np.testing.assert_array_equal(T.as_matrix(), np.eye(4))
    assert np.isnan(covariance).all()


def test_predictions_of_a_random_walk_are_consistent():
    rng, nees = np.random.default_rng(0), {1: [], 3: []}
    for _ in range(200):
        motions = walk(REMEMBERED + 4, rng)
        model = told(motions[:-3])
        for ahead in nees:
            T, covariance = model.predict()
            for _ in range(ahead - 1):
                model = model.skip()
                T, covariance = model.predict()
            xi = (motions[-4 + ahead] * T.inv()).as_exp_coords()
            nees[ahead].append(xi @ np.linalg.solve(covariance, xi))
            model = told(motions[:-3])
    # 5.35 for six directions; 30 changes leave the covariance itself uncertain
    for found in nees.values():
        assert 4.5 < np.median(found) < 8


def test_the_covariance_grows_by_the_frame_and_starts_at_the_last():
    model = told(walk(10, np.random.default_rng(1)))
    last = 1e-4 * np.eye(6)
    model = ConstantVelocity(model.last, last, model.changes)
    one, two = model.predict()[1], model.skip().predict()[1]
    np.testing.assert_allclose(two - last, 2 * (one - last))
    assert (np.diag(one) > np.diag(last)).all()


def test_a_gap_leaves_no_change_and_one_motion_promises_its_size():
    model = ConstantVelocity().update(MEAN, np.full((6, 6), np.nan))
    T, covariance = model.predict()
    np.testing.assert_array_equal(T.as_matrix(), MEAN.as_matrix())
    expected = [MEAN.rotation.magnitude(), np.linalg.norm(MEAN.translation)]
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), np.repeat(expected, 3))
    assert model.skip().update(RigidTransform.identity(), np.eye(6)).changes == ()
