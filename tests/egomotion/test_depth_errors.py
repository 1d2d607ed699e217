"""Motions from depth that errs: as far off as they say, and by components that are what was asked for."""

from dataclasses import replace

import numpy as np
import pytest

from flowlik.egomotion import mle, with_depth_errors
from flowlik.errors import DataError
from flowlik.geometry.motion import h
from flowlik.likelihood.likelihood import FlowLikelihood
from tests.helpers import CAMERA, make_scene, random_motion, tangent_error

SIGMA_PX = 0.1
MODEL = FlowLikelihood.constant_gaussian(SIGMA_PX)


def noisy(seed: int, sd_share: float = 0.015):
    """Residual of flow and depth that err, its deviations of inverse range, and the true motion."""
    rng = np.random.default_rng(seed)
    scene = make_scene(random_motion(rng, 1.0, 0.4), rng, 200, MODEL)
    exact = scene.known_depth
    sd = exact.rho * sd_share * rng.uniform(0.1, 2, len(exact.rho))
    return replace(exact, rho=exact.rho + sd * rng.standard_normal(len(sd))), sd, scene


def test_a_component_is_widened_by_what_depth_moves_along_it():
    """By finite differences of the predicted flow."""
    residual, sd, scene = noisy(0)
    wide = with_depth_errors(residual, MODEL, scene.T, sd)
    pixels = residual.measurements.pixels
    moved = (
        h(scene.T, CAMERA, pixels, residual.rho + 1e-6) - h(scene.T, CAMERA, pixels, residual.rho - 1e-6)
    ) / 2e-6
    along = np.einsum("nij,ni->nj", residual.measurements.R_i_e, moved) * sd[:, None]
    np.testing.assert_allclose(wide.widened, np.sqrt(1 + (along / SIGMA_PX) ** 2), rtol=1e-5)
    T, index = scene.T.as_matrix()[:3], MODEL.schedule.index
    np.testing.assert_allclose(
        wide.at(T, index).z * wide.widened.ravel(), residual.at(T, index).z, atol=1e-12
    )
    some = wide.sampling.among(np.arange(len(sd)) < 30)
    np.testing.assert_array_equal(some.at(T, index).z, wide.at(T, index).z[:60])


def test_motions_are_as_far_off_as_they_say():
    """NEES is 6 with depth's errors told, and far above where depth is taken as exact.

    Depth errs by 1.5 % on average: much more, and errors in what the Jacobian is made of bias the motion.
    """
    told, silent = [], []
    for seed in range(30):
        residual, sd, scene = noisy(seed)
        for values, r in ((told, with_depth_errors(residual, MODEL, scene.T, sd)), (silent, residual)):
            motion = mle(MODEL).estimate(r, start=scene.T)
            xi = tangent_error(motion.T_k_prev, scene.T)
            values.append((xi @ np.linalg.solve(motion.covariance, xi), (xi**2)[3:].sum()))
    nees, squared = np.mean(told, axis=0)
    assert abs(nees - 6) < 4 * np.sqrt(12 / 30)
    assert np.mean(silent, axis=0)[0] > 12
    assert squared < 0.8 * np.mean(silent, axis=0)[1]


def test_deviations_that_are_none():
    residual, sd, scene = noisy(0)
    for bad in (sd[:-1], -sd, sd * np.nan):
        with pytest.raises(DataError, match="need as many finite deviations"):
            with_depth_errors(residual, MODEL, scene.T, bad)
