"""The one place that decides what a camera is: which lens models and matrices are known, the rest refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from flowlik.datasets._lens import Lens
from flowlik.datasets._lens_models import BrownConrady, DoubleSphere, KannalaBrandt, LensModel
from flowlik.errors import DataError
from flowlik.support.arrays import Array

MAX_SIDE = 2**16

Numbers = Sequence[float] | Array
_Model = Callable[[tuple[float, ...]], LensModel]

PERSPECTIVE = ("plumb_bob", "radtan", "radial-tangential", "rational_polynomial", "brown_conrady")
EQUIDISTANT = ("equidistant", "equi", "fisheye", "kannala_brandt", "kannala_brandt4", "kannala_brandt8")


def _double_sphere(coefficients: tuple[float, ...]) -> DoubleSphere:
    if len(coefficients) != 2:
        raise DataError(f"{len(coefficients)} parameters of a double sphere, expected 2 (xi, alpha)")
    return DoubleSphere(*coefficients)


MODELS: dict[str, _Model] = {
    **{name: BrownConrady for name in PERSPECTIVE},
    **{name: KannalaBrandt for name in EQUIDISTANT},
    "ds": _double_sphere,
    "double_sphere": _double_sphere,
}
"""Lens models by the names that calibrations give them."""


def make_lens(
    intrinsics: Numbers, model: str, coefficients: Numbers = (), size: Numbers | None = None
) -> Lens:
    """Lens of what a calibration says.

    Parameters
    ----------
    intrinsics : sequence of float (4,)
        fx, fy, cx, cy [px], with the origin at the centre of the top-left pixel.
    model : str
        Name of the lens model, one in `MODELS`; ``none`` or empty of a pinhole camera.
    coefficients : sequence of float
        Those of the model. Zeros beyond what it has are dropped.
    size : sequence of float (2,), optional
        Width and height [px].

    Raises
    ------
    DataError
        If the model is not known, has another number of coefficients, or a number is impossible.
    """
    fx, fy, cx, cy = map(float, intrinsics)
    return Lens(fx, fy, cx, cy, lens_model(model, coefficients), None if size is None else whole_size(size))


def matrix_lens(
    matrix: Array, source: str, model: str = "none", coefficients: Numbers = (), size: Numbers | None = None
) -> Lens:
    """Lens of a camera matrix (3, 3) or projection matrix (3, 4); otherwise as `make_lens`.

    Raises
    ------
    DataError
        Beginning with ``source``, if it is not known.
    """
    try:
        lens = make_lens(camera_matrix(np.asarray(matrix)), model, coefficients, size)
    except DataError as error:
        raise DataError(f"{source}: {error}") from error
    return replace(lens, source=source)


def lens_model(name: str, coefficients: Numbers) -> LensModel:
    """Lens model of a name in `MODELS` with its coefficients; see `make_lens`.

    Raises
    ------
    DataError
        If the model is not known, or has another number of coefficients.
    """
    values = tuple(map(float, coefficients))
    plain = name.strip().lower()
    if plain in ("", "none"):
        if any(values):
            said = f"model {plain!r}" if plain else "no distortion model"
            raise DataError(f"distortion coefficients, but {said}: known are {known_models()}")
        return BrownConrady()
    make = {_plain(key): make for key, make in MODELS.items()}.get(_plain(plain))
    if make is None:
        raise DataError(f"distortion model {name!r} is not known, known are {known_models()}")
    most = max(getattr(make, "counts", (2,)))
    if len(values) > most and not any(values[most:]):
        values = values[:most]
    return make(values)


def known_models() -> str:
    """Names of the lens models, for messages."""
    return ", ".join(["none", *MODELS])


def camera_matrix(values: Array) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy [px] of a camera matrix (3, 3) or a projection matrix (3, 4).

    Raises
    ------
    DataError
        If it is none, or has a skew.
    """
    if values.size not in (9, 12):
        raise DataError(f"{values.size} numbers are no camera matrix, expected 3 x 3 (or a 3 x 4 projection)")
    K = values.reshape(3, -1)[:, :3]
    if K[0, 1]:
        raise DataError(f"the camera matrix has a skew of {K[0, 1]:g}: only cameras without skew are read")
    if K[1, 0] or not np.array_equal(K[2], [0, 0, 1]):
        raise DataError("not the matrix of a camera: expected rows fx 0 cx, 0 fy cy, 0 0 1")
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])


def whole_size(size: Numbers) -> tuple[int, int]:
    """Width and height [px].

    Raises
    ------
    DataError
        If they are not two positive whole numbers.
    """
    values = np.asarray(size, dtype=np.float64).ravel()
    if values.size != 2 or not ((values >= 1) & (values <= MAX_SIDE) & (values % 1 == 0)).all():
        raise DataError("the image size is not two positive whole numbers")
    return int(values[0]), int(values[1])


def _plain(name: str) -> str:
    return name.replace("-", "").replace("_", "").replace(" ", "")
