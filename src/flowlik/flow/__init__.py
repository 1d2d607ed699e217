"""Flow methods by name; presets of one method are names of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from flowlik.errors import ModelError
from flowlik.flow.base import FlowMethod, describe
from flowlik.flow.farneback import Farneback
from flowlik.flow.lucas_kanade import LucasKanade, detect_corners

METHODS: dict[str, Callable[..., FlowMethod]] = {"farneback": Farneback, "lucas-kanade": LucasKanade}

# "farneback-wide": the other reading of the paper's list, window 15 and neighbourhood 5
PRESETS: dict[str, FlowMethod] = {
    "farneback": Farneback(),
    "farneback-wide": Farneback(window=15, poly_n=5),
    "lucas-kanade": LucasKanade(),
}


def flow_method(description: str | Mapping[str, Any]) -> FlowMethod:
    """Flow method of a preset's name, or of a model file's record ``{"name": ..., parameters}``.

    Raises
    ------
    ModelError
        If name or parameters are unknown.
    """
    if isinstance(description, str):
        if description not in PRESETS:
            raise ModelError(f"unknown flow method {description!r}: known are {', '.join(PRESETS)}")
        return PRESETS[description]
    parameters = dict(description)
    name = parameters.pop("name", None)
    try:
        method = METHODS[name](**parameters)
    except (KeyError, TypeError):
        raise ModelError(f"unknown flow method {dict(description)}: known are {', '.join(METHODS)}") from None
    if not all(isinstance(v, int | float) and 0 < v < 1000 for v in parameters.values()):
        raise ModelError(f"flow method {dict(description)}: parameters must be positive numbers")
    return method


__all__ = [
    "METHODS",
    "PRESETS",
    "Farneback",
    "FlowMethod",
    "LucasKanade",
    "describe",
    "detect_corners",
    "flow_method",
]
