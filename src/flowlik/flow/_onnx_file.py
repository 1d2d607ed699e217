"""A network's file made a flow method: its conventions, and the self-test that they must pass."""

from __future__ import annotations

import json
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from flowlik.errors import DataError, ModelError
from flowlik.flow._onnx_graph import content
from flowlik.flow._onnx_self_test import KnownMotion, complaint, explain
from flowlik.flow.network import OnnxFlow

OTHER_RANGES = ((-1.0, 1.0), (0.0, 255.0))
SIZE = (192, 256)
CLEARLY = 0.5
ALIKE_PX = 0.01


def onnx_flow(path: Path, **conventions: Any) -> OnnxFlow:
    """Flow of a network in an ONNX file, after a self-test: a known motion of a textured image comes back.

    The test finds u and v or the images swapped, another sign or scale, and values in another range where
    these do better; RGB and BGR are the same to grey images, so that it cannot tell them apart.

    Parameters
    ----------
    path : Path
        The file. A JSON file beside it, ``FILE.json``, may hold conventions.
    **conventions
        Parameters of `OnnxFlow`, before those of the JSON file; ``range=(low, high)`` stands for two.

    Raises
    ------
    DataError
        If a file cannot be read, or the graph does not take images or gives no finite flow.
    ModelError
        If the file is no ONNX network of two images, a convention is unknown, or the self-test fails.
    MissingExtraError
        If onnxruntime is not installed.
    """
    given = {"label": path.stem, **_beside(path), **conventions}
    if "range" in given:
        given["low"], given["high"] = _range(given.pop("range"))
    known = {f.name for f in fields(OnnxFlow)} - {"path", "sha256"}
    if unknown := sorted(set(given) - known):
        raise ModelError(f"{path}: no convention of a network is {', '.join(unknown)}; known are range, "
                         f"{', '.join(sorted(known))}")  # fmt: skip
    method = OnnxFlow(sha256=content(path), path=path, **given)
    _test(method, range_said="low" in given or "high" in given or method.normalise != "none")
    return method


def named_network(words: str) -> OnnxFlow:
    """Network of a command line's ``FILE`` or ``FILE,convention=value,...``; see `onnx_flow`.

    A range is written ``range=0..255``.

    Raises
    ------
    DataError
        If a file cannot be read, or the graph does not take images or gives no finite flow.
    ModelError
        If the file is no ONNX network of two images, a convention is unknown, or the self-test fails.
    MissingExtraError
        If onnxruntime is not installed.
    """
    file, *rest = re.split(r",(?=[a-z_]+=)", words)
    conventions: dict[str, Any] = {}
    for name, _, value in (word.partition("=") for word in rest):
        conventions[name] = value.split("..") if name == "range" else _number(value)
    return onnx_flow(Path(file), **conventions)


def _number(value: str) -> Any:
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return value


def _range(given: Any) -> tuple[float, float]:
    try:
        low, high = (float(value) for value in given)
    except (TypeError, ValueError):
        raise ModelError(f"a network's range is two numbers, such as 0..255, not {given!r}") from None
    return low, high


def _beside(path: Path) -> dict[str, Any]:
    """Conventions of the JSON file beside a network, if there is one."""
    file = path.with_name(f"{path.name}.json")
    if not file.is_file():
        return {}
    try:
        values = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{file}: not readable as JSON ({error})") from error
    if not isinstance(values, dict):
        raise DataError(f"{file}: conventions of a network are an object, not {type(values).__name__}")
    return values


def _test(method: OnnxFlow, range_said: bool) -> None:
    """Refuse a network by whose conventions a known motion does not come back."""
    form = method.ready().form
    free = [max(side, method.multiple) for side in SIZE]
    free = [-(-side // method.multiple) * method.multiple for side in free]
    motion = KnownMotion.of((form.size[0] or free[0], form.size[1] or free[1]))
    pair = (motion.previous, motion.current)
    flow = method.dense(*pair)
    wrong = complaint(flow, motion)
    if not range_said:
        own = explain(flow, motion).error_px
        others = {r: _error(replace(method, low=r[0], high=r[1]), motion) for r in OTHER_RANGES}
        (low, high), least = min(others.items(), key=lambda item: item[1])
        if least < CLEARLY * own:
            wrong = (
                f"a known motion comes back to {own:.2f} px with values of 0 to 1, to {least:.2f} px with "
                f"{low:g} to {high:g} (`range`: {low:g}..{high:g})"
            )
    if wrong:
        raise ModelError(f"{method.path}: the self-test fails: {wrong}")
    if method.batch > 1 and form.pairs is None:
        back = (motion.current, motion.previous)
        both = method.maps([pair, back])
        apart = np.abs(np.stack([both[0].flow - flow, both[1].flow - method.dense(*back)]))
        if not np.nanmax(apart) < ALIKE_PX:
            raise ModelError(
                f"{method.path}: the self-test fails: two pairs in one call give another flow than one by "
                f"one, by {np.nanmax(apart):.2g} px, though the graph leaves the batch free (`batch`: 1)"
            )


def _error(method: OnnxFlow, motion: KnownMotion) -> float:
    """Median error [px] of a known motion but for swaps and scale; infinite where the network fails."""
    try:
        return explain(method.dense(motion.previous, motion.current), motion).error_px
    except DataError:
        return float("inf")
