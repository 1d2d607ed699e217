"""What data sets' pose files need: checked rigid transforms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.pose_table import ROTATION_TOLERANCE

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
