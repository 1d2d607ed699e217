"""Options of `flowlik fuse`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

from flowlik.commands._shared_options import Data
from flowlik.commands.options import OdometryOptions


@dataclass(frozen=True, kw_only=True)
class FuseOptions(Data):
    """Options of `flowlik.commands.fuse`, those of `Data` among them; flow's as in `OdometryOptions`.

    Attributes
    ----------
    imu : Path, optional
        IMU, as `flowlik.datasets.read_imu` takes it; needed.
    imu_sensor : Path, optional
        YAML of its noise densities and turn-on deviations, in place of the format's own.
    imu_offset_s : float
        Its stamps minus the camera's clock [s]: taken away from them.
    imu_topic, gps_topic : str, optional
        Topics of a ROS bag.
    gps : Path, optional
        GPS, as `flowlik.datasets.read_gps` takes it; without it only motion is fused.
    gps_coloured : tuple of 2 float, optional
        Share of the variance of a fix that stays, and its memory [s].
    camera_pose : str, optional
        YAML with the camera's ``T_BS``, or ``"body"`` where {B} is the camera; by default EuRoC's ``cam0``.
    antenna_m : tuple of 3 float, optional
        Where the antenna sits [m] in {B}; by default ``T_BS`` of ``gps0/sensor.yaml``.
    up : str, optional
        Axis of {n} that points up; by default -y, or z where GPS told latitude and longitude.
    initial : str, optional
        YAML of the initial state, or ``"truth"``: drawn around the data's own poses; by default it is found.
    align_s : float
        First seconds from which it is found, and which are left out.
    residual : {"depth", "epipolar"}, optional
        By default known depth if the data has it; else directions are fused.
    form : {"given-rotation", "full"}
        Form of a flow factor.
    long_run_factor : float, optional
        By which a motion's covariance grows for a filter, for a model that does not know; directions need it.
    lag_s : float
        Lag [s] of the smoother.
    false_alarms : float
        False alarms an hour that the monitor of GPS may raise.
    motions : Path, optional
        Run of `flowlik odometry` on the same data, whose motions are used in place of images.
    """

    imu: Path | None = None
    imu_sensor: Path | None = None
    imu_offset_s: float = 0.0
    imu_topic: str | None = None
    gps: Path | None = None
    gps_topic: str | None = None
    gps_coloured: tuple[float, ...] | None = None
    camera_pose: str | None = None
    antenna_m: tuple[float, ...] | None = None
    up: str | None = None
    initial: str | None = None
    align_s: float = 10.0
    residual: str | None = None
    form: str = "given-rotation"
    long_run_factor: float | None = None
    lag_s: float = 1.0
    false_alarms: float = 1.0
    motions: Path | None = None
    model: Path | None = None
    method: str | None = None
    estimator: str = "lcmsac"
    truth: Path | None = None
    frames: int | None = None
    start: int = 0
    stride: int = 1
    frames_per_second: float | None = None
    topic: str | None = None
    depth_topic: str | None = None
    seed: int = 0

    @property
    def odometry(self) -> OdometryOptions:
        """How flow is measured and motions are estimated."""
        shared = {field.name for field in fields(OdometryOptions)} & {field.name for field in fields(self)}
        return OdometryOptions(**{name: getattr(self, name) for name in shared})
