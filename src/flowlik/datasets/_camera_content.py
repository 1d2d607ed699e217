"""What stands in a camera file of YAML, JSON or OpenCV's XML: plain mappings, lists, words and numbers."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml
from numpy.typing import NDArray

from flowlik.errors import DataError

MAX_DEPTH = 20
MAX_YAML_BYTES = 2**16

MALFORMED = (
    yaml.YAMLError, ElementTree.ParseError, ValueError, TypeError, OverflowError, AttributeError, KeyError,
    IndexError, RecursionError,
)  # fmt: skip
"""What the parsers raise; YAML's constructors fail in ways of their own on malformed dates and numbers."""


class _Loader(yaml.SafeLoader):
    """YAML's plain types, OpenCV's matrices, and nothing else: no references, which grow without bound."""

    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("references are not read")
        if self._depth >= MAX_DEPTH:
            raise yaml.YAMLError("nested too deeply")
        self._depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1

    def matrix(self, node: Any) -> dict[Any, Any]:
        """Rows, columns and data of a matrix."""
        return self.construct_mapping(node, deep=True)


for _kind in ("opencv-matrix", "opencv-nd-matrix"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", _Loader.matrix)


def parse_mappings(text: str) -> list[dict[Any, Any]]:
    """Mappings of a text: one, or in YAML one a document (as ``ros2 topic echo`` prints message by message).

    Raises
    ------
    DataError
        If the text is none of YAML, JSON and OpenCV's XML.
    """
    start = text.lstrip()[:1]
    kind, parse = {"<": ("XML", _xml), "{": ("JSON", _json)}.get(start, ("YAML", _yaml))
    try:
        found = list(parse(text))
    except MALFORMED as error:
        raise DataError(f"not readable {kind}") from error
    if not found or not all(isinstance(document, dict) for document in found):
        raise DataError("not a mapping of names to values")
    return found


def _yaml(text: str) -> Iterator[Any]:
    if len(text) > MAX_YAML_BYTES:
        raise DataError("larger than a camera file can be")
    if text.startswith("%YAML:"):
        # OpenCV's own dialect: its way to write the version, and no space needed after a colon
        text = re.sub(r"^(\s*[\w.]+):(?=\S)", r"\1: ", text.partition("\n")[2], flags=re.MULTILINE)
    return (document for document in yaml.load_all(text, Loader=_Loader) if document is not None)


def _json(text: str) -> Iterator[Any]:
    try:
        yield json.loads(text)
    except ValueError:  # YAML may begin with a brace too
        yield from _yaml(text)


def _xml(text: str) -> Iterator[Any]:
    if len(text) > MAX_YAML_BYTES:
        raise DataError("larger than a camera file can be")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError("definitions are not read")
    root = ElementTree.fromstring(text)
    if root.tag != "opencv_storage":
        raise ValueError("not OpenCV's")
    yield {child.tag: _value(child) for child in root}


def _value(element: ElementTree.Element) -> Any:
    if len(element):
        return {child.tag: _value(child) for child in element}
    words = (element.text or "").split()
    return words[0] if len(words) == 1 else words


def numbers_of(value: Any, what: str) -> NDArray[np.float64]:
    """Finite numbers of a number, a list, a list of lists, or a matrix written as rows, cols, data.

    Raises
    ------
    DataError
        Naming ``what`` is not one, if it is not.
    """
    if isinstance(value, dict):
        value = value.get("data")
    rows = value if isinstance(value, list) else None
    if rows is not None and rows and all(isinstance(row, list) for row in rows):
        rows = [number for row in rows for number in row]
    # YAML 1.1 takes 1e-3 for a word
    numbers = [] if rows is None else [_number(v) for v in rows]
    if rows is None or not np.isfinite(numbers).all():
        raise DataError(f"the {what} is not a list of finite numbers")
    return np.array(numbers, dtype=np.float64)


def number_of(value: Any, what: str) -> float:
    """One finite number.

    Raises
    ------
    DataError
        Naming ``what`` is not one, if it is not.
    """
    found = _number(value)
    if not np.isfinite(found):
        raise DataError(f"{what} is {str(value)[:40]!r}, not a finite number")
    return found


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return float("nan")
    try:
        return float(value)
    except (ValueError, OverflowError):
        return float("nan")
