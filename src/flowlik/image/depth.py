"""Whether a depth map can be what it is said to be: metres along z."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError

FAR_M = 1000.0
"""Half of a scene beyond this is taken for millimetres."""

NEGATIVE_SHARE = 0.01
LOOKED_AT = 5000


class ImplausibleDepthWarning(UserWarning):
    """Depth that is hardly in metres along z."""


def check_depth_z(depth_z: NDArray[np.floating]) -> None:
    """Refuse depth of whole numbers, and warn (`ImplausibleDepthWarning`) of depth that is hardly in metres.

    Parameters
    ----------
    depth_z : array
        Depth along z [m], of any shape; not finite or not positive where unknown.

    Raises
    ------
    DataError
        If it is no array of floats: whole numbers are a sensor's units, such as millimetres.
    """
    if not isinstance(depth_z, np.ndarray) or depth_z.dtype.kind != "f":
        found = getattr(depth_z, "dtype", type(depth_z).__name__)
        raise DataError(
            f"depth must be metres along z in an array of floats, not {found}: divide a sensor's whole "
            "numbers by its units a metre (1000 where they are millimetres)"
        )
    if doubt := _depth_doubt(depth_z):
        warnings.warn(doubt, ImplausibleDepthWarning, stacklevel=3)


def _depth_doubt(depth_z: NDArray[np.floating]) -> str | None:
    """What is implausible in depth [m] of any shape, judged by some of its values; None if nothing is."""
    values = depth_z.ravel()[:: 1 + depth_z.size // LOOKED_AT]
    if not len(values):
        return None
    with np.errstate(invalid="ignore"):
        known, sky, negative = values[(values > 0) & (values < np.inf)], values == np.inf, np.mean(values < 0)
    if negative > NEGATIVE_SHARE:
        return "depths are negative: not metres along z, ahead of the camera?"
    if not len(known) and not sky.any():
        return "no depth is known: none is above zero"
    if len(known) and np.median(known) > FAR_M:
        return f"half of the depths are beyond {FAR_M:.0f} m: millimetres, not metres?"
    return None
