"""Time offset and rotation between camera and IMU, from the images' rotations and the gyroscope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp
from scipy.stats import t as student

from flowlik.datasets.inertial import ImuSamples
from flowlik.errors import DataError
from flowlik.geometry.motion import skew
from flowlik.geometry.times import check_times
from flowlik.support.arrays import Array

FEWEST_MOTIONS = 30
LEAST_EXPLAINED = 0.5
"""Share of the variance of the images' rotations that a gyroscope must explain."""
ALIKE = 1.2
"""Two offsets whose squared residuals have a smaller ratio explain the rotations alike."""

STEP_S = 0.01
DIFFERENCE_S = 0.001
STEPS = 12
BLOCK_S, FEWEST_BLOCKS, MOST_BLOCKS = 2.0, 8, 20
CAUCHY = 3.0
CHI2_MEDIAN = 2.366
"""Median of chi-squared with three freedoms."""
MOST_CONDITION = 1e8


@dataclass(frozen=True, eq=False)
class TimeOffset:
    """How an IMU's stamps and axes stand to the camera's.

    Attributes
    ----------
    offset_s : float
        The IMU's stamp minus the camera's clock [s]: positive where the IMU is stamped late. Subtract it from
        the IMU's times.
    interval_s : tuple of 2 float
        Interval [s] of the confidence that was asked for.
    R_c_i : Rotation
        Takes the IMU's axes to the camera's.
    rotation_covariance : array (3, 3)
        Of its left perturbation, in the camera's axes [rad²]; zero where the rotation was given.
    gyroscope_bias_c_radps : array (3,)
        What the gyroscope reads at rest [rad/s], in the camera's axes.
    explained : float
        Share of the variance of the images' rotations that the gyroscope explains.
    motions : int
        How many motions were used.
    """

    offset_s: float
    interval_s: tuple[float, float]
    R_c_i: Rotation
    rotation_covariance: Array
    gyroscope_bias_c_radps: Array
    explained: float
    motions: int


def estimate_time_offset(
    frame_times_s: Array,
    R_k_prev: Rotation,
    imu: ImuSamples,
    R_c_i: Rotation | None = None,
    most_s: float = 0.3,
    confidence: float = 0.95,
) -> TimeOffset:
    """Estimate how late an IMU is stamped and how it is turned, from a flight's rotations.

    Each motion's rotation vector is that of the gyroscope over the same time, turned, plus a bias. For every
    offset on a grid the turn has a closed form (Wahba's problem, by the singular value decomposition); from
    the best on, all are refined together by least squares, with the residuals' own covariance and Cauchy's
    weights. Intervals follow from the scatter of 8 to 20 blocks of time, of 2 s if there are so many, so that
    errors that stay from frame to frame count as they should; where the three axes alone tell offsets that
    differ by more than they may, the interval is wider by the root of that excess (Birge's ratio).

    Parameters
    ----------
    frame_times_s : array (N,)
        Times [s] of frames, increasing.
    R_k_prev : Rotation of N - 1
        Of each motion, from frame k-1 to k: ``EgoMotion.T_k_prev.rotation``. A few that are wrong are
        weighted down.
    imu : ImuSamples
        The IMU.
    R_c_i : Rotation, optional
        Takes the IMU's axes to the camera's, if it is known.
    most_s : float
        Largest offset [s] that is looked for, of either sign.
    confidence : float
        Of the interval.

    Raises
    ------
    DataError
        If numbers do not fit, or fewer than 30 motions lie within the IMU's times; if the gyroscope explains
        less than half of the rotations' variance (there is too little rotation, or it is another flight's);
        if the best offset lies at the end of what is looked for, or two explain the rotations alike; or if
        the rotations leave the turn undetermined (all about one axis), and it is not given.
    """
    a_s, b_s, turned = _used(frame_times_s, R_k_prev, imu, most_s)
    attitudes = _integrated(imu)
    grid_s = np.arange(-most_s, most_s + STEP_S / 2, STEP_S)
    centred = turned - turned.mean(axis=0)
    total = float((centred**2).sum())
    misfit = np.array([_misfit(centred, _between(attitudes, a_s + s, b_s + s), R_c_i)[0] for s in grid_s])
    _check_minimum(grid_s, misfit, total, most_s)
    offset_s = float(grid_s[misfit.argmin()])
    R = _misfit(centred, _between(attitudes, a_s + offset_s, b_s + offset_s), R_c_i)[1]
    return _refined(a_s, b_s, turned, attitudes, offset_s, R, R_c_i is None, confidence)


