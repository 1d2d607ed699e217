"""From copies in view to a picture: to the screen, into tiles, and tile by tile to light and depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.camera import Pinhole
from flowlik.simulation._base import Frame
from flowlik.simulation.render._daylight import Daylight
from flowlik.simulation.render._raster._corners import corners_in_space
from flowlik.simulation.render._raster._screen import to_screen
from flowlik.simulation.render._raster._tiles import render_tiles
from flowlik.simulation.render._raster._visibility import TILE, count_in_tiles, list_in_tiles, make_buffers
from flowlik.simulation.render._raster.packed import OUTLINE, Drawn, Ints, Looks, Shapes
from flowlik.simulation.render._raster.shadows import Shadows
from flowlik.support.arrays import Array
from flowlik.support.threads import in_bands

_CHUNKS = 48
_TILES_PER_BAND = 4


def render_frame(
    shapes: Shapes,
    drawn: Drawn,
    looks: Looks,
    light: Daylight,
    shadows: Shadows,
    T_n_c: RigidTransform,
    camera: Pinhole,
    samples: bool = True,
) -> Frame:
    """Picture, exact depth and moving objects; without samples the radiance is 0."""
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    R_n_c, origin = np.ascontiguousarray(T_n_c.rotation.as_matrix()), np.asarray(T_n_c.translation)
    chunks, screen, owner = _project(shapes, drawn, np.ascontiguousarray(R_n_c.T), origin, intrinsics, camera)
    starts, lists = _bin(chunks, screen, camera)
    shape = (camera.height, camera.width)
    radiance, depth = np.zeros(shape, np.float32), np.empty(shape)
    movers = np.empty(shape, np.int16)
    daylight = np.array([light.sun, light.sky, light.haze_per_m, light.horizon, light.zenith, light.clouds])
    inputs = (
        starts, lists, screen, owner, np.full(len(owner), -1, np.float32), shapes, drawn, looks,
        daylight, shadows.axes, shadows[1:],
        origin, R_n_c, intrinsics, samples, radiance, depth, movers,
    )  # fmt: skip
    in_bands(
        lambda first, last: render_tiles(first, last, make_buffers(), *inputs),
        len(starts) - 1,
        _TILES_PER_BAND,
    )
    return Frame(radiance, depth, movers if (drawn.movers >= 0).any() else None)


def triangles_of(shapes: Shapes, drawn: Drawn) -> Array:
    """Corners (F, 3, 3) in {n} [m] of all triangles of the copies, at the detail in which they are drawn."""
    corners = np.empty((int(_most_triangles(shapes, drawn).sum()) // 2, 3, 3))
    corners_in_space(shapes, drawn, np.zeros(3), corners)
    return corners


def _project(
    shapes: Shapes, drawn: Drawn, R_c_n: Array, origin: Array, intrinsics: Array, camera: Pinhole
) -> tuple[Ints, NDArray[np.float32], NDArray[np.int32]]:
    """Triangles on the screen; rows ``first`` to ``last`` of each chunk (C, 2) are in use."""
    room = _most_triangles(shapes, drawn)
    limits = _even_chunks(room)
    places = np.concatenate([[0], np.cumsum(room)])[limits]
    screen, owner = np.empty((places[-1], 9), np.float32), np.empty((places[-1], 2), np.int32)
    chunks = np.column_stack([places[:-1], places[:-1]])

    def work(first: int, last: int) -> None:
        for c in range(first, last):
            rows = slice(places[c], places[c + 1])
            most = max(int(drawn.points[limits[c] : limits[c + 1]].max(initial=0)), OUTLINE)
            chunks[c, 1] += to_screen(
                limits[c], limits[c + 1], shapes, drawn, R_c_n, origin, intrinsics,
                camera.width, camera.height, np.empty((most, 5)), np.empty((10, 4)),
                screen[rows], owner[rows],
            )  # fmt: skip

    in_bands(work, len(chunks), 1)
    return chunks, screen, owner


def _bin(chunks: Ints, screen: NDArray[np.float32], camera: Pinhole) -> tuple[Ints, NDArray[np.int32]]:
    """Where each tile's list starts (tiles + 1,), and the triangles in it (entries,), chunk by chunk."""
    width, height = camera.width, camera.height
    tiles = -(-width // TILE) * -(-height // TILE)
    counts = np.zeros((len(chunks), tiles), np.int64)

    def count(first: int, last: int) -> None:
        for c in range(first, last):
            count_in_tiles(chunks[c, 0], chunks[c, 1], screen, width, height, counts[c])

    in_bands(count, len(chunks), 2)
    ends = np.cumsum(counts.T.ravel()).reshape(tiles, len(chunks))
    places = np.ascontiguousarray(ends.T - counts)
    starts = np.concatenate([[0], ends[:, -1]]).astype(np.int64)
    lists = np.empty(starts[-1], np.int32)

    def fill(first: int, last: int) -> None:
        for c in range(first, last):
            list_in_tiles(chunks[c, 0], chunks[c, 1], screen, width, height, places[c], lists)

    in_bands(fill, len(chunks), 2)
    return starts, lists


def _most_triangles(shapes: Shapes, drawn: Drawn) -> Ints:
    """Bound (N,) on the triangles of each copy: twice its own, since the near plane may cut one into two."""
    sizes = np.append(shapes.outline_sizes[:, 1], 0)
    outline = sizes[shapes.outlines[drawn.prototypes]]
    return 2 * (drawn.parts + drawn.fine * outline + 2 * (drawn.leaves - drawn.fine))


def _even_chunks(room: Ints) -> Ints:
    """Limits (C + 1,) of runs of copies with about the same number of triangles."""
    total = np.concatenate([[0], np.cumsum(room)])
    limits = np.searchsorted(total, np.linspace(0, total[-1], _CHUNKS + 1))
    # an empty view still has one chunk, of no copies
    return np.append(np.unique(limits[:-1]), len(room))
