"""Compiled kernels of the simulated worlds; no fastmath, so that every machine computes the same.

They release the interpreter lock and run on Python's threads: unlike numba's own these survive a fork, so
that process pools may render too.
"""

# mypy: disable-error-code=no-untyped-def

import math

import numpy as np
from numba import njit


@njit(cache=True)
def _form(equations, i, row, x, y):
    return equations[i, row, 0] * x + equations[i, row, 1] * y + equations[i, row, 2]


@njit(cache=True)
def _nearest(x, y, candidates, count, equations, half_sizes):
    """Nearest rectangle on the ray (x, y, 1): its index (-1: none), inverse depth and coordinates on it."""
    nearest, nearest_w, nearest_s, nearest_t = -1, 0.0, 0.0, 0.0
    for j in range(count):
        i = candidates[j]
        w = _form(equations, i, 0, x, y)
        if w > nearest_w:
            depth = 1.0 / w
            s = _form(equations, i, 1, x, y) * depth + equations[i, 1, 3]
            t = _form(equations, i, 2, x, y) * depth + equations[i, 2, 3]
            if abs(s) <= half_sizes[i, 0] and abs(t) <= half_sizes[i, 1]:
                nearest, nearest_w, nearest_s, nearest_t = i, w, s, t
    return nearest, nearest_w, nearest_s, nearest_t


@njit(cache=True)
def _footprint_m(x, y, i, w, equations, step_x, step_y):
    """Longer side [m] on rectangle i of the step between neighbouring rays."""
    e, along_s, along_t = equations, _form(equations, i, 1, x, y), _form(equations, i, 2, x, y)
    s_x, t_x = e[i, 1, 0] * w - along_s * e[i, 0, 0], e[i, 2, 0] * w - along_t * e[i, 0, 0]
    s_y, t_y = e[i, 1, 1] * w - along_s * e[i, 0, 1], e[i, 2, 1] * w - along_t * e[i, 0, 1]
    longer = max((s_x * s_x + t_x * t_x) * step_x * step_x, (s_y * s_y + t_y * t_y) * step_y * step_y)
    return math.sqrt(longer) / (w * w)


@njit(cache=True)
def _bilinear(images, image, offset, size, s, t):
    """Value of a periodic size x size image at (s, t) in periods; texels lie at cell centres."""
    x, y = s * size - 0.5, t * size - 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    left, top = x0 & (size - 1), y0 & (size - 1)
    right, bottom = (left + 1) & (size - 1), (top + 1) & (size - 1)
    top, bottom = offset + top * size, offset + bottom * size
    upper = (1 - fx) * images[image, top + left] + fx * images[image, top + right]
    lower = (1 - fx) * images[image, bottom + left] + fx * images[image, bottom + right]
    return (1 - fy) * upper + fy * lower


@njit(cache=True)
def _trilinear(pyramids, image, offsets, size, s, t, level):
    """Value of a mip pyramid at (s, t) in periods, between two levels."""
    level = min(max(level, 0.0), len(offsets) - 1.0)
    fine = int(level)
    value = _bilinear(pyramids, image, offsets[fine], size >> fine, s, t)
    if level > fine:
        coarse = _bilinear(pyramids, image, offsets[fine + 1], size >> (fine + 1), s, t)
        value += (level - fine) * (coarse - value)
    return value


@njit(cache=True, nogil=True)
def render_rectangles(
    rows,
    camera,
    samples,
    equations,
    half_sizes,
    bounds,
    tiles,
    looks,
    tile_px,
    pyramids,
    offsets,
    contrast_px,
    contrasts,
    radiance,
    depth,
):
    """Render some rows of a picture of textured rectangles into radiance and depth (H, W).

    Parameters
    ----------
    rows : tuple of two int
        First row, and the row after the last.
    camera : array (4,)
        fx, fy, cx, cy [px].
    samples : array (S, 2)
        Offsets [px] from the pixel centre over which the radiance is averaged.
    equations : array (R, 3, 4)
        Row 0: inverse depth on the ray (x, y, 1), linear in it; rows 1 and 2: coordinates on the rectangle
        [m], a linear form of the ray over the inverse depth, plus a constant in the last column.
    half_sizes : array (R, 2)
        Half extents [m].
    bounds : array (R, 4) int
        Pixels that the rectangle may cover: first and last column, first and last row.
    tiles : array (R, 2) int
        Texture tile and contrast map of each rectangle.
    looks : array (R, 8)
        Mean grey, contrast [grey]; periods a metre [1/m], phase s, phase t of the tile; these three of the
        contrast map.
    tile_px, contrast_px : int
        Finest size of a tile and of a contrast map.
    pyramids, offsets, contrasts : arrays
        As in `flowlik.simulation._noise.Textures`.
    radiance, depth : arrays (H, W)
        Written: mean grey over the samples; depth [m] at the pixel centre, inf where there is nothing.
    """
    height, width = depth.shape
    fx, fy, cx, cy = camera
    # samples share a pixel's footprint; each covers twice its part, or the texture aliases
    spacing = 2.0 / math.sqrt(len(samples))
    step_x, step_y = spacing / fx, spacing / fy
    for v in range(rows[0], min(rows[1], height)):
        in_row, in_pixel = np.empty(len(equations), np.int64), np.empty(len(equations), np.int64)
        row_count = 0
        for i in range(len(equations)):
            if bounds[i, 2] <= v <= bounds[i, 3]:
                in_row[row_count] = i
                row_count += 1
        for u in range(width):
            count = 0
            for j in range(row_count):
                if bounds[in_row[j], 0] <= u <= bounds[in_row[j], 1]:
                    in_pixel[count] = in_row[j]
                    count += 1
            x_centre, y_centre = (u - cx) / fx, (v - cy) / fy
            hit, w, s, t = _nearest(x_centre, y_centre, in_pixel, count, equations, half_sizes)
            depth[v, u] = 1.0 / w if hit >= 0 else np.inf
            total, last, level = 0.0, -1, 0.0
            for k in range(len(samples)):
                x, y = x_centre + samples[k, 0] / fx, y_centre + samples[k, 1] / fy
                i, w, s, t = _nearest(x, y, in_pixel, count, equations, half_sizes)
                if i < 0:
                    continue
                if i != last:
                    footprint_m = _footprint_m(x, y, i, w, equations, step_x, step_y)
                    level = math.log2(footprint_m * looks[i, 2] * tile_px)
                    last = i
                s_tile, t_tile = s * looks[i, 2] + looks[i, 3], t * looks[i, 2] + looks[i, 4]
                s_map, t_map = s * looks[i, 5] + looks[i, 6], t * looks[i, 5] + looks[i, 7]
                detail = _trilinear(pyramids, tiles[i, 0], offsets, tile_px, s_tile, t_tile, level)
                contrast = _bilinear(contrasts, tiles[i, 1], 0, contrast_px, s_map, t_map)
                total += looks[i, 0] + looks[i, 1] * contrast * detail
            radiance[v, u] = total / len(samples)
