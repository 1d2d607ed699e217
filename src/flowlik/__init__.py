"""flowlik: honest error distributions for optical flow, and ego-motion that uses them.

Public names load on first use, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import Any

_HOME = {
    "Pinhole": "camera",
    "TextureDefinition": "texture",
    "Measurements": "measurements",
    "measure": "measurements",
    "stratified_pixels": "measurements",
    "CallableFlow": "flow",
    "DIS": "flow",
    "Farneback": "flow",
    "FlowFiles": "flow",
    "HornSchunck": "flow",
    "LucasKanade": "flow",
    "flow_method": "flow",
    "Gaussian": "families",
    "LaplaceCauchy": "families",
    "LogLogistic": "families",
    "Index": "schedule",
    "Input": "schedule",
    "Schedule": "schedule",
    "Term": "schedule",
    "FlowLikelihood": "likelihood",
    "load_likelihood": "model_file",
    "save_likelihood": "model_file",
    "ErrorSketch": "calibration",
    "Task": "calibration",
    "calibrate": "calibration",
    "sketch_blocks": "calibration",
    "split_blocks": "calibration",
    "EgoMotion": "egomotion",
    "Epipolar": "egomotion",
    "Estimator": "egomotion",
    "KnownDepth": "egomotion",
    "Status": "egomotion",
    "lcmsac": "egomotion",
    "mle": "egomotion",
    "ransac": "egomotion",
    "Odometry": "odometry",
    "Trajectory": "trajectory",
    "open_sequence": "datasets",
    "simulate": "simulation",
    "FlowlikError": "errors",
    "DataError": "errors",
    "ModelError": "errors",
    "CalibrationError": "errors",
    "MissingFieldError": "errors",
}

__version__ = version("flowlik")
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'flowlik' has no attribute {name!r}")
    return getattr(import_module(f"flowlik.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
