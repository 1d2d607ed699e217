"""Flow methods by name; presets of one method are names of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, cast

from flowlik.errors import ModelError
from flowlik.flow._callable_flow import CallableFlow, brought, find
from flowlik.flow._onnx_file import named_network, onnx_flow
from flowlik.flow.base import (
    DenseFlow,
    FlowMethod,
    FlowOfPairs,
    backward_method,
    describe,
    method_for_pair,
)
from flowlik.flow.dis import DIS
from flowlik.flow.farneback import Farneback
from flowlik.flow.horn_schunck import HornSchunck
from flowlik.flow.lucas_kanade import LucasKanade, detect_corners
from flowlik.flow.network import OnnxFlow
from flowlik.flow.on_disk import FlowFiles, coded

METHODS: dict[str, Callable[..., FlowMethod]] = {
    "dis": DIS,
    "farneback": Farneback,
    "horn-schunck": HornSchunck,
    "lucas-kanade": LucasKanade,
}

# "farneback-wide": the other reading of the paper's list, window 15 and neighbourhood 5;
# "lucas-kanade-11": half the window, less blurred at depth edges; "-opencv": solved by it, as in the paper
PRESETS: dict[str, FlowMethod] = {
    "farneback": Farneback(),
    "farneback-wide": Farneback(window=15, poly_n=5),
    "lucas-kanade": LucasKanade(),
    "lucas-kanade-11": LucasKanade(window=11),
    "lucas-kanade-opencv": LucasKanade(solver="opencv"),
    "lucas-kanade-11-opencv": LucasKanade(window=11, solver="opencv"),
    "dis": DIS(),
    "horn-schunck": HornSchunck(),
}


# methods that a file alone may not start: the user says where they are
CONFIRMED: dict[str, Callable[..., FlowMethod]] = {
    "callable": CallableFlow,
    "flow-files": FlowFiles,
    "onnx": OnnxFlow,
}


def flow_method(description: str | Mapping[str, Any]) -> FlowMethod:
    """Flow method of a name, or of a model file's record ``{"name": ..., parameters}``.

    Parameters
    ----------
    description : str or mapping
        A preset's name; ``package.module:object``, a callable or flow method of one's own, which is imported
        (see `CallableFlow`); ``onnx:FILE``, a network, which is tested first (see `onnx_flow`); or
        ``flow-files:LABEL=PATH``, flow on disk (see `FlowFiles`).

    Raises
    ------
    ModelError
        If name or parameters are unknown, an object cannot be imported or is no flow, a network fails its
        test, or a record is of an object, a network or flow on disk: these only the user may name, see
        `confirmed_method`.
    DataError
        If a network's file cannot be read or run.
    MissingExtraError
        If a network is named and onnxruntime is not installed.
    """
    if isinstance(description, str):
        return _named(description)
    method = _recorded(description)
    if method.name in CONFIRMED:
        raise ModelError(f"the flow {dict(description)} is not flowlik's own: {_advice(description)}")
    return method


def confirmed_method(record: Mapping[str, Any], given: str | None = None) -> FlowMethod:
    """Flow method of a model's record, which a name given beside it may only confirm.

    A model file starts no code of others: where it names an object, a network or flow on disk, the same must
    be given.

    Raises
    ------
    ModelError
        If another method is given, or none where one must be.
    """
    if given is None:
        return flow_method(record)
    method = flow_method(given)
    if describe(method) != dict(record):
        own = method_label(record)
        own = own if own != method_label(describe(method)) else f"{dict(record)}"
        apart = _apart(record, describe(method))
        raise ModelError(f"the model is for the flow {own}, not for {given!r}: {apart or _advice(record)}")
    return method


def check_record(record: Mapping[str, Any]) -> dict[str, Any]:
    """Record of a method as `describe` makes it, with parameters left out at their defaults; imports nothing.

    Raises
    ------
    ModelError
        If name or parameters are unknown.
    """
    return describe(_recorded(record))


def method_label(record: Mapping[str, Any]) -> str:
    """Short name of a method in results and file names: a preset's, an object's, a label's.

    Who solves Lucas and Kanade's equations is not in it: the vectors are the same.
    """

    def unsolved(record: Mapping[str, Any]) -> dict[str, Any]:
        return {key: value for key, value in record.items() if key != "solver"}

    presets = (name for name, preset in PRESETS.items() if unsolved(describe(preset)) == unsolved(record))
    own = str(record.get("object") or record.get("label") or record.get("name"))
    return next(presets, own.replace(":", "."))


def _named(name: str) -> FlowMethod:
    kind, colon, rest = name.partition(":")
    if kind == FlowFiles.name:
        own, equals, path = rest.partition("=")
        if not equals or not path:
            raise ModelError(f"{name!r} does not say which flow it is and where: flow-files:LABEL=FOLDER")
        return FlowFiles(own, Path(path))
    if kind == OnnxFlow.name and rest:
        return named_network(rest)
    if colon:
        own_method = find(name)
        # one of flowlik's own methods with other parameters needs no import to be found again
        return own_method if type(own_method) in METHODS.values() else brought(name)
    if name not in PRESETS:
        others = "package.module:object, onnx:FILE, flow-files:LABEL=FOLDER"
        raise ModelError(f"unknown flow method {name!r}: known are {', '.join(PRESETS)}, {others}")
    return PRESETS[name]


def _recorded(record: Mapping[str, Any]) -> FlowMethod:
    """Make the method of a record; one to be confirmed is not ready to run."""
    parameters = dict(record)
    name = parameters.pop("name", None)
    if name == LucasKanade.name and "centred" in parameters:  # files of before 0.1.0
        parameters["anchor"] = "middle" if parameters.pop("centred") else "energy"
    if name == LucasKanade.name:  # files of before there was a choice
        parameters.setdefault("solver", "opencv")
    try:
        method = {**METHODS, **CONFIRMED}[name](**parameters)
    except (KeyError, TypeError):
        raise ModelError(f"unknown flow method {dict(record)}: known are {', '.join(METHODS)}") from None
    if not {"name", *parameters} <= set(describe(method)):
        raise ModelError(f"flow method {dict(record)}: not what a model file records of it")
    if name in METHODS:
        _check_parameters(method)
    return method


def _advice(record: Mapping[str, Any]) -> str:
    """Which --method goes with a model."""
    if record.get("name") == CallableFlow.name:
        return f"give --method {record['object']} if you trust that code"
    if record.get("name") == OnnxFlow.name:
        return f"give --method onnx:FILE of the network {record['label']!r}"
    if record.get("name") == FlowFiles.name:
        return f"give --method flow-files:{record['label']}=FOLDER"
    return "leave out --method"


def _apart(record: Mapping[str, Any], given: Mapping[str, Any]) -> str:
    """What differs in the network that is given from the one of a model."""
    if not (record.get("name") == given["name"] == OnnxFlow.name):
        return ""
    if record["sha256"] != given["sha256"]:
        return f"its file has the SHA-256 {given['sha256'][:12]}…, not {record['sha256'][:12]}…"
    changed = [f"{key} is {given[key]!r}, not {record[key]!r}" for key in given if given[key] != record[key]]
    return f"the same network, but {', '.join(changed)}"


def _check_parameters(method: FlowMethod) -> None:
    """Check that a built-in method's parameters are numbers below 1000 of their kinds."""
    for f in fields(method):  # type: ignore[arg-type]
        value, default = getattr(method, f.name), cast(Any, f.default)
        kind = type(default)
        if not (type(value) is kind or (kind is float and type(value) is int)):
            raise ModelError(f"flow method {method.name}: {f.name} must be of {kind.__name__}, not {value!r}")
        if kind is str and value not in f.metadata["choices"]:
            known = ", ".join(f.metadata["choices"])
            raise ModelError(f"flow method {method.name}: {f.name} must be one of {known}, not {value!r}")
        if kind in (int, float) and not (0 < value < 1000 or (value == 0 and f.metadata.get("zero"))):
            raise ModelError(
                f"flow method {method.name}: {f.name} must be a positive number below 1000, not {value}"
            )


__all__ = [
    "DIS",
    "METHODS",
    "PRESETS",
    "CallableFlow",
    "DenseFlow",
    "Farneback",
    "FlowFiles",
    "FlowMethod",
    "FlowOfPairs",
    "HornSchunck",
    "LucasKanade",
    "OnnxFlow",
    "backward_method",
    "check_record",
    "coded",
    "confirmed_method",
    "describe",
    "detect_corners",
    "flow_method",
    "method_for_pair",
    "method_label",
    "onnx_flow",
]
