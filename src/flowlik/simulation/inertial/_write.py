"""Write what IMU and GPS measured, beside images, and what they should have."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.gps import GPS_COLUMNS
from flowlik.errors import DataError
from flowlik.geometry.pose_table import NS_PER_S, ned_vectors
from flowlik.simulation.inertial._gps import GpsModel, simulate_gps
from flowlik.simulation.inertial._imu import ImuModel, simulate_imu
from flowlik.simulation.inertial._kinematics import SmoothMotion
from flowlik.simulation.inertial._specifications import kind_of
from flowlik.simulation.inertial._spoofing import Spoofing
from flowlik.support.arrays import Array
from flowlik.support.files import atomic_write

_IMU_HEADER = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"  # noqa: E501
_STATE_HEADER = (
    "#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],"
    "v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],"
    "b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],b_w_RS_S_z [rad s^-1],"
    "b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],b_a_RS_S_z [m s^-2]"
)
_GPS_TRUTH = (
    "time_s,x_n_m,y_n_m,z_n_m,coloured_x_m,coloured_y_m,coloured_z_m,"
    "spoofed_x_m,spoofed_y_m,spoofed_z_m,spoofed"
)


@dataclass(frozen=True)
class InertialSensors:
    """Which sensors stand beside the camera.

    Attributes
    ----------
    imu : ImuModel, optional
        The IMU.
    gps : GpsModel, optional
        The GPS receiver.
    attacks : tuple of Spoofing
        How its positions are spoofed.
    """

    imu: ImuModel | None = None
    gps: GpsModel | None = None
    attacks: tuple[Spoofing, ...] = ()

    def __post_init__(self) -> None:
        if self.attacks and self.gps is None:
            raise DataError("spoofing is of a GPS, and there is none")


Files = dict[str, bytes]


def check_inertial(
    poses: RigidTransform, times_s: Array, sensors: InertialSensors, seed: int, folder: Path | str
) -> Files:
    """Simulate the sensors; what is to be written, by name, once the folder is seen not to hold others.

    Parameters
    ----------
    poses : RigidTransform of N
        ``T_n_c`` [m].
    times_s : array (N,)
        Their times [s].
    sensors : InertialSensors
        Which.
    seed : int
        Seed of their errors.
    folder : Path or str
        Where they will be written.

    Raises
    ------
    DataError
        If the motion is none, an attack lies outside it, or the folder holds other sensors' data.
    """
    files: Files = {}
    if sensors.imu is not None or sensors.gps is not None:
        motion = SmoothMotion(poses, times_s)
        if sensors.imu is not None:
            files |= _imu_files(motion, sensors.imu, seed, times_s)
        if sensors.gps is not None:
            files |= _gps_files(motion, sensors.gps, seed, sensors.attacks)
    for sensor in ("imu0", "gps0"):
        there, name = Path(folder) / sensor / "sensor.yaml", f"{sensor}/sensor.yaml"
        if there.is_file() and there.read_bytes() != files.get(name):
            raise DataError(f"{folder}: holds {sensor} of other settings, choose a new or empty folder")
    return files


def write_inertial(files: Files, folder: Path | str) -> None:
    """Write what `check_inertial` returned.

    Raises
    ------
    DataError
        If the folder cannot be written to.
    """
    for name, content in files.items():
        with atomic_write(Path(folder) / name, "wb") as file:
            file.write(content)


def _imu_files(motion: SmoothMotion, model: ImuModel, seed: int, frame_times_s: Array) -> Files:
    imu = simulate_imu(motion, model, seed)
    # EuRoC's stamps are whole and not negative, so what is stamped before the clock begins is left out
    kept = np.rint(imu.times_s * NS_PER_S) >= 0
    measured = np.column_stack([imu.angular_rate_radps, imu.specific_force_mps2])[kept]
    stamps = np.rint(imu.times_s[kept] * NS_PER_S).astype(np.int64)
    quaternions = imu.poses.rotation.as_quat(scalar_first=True)
    state = np.column_stack([
        imu.poses.translation, quaternions, imu.velocity_n_mps,
        imu.gyroscope_bias_radps, imu.accelerometer_bias_mps2,
    ])  # fmt: skip
    true_stamps = np.rint(imu.true_times_s * NS_PER_S).astype(np.int64)
    in_camera = model.T_c_i.rotation
    period_s = float(np.median(np.diff(frame_times_s)))
    noise = {name: value for name, value in asdict(model).items() if name.endswith(("density", "walk"))}
    settings = {
        "sensor_type": "imu",
        "comment": "B is the left camera: x right, y down, z forward",
        "T_BS": _matrix(model.T_c_i),
        "rate_hz": model.rate_hz,
        **noise,
        "gyroscope_turn_on_sd": model.gyroscope_turn_on_sd,
        "accelerometer_turn_on_sd": model.accelerometer_turn_on_sd,
        "time_offset_s": model.time_offset_s,
        "seed": seed,
    }
    return {
        "imu0/data.csv": _table(_IMU_HEADER, stamps, measured),
        "imu0/sensor.yaml": _yaml(settings),
        "state_groundtruth_estimate0/data.csv": _table(_STATE_HEADER, true_stamps, state),
        "imu/acc.npy": _npy(ned_vectors(in_camera.apply(measured[:, 3:]))),
        "imu/gyro.npy": _npy(ned_vectors(in_camera.apply(measured[:, :3]))),
        "imu/imu_time.npy": _npy(imu.times_s[kept]),
        "imu/cam_time.npy": _npy(np.asarray(frame_times_s, dtype=np.float64)),
        "imu/parameter.yaml": _yaml({"img_fps": 1 / period_s, "imu_fps": model.rate_hz}),
    }


def _gps_files(motion: SmoothMotion, model: GpsModel, seed: int, attacks: Sequence[Spoofing]) -> Files:
    gps = simulate_gps(motion, model, seed, attacks)
    sigmas = np.tile(gps.sigma_m, (len(gps.times_s), 1))
    measured = np.column_stack([gps.times_s, gps.positions_n_m, sigmas])
    spoofed = gps.spoofed.astype(np.float64)
    truth = np.column_stack([
        gps.times_s, gps.true_positions_n_m, gps.coloured_m, gps.spoofed_m, spoofed
    ])  # fmt: skip
    settings = {
        "sensor_type": "gps",
        "comment": "B is the left camera: x right, y down, z forward; positions in {n}, whose y points down",
        "T_BS": _matrix(RigidTransform.from_translation(model.position_c_m)),
        **{name: value for name, value in asdict(model).items() if name not in ("position_c_m", "outages_s")},
        "outages_s": list(model.outages_s),
        "spoofing": [{"kind": kind_of(attack), **vars(attack)} for attack in attacks],
        "seed": seed,
    }
    return {
        "gps0/data.csv": _table(",".join(GPS_COLUMNS), None, measured),
        "gps0/truth.csv": _table(_GPS_TRUTH, None, truth),
        "gps0/sensor.yaml": _yaml(settings),
    }


def _matrix(transform: RigidTransform) -> dict[str, Any]:
    return {"cols": 4, "rows": 4, "data": transform.as_matrix().ravel().tolist()}


def _table(header: str, stamps: NDArray[np.int64] | None, rows: Array) -> bytes:
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    if stamps is not None:
        lines = [f"{stamp},{line}" for stamp, line in zip(stamps.tolist(), lines, strict=True)]
    return "\n".join([header, *lines, ""]).encode()


def _yaml(settings: dict[str, Any]) -> bytes:
    return str(yaml.safe_dump(settings, sort_keys=False, default_flow_style=None, width=200)).encode()


def _npy(values: Array) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values, allow_pickle=False)
    return buffer.getvalue()
