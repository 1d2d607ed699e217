"""The smoother and the error-state filter, which share no code, say the same on the same draws."""

import numpy as np
import pytest

from flowlik.fusion import ColouredGps
from flowlik.likelihood.model_file import load_likelihood

pytest.importorskip("gtsam")
import fusion
from error_state_filter import Coloured
from fused_over_time import ways
from gps_integrity_flights import COLOURED, GPS_MEMORY_S, WHITE, drawn_flight


@pytest.mark.parametrize(
    ("form", "receiver"), [("given-rotation", WHITE), ("full", WHITE), ("full", COLOURED)]
)
def test_smoother_and_filter_agree(form, receiver):
    likelihood = load_likelihood("lucas-kanade")
    stays = likelihood.shared_errors.over_time
    flight = drawn_flight(3, 1.2, stays)
    factor = ways(likelihood, stays)[form]
    flows = [factor(motion) for motion in flight.motions.estimated]
    of = fusion.drawn(flight, 2, 0, receiver, modelled=receiver is COLOURED)
    starts = fusion.starts_of(of)
    colour = ColouredGps(0.5, GPS_MEMORY_S) if receiver is COLOURED else None
    found, _ = fusion.by_smoother(of, starts, flows, outage=(0.5, 0.7), coloured=colour)
    smoothed, filtered = fusion.judged(of, found), fusion.by_filter(of, flows, (0.5, 0.7))
    sigma = np.sqrt(np.diagonal(filtered.covariances, axis1=-2, axis2=-1))
    assert np.abs((smoothed.errors - filtered.errors) / sigma).max() < 0.05
    ratio = np.sqrt(np.diagonal(smoothed.covariances, axis1=-2, axis2=-1)) / sigma
    np.testing.assert_allclose(ratio, 1, atol=0.02)
    assert isinstance(of.robot.coloured, Coloured | None)
    # what a monitor is told is the same too
    own, (record, innovations) = found[0].innovations, of.robot.innovations(found[0].innovations.times_s)
    np.testing.assert_allclose(own.innovations_m, innovations[:, 0], atol=0.02)
    np.testing.assert_allclose(
        own.innovation_covariances_m2, record.innovation_covariances_m2, rtol=0.01, atol=0.01
    )
