"""What `flowlik reproduce` simulates: its quick and its full size."""

from __future__ import annotations

from dataclasses import dataclass, replace

from flowlik.evaluation.likelihood import Counting

METHODS = ("farneback", "lucas-kanade")
PAPER = {"lucas-kanade": "lucas-kanade-opencv"}
"""Presets of the methods as the paper has them, where theirs is another."""

SPEEDS_MPS = (1.5, 3.0, 6.0, 12.0)
BYTES_A_FRAME = 1_700_000
"""Of a forest's frame on disk at 640x360: image, depth and flow."""

FAMILIES_SHOWN = ("lcm", "log-logistic", "gaussian", "glc")


@dataclass(frozen=True)
class Flight:
    """A simulated flight: world seed, trajectory, speed [m/s] at 60 frames/s, pairs, methods that see it."""

    seed: int
    trajectory: str
    speed_mps: float
    pairs: int
    methods: tuple[str, ...] = METHODS

    @property
    def label(self) -> str:
        """Short name in results."""
        return f"{self.trajectory}-{self.speed_mps:g}mps-seed{self.seed}"


@dataclass(frozen=True)
class Plan:
    """World, camera, calibration and held-out flights of a reproduction, and the levels counted in K-S.

    ``dense_pixels`` of a dense method's image are calibrated on, or all; ``cached`` flights are rendered
    once, to disk.
    """

    world: str
    width: int
    height: int
    fov_deg: float
    calibration: tuple[Flight, ...]
    held_out: tuple[Flight, ...]
    counting: Counting
    dense_pixels: int | None = None
    cached: bool = False

    @property
    def frames(self) -> int:
        """Frames of all flights together."""
        return sum(flight.pairs + 1 for flight in (*self.calibration, *self.held_out))

    def dataset(self, flight: Flight) -> str:
        """Name of a flight in results."""
        return f"{self.world}-{flight.label}"

    def shared(self, share: float) -> Plan:
        """Plan with the first share of every flight's pairs, at least two."""

        def fewer(flights: tuple[Flight, ...]) -> tuple[Flight, ...]:
            return tuple(replace(f, pairs=max(2, round(share * f.pairs))) for f in flights)

        return replace(self, calibration=fewer(self.calibration), held_out=fewer(self.held_out))


QUICK = Plan(
    world="forest-small",
    width=320,
    height=180,
    fov_deg=120.0,
    calibration=tuple(Flight(seed, "training", v, 20) for seed in (0, 1) for v in SPEEDS_MPS),
    held_out=(Flight(100, "curve", 6.0, 60), Flight(101, "curve", 9.0, 60)),
    counting=Counting(10_000, 20),
    dense_pixels=20_000,
)

FULL = Plan(
    world="forest",
    width=640,
    height=360,
    fov_deg=120.0,
    # 1651 pairs for Farnebäck and 6478 for Lucas-Kanade, as in the paper's Table I
    calibration=(
        *(Flight(0, "training", v, n) for v, n in zip(SPEEDS_MPS, (413, 413, 413, 412))),
        *(
            Flight(1, "training", v, n, ("lucas-kanade",))
            for v, n in zip(SPEEDS_MPS, (1207, 1207, 1207, 1206))
        ),
    ),
    # 100 m, and one lap of the figure eight (198 m)
    held_out=(Flight(100, "straight", 6.0, 1000), Flight(101, "forest-fig8", 6.0, 1980)),
    counting=Counting(),
    cached=True,
)
