"""EuRoC's sensor.yaml: the few numbers of a camera."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.support.files import numbers, read_text

MAX_YAML_BYTES = 2**14

DISTORTION_MODEL = "radial-tangential"


@dataclass(frozen=True, eq=False)
class SensorFile:
    """What a camera's ``sensor.yaml`` says.

    Attributes
    ----------
    resolution : tuple of int
        Width and height [px].
    intrinsics : tuple of float
        fx, fy, cx, cy [px].
    distortion : tuple of float
        k1, k2, p1, p2 of Brown and Conrady, in OpenCV's order.
    T_b_c : array (4, 4)
        Takes points in the camera to points in the robot's body [m].
    """

    resolution: tuple[int, int]
    intrinsics: tuple[float, float, float, float]
    distortion: tuple[float, float, float, float]
    T_b_c: NDArray[np.float64]


def read_sensor(path: Path | str) -> SensorFile:
    """Read the ``sensor.yaml`` of a EuRoC camera: only its keys, not YAML at large.

    Raises
    ------
    DataError
        If the file or a key is missing, given twice, or malformed, or the camera is not a pinhole with
        radial-tangential distortion.
    """
    path = Path(path)
    if path.is_file() and path.stat().st_size > MAX_YAML_BYTES:
        raise DataError(f"{path}: larger than a EuRoC sensor.yaml can be")
    lines = (line.partition("#")[0].rstrip() for line in read_text(path).splitlines())
    text = "\n".join(line for line in lines if line)
    for key, expected in [("camera_model", "pinhole"), ("distortion_model", DISTORTION_MODEL)]:
        if (found := _word(text, key, path)) != expected:
            raise DataError(f"{path}: {key} is {found}, only {expected} is read")
    width, height = _list(text, r"^resolution", 2, path)
    if min(width, height) < 1 or width % 1 or height % 1:
        raise DataError(f"{path}: resolution must be two positive whole numbers")
    fx, fy, cx, cy = _list(text, r"^intrinsics", 4, path)
    k1, k2, p1, p2 = _list(text, r"^distortion_coefficients", 4, path)
    matrix = _list(text, r"^T_BS:\n(?:[ \t]+(?:cols|rows):[ \t]*4\n){0,2}[ \t]+data", 16, path)
    return SensorFile(
        (int(width), int(height)), (fx, fy, cx, cy), (k1, k2, p1, p2), np.array(matrix).reshape(4, 4)
    )


def _word(text: str, key: str, path: Path) -> str:
    return _only(re.findall(rf"^{key}:[ \t]*([\w-]+)[ \t]*$", text, re.MULTILINE), key, path)


def _list(text: str, key: str, count: int, path: Path) -> list[float]:
    name = re.sub(r"\W*(\w+).*", r"\1", key, flags=re.DOTALL)
    inside = _only(re.findall(rf"{key}:[ \t]*\n?[ \t]*\[([^\]]*)\]", text, re.MULTILINE), name, path)
    words = [word.strip() for word in inside.split(",")]
    if len(words) != count:
        raise DataError(f"{path}: {name} holds {len(words)} numbers, expected {count}")
    return numbers(words, f"{path}, {name}")


def _only(found: list[str], key: str, path: Path) -> str:
    if len(found) != 1:
        raise DataError(f"{path}: {len(found) or 'no'} readable {key} in this sensor.yaml, expected one")
    return found[0]
