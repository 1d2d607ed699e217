"""Flow and GPS in one factor graph: motions with their covariances as GTSAM between-factors.

Needs the extra ``fusion``: ``pip install 'flowlik[fusion]'``. The motions here are drawn, so that the example
takes a moment; `flowlik.Odometry.step` gives such motions of images.

GTSAM's Pose3 puts rotation first, as flowlik does, and perturbs on the right. A between-factor of X_prev and
X_k is the pose of camera k in camera k-1, the *inverse* of ``T_k_prev``. Since (exp(xi) T)⁻¹ = T⁻¹ exp(−xi),
the covariance of the left perturbation of ``T_k_prev`` is that of the right one of its inverse, unchanged;
that of ``T_k_prev`` itself would be turned by the adjoint (`flowlik.geometry.right_covariance`).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik import EgoMotion, Status
from flowlik.geometry import exp_se3

GPS_SIGMA_M = 0.5


def between_factor(gtsam, previous: int, current: int, motion: EgoMotion):  # type: ignore[no-untyped-def]
    """BetweenFactorPose3 of a solved, metric motion."""
    noise = gtsam.noiseModel.Gaussian.Covariance(motion.covariance)
    return gtsam.BetweenFactorPose3(previous, current, pose3(gtsam, motion.T_k_prev.inv()), noise)


def pose3(gtsam, T: RigidTransform):  # type: ignore[no-untyped-def]
    """Pose3 of a transform."""
    return gtsam.Pose3(T.as_matrix())


def drawn_flight(count: int, rng: np.random.Generator) -> tuple[list[RigidTransform], list[EgoMotion]]:
    """True poses T_n_c along an arc, and motions between them with errors drawn from their covariance."""
    covariance = np.diag(np.array([1e-3, 1e-3, 1e-3, 0.02, 0.01, 0.02]) ** 2)
    poses, motions = [RigidTransform.identity()], []
    for _ in range(count):
        T_k_prev = exp_se3(np.array([0.0, -0.02, 0.0, 0.0, 0.0, -0.5]))
        poses.append(poses[-1] * T_k_prev.inv())
        measured = exp_se3(rng.multivariate_normal(np.zeros(6), covariance)) * T_k_prev
        motions.append(EgoMotion(measured, np.linalg.inv(covariance), covariance, Status.SOLVED))
    return poses, motions


def main(count: int = 60) -> tuple[float, float]:
    """Return the position error [m] at the end: of flow alone, and fused with a GPS fix every 10 frames."""
    import gtsam

    rng = np.random.default_rng(0)
    poses, motions = drawn_flight(count, rng)
    graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    known = gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)
    graph.add(gtsam.PriorFactorPose3(0, pose3(gtsam, poses[0]), known))
    start.insert(0, pose3(gtsam, poses[0]))
    chained = poses[0]
    for k, motion in enumerate(motions, start=1):
        chained = chained * motion.T_k_prev.inv()
        start.insert(k, pose3(gtsam, chained))
        graph.add(between_factor(gtsam, k - 1, k, motion))
        if k % 10 == 0:
            fix = poses[k].translation + rng.normal(0, GPS_SIGMA_M, 3)
            graph.add(gtsam.GPSFactor(k, fix, gtsam.noiseModel.Isotropic.Sigma(3, GPS_SIGMA_M)))
    fused = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    position = fused.atPose3(count).translation()
    errors = (
        float(np.linalg.norm(chained.translation - poses[-1].translation)),
        float(np.linalg.norm(position - poses[-1].translation)),
    )
    print(f"flow alone {errors[0]:.3f} m, with GPS {errors[1]:.3f} m after {0.5 * count:.0f} m")
    return errors


if __name__ == "__main__":
    main()
