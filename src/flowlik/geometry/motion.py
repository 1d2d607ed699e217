"""Two-view geometry: predicted flow h of the paper's Eq. (1)-(4), the epipolar distance, and their Jacobians.

Motions are ``T_k_prev``: they take points in the camera frame of image k-1 to that of image k. Their
tangent is (rotation vector [rad], translation [m]) with the left perturbation ``T <- exp(xi) T``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.camera import Pinhole
from flowlik.support.arrays import Array


def relative_motion(T_n_prev: RigidTransform, T_n_k: RigidTransform) -> RigidTransform:
    """Motion ``T_k_prev`` between two camera poses in {n}; below Eq. (1)."""
    return T_n_k.inv() * T_n_prev


def exp_se3(xi: Array) -> RigidTransform:
    """Rigid transform of a tangent vector (6,): rotation vector [rad], then translation [m]."""
    return RigidTransform.from_exp_coords(np.asarray(xi, dtype=np.float64))


def scaled(T_k_prev: RigidTransform, distance_m: float) -> RigidTransform:
    """Return the motion with a translation of the given length [m]; a zero translation stays zero."""
    length = float(np.linalg.norm(T_k_prev.translation))
    factor = distance_m / length if length > 0 else 0.0
    return RigidTransform.from_components(T_k_prev.translation * factor, T_k_prev.rotation)


def adjoint(T: RigidTransform) -> Array:
    """Adjoint (6, 6) of a transform: ``T exp(xi) T^-1 = exp(Ad xi)``, tangent as (rotation, translation)."""
    R = T.rotation.as_matrix()
    adjoint = np.zeros((6, 6))
    adjoint[:3, :3] = adjoint[3:, 3:] = R
    adjoint[3:, :3] = skew(T.translation) @ R
    return adjoint


def _small_adjoint(xi: Array) -> Array:
    """Matrix (6, 6) of the Lie bracket with a tangent vector (6,)."""
    ad = np.zeros((6, 6))
    ad[:3, :3] = ad[3:, 3:] = skew(xi[:3])
    ad[3:, :3] = skew(xi[3:])
    return ad


def inverse_left_jacobian(xi: Array) -> Array:
    """Derivative (6, 6) of ``log(exp(delta) exp(xi))`` by delta at 0; to the fourth order of xi (6,)."""
    ad = _small_adjoint(xi)
    square = ad @ ad
    return np.eye(6) - ad / 2 + square / 12 - square @ square / 720


def right_covariance(T: RigidTransform, covariance: Array) -> Array:
    """Covariance (6, 6) of the right perturbation ``T exp(eta)`` from that of the left one, ``exp(xi) T``.

    GTSAM perturbs on the right. The *inverse* needs no conversion: ``(exp(xi) T)^-1 = T^-1 exp(-xi)``.
    """
    turn = adjoint(T.inv())
    return turn @ covariance @ turn.T


def skew(v: Array) -> Array:
    """Matrices (..., 3, 3) with ``skew(v) @ w = v x w``."""
    v = np.asarray(v, dtype=np.float64)
    S = np.zeros((*v.shape, 3))
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return S - np.swapaxes(S, -1, -2)


def inverse_range(camera: Pinhole, pixels: Array, depth_z: Array) -> Array:
    """Inverse range rho (N,) [1/m] along the ray of each pixel from depth (N,) [m] along z; Eq. (1)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1.0 / (depth_z * np.linalg.norm(camera.rays(pixels), axis=-1))


def _moved_directions(T_k_prev: RigidTransform, camera: Pinhole, pixels: Array, rho: Array) -> Array:
    """Points (N, 3) of Eq. (1) in {c} of image k, scaled by rho: ``C T [p2v(p); rho]``."""
    return T_k_prev.rotation.apply(camera.p2v(pixels)) + rho[:, None] * T_k_prev.translation


def g(T_k_prev: RigidTransform, camera: Pinhole, pixels: Array, rho: Array) -> Array:
    """Pixels (N, 2) in image k of pixels (N, 2) of image k-1 with inverse range rho (N,) [1/m]; Eq. (1)."""
    return camera.v2p(_moved_directions(T_k_prev, camera, pixels, rho))


