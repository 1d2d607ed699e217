"""Cameras in the mappings of YAML, JSON and XML files: whose file it is, and which cameras it holds."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from flowlik.datasets._camera_content import number_of, numbers_of
from flowlik.datasets._camera_model import camera_matrix, make_lens
from flowlik.datasets._lens import Lens
from flowlik.errors import DataError
from flowlik.support.arrays import Array

Content = Mapping[Any, Any]

INTRINSICS = ("fx", "fy", "cx", "cy")
CHAINED = re.compile(r"cam\d+")
ORB_SLAM = re.compile(r"Camera\d?\.fx")
COEFFICIENTS = (
    "distortioncoefficients", "distortioncoeffs", "distcoeffs", "d", "distcoefs", "distortion",
)  # fmt: skip

KNOWN = (
    "ROS camera_info, OpenCV (YAML, XML), Kalibr, EuRoC's sensor.yaml, ORB-SLAM, Basalt, COLMAP's "
    "cameras.txt, KITTI's calib.txt, transforms.json"
)


@dataclass(frozen=True, eq=False)
class Cameras:
    """Cameras of a file.

    Attributes
    ----------
    read : dict of str to callable
        Reads the camera of each name.
    default : str, optional
        Which one is meant where none is chosen; without it, only cameras that are all alike will do.
    """

    read: Mapping[str, Callable[[], Lens]]
    default: str | None = None


def cameras_in(content: Content) -> Cameras:
    """Cameras of a mapping.

    Raises
    ------
    DataError
        If it is that of no known kind of file.
    """
    chain = {str(k): v for k, v in content.items() if CHAINED.fullmatch(str(k)) and isinstance(v, dict)}
    if chain:
        return Cameras({name: partial(keyed_lens, v) for name, v in chain.items()}, min(chain))
    if names := {str(k).partition(".")[0] for k in content if ORB_SLAM.fullmatch(str(k))}:
        return _orb_slam(content, names)
    basalt = content.get("value0", content)
    if isinstance(basalt, dict) and _lists(basalt.get("intrinsics")):
        return _basalt(basalt)
    if {"fl_x", "camera_angle_x", "frames"} & set(content):
        return Cameras({"camera": partial(_transforms, content)})
    return Cameras({"camera": partial(keyed_lens, content)})


def keyed_lens(content: Content) -> Lens:
    """Lens of names as ROS, OpenCV, Kalibr and EuRoC use them.

    Raises
    ------
    DataError
        If there are neither a camera matrix nor intrinsics, or they are not known.
    """
    keys = {str(key).lower().replace("_", ""): value for key, value in content.items()}
    found = _first(keys, *COEFFICIENTS)
    coefficients = np.zeros(0) if found is None else numbers_of(found, "distortion coefficients")
    name, size = keys.get("distortionmodel"), _size(keys)
    matrix = _first(keys, "cameramatrix", "k", "intrinsicmatrix")
    if matrix is not None:
        intrinsics = camera_matrix(numbers_of(matrix, "camera matrix"))
        # OpenCV says nothing of a perspective lens, and this of the other
        opencv = "fisheye" if number_of(keys.get("fisheyemodel", 0), "fisheye_model") else "plumb_bob"
        return make_lens(intrinsics, opencv if name is None else str(name), coefficients, size)
    if "intrinsics" not in keys:
        raise DataError(f"neither camera_matrix nor intrinsics; known are {KNOWN}")
    values = numbers_of(keys["intrinsics"], "intrinsics")
    camera = str(keys.get("cameramodel", "pinhole"))
    if camera not in ("pinhole", "ds"):
        raise DataError(f"camera_model {camera} is not known, known are pinhole and ds")
    names = {"pinhole": "fx, fy, cx, cy", "ds": "xi, alpha, fx, fy, cx, cy"}[camera]
    if values.size != len(names.split()):
        raise DataError(f"intrinsics hold {values.size} numbers, expected {names}")
    if camera == "ds":
        if coefficients.any():
            raise DataError("a double sphere with distortion coefficients is not known")
        return make_lens(values[2:], "ds", values[:2], size)
    return make_lens(values, "" if name is None else str(name), coefficients, size)


def _orb_slam(content: Content, names: set[str]) -> Cameras:
    """Keys ``Camera.fx`` or ``Camera1.fx``; LEFT and RIGHT are cameras as they are, to be rectified."""
    sides = {side for side in ("LEFT", "RIGHT") if f"{side}.K" in content}
    read = {name: partial(_orb_slam_camera, content, name) for name in names}
    read |= {side: partial(keyed_lens, _under(content, side)) for side in sides}
    return Cameras(read, None if sides else min(names))


ORDERS = {
    "PinHole": ("plumb_bob", ("k1", "k2", "p1", "p2", "k3")),
    "KannalaBrandt8": ("kannala_brandt8", ("k1", "k2", "k3", "k4")),
    "Rectified": ("none", ()),
}
"""Cameras of ORB-SLAM, with their coefficients in order."""


def _orb_slam_camera(content: Content, name: str) -> Lens:
    keys = _under(content, name)
    kind = str(content.get("Camera.type", "PinHole"))
    if kind not in ORDERS:
        raise DataError(f"Camera.type {kind} is not known, known are {', '.join(ORDERS)}")
    if kind == "PinHole" and number_of(content.get("Camera.bFishEye", 0), "Camera.bFishEye"):
        raise DataError("Camera.bFishEye beside the type PinHole: which of them is right?")
    model, order = ORDERS[kind]
    there = {k for k in keys if re.fullmatch(r"[kp]\d+", k)}
    if strange := there - set(order):
        raise DataError(
            f"{name}.{min(strange)} of a {kind} camera is not known, known are {', '.join(order)}"
        )
    must = order[:4] if there or kind == "KannalaBrandt8" else ()
    _all_there(keys, (*INTRINSICS, *must), f"{name}.")
    coefficients = [number_of(keys.get(k, 0), f"{name}.{k}") for k in order] if must else []
    intrinsics = [number_of(keys[k], f"{name}.{k}") for k in INTRINSICS]
    return make_lens(intrinsics, model, coefficients, _size(_under(content, "Camera")))


BASALT = {
    "pinhole": ("none", ()),
    "kb4": ("kannala_brandt4", ("k1", "k2", "k3", "k4")),
    "pinhole-radtan8": ("rational_polynomial", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "ds": ("ds", ("xi", "alpha")),
}
"""Cameras of Basalt, with the parameters of each beside fx, fy, cx, cy."""


def _basalt(content: Content) -> Cameras:
    cameras = _lists(content["intrinsics"])
    sizes = content.get("resolution") or []
    sizes = [sizes] if sizes and not isinstance(sizes[0], list) else sizes

    def read(i: int) -> Lens:
        kind, keys = str(cameras[i].get("camera_type")), cameras[i].get("intrinsics")
        if kind not in BASALT or not isinstance(keys, dict):
            raise DataError(f"camera_type {kind} is not known, known are {', '.join(BASALT)}")
        model, order = BASALT[kind]
        _all_there(keys, (*INTRINSICS, *order), "intrinsics ")
        values = [number_of(keys[k], k) for k in (*INTRINSICS, *order)]
        size = numbers_of(sizes[i], "resolution") if i < len(sizes) else None
        return make_lens(values[:4], model, values[4:], size)

    return Cameras({f"cam{i}": partial(read, i) for i in range(len(cameras))}, "cam0")


NERF = {
    "OPENCV": "plumb_bob", "PINHOLE": "plumb_bob", "SIMPLE_PINHOLE": "plumb_bob", "PERSPECTIVE": "plumb_bob",
    "SIMPLE_RADIAL": "plumb_bob", "RADIAL": "plumb_bob", "OPENCV_FISHEYE": "fisheye",
}  # fmt: skip
"""Camera models of transforms.json."""

NERF_KEYS = (
    "fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "k3", "k4", "p1", "p2", "camera_model", "is_fisheye",
    "camera_angle_x", "camera_angle_y",
)  # fmt: skip


def _transforms(content: Content) -> Lens:
    """Camera of nerfstudio and instant-ngp.

    Their pixels have their origin at a corner: half a pixel is taken off. What the frames say of their own
    must be the same for all.
    """
    frames = content.get("frames") if isinstance(content.get("frames"), list) else []
    own = [{k: f[k] for k in NERF_KEYS if k in f} for f in frames if isinstance(f, dict)]  # type: ignore[union-attr]
    if any(keys != own[0] for keys in own):
        raise DataError("its frames have cameras of their own, which differ: only one camera is read")
    keys = {k: content[k] for k in NERF_KEYS if k in content} | (own[0] if own else {})
    values = {k: number_of(v, k) for k, v in keys.items() if k not in ("camera_model", "is_fisheye")}
    for axis, side in (("x", "w"), ("y", "h")):
        angle = values.get(f"camera_angle_{axis}")
        if f"fl_{axis}" not in values and angle is not None and side in values and 0 < angle < np.pi:
            values[f"fl_{axis}"] = values[side] / 2 / np.tan(angle / 2)
    _all_there(values, ("fl_x", "w", "h"))
    fisheye = keys.get("is_fisheye") is True
    kind = str(keys.get("camera_model", "OPENCV_FISHEYE" if fisheye else "OPENCV"))
    if kind not in NERF:
        raise DataError(f"camera_model {kind} is not known, known are {', '.join(NERF)}")
    bends = {k: values.get(k, 0.0) for k in ("k1", "k2", "k3", "k4", "p1", "p2")}
    k1, k2, k3, k4, p1, p2 = bends.values()
    strange = [k for k in (("p1", "p2") if NERF[kind] == "fisheye" else ("k4",)) if bends[k]]
    if strange or (fisheye and NERF[kind] != "fisheye"):
        raise DataError(f"camera_model {kind} with {' and '.join(strange) or 'is_fisheye'} is not known")
    fx, w, h = values["fl_x"], values["w"], values["h"]
    intrinsics = (fx, values.get("fl_y", fx), values.get("cx", w / 2) - 0.5, values.get("cy", h / 2) - 0.5)
    coefficients = (k1, k2, k3, k4) if NERF[kind] == "fisheye" else (k1, k2, p1, p2, k3)
    return make_lens(intrinsics, NERF[kind], coefficients, (w, h))


def _size(keys: Content) -> Array | None:
    for pair in (("imagewidth", "imageheight"), ("width", "height")):
        if all(name in keys for name in pair):
            return numbers_of([keys[name] for name in pair], "image size")
    size = _first(keys, "resolution", "imagesize")
    return None if size is None else numbers_of(size, "image size")


def _first(keys: Content, *names: str) -> Any:
    return next((keys[name] for name in names if name in keys), None)


def _under(content: Content, name: str) -> dict[str, Any]:
    """What stands under a name, as ``name.key``."""
    return {str(k).partition(".")[2]: v for k, v in content.items() if str(k).partition(".")[0] == name}


def _lists(value: Any) -> list[dict[Any, Any]]:
    """Cameras as Basalt lists them, or one alone; nothing if that is what it is not."""
    cameras = value if isinstance(value, list) else [value]
    return cameras if all(isinstance(c, dict) and "camera_type" in c for c in cameras) else []


def _all_there(keys: Content, names: tuple[str, ...], before: str = "") -> None:
    if lacking := [before + name for name in names if name not in keys]:
        raise DataError(f"no {', '.join(lacking)}")
