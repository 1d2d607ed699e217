"""Whether the images of a data set and its true poses belong together."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import Epipolar
from flowlik.geometry.camera import Pinhole
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array

LEAST_STEP_M = 0.1
TOLERANCE_PX = 2.0
TIMES_WORSE = 3.0
SHOWN = 5


class Agreement(NamedTuple):
    """Median distances [px] of the flow to the epipolar lines of the true motion and of the one found."""

    truth_px: float
    found_px: float


def agreement(m: Measurements, camera: Pinhole, truth: RigidTransform, found: RigidTransform) -> Agreement:
    """How well the true motion T_k_prev fits what the images show; NaN where it is shorter than 0.1 m."""
    if np.linalg.norm(truth.translation) < LEAST_STEP_M or not np.any(found.translation) or not len(m):
        return Agreement(np.nan, np.nan)
    residual = Epipolar.of(m, camera)
    distances = (residual.linearise(T.as_matrix()[:3])[0] for T in (truth, found))
    return Agreement(*(float(np.nanmedian(np.abs(z))) for z in distances))


def _disagreeing(pairs: Iterable[Agreement]) -> NDArray[np.intp]:
    """Numbers of the pairs whose images contradict the true motion.

    Its median distance is above 2 px and three times that of the motion found: noise of poses and wrong
    intrinsics stay below (KITTI 03: at most 2.3 px beside 0.1 to 0.4), poses of other frames do not.
    """
    values: Array = np.array(list(pairs), dtype=np.float64).reshape(-1, 2)
    return np.flatnonzero(values[:, 0] > TOLERANCE_PX + TIMES_WORSE * values[:, 1])


def disagreement_warning(name: str, frames: Array, pairs: list[Agreement]) -> str | None:
    """What to tell of pairs that disagree; ``frames`` (N,) are the later frames' numbers of all pairs."""
    bad = _disagreeing(pairs)
    if not len(bad):
        return None
    shown = ", ".join(str(int(frames[i])) for i in bad[:SHOWN]) + (", …" if len(bad) > SHOWN else "")
    worst = max(pairs[i].truth_px for i in bad)
    return (
        f"{name}: at {len(bad)} of {len(pairs)} frames the images do not move as the poses say "
        f"(frames {shown}; up to {worst:.1f} px): poses of other frames, or images of other drives?"
    )
