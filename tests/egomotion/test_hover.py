"""Standing still before almost no texture: a camera that does not move must not drift away."""

import numpy as np
import pytest

from flowlik.egomotion import lcmsac, mle
from flowlik.flow import flow_method
from flowlik.geometry.camera import Pinhole
from flowlik.likelihood.model_file import load_likelihood
from flowlik.odometry.odometry import Odometry
from flowlik.simulation import Sensor, simulate

FRAMES = 12
# so little light that the image spans 50 grey levels and most texture is noise
DARK = Sensor(gain=0.03)


@pytest.mark.parametrize("make", [lcmsac, mle])
@pytest.mark.parametrize("model", ["lucas-kanade", "lucas-kanade-lcm"])
def test_hovering_before_little_texture_does_not_drift(make, model):
    camera = Pinhole.from_fov(240, 136, 120.0)
    sequence = simulate("planes", "hover", frames=FRAMES, seed=3, camera=camera, sensor=DARK)
    likelihood = load_likelihood(model)
    odometry = Odometry(camera, flow_method(likelihood.method), make(likelihood))
    motions = [
        odometry.step(sequence.image(k), sequence.timestamp(k), sequence.depth(k)) for k in range(FRAMES)
    ]
    steps = motions[1:]
    assert all(m.solved for m in steps)
    # noise of neighbouring steps cancels rather than adds up, so that the sum of covariances is a bound
    covariance = np.sum([m.covariance for m in steps], axis=0)
    end = odometry.poses[-1].inv()
    away = np.concatenate([end.rotation.as_rotvec(), end.translation])
    assert (np.abs(away) < 3 * np.sqrt(np.diag(covariance))).all()
    # no step is pulled the same way as all others
    errors = np.array([m.T_k_prev.as_exp_coords() for m in steps])
    assert (np.abs(errors.mean(axis=0)) < 4 * errors.std(axis=0, ddof=1) / np.sqrt(len(steps))).all()
