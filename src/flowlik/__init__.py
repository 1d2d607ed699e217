"""flowlik: honest error distributions for optical flow, and ego-motion that uses them.

What most programs need stands here, and loads on first use, so that importing the package costs nothing. The
rest is imported from its room, such as ``from flowlik.calibration import fit_likelihood``.
"""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING

from flowlik.support.lazy import lazily

if TYPE_CHECKING:
    from flowlik.datasets import open_sequence as open_sequence
    from flowlik.egomotion import EgoMotion as EgoMotion
    from flowlik.egomotion import Epipolar as Epipolar
    from flowlik.egomotion import GaussianPrior as GaussianPrior
    from flowlik.egomotion import KnownDepth as KnownDepth
    from flowlik.egomotion import Status as Status
    from flowlik.egomotion import lcmsac as lcmsac
    from flowlik.egomotion import mle as mle
    from flowlik.egomotion import ransac as ransac
    from flowlik.errors import CalibrationError as CalibrationError
    from flowlik.errors import DataError as DataError
    from flowlik.errors import FlowlikError as FlowlikError
    from flowlik.errors import MissingExtraError as MissingExtraError
    from flowlik.errors import MissingFieldError as MissingFieldError
    from flowlik.errors import ModelError as ModelError
    from flowlik.flow import DIS as DIS
    from flowlik.flow import CallableFlow as CallableFlow
    from flowlik.flow import Farneback as Farneback
    from flowlik.flow import FlowFiles as FlowFiles
    from flowlik.flow import HornSchunck as HornSchunck
    from flowlik.flow import LucasKanade as LucasKanade
    from flowlik.flow import flow_method as flow_method
    from flowlik.geometry import Pinhole as Pinhole
    from flowlik.geometry import Trajectory as Trajectory
    from flowlik.likelihood import FlowLikelihood as FlowLikelihood
    from flowlik.likelihood import load_likelihood as load_likelihood
    from flowlik.measurement import Measurements as Measurements
    from flowlik.measurement import measure as measure
    from flowlik.odometry import Odometry as Odometry
    from flowlik.odometry import run_odometry as run_odometry
    from flowlik.simulation import simulate as simulate

__version__ = version("flowlik")
__all__, __getattr__, __dir__ = lazily(
    __name__,
    {
        "datasets": "open_sequence",
        "egomotion": "EgoMotion Epipolar GaussianPrior KnownDepth Status lcmsac mle ransac",
        "errors": "CalibrationError DataError FlowlikError MissingExtraError MissingFieldError ModelError",
        "flow": "DIS CallableFlow Farneback FlowFiles HornSchunck LucasKanade flow_method",
        "geometry": "Pinhole Trajectory",
        "likelihood": "FlowLikelihood load_likelihood",
        "measurement": "Measurements measure",
        "odometry": "Odometry run_odometry",
        "simulation": "simulate",
    },
)
