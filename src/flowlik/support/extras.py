"""Packages that only some need: each missing one is one line that names the extra."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from flowlik.errors import MissingExtraError

EXTRAS: dict[str, tuple[str, ...]] = {
    "baselines": ("poselib",),
    "cluster": ("dask", "distributed"),
    "fusion": ("gtsam",),
    "onnx": ("onnxruntime",),
    "ros": ("rosbags",),
    "viz": ("rerun",),
}
"""What a user may install beside flowlik, and the packages it brings."""


def extra(module: str, what: str) -> ModuleType:
    """Import a module of an extra.

    Parameters
    ----------
    module : str
        Module, such as ``rosbags.highlevel``.
    what : str
        What needs it, the subject of the message.

    Raises
    ------
    MissingExtraError
        If it is not installed, naming the extra.
    """
    package = module.partition(".")[0]
    name = next(name for name, packages in EXTRAS.items() if package in packages)
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(f"{what} needs {package}: pip install 'flowlik[{name}]'") from error


def missing(name: str) -> list[str]:
    """Packages of an extra that are not installed."""
    return [package for package in EXTRAS[name] if find_spec(package) is None]
