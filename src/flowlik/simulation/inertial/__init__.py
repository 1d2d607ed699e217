"""What an IMU and a GPS receiver on the camera would measure, and how GPS is spoofed."""

from flowlik.simulation.inertial._gps import GPS_PRESETS, GpsModel, SimulatedGps, simulate_gps
from flowlik.simulation.inertial._imu import (
    GRAVITY_N_MPS2,
    IMU_PRESETS,
    ImuModel,
    SimulatedImu,
    simulate_imu,
)
from flowlik.simulation.inertial._kinematics import Kinematics, SmoothMotion
from flowlik.simulation.inertial._specifications import gps_model, imu_model, spoofing
from flowlik.simulation.inertial._spoofing import CarryOff, Jump, Replay, Spoofing
from flowlik.simulation.inertial._write import InertialSensors, check_inertial, write_inertial

__all__ = [
    "GPS_PRESETS",
    "GRAVITY_N_MPS2",
    "IMU_PRESETS",
    "CarryOff",
    "GpsModel",
    "ImuModel",
    "InertialSensors",
    "Jump",
    "Kinematics",
    "Replay",
    "SimulatedGps",
    "SimulatedImu",
    "SmoothMotion",
    "Spoofing",
    "check_inertial",
    "gps_model",
    "imu_model",
    "simulate_gps",
    "simulate_imu",
    "spoofing",
    "write_inertial",
]
