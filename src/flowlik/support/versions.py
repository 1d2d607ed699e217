"""Versions of what results depend on."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("flowlik", "numpy", "scipy", "numba", "opencv-python-headless")
OTHER_OPENCV = ("opencv-python", "opencv-contrib-python-headless", "opencv-contrib-python")
"""Distributions that bring cv2 as well as the one that flowlik asks for."""


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        found[package] = _version(package) or "unknown"
    others = {name: number for name in OTHER_OPENCV if (number := _version(name))}
    if others:
        found |= others
        if found["opencv-python-headless"] == "unknown":
            del found["opencv-python-headless"]
    return found


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
