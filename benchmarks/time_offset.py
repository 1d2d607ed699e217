"""How late an IMU is: offsets that are known, of simulated flights, and KITTI's against its poses.

    python benchmarks/time_offset.py --data DATA --out RUN [--draws 60]

DATA is the folder of `fusion/kitti_imu`, `fusion/karma` and `kitti_poses`. Karma's rotations are those of its
images, without depth, f = 569 px. KITTI's interpolated IMU has ten rows a frame; a
frame takes 0.1037 s. Simulated: 10 s of shaking flight at 30 frames/s, IMU of 200 Hz, turned, 23.7 ms late;
the images' rotations err by 0.3 mrad an axis, of which half the variance stays for a second.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets import ImuSamples, open_sequence, read_imu
from flowlik.egomotion import lcmsac
from flowlik.flow import flow_method
from flowlik.fusion import TimeOffset, estimate_time_offset
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.pose_table import read_pose_table
from flowlik.geometry.trajectory import FRAME_RATE
from flowlik.likelihood.model_file import load_likelihood
from flowlik.likelihood.over_time import Persistence
from flowlik.odometry import Odometry
from flowlik.results.records import Record, protocol, write_records
from flowlik.simulation.inertial import ImuModel, SmoothMotion, simulate_imu
from gps_integrity_flights import persistent

FRAME_S, SEQUENCES = 0.10366, ("00", "01", "02", "05", "10")
OFFSET_S, TURN_RAD, NOISE_RAD = 0.0237, (0.4, -1.3, 0.8), 3e-4
FRAMES, PER_SECOND = 301, 30.0


def kitti(data: Path, name: str) -> TimeOffset:
    """Offset of a sequence's IMU against its poses."""
    turns = read_pose_table(data / "kitti_poses" / f"{name}.txt").poses.rotation
    imu = read_imu(data / "fusion" / "kitti_imu" / f"{name}.mat")
    imu = replace(imu, times_s=imu.times_s * FRAME_S * FRAME_RATE)
    return estimate_time_offset(np.arange(len(turns)) * FRAME_S, turns[1:].inv() * turns[:-1], imu)


def karma(data: Path) -> TimeOffset:
    """Offset of a drone's gyroscope against its images; the file's axes are z, x, y."""
    folder = data / "fusion" / "karma"
    gyro, accel = (np.loadtxt(folder / f"{n}.csv", delimiter=",", skiprows=1) for n in ("gyro", "accl"))
    force = np.stack([np.interp(gyro[:, 0], accel[:, 0], accel[:, k]) for k in (1, 2, 3)], axis=1)
    imu = ImuSamples(gyro[:, 0], gyro[:, [2, 3, 1]], force)
    model = load_likelihood("lucas-kanade")
    sequence = open_sequence(folder / "karma.mp4", camera=Pinhole(854, 480, 569, 569, 426.5, 239.5))
    robot = Odometry(sequence.camera, flow_method(model.method or {}), lcmsac(model))
    times_s = [sequence.timestamp(k) for k in range(len(sequence))]
    motions = [robot.step(sequence.image(k), t) for k, t in enumerate(times_s)]
    turns = Rotation.concatenate([motion.T_k_prev.rotation for motion in motions[1:]])
    return estimate_time_offset(np.array(times_s), turns, imu)


def simulated(seed: int) -> TimeOffset:
    """Offset of a simulated IMU, which is `OFFSET_S`."""
    rng, times_s = np.random.default_rng([seed, 1]), np.arange(FRAMES) / PER_SECOND
    hertz, phase = rng.uniform(0.2, 1.5, (3, 3, 1)), rng.uniform(0, 6, (3, 3, 1))
    waves = np.sin(2 * np.pi * hertz * times_s + phase).sum(axis=1) * np.array([[0.1], [0.17], [0.07]])
    poses = RigidTransform.from_rotation(Rotation.from_rotvec(waves.T))
    model = ImuModel(200.0, 2e-3, 1e-4, 0.01, 0.01, 0.0, 0.1, (0, 0, 0), TURN_RAD, OFFSET_S)
    imu = simulate_imu(SmoothMotion(poses, times_s), model, seed)
    errors = NOISE_RAD * persistent(FRAMES - 1, 1 / PER_SECOND, Persistence(0.5, 1.0), rng)
    turns = Rotation.from_rotvec(errors) * poses.rotation[1:].inv() * poses.rotation[:-1]
    samples = ImuSamples(imu.times_s, imu.angular_rate_radps, imu.specific_force_mps2)
    return estimate_time_offset(times_s, turns, samples)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--draws", type=int, default=60)
    options = parser.parse_args()
    records: list[Record] = []
    real = {f"kitti-{name}": kitti(options.data, name) for name in SEQUENCES}
    real["karma"] = karma(options.data)
    for name, found in real.items():
        low, high = found.interval_s
        sd = np.rad2deg(np.sqrt(np.diag(found.rotation_covariance)))
        print(f"{name}: {1e3 * found.offset_s:.1f} ms, {1e3 * low:.1f} to {1e3 * high:.1f}, explained "
              f"{found.explained:.4f}, turn known to {sd.round(3)} deg")  # fmt: skip
        rotations = "images" if name == "karma" else "benchmark poses"
        note = protocol(rotations=rotations, explained=round(found.explained, 4), confidence=0.95)
        for metric, value in (("time_offset_s", found.offset_s), ("low_s", low), ("high_s", high)):
            records.append(Record(metric, value, "s", name, count=found.motions, protocol=note))
    drawn = [simulated(seed) for seed in range(1000, 1000 + options.draws)]
    held = np.mean([found.interval_s[0] < OFFSET_S < found.interval_s[1] for found in drawn])
    off = np.array([found.offset_s - OFFSET_S for found in drawn])
    width = np.median([found.interval_s[1] - found.interval_s[0] for found in drawn])
    print(f"simulated: off by {1e3 * np.sqrt((off**2).mean()):.3f} ms rms, mean {1e3 * off.mean():.3f}, "
          f"95 % intervals of {1e3 * width:.2f} ms hold {held:.3f} of {len(drawn)}")  # fmt: skip
    note = protocol(rotations="drawn", frames=FRAMES, noise_rad=NOISE_RAD, stays=0.5, memory_s=1.0)
    rms_s = np.sqrt((off**2).mean())
    for metric, value, unit in (
        ("coverage_95", held, ""),
        ("time_offset_rms_s", rms_s, "s"),
        ("width_s", width, "s"),
    ):
        records.append(Record(metric, float(value), unit, "drawn", count=len(drawn), protocol=note))
    options.out.mkdir(parents=True, exist_ok=True)
    write_records(options.out / "metrics.json", records)


if __name__ == "__main__":
    main()
