"""The standard flights: on what the shipped models were calibrated, and on what they were tried.

Three populations of simulated flights that share no world seed: `CALIBRATION`, `VALIDATION` (on which the
covariates of the index and sizes were chosen) and `REPORT`. All at the paper's camera and 60 frames/s, or at
KITTI's in `driving`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StandardFlight:
    """Short runs of frames at places all along a simulated flight.

    Attributes
    ----------
    world : str
        Name in `flowlik.simulation.WORLDS`.
    trajectory : str
        Name in `flowlik.simulation.TRAJECTORIES`; in `driving` a route of KITTI odometry, such as ``"05"``.
    speed_mps : float
        Speed [m/s] of a named trajectory.
    seed : int
        Seed of everything random.
    places, run : int
        Number of places, and of neighbouring frames at each.
    use : str
        ``"cal"``, ``"val"`` or ``"rep"``: population.
    sensor : {"default", "clean", "poor"}
        Sensor: flowlik's, none, or one of much noise and blur.
    """

    world: str
    trajectory: str
    speed_mps: float
    seed: int
    places: int = 5
    run: int = 3
    use: str = "cal"
    sensor: str = "default"

    @property
    def name(self) -> str:
        """Name in results and of the file in a cache."""
        kind = {"driving": f"drive-{self.trajectory}"}.get(self.world, f"{self.world}-{self.speed_mps:g}")
        path = {"forest-fig8": "-fig8", "curve": "-curve"}.get(self.trajectory, "")
        sensor = "" if self.sensor == "default" else f"-{self.sensor}"
        return f"{self.use}-{kind}{path}-{self.seed}{sensor}"

    def shared(self, share: float) -> list[int]:
        """Return the places of a share of the flight, evenly spread and at least one, by number."""
        count = max(1, round(share * self.places))
        return [round((i + 0.5) * self.places / count - 0.5) for i in range(count)]


FOREST, PLANES, DRIVING = "forest", "planes", "driving"

# the default speed is 6 m/s; 0.25x to 5x, so that 4x does not lie at the edge
CALIBRATION = (
    *(StandardFlight(FOREST, "training", v, s, 12, 4) for v in (1.5, 6.0, 24.0) for s in (0, 1)),
    *(
        StandardFlight(FOREST, "training", v, s)
        for v, s in (
            (3.0, 4), (12.0, 5), (18.0, 6), (4.5, 7), (30.0, 8), (9.0, 9), (2.0, 10), (24.0, 11), (6.0, 12),
            (12.0, 13), (1.5, 14),
        )
    ),
    # the others turn so fast that long flow need not be near; in these it is
    *(
        StandardFlight(FOREST, "curve", v, s, sensor=sensor)
        for v, s, sensor in (
            (1.5, 30, "default"), (3.0, 31, "default"), (6.0, 32, "clean"), (12.0, 33, "default"),
            (24.0, 34, "default"), (4.0, 35, "default"), (2.0, 36, "default"), (6.0, 37, "default"),
            (9.0, 38, "default"), (18.0, 39, "clean"), (3.0, 40, "clean"), (6.0, 41, "poor"),
            (1.5, 42, "clean"), (12.0, 43, "poor"),
        )
    ),
    # a few: without depth edges their errors are smaller at the same index, and many make a table too sure
    StandardFlight(PLANES, "training", 6.0, 0, 12, 4),
    StandardFlight(PLANES, "training", 1.5, 1, 12, 4),
    *(
        StandardFlight(world, "training", v, s, 5, 3, sensor=sensor)
        for world, v, s, sensor in (
            (FOREST, 6.0, 20, "clean"), (FOREST, 1.5, 21, "clean"), (FOREST, 18.0, 22, "clean"),
            (FOREST, 6.0, 23, "poor"), (FOREST, 24.0, 24, "poor"), (FOREST, 2.0, 25, "poor"),
            (PLANES, 24.0, 22, "clean"),
        )
    ),
    StandardFlight(DRIVING, "05", 0.0, 26, 6, 3, sensor="clean"),
    StandardFlight(DRIVING, "09", 0.0, 27, 6, 3, sensor="poor"),
    *(
        StandardFlight(DRIVING, route, 0.0, s, places, run)
        for route, s, places, run in (
            ("00", 10, 8, 4), ("01", 11, 7, 3), ("05", 15, 7, 3), ("09", 19, 7, 3), ("10", 20, 7, 3),
            ("04", 14, 7, 3),
        )
    ),
)  # fmt: skip
VALIDATION = (
    StandardFlight(FOREST, "training", 9.0, 50, 8, 4, "val"),
    StandardFlight(FOREST, "training", 17.0, 51, 8, 4, "val"),
    StandardFlight(FOREST, "training", 4.0, 52, 6, 4, "val"),
    StandardFlight(FOREST, "forest-fig8", 6.0, 60, 12, 4, "val"),
    StandardFlight(FOREST, "forest-fig8", 6.0, 61, 12, 4, "val"),
    StandardFlight(DRIVING, "02", 0.0, 50, 10, 4, "val"),
)
REPORT = {
    "other seed, 6 m/s": StandardFlight(FOREST, "training", 6.0, 100, 12, 4, "rep"),
    "0.5x speed": StandardFlight(FOREST, "training", 3.0, 101, 12, 4, "rep"),
    "2x speed": StandardFlight(FOREST, "training", 12.0, 102, 12, 4, "rep"),
    "forest-fig8": StandardFlight(FOREST, "forest-fig8", 6.0, 103, 12, 4, "rep"),
    "other world (driving)": StandardFlight(DRIVING, "07", 0.0, 100, 12, 4, "rep"),
}
HELD_OUT_SPEEDS_MPS = (3.0, 12.0)


def strict() -> tuple[StandardFlight, ...]:
    """Calibration flights without the world kind and the speeds that the report tries."""
    return tuple(f for f in CALIBRATION if f.world != DRIVING and f.speed_mps not in HELD_OUT_SPEEDS_MPS)
