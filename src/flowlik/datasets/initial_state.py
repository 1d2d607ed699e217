"""Small YAML files about a body: its state at the start, an IMU's turn-on biases, where sensors sit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.datasets._camera_content import number_of, numbers_of, parse_mappings
from flowlik.datasets._euroc_files import read_T_b_c
from flowlik.datasets._poses import rigid_transform
from flowlik.errors import DataError
from flowlik.support.arrays import Array
from flowlik.support.files import read_text

_DEVIATIONS = ("attitude_sd_rad", "velocity_sd_mps", "position_sd_m")


@dataclass(frozen=True, eq=False)
class InitialState:
    """What is known of the body at the first frame.

    Attributes
    ----------
    T_n_b : RigidTransform
        Pose [m]; {b} is the IMU.
    velocity_n_mps : array (3,)
        Velocity [m/s] in {n}.
    deviations : array (9,)
        Standard deviations of attitude [rad] in {b}, velocity [m/s] and position [m] in {n}.
    """

    T_n_b: RigidTransform
    velocity_n_mps: Array
    deviations: Array


def read_initial_state(path: Path | str) -> InitialState:
    """Read ``T_n_b`` (4 x 4), ``velocity_n_mps`` and standard deviations of a YAML file.

    ``attitude_sd_rad``, ``velocity_sd_mps`` and ``position_sd_m`` are a number each, or three.

    Raises
    ------
    DataError
        If the file is missing or no YAML, or one of these is missing, no number or not above 0.
    """
    values = _mapping(path)
    T = _numbers(values, "T_n_b", path, 16)
    velocity = _numbers(values, "velocity_n_mps", path, 3)
    deviations = []
    for name in _DEVIATIONS:
        found = _numbers(values, name, path, 3)
        if (found <= 0).any():
            raise DataError(f"{path}: {name} must be above 0")
        deviations.append(found)
    pose = rigid_transform(T.reshape(4, 4), f"{path}, T_n_b")
    return InitialState(pose, velocity, np.concatenate(deviations))


def read_turn_on(path: Path | str) -> tuple[float, float]:
    """Read ``gyroscope_turn_on_sd`` [rad/s] and ``accelerometer_turn_on_sd`` [m/s²] of an IMU's YAML file.

    Raises
    ------
    DataError
        If the file is missing or no YAML, or one of them is missing, no number or not above 0.
    """
    values = _mapping(path)
    found = []
    for name in ("gyroscope_turn_on_sd", "accelerometer_turn_on_sd"):
        if name not in values:
            raise DataError(
                f"{path}: {name} is missing: how large the IMU's biases may be at the start; there is no "
                "default"
            )
        value = _number(values[name], name, path)
        if value <= 0:
            raise DataError(f"{path}: {name} must be above 0")
        found.append(value)
    return found[0], found[1]


def read_sensor_pose(path: Path | str) -> RigidTransform:
    """Where a sensor sits on the body: ``T_BS`` of a ``sensor.yaml`` as EuRoC's, takes its points to {B} [m].

    Raises
    ------
    DataError
        If the file is missing or no YAML, or T_BS is missing or no rigid transform.
    """
    return read_T_b_c(path)


def _mapping(path: Path | str) -> Mapping[Any, Any]:
    text = read_text(path)
    try:
        return parse_mappings(text)[0]
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def _number(value: Any, name: str, path: Path | str) -> float:
    try:
        return number_of(value, name)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def _numbers(values: Mapping[Any, Any], name: str, path: Path | str, count: int) -> Array:
    """So many numbers; where three are asked for, one may stand for all."""
    if name not in values:
        raise DataError(f"{path}: {name} is missing")
    value = values[name]
    if count == 3 and not isinstance(value, list):
        return np.full(3, _number(value, name, path))
    try:
        found = numbers_of(value, name)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    if len(found) != count:
        raise DataError(f"{path}: {name} has {len(found)} numbers, expected {count}")
    return found
