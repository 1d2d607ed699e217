"""EuRoC's sensor.yaml: where a camera sits."""

from __future__ import annotations

from pathlib import Path

from scipy.spatial.transform import RigidTransform

from flowlik.datasets._camera_content import numbers_of, parse_mappings
from flowlik.datasets._poses import rigid_transform
from flowlik.errors import DataError
from flowlik.support.files import read_text


def read_T_b_c(path: Path | str) -> RigidTransform:
    """Where a EuRoC camera sits, ``T_BS`` of its ``sensor.yaml``: takes the camera to the robot's body [m].

    Raises
    ------
    DataError
        If the file is missing or no YAML, or T_BS is missing or no rigid transform.
    """
    text = read_text(path)
    try:
        matrix = numbers_of(parse_mappings(text)[0].get("T_BS"), "T_BS")
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    if matrix.size != 16:
        raise DataError(f"{path}: T_BS has {matrix.size} numbers, expected 4 x 4")
    return rigid_transform(matrix.reshape(4, 4), f"{path}, T_BS")
