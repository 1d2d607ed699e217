"""The page on filters: its programs run, and what they say of their uncertainty holds on drawn errors."""

import numpy as np
import pytest
import yaml
from scipy import stats
from scipy.spatial.transform import RigidTransform

from examples import gtsam_fusion
from flowlik.geometry import exp_se3
from flowlik.geometry.motion import adjoint
from tests.docs.test_docs import ROOT, blocks
from tests.helpers import lcm_likelihood, random_motion
from tests.likelihood.test_covariance import drawn

PAGE = ROOT / "docs/in-your-own-filter.md"


@pytest.fixture(scope="module")
def page(flight):
    """Names that the page's programs leave, after all of them have run."""
    names: dict = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(flight.parent)
        for program in blocks(PAGE, "python"):
            exec(compile(program, str(PAGE), "exec"), names)
    return names


def test_the_programs_run(page):
    assert page["R"].shape == (len(page["everything"]), 2, 2)
    assert len(page["motions"]) == 3
    assert np.isfinite(page["x"]).all()
    assert np.linalg.eigvalsh(page["pose"].P).min() > 0


def test_the_points_filter_takes_what_is_in_the_gate_and_nothing_else(page):
    x, P = np.zeros(4), np.diag([0.0, 0, 1, 1])
    R = np.diag([0.04, 0.25])
    near, smaller = page["update"](x, P, np.array([0.3, 0.0]), R)
    assert near[2] == pytest.approx(0.3 / 1.04)  # of a prior of 1 px² and a measurement of 0.04
    assert smaller[2, 2] == pytest.approx(0.04 / 1.04)
    far, same = page["update"](x, P, np.array([5.0, 0.0]), R)
    np.testing.assert_array_equal(far, x)
    np.testing.assert_array_equal(same, P)
    moved, _ = page["predict"](near, smaller)
    np.testing.assert_allclose(moved[:2], near[2:])


def test_the_likeliest_state_is_as_far_off_as_it_says(page):
    """Drawn heavy-tailed errors: honest, and nearer than one update with Gaussians."""
    rng, model, nees, ratio = np.random.default_rng(0), lcm_likelihood(), [], []
    for _ in range(30):
        m = drawn(100, rng)
        error = np.einsum("nij,nj->ni", m.R_i_e, model.sample(model.coordinate(m), rng))
        m = m.__class__(m.pixels, error, m.R_i_e, m.t, m.texture, m.method)  # the true shift is 0
        page["m"] = m
        state, P = page["likeliest"](model, m, np.zeros(2), 100 * np.eye(2), page["one_shift"], 12)
        nees.append(state @ np.linalg.solve(P, state))
        weights = np.linalg.inv(model.covariance(m))
        gaussian = np.linalg.solve(weights.sum(axis=0), np.einsum("nij,nj->i", weights, m.flow))
        ratio.append(np.linalg.norm(state) / np.linalg.norm(gaussian))
    assert 1.0 < np.mean(nees) < 3.4  # 2 freedoms
    assert np.median(ratio) < 0.5


def test_the_hand_written_pose_filter_is_honest(page):
    nees, rng = [], np.random.default_rng(1)
    for _ in range(40):
        truth, motions = gtsam_fusion.drawn_flight(6, rng)
        pose = page["PoseFilter"](RigidTransform.identity(), 1e-12 * np.eye(6))
        for k, motion in enumerate(motions, start=1):
            pose.move(motion)
            if k == 4:
                pose.fix(truth[k].translation + rng.normal(0, 0.02, 3), 0.02**2 * np.eye(3))
        eta = (pose.T_n_c.inv() * truth[-1]).as_exp_coords()
        nees.append(eta @ np.linalg.solve(pose.P, eta))
    low, high = stats.chi2(6 * len(nees)).ppf([1e-3, 1 - 1e-3])
    assert low < np.sum(nees) < high


def test_its_adjoint_is_the_librarys(page):
    T = random_motion(np.random.default_rng(0), 40.0, 3.0)
    np.testing.assert_allclose(page["adjoint"](T), adjoint(T), atol=1e-12)
    eta = 1e-4 * np.arange(1.0, 7.0)
    left = exp_se3(page["adjoint"](T) @ eta) * T
    np.testing.assert_allclose((T * exp_se3(eta)).as_matrix(), left.as_matrix(), atol=1e-7)


def test_gtsams_factor_has_the_motions_covariance(page):
    gtsam = pytest.importorskip("gtsam")
    motion = page["motions"][0]
    xi = 0.1 * np.sqrt(np.diag(motion.covariance))
    values = gtsam.Values()
    values.insert(0, gtsam.Pose3())
    values.insert(1, gtsam.Pose3((exp_se3(xi) * motion.T_k_prev).inv().as_matrix()))
    error = page["between"](gtsam, 0, 1, motion).error(values)
    assert 2 * error == pytest.approx(xi @ np.linalg.solve(motion.covariance, xi), rel=1e-3)


def test_robot_localization_is_given_the_twist():
    (text,) = blocks(PAGE, "yaml")
    parameters = yaml.safe_load(text)["ekf_filter_node"]["ros__parameters"]
    assert parameters["odom0"] == "/flowlik/odometry"
    taken = parameters["odom0_config"]
    assert len(taken) == 15
    assert [k for k, used in enumerate(taken) if used] == [*range(6, 12)]  # vx … vyaw