def h(T_k_prev: RigidTransform, camera: Pinhole, pixels: Array, rho: Array) -> Array:
    """Predicted flow (N, 2) [px] of pixels (N, 2) of image k-1; Eq. (3). NaN behind the camera."""
    return g(T_k_prev, camera, pixels, rho) - pixels


def h_jacobian(T_k_prev: RigidTransform, camera: Pinhole, pixels: Array, rho: Array) -> Array:
    """Derivative (N, 2, 6) [px/rad, px/m] of `h` along the tangent of ``T_k_prev`` (left perturbation)."""
    moved = _moved_directions(T_k_prev, camera, pixels, rho)
    translation = np.broadcast_to(np.eye(3), (len(moved), 3, 3)) * rho[:, None, None]
    return camera.v2p_jacobian(moved) @ np.concatenate([-skew(moved), translation], axis=-1)


def essential_matrix(T_k_prev: RigidTransform) -> Array:
    """Essential matrix (3, 3), ``x_k^T E x_prev = 0`` for rays, with a unit translation."""
    t = T_k_prev.translation / np.linalg.norm(T_k_prev.translation)
    return skew(t) @ T_k_prev.rotation.as_matrix()


def epipolar_error(
    T_k_prev: RigidTransform, camera: Pinhole, pixels: Array, flow: Array
) -> tuple[Array, Array, Array]:
    """Signed distance of measured end points to their epipolar lines in image k.

    Parameters
    ----------
    T_k_prev : RigidTransform
        Motion; the length of its translation does not matter, but must not be zero.
    camera : Pinhole
        Camera of both images.
    pixels, flow : array (N, 2)
        Pixels of image k-1 and measured flow [px].

    Returns
    -------
    z : array (N,)
        Distance [px], positive on the side of the normal.
    normal : array (N, 2)
        Unit normal of each line in {i}; the sign of z goes with its direction.
    jacobian : array (N, 6)
        Derivative of z along the tangent of ``T_k_prev`` (translation of unit length).
    """
    t = T_k_prev.translation / np.linalg.norm(T_k_prev.translation)
    turned = T_k_prev.rotation.apply(camera.rays(pixels))
    end = camera.rays(pixels + flow)
    line = np.cross(t, turned)
    slope = line[:, :2] / [camera.fx, camera.fy]
    length = np.linalg.norm(slope, axis=1)
    normal = slope / length[:, None]
    z = np.einsum("ij,ij->i", line, end) / length
    # dz = dline . along, since both numerator and length are functions of the line alone
    along = end.copy()
    along[:, :2] -= z[:, None] * normal / [camera.fx, camera.fy]
    along /= length[:, None]
    rotation = np.cross(line, along)  # d line = omega x line
    translation = np.cross(turned, along)  # d line = upsilon x turned
    return z, normal, np.concatenate([rotation, translation], axis=1)


def decompose_essential(E: Array) -> list[RigidTransform]:
    """Return the four motions with unit translation that share an essential matrix (3, 3)."""
    U, _, Vt = np.linalg.svd(E)
    U, Vt = U * np.sign(np.linalg.det(U)), Vt * np.sign(np.linalg.det(Vt))
    W = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    rotations = (U @ W @ Vt, U @ W.T @ Vt)
    return [_transform(R, s * U[:, 2]) for R in rotations for s in (1.0, -1.0)]


def in_front(T_k_prev: RigidTransform, camera: Pinhole, pixels: Array, flow: Array) -> NDArray[np.bool_]:
    """Whether each match (N,) triangulates in front of both cameras."""
    a = T_k_prev.rotation.apply(camera.rays(pixels))
    b = camera.rays(pixels + flow)
    t = T_k_prev.translation
    # least squares of depth_prev * a + t = depth_k * b
    aa, bb, ab = (np.einsum("ij,ij->i", p, q) for p, q in ((a, a), (b, b), (a, b)))
    at, bt = a @ t, b @ t
    determinant = aa * bb - ab**2
    return (ab * bt - bb * at > 0) & (aa * bt - ab * at > 0) & (determinant > 0)


def _transform(R: Array, t: Array) -> RigidTransform:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return RigidTransform.from_matrix(T)
