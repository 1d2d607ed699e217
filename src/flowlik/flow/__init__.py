"""Flow methods by name; presets of one method are names of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from flowlik.errors import ModelError
from flowlik.flow.base import FlowMethod, check_parameters, describe
from flowlik.flow.dis import DIS
from flowlik.flow.farneback import Farneback
from flowlik.flow.horn_schunck import HornSchunck
from flowlik.flow.lucas_kanade import LucasKanade, detect_corners

METHODS: dict[str, Callable[..., FlowMethod]] = {
    "dis": DIS,
    "farneback": Farneback,
    "horn-schunck": HornSchunck,
    "lucas-kanade": LucasKanade,
}

# "farneback-wide": the other reading of the paper's list, window 15 and neighbourhood 5;
# "lucas-kanade-11": half the window, less blurred at depth edges
PRESETS: dict[str, FlowMethod] = {
    "farneback": Farneback(),
    "farneback-wide": Farneback(window=15, poly_n=5),
    "lucas-kanade": LucasKanade(),
    "lucas-kanade-11": LucasKanade(window=11),
    "dis": DIS(),
    "horn-schunck": HornSchunck(),
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
    check_parameters(method)
    return method


__all__ = [
    "DIS",
    "METHODS",
    "PRESETS",
    "Farneback",
    "FlowMethod",
    "HornSchunck",
    "LucasKanade",
    "describe",
    "detect_corners",
    "flow_method",
]
