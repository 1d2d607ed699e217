"""SPyNet as an ONNX file, of your own copy of its weights.

    git clone https://github.com/anuragranj/spynet
    python examples/spynet_onnx.py spynet/models 4 spynet-4.onnx
    flowlik calibrate flight-1 --method onnx:spynet-4.onnx --out calibration

Ranjan and Black, *Optical Flow Estimation using a Spatial Pyramid Network*, CVPR 2017. The weights are the
authors', for research only; look into their licence. Variants: 3 and 4 were trained on FlyingChairs, F and C
tuned on Sintel (final and clean), K on KITTI. Needs `onnx`; beside the network its conventions are written.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

LEVELS = 6
MEAN = np.array([0.485, 0.456, 0.406], np.float32)
DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)
STORAGES = {"Float": "<f4", "Cuda": "<f4", "Double": "<f8", "Long": "<i8", "Int": "<i4", "Byte": "u1"}


class TorchFile:
    """Reader of Torch 7's binary files: numbers, strings, tables, tensors and objects of any class.

    Tensors become arrays, tables dictionaries, and other objects dictionaries with their class as ``class``.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._seen: dict[int, Any] = {}

    def read(self) -> Any:
        """Return the next object."""
        kind = self._number("<i4")
        if kind == 0:
            return None
        if kind == 1:
            return self._number("<f8")
        if kind == 2:
            return self._text()
        if kind == 5:
            return bool(self._number("<i4"))
        if kind not in (3, 4):
            raise ValueError(f"a Torch file holds an object of kind {kind}, which is not read")
        index = self._number("<i4")
        if index not in self._seen:
            self._seen[index] = found = {}  # an object may hold itself
            made = self._table(found) if kind == 3 else self._object(found)
            self._seen[index] = made
        return self._seen[index]

    def _number(self, form: str) -> Any:
        return self._numbers(1, form)[0].item()

    def _numbers(self, count: int, form: str = "<i8") -> np.ndarray:
        return np.frombuffer(self._file.read(count * np.dtype(form).itemsize), form)

    def _text(self) -> str:
        return self._file.read(self._number("<i4")).decode("latin-1")

    def _table(self, found: dict) -> dict:
        for _ in range(self._number("<i4")):
            key = self.read()
            found[key] = self.read()
        return found

    def _object(self, found: dict) -> Any:
        name = self._text()
        name = self._text() if name.startswith("V ") else name
        kind = name.removeprefix("torch.")
        if kind.endswith("Storage") and kind.removesuffix("Storage") in STORAGES:
            return self._numbers(self._number("<i8"), STORAGES[kind.removesuffix("Storage")])
        if kind.endswith("Tensor") and kind.removesuffix("Tensor") in STORAGES:
            dimensions = self._number("<i4")
            shape, strides = self._numbers(dimensions), self._numbers(dimensions)
            first, storage = self._number("<i8") - 1, self.read()
            if storage is None or not dimensions:
                return np.zeros(0, np.float32)
            steps = strides * storage.itemsize
            return np.lib.stride_tricks.as_strided(storage[first:], shape, steps).copy()
        found["class"] = name
        found.update(self.read() or {})
        return found


