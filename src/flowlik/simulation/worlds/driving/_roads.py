"""Streets along a driven route: where the roadway ends, and the height of the ground around it.

Plans are in (x, z) of {n} [m], heights along y, which points down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from flowlik.simulation.worlds.driving._kernels import average_heights
from flowlik.simulation.worlds.driving._profiles import Profile
from flowlik.simulation.worlds.driving._route import STEP_M, Drive, Line
from flowlik.support.arrays import Array
from flowlik.support.threads import in_bands

REVISIT_M = 6.0
"""A stretch that comes back this near to an earlier one is the same street driven again."""

_NEIGHBOUR_M = 30.0
_OVERLAP_M = 8.0
_SHORTEST_M = 12.0
_LANE_RADIUS_M = 1.5
_HEIGHT_RADIUS_M = 6.0
_LOWEST_SCALE_M = 0.8
_FAR_M = 60.0


@dataclass(frozen=True, eq=False)
class Roads:
    """All roadways: streets along new stretches of a drive, joined where they meet.

    Attributes
    ----------
    drive : Drive
        What the streets follow.
    streets : tuple of Line
        Centre lines of the roadways.
    profile : Profile
        Their cross-section.
    """

    drive: Drive
    streets: tuple[Line, ...]
    profile: Profile

    @classmethod
    def along(cls, drive: Drive, profile: Profile) -> Roads:
        """Lay streets along a drive, each in its direction of traffic; what it drives again is laid once."""
        streets = []
        for first, last in new_stretches(drive.line.points):
            own, *opposite = (drive.line.part(first, last).shifted(offset) for offset in profile.centres_m)
            streets += [own, *(line.reversed() for line in opposite)]
        return cls(drive, tuple(streets), profile)

    def edge(self, points: Array) -> Array:
        """Distance (N,) [m] of points (N, 2) from the edge of the roadway; negative on it.

        Where streets meet, the edge is rounded. The lane that is driven belongs to the roadway everywhere.
        """
        distance = np.full(len(points), np.inf)
        for street in self.streets:
            near = street.around(points, _FAR_M)
            if near.any():
                to_street = street.nearest(points[near])[0] - self.profile.half_width_m
                distance[near] = _rounded_minimum(distance[near], to_street, self.profile.corner_m)
        near = ~(distance > 40.0) | self.drive.line.around(points, _FAR_M)
        if near.any():
            to_lane = self.drive.line.nearest(points[near])[0] - _LANE_RADIUS_M
            distance[near] = np.minimum(distance[near], to_lane)
        return np.minimum(distance, _FAR_M)

    def other_edge(self, points: Array, street: int) -> Array:
        """Distance (N,) [m] of points (N, 2) from the nearest roadway other than one street's, at most 60."""
        distance = np.full(len(points), _FAR_M)
        for i, line in enumerate(self.streets):
            if i == street:
                continue
            near = line.around(points, _FAR_M)
            if near.any():
                to_street = line.nearest(points[near])[0] - self.profile.half_width_m
                distance[near] = np.minimum(distance[near], to_street)
        return distance

    def nearest_street(self, points: Array) -> tuple[NDArray[np.int64], Array, NDArray[np.bool_]]:
        """Nearest street (N,) of points (N, 2), the length along it [m], and whether they lie to its right.

        Points farther than 60 m from all streets get street 0 and length 0.
        """
        count = len(points)
        number, arc, right = np.zeros(count, np.int64), np.zeros(count), np.zeros(count, np.bool_)
        distance = np.full(count, _FAR_M)
        for i, street in enumerate(self.streets):
            near = np.flatnonzero(street.around(points, _FAR_M))
            to_street, along = street.nearest(points[near])
            closer = to_street < distance[near]
            chosen, along = near[closer], along[closer]
            foot, tangent = street.at(along)
            aside = points[chosen] - foot
            number[chosen], arc[chosen], distance[chosen] = i, along, to_street[closer]
            right[chosen] = aside[:, 0] * tangent[:, 1] > aside[:, 1] * tangent[:, 0]
        return number, arc, right


def new_stretches(points: Array) -> list[tuple[int, int]]:
    """Ranges (first, last) of a line's points (K, 2), every metre, that no earlier stretch passes near.

    Each range reaches a little into the streets that it leaves and joins, so that roadways overlap there.
    """
    pairs = KDTree(points).query_pairs(REVISIT_M, output_type="ndarray")
    pairs = pairs[pairs[:, 1] - pairs[:, 0] > _NEIGHBOUR_M / STEP_M]
    pairs = pairs[np.argsort(pairs[:, 1], kind="stable")]
    new = np.ones(len(points), np.bool_)
    for earlier, later in pairs:
        # in order of the later point, so that the earlier one is already decided
        if new[earlier]:
            new[later] = False
    edges = np.diff(np.concatenate([[0], new.astype(np.int64), [0]]))
    firsts, lasts = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    overlap = round(_OVERLAP_M / STEP_M)
    return [
        (max(0, int(first) - overlap), min(len(points), int(last) + overlap))
        for first, last in zip(firsts, lasts)
        if last - first >= _SHORTEST_M / STEP_M
    ]


def height_samples(drive: Drive, every_m: float = 4.0) -> Array:
    """Points (K, 3) of a drive (x, z, y) [m] from which `smooth_heights` takes its average.

    An extension that passes near the route takes the route's height there, and so is left out.
    """
    line, step = drive.line, max(1, round(every_m / STEP_M))
    number = np.arange(0, len(line), step)
    first, last = np.searchsorted(line.arc_m, [drive.arc_m.min(), drive.arc_m.max() + STEP_M])
    driven = np.arange(first, max(last, first + 1))
    distance, nearest = KDTree(line.points[driven]).query(line.points[number])
    at_an_end = (driven[nearest] == driven[0]) | (driven[nearest] == driven[-1])
    own = (number >= driven[0]) & (number <= driven[-1])
    kept = number[own | at_an_end | (distance > 40.0)]
    return np.column_stack([line.points, line.heights])[kept]


def smooth_heights(points: Array, samples: Array) -> tuple[Array, Array]:
    """Kernel average of the heights of samples (K, 3) around points (N, 2).

    Where heights of several passes differ, the lowest counts most, so that no pass runs below the ground.

    Returns
    -------
    heights : array (N,)
        y [m].
    distances : array (N,)
        Distance to the nearest sample [m].
    """
    heights, distances = np.empty(len(points)), np.empty(len(points))
    inputs = np.ascontiguousarray(points), samples, _HEIGHT_RADIUS_M, _LOWEST_SCALE_M, heights, distances
    in_bands(lambda first, last: average_heights(first, last, *inputs), len(points), 32)
    return heights, distances


def _rounded_minimum(a: Array, b: Array, radius_m: float) -> Array:
    """Minimum of two distances whose level lines are rounded where the two are equal."""
    with np.errstate(invalid="ignore"):
        overlap = np.maximum(radius_m - np.abs(a - b), 0.0)
    overlap = np.where(np.isfinite(a), overlap, 0.0)
    return np.minimum(a, b) - overlap**2 / (4 * radius_m)
