"""Tiny ONNX networks with known behaviour: a matcher of patches over all shifts of a few pixels."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("onnxruntime")
onnx = pytest.importorskip("onnx")
TensorProto, helper, numpy_helper = onnx.TensorProto, onnx.helper, onnx.numpy_helper

PATCH_PX = 9
SHARPNESS = 400.0


@dataclass(frozen=True)
class Form:
    """What the exported graph looks like; the defaults are one input of two grey images, size free."""

    inputs: str = "channels"  # or "two", "axis", "batch"
    colours: int = 1
    channels_last: bool = False
    size: tuple[int | None, int | None] = (None, None)
    pairs: int | None = None
    values: float = 1.0  # white
    part: int = 1  # of the images' size that the flow has
    reach: int = 6  # shifts that are compared, in pixels of the flow
    flow_last: bool = False
    earlier: bool = False  # whether there is an earlier, coarser output
    variance: bool = False  # whether it tells the variance of its flow
    tail: str = ""  # "nan": of no use


def matcher(path: Path, form: Form = Form()) -> Path:
    """Write the matcher: softmax over the shifts' mean square differences, then the mean shift [px]."""
    nodes, constants = [], {}

    def node(kind: str, *inputs: str, to: str = "", **attributes) -> str:
        name = to or f"{kind.lower()}{len(nodes)}"
        nodes.append(helper.make_node(kind, inputs, [name], **attributes))
        return name

    def constant(value, name: str = "") -> str:
        name = name or f"constant{len(constants)}"
        constants[name] = numpy_helper.from_array(np.asarray(value), name)
        return name

    batch = form.pairs or "pairs"
    first, second = _images(form, node, constant)
    scale = constant(np.float32(1 / form.values))
    first, second = node("Mul", first, scale), node("Mul", second, scale)
    if form.part > 1:
        pool = {"kernel_shape": [form.part] * 2, "strides": [form.part] * 2}
        first, second = (node("AveragePool", image, **pool) for image in (first, second))

    reach, side = form.reach, 2 * form.reach + 1
    shifts = np.mgrid[-reach : reach + 1, -reach : reach + 1][::-1].reshape(2, -1)
    moved = np.eye(side**2, dtype=np.float32).reshape(-1, 1, side, side)
    candidates = node("Conv", second, constant(moved), pads=[reach] * 4)
    difference = node("Sub", candidates, first)
    cost = node(
        "AveragePool", node("Mul", difference, difference), kernel_shape=[PATCH_PX] * 2,
        pads=[PATCH_PX // 2] * 4, count_include_pad=1,
    )  # fmt: skip
    chance = node("Softmax", node("Mul", cost, constant(np.float32(-SHARPNESS))), axis=1)
    mean = constant(shifts.astype(np.float32)[:, :, None, None])
    flow = node("Conv", chance, mean)
    outputs = []
    if form.earlier:
        outputs.append(node("AveragePool", flow, kernel_shape=[4, 4], strides=[4, 4], to="coarse"))
    if form.variance:
        square = node("Conv", chance, constant((shifts.astype(np.float32) ** 2)[:, :, None, None]))
        outputs.append(node("Sub", square, node("Mul", flow, flow), to="variance"))
    if form.tail == "nan":
        flow = node("Mul", flow, constant(np.float32(np.nan)))
    outputs.append(node("Transpose", flow, perm=[0, 2, 3, 1] if form.flow_last else [0, 1, 2, 3], to="flow"))

    graph = helper.make_graph(
        nodes,
        "matcher",
        [_values(name, shape) for name, shape in _inputs(form, batch)],
        [_values(name, [None] * 4) for name in outputs],
        list(constants.values()),
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def _values(name: str, shape: list) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)


def _inputs(form: Form, batch: int | str) -> list[tuple[str, list]]:
    height, width = (side or name for side, name in zip(form.size, ("height", "width")))
    colours = 2 * form.colours if form.inputs == "channels" else form.colours
    image = [height, width, colours] if form.channels_last else [colours, height, width]
    if form.inputs == "two":
        return [("first", [batch, *image]), ("second", [batch, *image])]
    return [
        (
            "images",
            {"channels": [batch, *image], "axis": [batch, 2, *image], "batch": [2, *image]}[form.inputs],
        )
    ]


def _images(form: Form, node, constant) -> list[str]:
    """Two grey images (N, 1, H, W) of what the graph takes."""
    if form.inputs == "two":
        images = ["first", "second"]
    elif form.inputs == "channels":
        axis = 3 if form.channels_last else 1
        channels = np.arange(2 * form.colours).reshape(2, -1)
        images = [node("Gather", "images", constant(which), axis=axis) for which in channels]
    else:
        axis = 1 if form.inputs == "axis" else 0
        images = [node("Gather", "images", constant(np.array(i)), axis=axis) for i in (0, 1)]
        if form.inputs == "batch":
            images = [node("Unsqueeze", image, constant(np.array([0]))) for image in images]
    if form.channels_last:
        images = [node("Transpose", image, perm=[0, 3, 1, 2]) for image in images]
    return [node("ReduceMean", image, axes=[1], keepdims=1) for image in images]
