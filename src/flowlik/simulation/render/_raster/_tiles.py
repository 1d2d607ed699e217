"""Compiled: pictures tile by tile, from visible triangles to the light of each pixel."""

# mypy: disable-error-code=no-untyped-def

import numpy as np

from flowlik.simulation.render._compile import kernel
from flowlik.simulation.render._raster._corners import STEP
from flowlik.simulation.render._raster._shading import exact_depth, leaf_spot, leaf_tone, ray, shade_mesh, sky
from flowlik.simulation.render._raster._visibility import OFFSETS_X, OFFSETS_Y, SAMPLES, TILE, clear, draw
from flowlik.simulation.render._raster.packed import OUTLINE


@kernel
def render_tiles(
    first, last, buffers, starts, lists, screen, owner, tones, shapes, drawn, looks, light, sun, shadows,
    origin, R_n_c, camera, samples, radiance, depth, movers,
):  # fmt: skip
    """Draw tiles first to last of a picture into radiance, depth and movers (H, W).

    Parameters
    ----------
    buffers : Buffers
        Written on.
    starts, lists : arrays (tiles + 1,), (entries,)
        Triangles of each tile, near copies first.
    screen, owner : arrays
        As `flowlik.simulation.render._raster._screen.to_screen` wrote them.
    tones : array (K,) float32
        Radiance of the leaves found so far, by triangle; negative where not yet found.
    samples : bool
        Whether to find the radiance; else depth only.
    """
    height, width = depth.shape
    across = (width + TILE - 1) // TILE
    seen, centre_seen = buffers.seen, buffers.centre_seen
    who, how_many, mean_x, mean_y = buffers.who, buffers.how_many, buffers.mean_x, buffers.mean_y
    spread = 1.0 / camera[0]
    for tile in range(first, last):
        left, top = (tile % across) * TILE, (tile // across) * TILE
        columns, rows = min(TILE, width - left), min(TILE, height - top)
        clear(buffers)
        for j in range(starts[tile], starts[tile + 1]):
            draw(lists[j], screen, left, top, columns, rows, buffers, samples)
        for v in range(rows):
            for u in range(columns):
                x, y, pixel = u + left, v + top, v * TILE + u
                i = centre_seen[pixel]
                depth[y, x], movers[y, x] = np.inf, -1
                if i >= 0:
                    copy, part = owner[i, 0], owner[i, 1]
                    depth[y, x] = exact_depth(copy, part, shapes, drawn, origin, R_n_c, camera, x, y)
                    movers[y, x] = drawn.movers[copy]
                if not samples:
                    continue
                found = 0
                for k in range(SAMPLES):
                    i, j = seen[pixel, k], 0
                    while j < found and who[j] != i:
                        j += 1
                    if j == found:
                        who[j], how_many[j], mean_x[j], mean_y[j] = i, 0.0, 0.0, 0.0
                        found += 1
                    how_many[j] += 1.0
                    mean_x[j] += OFFSETS_X[k]
                    mean_y[j] += OFFSETS_Y[k]
                total = 0.0
                for j in range(found):
                    xs, ys = x + mean_x[j] / how_many[j], y + mean_y[j] / how_many[j]
                    i = who[j]
                    if i < 0:
                        value = sky(looks, light, sun[0], ray(R_n_c, camera, xs, ys), spread)
                    else:
                        copy, part = owner[i, 0], owner[i, 1]
                        p = drawn.prototypes[copy]
                        mesh = shapes.triangle_starts[p + 1] - shapes.triangle_starts[p]
                        if part < mesh:
                            value = shade_mesh(
                                copy, part, xs, ys, shapes, drawn, looks, light, sun, shadows,
                                origin, R_n_c, camera,
                            )  # fmt: skip
                        else:
                            # all of a leaf has one tone: found once, whichever tile asks first
                            if tones[i] < 0.0:
                                leaf = shapes.leaf_starts[p] + (part - mesh) // STEP
                                tones[i] = leaf_tone(
                                    copy, leaf, shapes, drawn, looks, light, sun, shadows, origin, R_n_c
                                )
                            value = np.float64(tones[i])
                            if (part - mesh) % STEP < OUTLINE:
                                value *= leaf_spot(
                                    copy, part, mesh, xs, ys, shapes, drawn, looks, origin, R_n_c, camera
                                )
                    total += value * how_many[j]
                radiance[y, x] = total / SAMPLES
