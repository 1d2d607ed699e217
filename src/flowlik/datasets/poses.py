"""What data sets' pose and time tables need: checked rigid transforms, frames matched by time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.trajectory import ROTATION_TOLERANCE

Array = NDArray[np.float64]


def rigid_transform(matrix: Array, where: str) -> RigidTransform:
    """Transform of a matrix (4, 4), whose rotation is mended within `ROTATION_TOLERANCE`.

    Raises
    ------
    DataError
        Beginning with ``where``, if the matrix is not that of a rotation and a translation.
    """
    R = matrix[:3, :3]
    deviation = np.abs(R @ R.T - np.eye(3)).max()
    if not (deviation <= ROTATION_TOLERANCE and np.linalg.det(R) > 0):
        raise DataError(f"{where}: its upper left 3 x 3 is not a rotation")
    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > ROTATION_TOLERANCE:
        raise DataError(f"{where}: a rigid transform's last row is 0 0 0 1, not {matrix[3]}")
    return RigidTransform.from_components(matrix[:3, 3], Rotation.from_matrix(R))


def nearest(times: Array, others: Array, tolerance_s: float) -> NDArray[np.int64]:
    """Index (N,) into increasing times ``others`` of the one nearest to each of ``times``.

    It is -1 where none lies within the tolerance [s].
    """
    if len(others) == 0:
        return np.full(len(times), -1)
    right = np.clip(np.searchsorted(others, times), 1, max(len(others) - 1, 1))
    right = np.minimum(right, len(others) - 1)
    left = np.maximum(right - 1, 0)
    found = np.where(np.abs(others[left] - times) <= np.abs(others[right] - times), left, right)
    return np.where(np.abs(others[found] - times) <= tolerance_s, found, -1)


def mutual(times: Array, others: Array, tolerance_s: float) -> NDArray[np.int64]:
    """As `nearest`, but each of ``others`` serves only that one of ``times`` that is nearest to it."""
    found = nearest(times, others, tolerance_s)
    back = nearest(others, times, tolerance_s)
    return np.where((found >= 0) & (back[found] == np.arange(len(times))), found, -1)
