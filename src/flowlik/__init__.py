"""flowlik: honest error distributions for optical flow, and ego-motion that uses them.

Public names load on first use, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import Any

_HOME = {
    "Pinhole": "geometry.camera",
    "TextureDefinition": "image.texture",
    "Measurements": "measurement.measurements",
    "measure": "measurement.measurements",
    "stratified_pixels": "measurement.measurements",
    "CallableFlow": "flow",
    "DIS": "flow",
    "Farneback": "flow",
    "FlowFiles": "flow",
    "HornSchunck": "flow",
    "LucasKanade": "flow",
    "flow_method": "flow",
    "Gaussian": "likelihood.families",
    "LaplaceCauchy": "likelihood.families",
    "LogLogistic": "likelihood.families",
    "Index": "likelihood.schedule",
    "Input": "likelihood.schedule",
    "Schedule": "likelihood.schedule",
    "Term": "likelihood.schedule",
    "FlowLikelihood": "likelihood.likelihood",
    "load_likelihood": "likelihood.model_file",
    "save_likelihood": "likelihood.model_file",
    "ErrorSketch": "calibration",
    "Task": "calibration",
    "fit_likelihood": "calibration",
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
    "Odometry": "odometry.odometry",
    "Trajectory": "geometry.trajectory",
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
