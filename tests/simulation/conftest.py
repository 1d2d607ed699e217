import pytest

from flowlik.geometry.camera import Pinhole
from flowlik.simulation import IDEAL_SENSOR, Flight, PlanesWorld, SimulatedSequence
from flowlik.simulation.flight._trajectories import straight, training


@pytest.fixture(scope="session")
def camera() -> Pinhole:
    return Pinhole.from_fov(320, 180, 120.0)


@pytest.fixture(scope="session")
def straight_ideal(camera: Pinhole) -> SimulatedSequence:
    return SimulatedSequence(PlanesWorld(), Flight.of(straight(200)), camera, IDEAL_SENSOR)


@pytest.fixture(scope="session")
def training_noisy(camera: Pinhole) -> SimulatedSequence:
    return SimulatedSequence(PlanesWorld(), Flight.of(training(400)), camera)