def _used(times_s: Array, R_k_prev: Rotation, imu: ImuSamples, most_s: float) -> tuple[Array, Array, Array]:
    """Begin and end (M,) [s] of motions within the IMU's times, and their rotation vectors (M, 3) in {c}."""
    times_s = np.asarray(times_s, dtype=np.float64)
    check_times(times_s, "frames")
    if R_k_prev.single or len(R_k_prev) != len(times_s) - 1:
        count = 1 if R_k_prev.single else len(R_k_prev)
        raise DataError(f"{len(times_s)} frames have {count} rotations, expected one less")
    if not 0 < most_s < np.inf:
        raise DataError(f"no largest offset of {most_s:g} s")
    a_s, b_s = times_s[:-1], times_s[1:]
    inside = (a_s - most_s >= imu.times_s[0]) & (b_s + most_s <= imu.times_s[-1])
    if inside.sum() < FEWEST_MOTIONS:
        raise DataError(
            f"{int(inside.sum())} motions lie within the IMU's times by {most_s:g} s, at least "
            f"{FEWEST_MOTIONS} are needed for a time offset"
        )
    return a_s[inside], b_s[inside], R_k_prev[inside].inv().as_rotvec()


def _integrated(imu: ImuSamples) -> Slerp:
    """Attitude over time by the gyroscope, from its first sample on."""
    steps = np.diff(imu.times_s)[:, None] * (imu.angular_rate_radps[1:] + imu.angular_rate_radps[:-1]) / 2
    whole = np.zeros((len(steps) + 1, 4))
    whole[0, 3] = 1.0
    turns = Rotation.from_rotvec(steps).as_quat()
    for k, (x, y, z, w) in enumerate(turns.tolist()):
        a, b, c, d = whole[k]
        whole[k + 1] = (
            d * x + a * w + b * z - c * y,
            d * y - a * z + b * w + c * x,
            d * z + a * y - b * x + c * w,
            d * w - a * x - b * y - c * z,
        )
    return Slerp(imu.times_s, Rotation.from_quat(whole))


def _between(attitudes: Slerp, a_s: Array, b_s: Array) -> Array:
    """Rotation vectors (M, 3) of the gyroscope between times, in {i}."""
    return np.asarray((attitudes(a_s).inv() * attitudes(b_s)).as_rotvec())


def _misfit(centred_c: Array, of_gyroscope_i: Array, R_c_i: Rotation | None) -> tuple[float, Rotation]:
    """Least squares over the turn (unless given) and a bias: the sum of squares, and the turn."""
    centred_i = of_gyroscope_i - of_gyroscope_i.mean(axis=0)
    if R_c_i is None:
        U, _, Vt = np.linalg.svd(centred_c.T @ centred_i)
        R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
        R_c_i = Rotation.from_matrix(R)
    return float(((centred_c - R_c_i.apply(centred_i)) ** 2).sum()), R_c_i


def _check_minimum(grid_s: Array, misfit: Array, total: float, most_s: float) -> None:
    best = int(misfit.argmin())
    explained = 1 - misfit[best] / total if total > 0 else 0.0
    if explained < LEAST_EXPLAINED:
        raise DataError(
            f"no time offset: the gyroscope explains {max(explained, 0):.0%} of the images' rotations; there "
            "is too little rotation, or they are of another flight"
        )
    if best in (0, len(grid_s) - 1):
        raise DataError(f"no time offset: the best lies at the end of what is looked for, {most_s:g} s")
    inner = misfit[1:-1]
    minima = 1 + np.flatnonzero((inner <= misfit[:-2]) & (inner <= misfit[2:]))
    others = [int(k) for k in minima if abs(k - best) > 1 and misfit[k] < ALIKE * misfit[best]]
    if others:
        raise DataError(
            f"no time offset: {grid_s[best]:.3f} s and {grid_s[others[0]]:.3f} s explain the rotations alike"
        )


