"""The paper's Bayes recursion over a simulated flight: flow as likelihood, constant velocity as prior.

Each frame's belief about the camera's motion is the previous one, widened by what an acceleration may have
changed, times the likelihood of the new flow. Run it with ``python examples/bayes_recursion.py``.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik import (
    EgoMotion,
    FlowLikelihood,
    GaussianPrior,
    KnownDepth,
    LucasKanade,
    Pinhole,
    measure,
    mle,
    simulate,
)
from flowlik.calibration import (
    Task,
    fit_likelihood,
    measured_pairs,
    sketch_blocks,
    split_blocks,
    with_shared_errors,
)
from flowlik.datasets import ImageSequence
from flowlik.geometry import relative_motion
from flowlik.likelihood import LaplaceCauchy
from flowlik.measurement import stratified_pixels

CAMERA = Pinhole.from_fov(320, 240, 90.0)
FRAMES_PER_SECOND = 60.0
ACCELERATION = np.array([3.0, 3.0, 3.0, 2.0, 2.0, 2.0])  # one sigma: rad/s² about, m/s² along the axes


def calibrated(method: LucasKanade) -> FlowLikelihood:
    """Likelihood of the flow, and of what its errors share, from a flight of another seed."""
    flight = simulate("planes", "training", 12, 6.0, 1, CAMERA)
    blocks = split_blocks(flight, seed=1)
    sketches = [found[0] for found in sketch_blocks(blocks, [Task(method)])]
    likelihood = fit_likelihood(sketches, LaplaceCauchy(), method)
    return with_shared_errors(likelihood, measured_pairs(blocks, method, likelihood.texture))


def recursion(flight: ImageSequence, likelihood: FlowLikelihood, method: LucasKanade) -> Iterator[EgoMotion]:
    """Beliefs about the motion from each frame to the next, each given all images so far."""
    acceleration = np.diag((ACCELERATION / FRAMES_PER_SECOND**2) ** 2)
    # before the first pair: at rest, give or take 10 m/s and 1 rad/s
    prior = GaussianPrior(
        RigidTransform.identity(), np.diag((np.array([1.0] * 3 + [10.0] * 3) / FRAMES_PER_SECOND) ** 2)
    )
    for k in range(len(flight) - 1):
        pixels = stratified_pixels(flight.image(k).shape, 600, np.random.default_rng(k))
        m = measure(flight.image(k), flight.image(k + 1), method, likelihood.texture, pixels)
        residual = KnownDepth.of(m, flight.camera, flight.depth(k))
        belief = mle(likelihood).estimate(residual, seed=k, prior=prior)
        yield belief
        # predict: the motion goes on, its uncertainty grows by the acceleration's
        prior = GaussianPrior(belief.T_k_prev, belief.covariance + acceleration)


def main(frames: int = 16) -> np.ndarray:
    """Fly, and return translation errors (K, 2) [m]: of the recursion and of each pair on its own."""
    method = LucasKanade(window=11)
    likelihood = calibrated(method)
    flight = simulate("planes", "straight", frames, 6.0, 5, CAMERA)
    errors = []
    for k, belief in enumerate(recursion(flight, likelihood, method)):
        true = relative_motion(flight.T_n_c(k), flight.T_n_c(k + 1))
        pixels = stratified_pixels(flight.image(k).shape, 600, np.random.default_rng(k))
        m = measure(flight.image(k), flight.image(k + 1), method, likelihood.texture, pixels)
        alone = mle(likelihood).estimate(KnownDepth.of(m, CAMERA, flight.depth(k)), seed=k)
        error = [np.linalg.norm(e.T_k_prev.translation - true.translation) for e in (belief, alone)]
        sigma = 1e3 * np.sqrt(np.trace(belief.covariance[3:, 3:]))
        ours, alone_mm = (1e3 * e for e in error)
        print(f"pair {k:2d}: recursion {ours:6.2f} mm (sigma {sigma:.2f} mm), alone {alone_mm:6.2f} mm")
        errors.append(error)
    return np.array(errors)


if __name__ == "__main__":
    main()
