"""Files that `flowlik fuse` leaves."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from flowlik.commands._fuse_flight import FusedFlight
from flowlik.commands._fuse_monitor import Watched
from flowlik.commands._odometry_files import write_frames
from flowlik.fusion import Fused
from flowlik.geometry.trajectory import write_tum
from flowlik.odometry.trajectory_covariance import write_covariances
from flowlik.support.files import atomic_write, write_npz


def write_fusion(folder: Path, flight: FusedFlight) -> None:
    """Write trajectory, covariances, biases, states, frames and what the monitor saw.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    write_tum(folder / "trajectory_tum.txt", flight.trajectory)
    write_covariances(folder, flight.trajectory, flight.covariances)
    _write_states(folder / "states.npz", flight.fused)
    _write_biases(folder / "biases.csv", flight.fused)
    _write_monitor(folder / "monitor.csv", flight.seen)
    first = flight.first
    write_frames(
        folder / "frames.csv", flight.trajectory, flight.motions[first:], flight.sequence.numbers[first + 1 :]
    )


def _write_states(path: Path, fused: Fused) -> None:
    arrays = {
        "timestamps_s": fused.times_s,
        "T_n_b": fused.trajectory.poses.as_matrix(),
        "velocity_n_mps": np.array([s.velocity_n_mps for s in fused.states]),
        "gyroscope_bias_radps": np.array([s.gyroscope_bias_radps for s in fused.states]),
        "accelerometer_bias_mps2": np.array([s.accelerometer_bias_mps2 for s in fused.states]),
        "covariance": fused.covariances,
    }
    write_npz(path, arrays)


def _write_biases(path: Path, fused: Fused) -> None:
    """One row a frame: biases of gyroscope [rad/s] and accelerometer [m/s²] with standard deviations."""
    sensors = (("gyro", "radps"), ("accel", "mps2"))
    names = [f"{sensor}_{axis}_{unit}" for sensor, unit in sensors for axis in "xyz"]
    sigmas = np.sqrt(np.diagonal(fused.covariances, axis1=1, axis2=2)[:, 9:15])
    with atomic_write(path) as file:
        writer = csv.writer(file)
        writer.writerow(["timestamp_s", *names, *(f"sigma_{name}" for name in names)])
        for state, sigma in zip(fused.states, sigmas):
            values = (*state.gyroscope_bias_radps, *state.accelerometer_bias_mps2, *sigma)
            writer.writerow([f"{state.time_s:.17g}", *(f"{value:.8g}" for value in values)])


def _write_monitor(path: Path, seen: Watched) -> None:
    """One row a fix: innovation [m] and its deviations, NIS, and what the test of a ramp says."""
    fixes = seen.fixes
    sigmas = np.sqrt(np.diagonal(fixes.innovation_covariances_m2, axis1=1, axis2=2))
    with atomic_write(path) as file:
        writer = csv.writer(file)
        writer.writerow(
            ["timestamp_s", *(f"innovation_{axis}_m" for axis in "xyz"),
             *(f"sigma_{axis}_m" for axis in "xyz"), "nis", "windowed_nis_nat", "ramp_statistic",
             "threshold", "ramp_onset_s",
             *(f"ramp_{axis}_mps" for axis in "xyz"), "alarm"]
        )  # fmt: skip
        for k, time_s in enumerate(fixes.times_s):
            ramp = ["", "", "", "", "", ""]
            if seen.test is not None:
                onset = f"{seen.test.onset_s[k]:.17g}"
                rate = (f"{v:.5g}" for v in seen.test.rate_n_mps[k])
                ramp = [f"{seen.test.statistic[k]:.5g}", f"{seen.threshold:.5g}", onset, *rate]
            alarm = seen.alarm is not None and time_s >= seen.alarm.time_s
            row = (*fixes.innovations_m[k], *sigmas[k], seen.nis[k], seen.surprise[k])
            writer.writerow([f"{time_s:.17g}", *(f"{v:.6g}" for v in row), *ramp, int(alarm)])