def convolutions(path: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Weights (out, in, 7, 7) and biases (out,) of one level's five convolutions."""
    with path.open("rb") as file:
        model = TorchFile(file).read()
    if "DataParallelTable" in model["class"]:
        model = model["modules"][1]
    layers = [model["modules"][i] for i in sorted(k for k in model["modules"] if k != "class")]
    found = []
    for layer in layers:
        if "Convolution" in layer["class"]:
            shape = [int(layer[key]) for key in ("nOutputPlane", "nInputPlane", "kH", "kW")]
            weights = np.ascontiguousarray(layer["weight"], np.float32).reshape(shape)
            found.append((weights, np.ascontiguousarray(layer["bias"], np.float32)))
    return found


def network(levels: list[list[tuple[np.ndarray, np.ndarray]]]) -> onnx.ModelProto:
    """Graph of the pyramid: two images (N, 6, H, W), colours from 0 to 1, to flow (N, 2, H, W)."""
    nodes: list[onnx.NodeProto] = []
    constants: dict[str, onnx.TensorProto] = {}

    def node(kind: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        name = name or f"{kind.lower()}{len(nodes)}"
        nodes.append(helper.make_node(kind, inputs, [name], **attributes))
        return name

    def constant(values: Any) -> str:
        name = f"constant{len(constants)}"
        constants[name] = numpy_helper.from_array(np.asarray(values), name)
        return name

    two = np.tile(MEAN, 2)[:, None, None], np.tile(DEVIATION, 2)[:, None, None]
    whole = node("Div", node("Sub", "images", constant(two[0])), constant(two[1]))
    pyramid = [whole]
    for _ in levels[1:]:
        pyramid.append(node("AveragePool", pyramid[-1], kernel_shape=[2, 2], strides=[2, 2]))
    pyramid.reverse()

    double = constant(np.float32(2))
    coarse = node("Mul", node("Slice", pyramid[0], *map(constant, _span(0, 2))), constant(np.float32(0)))
    flow = coarse
    for level, (images, weights) in enumerate(zip(pyramid, levels)):
        first = node("Slice", images, *map(constant, _span(0, 3)))
        second = node("Slice", images, *map(constant, _span(3, 6)))
        if level:
            size = node("Shape", images)
            size = node(
                "Concat",
                node("Shape", flow, end=2),
                node("Slice", size, constant([2]), constant([4])),
                axis=0,
            )
            larger = node(
                "Resize", flow, "", "", size, mode="linear", coordinate_transformation_mode="align_corners"
            )  # fmt: skip
            flow = node("Mul", larger, double)
            second = _warped(node, constant, second, flow)
        x = node("Concat", first, second, flow, axis=1)
        for i, (kernel, bias) in enumerate(weights):
            x = node("Conv", x, constant(kernel), constant(bias), pads=[3] * 4)
            x = node("Relu", x) if i < len(weights) - 1 else x
        last = level == len(levels) - 1
        flow = node("Add", x, flow, name="flow" if last else "")

    def values(name: str, channels: int) -> onnx.ValueInfoProto:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["pairs", channels, "height", "width"])

    graph = helper.make_graph(
        nodes, "spynet", [values("images", 6)], [values("flow", 2)], list(constants.values())
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    return model


def _span(first: int, last: int) -> tuple[np.ndarray, ...]:
    """Starts, ends and axes of some channels."""
    return np.array([first]), np.array([last]), np.array([1])


def _warped(node: Any, constant: Any, image: str, flow: str) -> str:
    """Image at the ends of the flow, the border's values beyond it."""
    size = node("Shape", flow)
    sides = [node("Gather", size, constant(axis)) for axis in (3, 2)]
    rows = []
    for channel, (side, shape) in enumerate(zip(sides, ([1, 1, 1, -1], [1, 1, -1, 1]))):
        ramp = node("Range", constant(np.array(0)), side, constant(np.array(1)))
        ramp = node("Reshape", node("Cast", ramp, to=TensorProto.FLOAT), constant(np.array(shape)))
        ends = node("Add", node("Slice", flow, *map(constant, _span(channel, channel + 1))), ramp)
        most = node("Sub", node("Cast", side, to=TensorProto.FLOAT), constant(np.float32(1)))
        scaled = node("Div", node("Mul", ends, constant(np.float32(2))), most)
        rows.append(node("Sub", scaled, constant(np.float32(1))))
    grid = node("Transpose", node("Concat", *rows, axis=1), perm=[0, 2, 3, 1])
    return node("GridSample", image, grid, mode="bilinear", padding_mode="border", align_corners=1)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("models", type=Path, help="folder of the repository's modelL*.t7 files")
    parser.add_argument("variant", choices=("3", "4", "C", "F", "K"))
    parser.add_argument("out", type=Path, help="ONNX file")
    options = parser.parse_args()
    paths = [options.models / f"modelL{level}_{options.variant}.t7" for level in range(1, LEVELS + 1)]
    # 3 and 4 have five levels: their authors use the fifth twice
    paths = [path if path.is_file() else paths[LEVELS - 2] for path in paths]
    onnx.save(network([convolutions(path) for path in paths]), str(options.out))
    conventions = {"multiple": 2 ** (LEVELS - 1), "fit": "resize", "range": [0, 1]}
    options.out.with_name(f"{options.out.name}.json").write_text(json.dumps(conventions))


if __name__ == "__main__":
    main()
