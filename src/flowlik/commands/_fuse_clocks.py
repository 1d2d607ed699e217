"""Do IMU and camera go by one clock, and sit as was said: what rotations tell of a flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from flowlik.commands._fuse_inputs import Sensors
from flowlik.egomotion import EgoMotion
from flowlik.errors import DataError
from flowlik.fusion import TimeOffset, estimate_time_offset
from flowlik.results.runs import RunFolder
from flowlik.support.arrays import Array

HARMLESS_S = 0.005
"""Offsets below this do a filter no harm."""
HARMLESS_RAD = float(np.deg2rad(2.0))
BEYOND_DEVIATIONS = 5.0


def told_clocks(times_s: Array, motions: Sequence[EgoMotion], sensors: Sensors) -> TimeOffset | str:
    """Time offset and turn of the IMU by the images' rotations, or why they tell none."""
    turns = Rotation.concatenate([motion.T_k_prev.rotation for motion in motions])
    try:
        return estimate_time_offset(times_s, turns, sensors.imu)
    except DataError as free:
        try:
            return estimate_time_offset(times_s, turns, sensors.imu, sensors.settings.T_b_c.rotation.inv())
        except DataError:
            return str(free)


def report_clocks(run: RunFolder, found: TimeOffset | str, sensors: Sensors) -> None:
    """Add records of an offset to a run, and warnings if it, or the turn, is not what was said."""
    plain = run.records[0]
    if isinstance(found, str):
        why = f"{plain.protocol}; why={found.replace(';', ',')}"
        run.records.append(replace(plain, metric="imu_time_offset_s", value=None, unit="s", protocol=why))
        return
    low, high = found.interval_s
    for metric, value in (
        ("imu_time_offset_s", found.offset_s),
        ("imu_time_offset_low_s", low),
        ("imu_time_offset_high_s", high),
    ):
        run.records.append(replace(plain, metric=metric, value=value, unit="s", count=found.motions))
    if low > HARMLESS_S or high < -HARMLESS_S:
        run.warn(
            f"{plain.dataset}: by images' rotations the IMU is stamped {1e3 * found.offset_s:.1f} ms late "
            f"({1e3 * low:.1f} to {1e3 * high:.1f}): --imu-offset {found.offset_s:.4f} takes that away"
        )
    off = (found.R_c_i * sensors.settings.T_b_c.rotation).as_rotvec()
    size = float(np.linalg.norm(off))
    if not found.rotation_covariance.any() or size < HARMLESS_RAD:
        return
    along = off / size
    if size > BEYOND_DEVIATIONS * np.sqrt(along @ found.rotation_covariance @ along):
        run.warn(
            f"{plain.dataset}: by images' rotations the IMU is turned {np.rad2deg(size):.1f} deg from "
            "where --camera-pose and its T_BS place it"
        )
