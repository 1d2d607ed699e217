"""Compiled kernels of ego-motion: linearisation, minimal solutions and support. Twins stand in the tests.

Motions are (3, 4) matrices [R | t]. Cameras are (fx, fy, cx, cy).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from flowlik.likelihood.tables import bilinear, magnitude_position

NEWTON_STEPS = 10
NEWTON_TOLERANCE_PX = 1e-6


@njit(cache=True)
def retract(T, step):  # type: ignore[no-untyped-def]
    """Left retraction: R <- exp(omega) R, t <- exp(omega) t + upsilon; equals exp(xi) T to first order."""
    wx, wy, wz = step[0], step[1], step[2]
    angle = np.sqrt(wx * wx + wy * wy + wz * wz)
    a = np.sin(angle) / angle if angle > 1e-8 else 1.0
    b = (1 - np.cos(angle)) / (angle * angle) if angle > 1e-8 else 0.5
    # exp(W) = 1 + a W + b W^2, written out: arrays in expressions take seconds to compile
    E00, E01, E02 = 1 - b * (wy * wy + wz * wz), b * wx * wy - a * wz, b * wx * wz + a * wy
    E10, E11, E12 = b * wx * wy + a * wz, 1 - b * (wx * wx + wz * wz), b * wy * wz - a * wx
    E20, E21, E22 = b * wx * wz - a * wy, b * wy * wz + a * wx, 1 - b * (wx * wx + wy * wy)
    moved = np.empty((3, 4))
    for j in range(4):
        moved[0, j] = E00 * T[0, j] + E01 * T[1, j] + E02 * T[2, j]
        moved[1, j] = E10 * T[0, j] + E11 * T[1, j] + E12 * T[2, j]
        moved[2, j] = E20 * T[0, j] + E21 * T[1, j] + E22 * T[2, j]
    for i in range(3):
        moved[i, 3] += step[3 + i]
    return moved


@njit(cache=True, inline="always")
def _point(T, direction, rho):  # type: ignore[no-untyped-def]
    x = T[0, 0] * direction[0] + T[0, 1] * direction[1] + T[0, 2] * direction[2] + rho * T[0, 3]
    y = T[1, 0] * direction[0] + T[1, 1] * direction[1] + T[1, 2] * direction[2] + rho * T[1, 3]
    z = T[2, 0] * direction[0] + T[2, 1] * direction[1] + T[2, 2] * direction[2] + rho * T[2, 3]
    return x, y, z


@njit(cache=True, inline="always")
def _depth_rows(T, direction, rho, end, camera, J):  # type: ignore[no-untyped-def]
    """Error (2,) of one point in {i} and its Jacobian, written to J (2, 6); z <= 0 leaves both unset."""
    x, y, z = _point(T, direction, rho)
    if z <= 1e-9:
        return 0.0, 0.0, False
    fx, fy, cx, cy = camera
    iz = 1.0 / z
    xn, yn = x * iz, y * iz
    J[0, 0], J[0, 1], J[0, 2] = fx * xn * yn, -fx * (1 + xn * xn), fx * yn
    J[1, 0], J[1, 1], J[1, 2] = fy * (1 + yn * yn), -fy * xn * yn, -fy * xn
    J[0, 3], J[0, 4], J[0, 5] = -fx * iz * rho, 0.0, fx * xn * iz * rho
    J[1, 3], J[1, 4], J[1, 5] = 0.0, -fy * iz * rho, fy * yn * iz * rho
    return end[0] - (fx * xn + cx), end[1] - (fy * yn + cy), True


@njit(cache=True, nogil=True)
def linearise_depth(T, directions, rho, ends, R_i_e, camera):  # type: ignore[no-untyped-def]
    """Eigenbasis errors (2N,) [px] and Jacobian (2N, 6); NaN errors behind the camera."""
    n = len(rho)
    z, J = np.empty(2 * n), np.zeros((2 * n, 6))
    rows = np.empty((2, 6))
    for i in range(n):
        u, v, valid = _depth_rows(T, directions[i], rho[i], ends[i], camera, rows)
        if not valid:
            z[2 * i] = z[2 * i + 1] = np.nan
            continue
        for e in range(2):
            a, b = R_i_e[i, 0, e], R_i_e[i, 1, e]
            z[2 * i + e] = a * u + b * v
            for j in range(6):
                J[2 * i + e, j] = a * rows[0, j] + b * rows[1, j]
    return z, J


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def equations_depth(T, directions, rho, ends, R_i_e, camera, rows, fisher, used, log_prob, weight, widened):  # type: ignore[no-untyped-def]
    """`linearise_depth` and `tables.normal_equations` in one pass: H, b, sum of log_prob, components lost.

    A vector's two components share its Jacobian in {i}; what they say is turned into {i} first.
    """
    H, b, total, lost = np.zeros((6, 6)), np.zeros(6), 0.0, 0
    J = np.empty((2, 6))
    last_row, scale = log_prob.shape[0] - 2, 1.0 / widened
    for n in range(len(rho)):
        if used[2 * n] == 0 and used[2 * n + 1] == 0:
            continue
        u, v, valid = _depth_rows(T, directions[n], rho[n], ends[n], camera, J)
        if not valid:
            lost += int(used[2 * n]) + int(used[2 * n + 1])
            continue
        gu = gv = fuu = fuv = fvv = 0.0
        for c in (2 * n, 2 * n + 1):
            if used[c] == 0:
                continue
            p, q = scale * R_i_e[n, 0, c - 2 * n], scale * R_i_e[n, 1, c - 2 * n]
            z = p * u + q * v
            i, (j, f) = min(int(rows[c]), last_row), magnitude_position(abs(z))
            a = rows[c] - i
            total += bilinear(log_prob, i, a, j, f)
            wz = bilinear(weight, i, a, j, f) * z
            gu += wz * p
            gv += wz * q
            fuu += fisher[c] * p * p
            fuv += fisher[c] * p * q
            fvv += fisher[c] * q * q
        for i in range(6):
            b[i] -= gu * J[0, i] + gv * J[1, i]
            fu, fv = fuu * J[0, i] + fuv * J[1, i], fuv * J[0, i] + fvv * J[1, i]
            for j in range(i, 6):
                H[i, j] += fu * J[0, j] + fv * J[1, j]
    for i in range(6):
        for j in range(i):
            H[i, j] = H[j, i]
    return H, b, total, lost


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def total_scores_depth(motions, directions, rho, ends, R_i_e, camera, rows, used, bounds, weight):  # type: ignore[no-untyped-def]
    """Gradients (K, 6) of `equations_depth` at motions (K, 3, 4), of the components within bounds (2N,)."""
    scores, last_row = np.zeros((len(motions), 6)), weight.shape[0] - 2
    fx, fy, cx, cy = camera
    for n in range(len(rho)):
        if used[2 * n] == 0 and used[2 * n + 1] == 0:
            continue
        first, second = 2 * n, 2 * n + 1
        i1, i2 = min(int(rows[first]), last_row), min(int(rows[second]), last_row)
        a1, a2 = rows[first] - i1, rows[second] - i2
        b1 = bounds[first] if used[first] else -1.0
        b2 = bounds[second] if used[second] else -1.0
        p1, q1, p2, q2 = R_i_e[n, 0, 0], R_i_e[n, 1, 0], R_i_e[n, 0, 1], R_i_e[n, 1, 1]
        for k in range(len(motions)):
            x, y, z = _point(motions[k], directions[n], rho[n])
            if z <= 1e-9:
                continue
            iz = 1.0 / z
            x, y = x * iz, y * iz
            u, v = ends[n, 0] - (fx * x + cx), ends[n, 1] - (fy * y + cy)
            z1, z2 = p1 * u + q1 * v, p2 * u + q2 * v
            gu = gv = 0.0
            if abs(z1) <= b1:
                j, f = magnitude_position(abs(z1))
                wz = bilinear(weight, i1, a1, j, f) * z1
                gu, gv = wz * p1, wz * q1
            if abs(z2) <= b2:
                j, f = magnitude_position(abs(z2))
                wz = bilinear(weight, i2, a2, j, f) * z2
                gu, gv = gu + wz * p2, gv + wz * q2
            # the rows of the Jacobian, multiplied out
            gu, gv = fx * gu, fy * gv
            along = gu * x + gv * y
            scores[k, 0] -= along * y + gv
            scores[k, 1] += along * x + gu
            scores[k, 2] -= gu * y - gv * x
            scores[k, 3] += gu * iz * rho[n]
            scores[k, 4] += gv * iz * rho[n]
            scores[k, 5] -= along * iz * rho[n]
    return scores


@njit(cache=True, nogil=True)
def support_depth(motions, directions, rho, ends, R_i_e, camera, bounds, by_vector, first, last, counts):  # type: ignore[no-untyped-def]
    """Inliers of each motion (K, 3, 4): components within bounds (N, 2), or vectors within bounds[:, 0].

    A negative bound leaves a component out. Motions first to last are counted.
    """
    fx, fy, cx, cy = camera
    for k in range(first, last):
        T, count = motions[k], 0
        for i in range(len(rho)):
            x, y, z = _point(T, directions[i], rho[i])
            if z <= 1e-9:
                continue
            iz = 1.0 / z
            u, v = ends[i, 0] - (fx * x * iz + cx), ends[i, 1] - (fy * y * iz + cy)
            z1 = R_i_e[i, 0, 0] * u + R_i_e[i, 1, 0] * v
            z2 = R_i_e[i, 0, 1] * u + R_i_e[i, 1, 1] * v
            b1, b2 = bounds[i, 0], bounds[i, 1]
            if by_vector:
                if b1 < 0:
                    z1 = 0.0
                if b2 < 0:
                    z2 = 0.0
                b = max(b1, b2)
                count += b >= 0 and z1 * z1 + z2 * z2 <= b * b
            else:
                count += abs(z1) <= b1
                count += abs(z2) <= b2
        counts[k] = count


@njit(cache=True)
def _solve6(A, b):  # type: ignore[no-untyped-def]
    """Solve a (6, 6) system in place by elimination with pivoting; False if it is singular."""
    for i in range(6):
        pivot = i
        for r in range(i + 1, 6):
            if abs(A[r, i]) > abs(A[pivot, i]):
                pivot = r
        if abs(A[pivot, i]) < 1e-12:
            return False
        if pivot != i:
            for c in range(6):
                A[i, c], A[pivot, c] = A[pivot, c], A[i, c]
            b[i], b[pivot] = b[pivot], b[i]
        for r in range(i + 1, 6):
            f = A[r, i] / A[i, i]
            for c in range(i, 6):
                A[r, c] -= f * A[i, c]
            b[r] -= f * b[i]
    for i in range(5, -1, -1):
        for c in range(i + 1, 6):
            b[i] -= A[i, c] * b[c]
        b[i] /= A[i, i]
    return True


@njit(cache=True, nogil=True)
def three_point_motions(samples, start, directions, rho, ends, camera):  # type: ignore[no-untyped-def]
    """Motions (K, 3, 4) through three points each, by Newton's method from `start`; and which converged.

    Three flow vectors of known depth are six equations in six unknowns; flow is small by nature, so that
    the solution near `start` is the one wanted.
    """
    motions, converged = np.empty((len(samples), 3, 4)), np.zeros(len(samples), np.bool_)
    A, b, J = np.empty((6, 6)), np.empty(6), np.empty((2, 6))
    for k in range(len(samples)):
        T = start
        for _ in range(NEWTON_STEPS):
            worst, valid = 0.0, True
            for s in range(3):
                i = samples[k, s]
                u, v, ahead = _depth_rows(T, directions[i], rho[i], ends[i], camera, J)
                valid = valid and ahead
                worst = max(worst, abs(u), abs(v))
                for j in range(6):
                    A[2 * s, j], A[2 * s + 1, j] = J[0, j], J[1, j]
                b[2 * s], b[2 * s + 1] = -u, -v
            if not valid:
                break
            if worst < NEWTON_TOLERANCE_PX:
                converged[k] = True
                break
            if not _solve6(A, b):
                break
            T = retract(T, b)
        for j in range(4):
            motions[k, 0, j], motions[k, 1, j], motions[k, 2, j] = T[0, j], T[1, j], T[2, j]
    return motions, converged


@njit(cache=True, nogil=True)
def linearise_epipolar(T, rays, ends, focal):  # type: ignore[no-untyped-def]
    """Epipolar errors (N,) [px], line normals (N, 2) in {i} and Jacobian (N, 6); rays scaled to z = 1."""
    n = len(rays)
    fx, fy = focal
    z, normal, J = np.empty(n), np.empty((n, 2)), np.empty((n, 6))
    t0, t1, t2 = T[0, 3], T[1, 3], T[2, 3]
    for i in range(n):
        a0, a1, a2 = _point(T, rays[i], 0.0)
        l0, l1, l2 = t1 * a2 - t2 * a1, t2 * a0 - t0 * a2, t0 * a1 - t1 * a0
        s0, s1 = l0 / fx, l1 / fy
        length = np.sqrt(s0 * s0 + s1 * s1)
        if length < 1e-12:  # the point is the epipole: no line
            z[i] = np.nan
            normal[i, 0], normal[i, 1] = 1.0, 0.0
            J[i] = 0.0
            continue
        e0, e1, e2 = ends[i, 0], ends[i, 1], ends[i, 2]
        z[i] = (l0 * e0 + l1 * e1 + l2 * e2) / length
        normal[i, 0], normal[i, 1] = s0 / length, s1 / length
        g0 = (e0 - z[i] * normal[i, 0] / fx) / length
        g1 = (e1 - z[i] * normal[i, 1] / fy) / length
        g2 = e2 / length
        J[i, 0], J[i, 1], J[i, 2] = l1 * g2 - l2 * g1, l2 * g0 - l0 * g2, l0 * g1 - l1 * g0
        J[i, 3], J[i, 4], J[i, 5] = a1 * g2 - a2 * g1, a2 * g0 - a0 * g2, a0 * g1 - a1 * g0
    return z, normal, J


@njit(cache=True, nogil=True)
def support_epipolar(essentials, rays, ends, focal, bounds, first, last, counts):  # type: ignore[no-untyped-def]
    """Inliers of each essential matrix (K, 3, 3); bounds (N, A) over the normal's pseudo-angle."""
    fx, fy = focal
    nodes = bounds.shape[1] - 1
    for k in range(first, last):
        E, count = essentials[k], 0
        for i in range(len(rays)):
            r0, r1, r2 = rays[i, 0], rays[i, 1], rays[i, 2]
            l0 = E[0, 0] * r0 + E[0, 1] * r1 + E[0, 2] * r2
            l1 = E[1, 0] * r0 + E[1, 1] * r1 + E[1, 2] * r2
            l2 = E[2, 0] * r0 + E[2, 1] * r1 + E[2, 2] * r2
            s0, s1 = l0 / fx, l1 / fy
            square = s0 * s0 + s1 * s1
            if square < 1e-24:
                continue
            d = l0 * ends[i, 0] + l1 * ends[i, 1] + l2 * ends[i, 2]
            # pseudo-angle of +-n: 0 at -v, 1/2 at u, 1 at +v
            p = 0.5 + 0.5 * (s1 if s0 >= 0 else -s1) / (abs(s0) + abs(s1))
            position = p * nodes
            j = min(int(position), nodes - 1)
            b = bounds[i, j] + (position - j) * (bounds[i, j + 1] - bounds[i, j])
            count += b >= 0 and d * d <= b * b * square
        counts[k] = count
