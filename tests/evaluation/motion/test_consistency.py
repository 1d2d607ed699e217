import numpy as np
import pytest

from flowlik.errors import DataError
from flowlik.evaluation.motion import consistency, consistency_records, tangent_errors
from flowlik.geometry.motion import exp_se3
from flowlik.results.records import Record

SCALES = np.array([1e-4, 2e-4, 1e-4, 1e-2, 3e-2, 1e-2])


def drawn(count, rng, rank=6):
    basis = np.linalg.qr(rng.standard_normal((count, 6, 6)))[0][:, :, :rank]
    roots = SCALES[:, None] * basis * rng.uniform(0.3, 3, (count, 1, rank))
    covariances = roots @ roots.transpose(0, 2, 1)
    return np.einsum("kij,kj->ki", roots, rng.standard_normal((count, rank))), covariances


@pytest.mark.parametrize("rank", [6, 5])
def test_errors_drawn_from_their_covariances_are_consistent(rank):
    found = consistency(*drawn(20_000, np.random.default_rng(0), rank))
    assert found.freedoms == rank
    assert found.mean == pytest.approx(rank, rel=0.03)
    assert found.trimmed_mean == pytest.approx(rank, rel=0.03)
    assert found.median == pytest.approx({6: 5.348, 5: 4.351}[rank], rel=0.03)
    for confidence in (0.5, 0.9, 0.95):
        assert found.coverage(confidence) == pytest.approx(confidence, abs=0.015)


def test_a_covariance_half_as_large_doubles_it():
    errors, covariances = drawn(5000, np.random.default_rng(1))
    assert consistency(errors, covariances / 2).mean == pytest.approx(
        2 * consistency(errors, covariances).mean, rel=1e-6
    )


def test_errors_are_along_the_left_tangent():
    T, xi = exp_se3(np.array([0.1, 0.2, 0.0, 1.0, 0.0, 2.0])), np.array([1e-3, 0, 2e-3, 0.01, 0.02, 0.0])
    np.testing.assert_allclose(tangent_errors([exp_se3(xi) * T], [T])[0], xi, atol=1e-12)


def test_records_say_which_covariance_they_judge():
    found = consistency(*drawn(100, np.random.default_rng(2)))
    records = consistency_records(
        found, Record("x", 0.0, "", dataset="here", protocol="gate=none"), "sandwich"
    )
    assert {r.metric for r in records} == {
        "nees_mean", "nees_trimmed_mean", "nees_median", "ellipsoid_coverage_50", "ellipsoid_coverage_90",
        "ellipsoid_coverage_95",
    }  # fmt: skip
    assert {r.protocol for r in records} == {"gate=none; covariance=sandwich; freedoms=6"}
    assert {r.count for r in records} == {100}


def test_what_cannot_be_judged_is_refused():
    errors, covariances = drawn(3, np.random.default_rng(3))
    with pytest.raises(DataError, match="no frames"):
        consistency(errors[:0], covariances[:0])
    with pytest.raises(DataError, match="not finite"):
        consistency(errors, np.where(np.arange(3)[:, None, None] == 1, np.nan, covariances))
    fifth = drawn(1, np.random.default_rng(4), 5)[1]
    with pytest.raises(DataError, match="different rank"):
        consistency(errors, np.concatenate([covariances[:2], fifth]))
