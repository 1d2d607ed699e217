"""Camera files: ROS camera_info, OpenCV's and Kalibr's YAML, read as a lens."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from flowlik.datasets.lens import Lens
from flowlik.errors import DataError
from flowlik.support.files import read_text

MAX_BYTES = 2**16
MAX_SIDE = 2**16
MAX_DEPTH = 20

PERSPECTIVE = {"plumb_bob", "radtan", "radial-tangential", "rational_polynomial", "none", ""}
FISHEYE = {"equidistant", "fisheye", "equi"}
COEFFICIENTS = {False: (0, 4, 5, 8, 12, 14), True: (0, 4)}
"""How many OpenCV takes, of a perspective camera and of a fisheye."""

EXPECTED = "a camera as ROS (camera_info), OpenCV or Kalibr write it in YAML"


class _Loader(yaml.SafeLoader):
    """YAML's plain types, OpenCV's matrices, and nothing else: no references, which grow without bound."""

    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("references are not read")
        if self._depth >= MAX_DEPTH:
            raise yaml.YAMLError("nested too deeply")
        self._depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1

    def matrix(self, node: Any) -> dict[Any, Any]:
        """Rows, columns and data of a matrix."""
        return self.construct_mapping(node, deep=True)


for _kind in ("opencv-matrix", "opencv-nd-matrix"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", _Loader.matrix)


def read_camera(path: Path | str) -> Lens:
    """Read a camera file: intrinsics, distortion and, where the file has it, the image size.

    ROS: ``image_width``, ``camera_matrix``, ``distortion_model``, ``distortion_coefficients`` as camera_info
    files have them, or ``width``, ``k``, ``distortion_model``, ``d`` as ``ros2 topic echo`` prints them.
    OpenCV: ``camera_matrix`` and ``distortion_coefficients`` as matrices. Kalibr: ``cam0`` of a camchain.
    EuRoC's ``sensor.yaml`` is read too. Rectification and projection matrices are not used: the camera
    matrix stays.

    Raises
    ------
    DataError
        If the file is missing or malformed, or its camera is neither a perspective one with up to eight
        coefficients nor an equidistant fisheye.
    """
    path = Path(path)
    if path.is_file() and path.stat().st_size > MAX_BYTES:
        raise DataError(f"{path}: larger than a camera file can be")
    text = read_text(path)
    if text.startswith("%YAML:"):  # OpenCV's own way to write a directive
        text = text.partition("\n")[2]
    try:
        # constructors fail in ways of their own on malformed scalars (dates, numbers)
        content = yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, AttributeError, KeyError, IndexError,
            RecursionError) as error:  # fmt: skip
        raise DataError(f"{path}: not readable YAML, expected {EXPECTED}") from error
    if not isinstance(content, dict):
        raise DataError(f"{path}: not {EXPECTED}")
    if isinstance(content.get("cam0"), dict):
        content = content["cam0"]
    try:
        return _lens(_plain(content))
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def _plain(content: Mapping[Any, Any]) -> dict[str, Any]:
    """Keys in one spelling: ``Camera_Matrix`` and ``cameraMatrix`` are ``cameramatrix``."""
    return {str(key).lower().replace("_", ""): value for key, value in content.items()}


def _lens(keys: dict[str, Any]) -> Lens:
    matrix = _first(keys, "cameramatrix", "k", "intrinsicmatrix")
    if matrix is not None:
        values = _numbers(matrix, "camera matrix")
        K = values.reshape(3, 3) if values.size == 9 else np.zeros((3, 3))
        if K[0, 1] or K[1, 0] or not np.array_equal(K[2], [0, 0, 1]):
            raise DataError("the camera matrix is not 3 x 3 without skew")
        intrinsics = (K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    elif "intrinsics" in keys:
        if keys.get("cameramodel", "pinhole") != "pinhole":
            raise DataError(f"camera_model is {keys['cameramodel']}, only pinhole is read")
        values = _numbers(keys["intrinsics"], "intrinsics")
        if values.size != 4:
            raise DataError(f"intrinsics hold {values.size} numbers, expected fx, fy, cx, cy")
        intrinsics = tuple(values)
    else:
        raise DataError(f"neither camera_matrix nor intrinsics, expected {EXPECTED}")
    model = _first(keys, "distortionmodel")
    model = "" if model is None else str(model).lower()
    if model not in PERSPECTIVE | FISHEYE:
        known = ", ".join(sorted(PERSPECTIVE | FISHEYE - {""}))
        raise DataError(f"distortion model {model}, known are {known}")
    found = _first(
        keys, "distortioncoefficients", "distortioncoeffs", "distcoeffs", "d", "distcoefs", "distortion"
    )
    coefficients = np.zeros(0) if found is None else _numbers(found, "distortion coefficients")
    if model == "none":
        coefficients = np.zeros(0)
    fisheye = model in FISHEYE
    if coefficients.size not in COEFFICIENTS[fisheye]:
        raise DataError(f"{coefficients.size} distortion coefficients, expected 4, 5 or 8 (fisheye: 4)")
    fx, fy, cx, cy = map(float, intrinsics)
    return Lens(fx, fy, cx, cy, tuple(map(float, coefficients)), fisheye, _size(keys))


def _size(keys: dict[str, Any]) -> tuple[int, int] | None:
    pairs = [("imagewidth", "imageheight"), ("width", "height")]
    for pair in pairs:
        if all(name in keys for name in pair):
            size = [keys[name] for name in pair]
            break
    else:
        size = _first(keys, "resolution", "imagesize")
        if size is None:
            return None
    values = _numbers(size, "image size")
    if values.size != 2 or (values < 1).any() or (values > MAX_SIDE).any() or (values % 1).any():
        raise DataError("the image size is not two positive whole numbers")
    return int(values[0]), int(values[1])


def _first(keys: dict[str, Any], *names: str) -> Any:
    return next((keys[name] for name in names if name in keys), None)


def _numbers(value: Any, what: str) -> np.ndarray:
    """Finite numbers of a list, a list of lists, or a matrix written as rows, cols, data."""
    if isinstance(value, dict):
        value = value.get("data")
    rows = value if isinstance(value, list) else None
    if rows is not None and rows and all(isinstance(row, list) for row in rows):
        rows = [number for row in rows for number in row]
    # YAML 1.1 takes 1e-3 for a word
    numbers = [] if rows is None else [_number(v) for v in rows]
    if rows is None or not np.isfinite(numbers).all():
        raise DataError(f"the {what} is not a list of finite numbers")
    return np.array(numbers, dtype=np.float64)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return float("nan")
    try:
        return float(value)
    except (ValueError, OverflowError):
        return float("nan")
