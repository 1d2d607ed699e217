"""What a pair of images says: flow vectors with their texture and other signals."""

from flowlik.measurement._signals import SIGNALS
from flowlik.measurement.features import measure_features
from flowlik.measurement.measurements import Measurements, attach_texture, measure, stratified_pixels

__all__ = [
    "SIGNALS",
    "Measurements",
    "attach_texture",
    "measure",
    "measure_features",
    "stratified_pixels",
]
