import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import EgoMotion, Status
from flowlik.evaluation.motion import length_records, length_sigma
from flowlik.geometry.trajectory import Trajectory, chain
from flowlik.results.records import Record

BASE = Record("x", 0.0, "", "made up", None, None, None, None, 0, 0, "scale=stereo")
T = RigidTransform.from_translation([0, 0, -1.0])
TRUTH = Trajectory(np.arange(201) / 10, chain([T] * 200))


def motion(metres, sigma, told=True):
    moved = RigidTransform.from_translation([0, 0, -metres])
    covariance = np.diag([0, 0, 0, 1.0, 1.0, sigma**2])
    return EgoMotion(moved, np.eye(6), covariance, Status.SOLVED, scale_known=told, length_predicted=not told)


def by_name(motions, truth=TRUTH):
    return {r.metric: r for r in length_records(motions, truth, BASE)}


def test_the_sigma_of_a_length_is_along_the_travel():
    assert length_sigma(motion(0.9, 0.02)) == pytest.approx(0.02)
    assert np.isnan(length_sigma(motion(0.0, 0.02)))


@pytest.mark.parametrize(
    ("stated", "within"), [(0.02, (0.9, 0.99)), (0.002, (0.0, 0.4)), (0.2, (0.999, 1.0))]
)
def test_coverage_tells_whether_lengths_know_their_errors(stated, within):
    rng = np.random.default_rng(0)
    motions = [motion(1 + 0.02 * rng.standard_normal(), stated, told=k % 4 > 0) for k in range(200)]
    records = by_name(motions)
    assert records["length_told_fraction"].value == 0.75
    assert within[0] <= records["length_coverage_95"].value <= within[1]
    assert records["length_nis_mean"].value == pytest.approx((0.02 / stated) ** 2, rel=0.3)
    assert records["length_error_median_percent"].value == pytest.approx(1.35, rel=0.3)
    assert records["length_coverage_95"].count == 200


def test_without_truth_or_a_stated_length_there_is_little_to_say():
    assert set(by_name([motion(1.0, 0.1)], None)) == {"length_told_fraction"}
    exact = by_name([motion(1.0, 0.0)] * 200)
    assert (exact["length_coverage_95"].value, exact["length_coverage_95"].count) == (None, 0)
    none = by_name([motion(1.0, 0.1, told=False)] * 200)
    assert (none["length_told_fraction"].value, none["length_error_median_percent"].value) == (0, None)