def _refined(
    a_s: Array,
    b_s: Array,
    turned: Array,
    attitudes: Slerp,
    offset_s: float,
    R_c_i: Rotation,
    free_turn: bool,
    confidence: float,
) -> TimeOffset:
    """Offset, turn and bias by weighted least squares from a start, with their covariance."""
    bias = np.zeros(3)
    used: NDArray[np.intp] = np.array([0, *(range(1, 4) if free_turn else ()), 4, 5, 6])
    weight = np.ones(len(a_s))
    for _ in range(STEPS):
        r, J = _linearised(a_s, b_s, turned, attitudes, offset_s, R_c_i, bias)
        C = (r * weight[:, None]).T @ r / weight.sum() + np.finfo(float).tiny * np.eye(3)
        whiten = np.linalg.inv(np.linalg.cholesky(C))
        white, J = r @ whiten.T, whiten @ J[:, :, used]
        squared = (white**2).sum(axis=1)
        weight = 1 / (1 + squared / (CAUCHY**2 * np.median(squared) / CHI2_MEDIAN))
        gradient = np.einsum("kij,ki,k->kij", J, white, weight)
        curvature = np.einsum("kij,kil,k->ijl", J, J, weight)
        A = curvature.sum(axis=0)
        if np.linalg.cond(A / np.sqrt(np.outer(np.diag(A), np.diag(A)))) > MOST_CONDITION:
            raise DataError(
                "no turn between camera and IMU: the rotations are all about one axis; give it if it is known"
            )
        step = np.zeros(7)
        step[used] = -np.linalg.solve(A, gradient.sum(axis=(0, 1)))
        offset_s, bias = offset_s + step[0], bias + step[4:]
        R_c_i = Rotation.from_rotvec(step[1:4]) * R_c_i
        if abs(step[0]) < 1e-7 and np.abs(step[1:4]).max() < 1e-8:
            break
    blocks = int(np.clip((b_s[-1] - a_s[0]) / BLOCK_S, FEWEST_BLOCKS, MOST_BLOCKS))
    sums = np.array([part.sum(axis=0) for part in np.array_split(gradient, blocks)])
    inverse, unbiased = np.linalg.inv(A), blocks / (blocks - 1)
    whole = sums.sum(axis=1)
    covariance = unbiased * inverse @ (whole.T @ whole) @ inverse
    # each axis alone moves the offset by so much, and may by so much
    moved = sums[:, :, 0].sum(axis=0) / curvature[:, 0, 0]
    may = unbiased * (sums[:, :, 0] ** 2).sum(axis=0) / curvature[:, 0, 0] ** 2
    ratio = max(1.0, float((moved**2 / may).sum()) / 2)
    half_s = float(student.ppf((1 + confidence) / 2, blocks - 1) * np.sqrt(ratio * covariance[0, 0]))
    centred = turned - turned.mean(axis=0)
    return TimeOffset(
        offset_s=float(offset_s),
        interval_s=(float(offset_s - half_s), float(offset_s + half_s)),
        R_c_i=R_c_i,
        rotation_covariance=covariance[1:4, 1:4] if free_turn else np.zeros((3, 3)),
        gyroscope_bias_c_radps=bias,
        explained=float(1 - (r**2).sum() / (centred**2).sum()),
        motions=len(a_s),
    )


def _linearised(
    a_s: Array, b_s: Array, turned: Array, attitudes: Slerp, offset_s: float, R_c_i: Rotation, bias: Array
) -> tuple[Array, Array]:
    """Residuals (M, 3) [rad], and their derivatives (M, 3, 7) by offset, left turn and bias."""
    at = [
        R_c_i.apply(_between(attitudes, a_s + s, b_s + s))
        for s in (offset_s, offset_s + DIFFERENCE_S, offset_s - DIFFERENCE_S)
    ]
    elapsed_s = (b_s - a_s)[:, None]
    J = np.empty((len(a_s), 3, 7))
    J[:, :, 0] = (at[2] - at[1]) / (2 * DIFFERENCE_S)
    J[:, :, 1:4] = skew(at[0])
    J[:, :, 4:] = elapsed_s[:, :, None] * np.eye(3)
    return turned - at[0] + elapsed_s * bias, J
