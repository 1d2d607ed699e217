"""Cross-sections of roads: what lies how far from the edge of the roadway."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError

MOTORWAY_MPS = 17.0
COUNTRY_MPS = 13.0
"""Median speeds above which a route is taken for one along a motorway or a country road."""


@dataclass(frozen=True)
class Marking:
    """A painted line along the road.

    Parameters
    ----------
    lateral_m : float
        Its middle, to the right of the roadway's centre line.
    width_m : float
        Its width.
    dash_m, period_m : float
        Length of a dash, and from one dash to the next; equal for a solid line.
    """

    lateral_m: float
    width_m: float = 0.12
    dash_m: float = 3.0
    period_m: float = 9.0


@dataclass(frozen=True)
class Profile:
    """Cross-section of a road.

    Parameters
    ----------
    name : str
        Scenery.
    centres_m : tuple of float
        Centre of each carriageway, to the right of the camera's lane; negative to its left. All but the
        first carry oncoming traffic only.
    lanes_m : tuple of float
        Middle of each other lane, counted likewise: of oncoming traffic, then of one's own direction.
    half_width_m : float
        Half width of a carriageway.
    bands : tuple of (float, str)
        Ground materials from the roadway outwards, each up to a distance from the roadway's edge.
    kerb_m : float
        Height of everything beside the roadway above it.
    corner_m : float
        How far edges are rounded where streets meet.
    markings : tuple of Marking
        Painted lines of each carriageway.
    banks_m : float
        Height of the banks and hollows that begin beside the road.
    """

    name: str
    centres_m: tuple[float, ...]
    lanes_m: tuple[float, float]
    half_width_m: float
    bands: tuple[tuple[float, str], ...]
    kerb_m: float
    corner_m: float
    markings: tuple[Marking, ...]
    banks_m: float

    @property
    def levels_m(self) -> tuple[float, ...]:
        """Distances from the roadway's edge at which the ground changes."""
        return tuple(limit for limit, _ in self.bands if np.isfinite(limit))

    @property
    def verge_m(self) -> float:
        """Distance from the roadway's edge at which open ground begins."""
        return self.levels_m[-1]


_STREET = Profile(
    "street",
    (-1.75,),
    (-3.5, 0.0),
    3.5,
    ((0.0, "asphalt"), (0.14, "kerb"), (2.3, "strip"), (4.2, "paving"), (np.inf, "ground")),
    0.1,
    6.0,
    (Marking(0.0),),
    0.6,
)
_COUNTRY = Profile(
    "country",
    (-1.6,),
    (-3.2, 0.0),
    3.2,
    ((0.0, "asphalt"), (0.7, "gravel"), (np.inf, "ground")),
    0.0,
    8.0,
    (Marking(0.0, 0.12, 4.0, 12.0), Marking(-2.95, 0.12, 1.0, 1.0), Marking(2.95, 0.12, 1.0, 1.0)),
    1.5,
)
_MOTORWAY = Profile(
    "motorway",
    (-1.2, -17.2),
    (-18.4, -3.9),
    6.0,
    ((0.0, "asphalt"), (0.6, "gravel"), (np.inf, "ground")),
    0.0,
    0.5,
    (
        Marking(-5.3, 0.15, 1.0, 1.0),
        Marking(-0.75, 0.15, 6.0, 18.0),
        Marking(3.15, 0.3, 1.0, 1.0),
    ),
    3.0,
)

PROFILES = {profile.name: profile for profile in (_STREET, _COUNTRY, _MOTORWAY)}
"""Cross-sections by the name of the scenery."""


def profile_of(scenery: str, positions_m: NDArray[np.float64], frames_per_second: float) -> Profile:
    """Cross-section of a scenery; of "auto" by the median speed over positions (N, 3) [m].

    Raises
    ------
    DataError
        If the scenery is unknown.
    """
    if scenery == "auto":
        steps_m = np.linalg.norm(np.diff(positions_m, axis=0), axis=1)
        speed_mps = float(np.median(steps_m) * frames_per_second) if len(steps_m) else 0.0
        scenery = (
            "motorway" if speed_mps > MOTORWAY_MPS else "country" if speed_mps > COUNTRY_MPS else "street"
        )
    if scenery not in PROFILES:
        raise DataError(f"unknown scenery {scenery!r}: known are auto, {', '.join(sorted(PROFILES))}")
    return PROFILES[scenery]
