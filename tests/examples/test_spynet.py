"""The export of SPyNet, on weights and files made here."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")

from examples import spynet_onnx  # noqa: E402
from tests.helpers import textured_image  # noqa: E402


class Writer:
    """Torch 7's binary format, as much of it as networks need."""

    def __init__(self) -> None:
        self.bytes, self.index = b"", 0

    def number(self, form: str, *values) -> None:
        self.bytes += struct.pack(f"<{len(values)}{form}", *values)

    def text(self, text: str) -> None:
        self.number("i", len(text))
        self.bytes += text.encode()

    def begin(self, kind: int, name: str = "") -> None:
        self.index += 1
        self.number("i", kind, self.index)
        if name:
            self.text("V 1")
            self.text(name)

    def write(self, value) -> None:
        if isinstance(value, bool):
            self.number("i", 5, int(value))
        elif isinstance(value, int | float):
            self.number("i", 1)
            self.number("d", value)
        elif isinstance(value, str):
            self.number("i", 2)
            self.text(value)
        elif isinstance(value, np.ndarray):
            self.begin(4, "torch.CudaTensor")
            self.number("i", value.ndim)
            self.number("q", *value.shape)
            self.number("q", *(stride // 4 for stride in value.strides))
            self.number("q", 3)  # the storage begins with two numbers of others
            self.begin(4, "torch.CudaStorage")
            self.number("q", value.size + 2)
            self.bytes += np.concatenate([[9, 9], value.ravel()]).astype("<f4").tobytes()
        elif value is None:
            self.number("i", 0)
        else:
            name = value.pop("class", "")
            if name:
                self.begin(4, name)
            self.begin(3)
            self.number("i", len(value))
            for key, item in value.items():
                self.write(key)
                self.write(item)


def convolution(weight: np.ndarray, bias: np.ndarray, flat: bool) -> dict:
    out, into, height, width = weight.shape
    return {
        "class": "cudnn.SpatialConvolution",
        **{"nOutputPlane": out, "nInputPlane": into, "kH": height, "kW": width},
        **{"weight": weight.reshape(out, -1) if flat else weight, "bias": bias},
        **{"train": False, "gradWeight": None},
    }


def level(seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(seed)
    sizes = [(5, 8), (2, 5)]
    return [
        (0.05 * rng.standard_normal((*s, 7, 7)).astype(np.float32), rng.random(s[0], np.float32))
        for s in sizes
    ]


def write(path: Path, layers, parallel: bool) -> None:
    modules = {
        1: convolution(*layers[0], flat=False),
        2: {"class": "nn.ReLU"},
        3: convolution(*layers[1], flat=True),
    }
    model = {"class": "nn.Sequential", "modules": modules}
    writer = Writer()
    writer.write({"class": "nn.DataParallelTable", "modules": {1: model}} if parallel else model)
    path.write_bytes(writer.bytes)


def forward(images: np.ndarray, levels) -> np.ndarray:
    """The pyramid in numpy and OpenCV: two colour images (6, H, W), flow (2, H, W)."""
    mean, deviation = np.tile(spynet_onnx.MEAN, 2), np.tile(spynet_onnx.DEVIATION, 2)
    pyramid = [(images - mean[:, None, None]) / deviation[:, None, None]]
    for _ in levels[1:]:
        c, h, w = pyramid[-1].shape
        pyramid.append(pyramid[-1].reshape(c, h // 2, 2, w // 2, 2).mean(axis=(2, 4)))
    flow = np.zeros((2, *pyramid[-1].shape[1:]))
    for i, (image, layers) in enumerate(zip(reversed(pyramid), levels)):
        height, width = image.shape[1:]
        v, u = np.mgrid[0:height, 0:width].astype(float)
        second = image[3:]
        if i:
            at = u * (flow.shape[2] - 1) / (width - 1), v * (flow.shape[1] - 1) / (height - 1)
            flow = 2 * np.stack([sampled(f, *at) for f in flow])
            second = np.stack([sampled(c, u + flow[0], v + flow[1]) for c in second])
        x = np.concatenate([image[:3], second, flow])
        for j, (kernels, biases) in enumerate(layers):
            rows = [
                sum(
                    cv2.filter2D(c, -1, k.astype(float), borderType=cv2.BORDER_CONSTANT)
                    for c, k in zip(x, kernel)
                )
                + b
                for kernel, b in zip(kernels, biases)
            ]
            x = np.stack(rows) if j else np.maximum(np.stack(rows), 0)
        flow = flow + x
    return flow


def sampled(values: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Bilinear, the border's values beyond it."""
    height, width = values.shape
    u, v = np.clip(u, 0, width - 1), np.clip(v, 0, height - 1)
    i, j = np.minimum(u.astype(int), width - 2), np.minimum(v.astype(int), height - 2)
    a, b = u - i, v - j
    top = (1 - a) * values[j, i] + a * values[j, i + 1]
    return (1 - b) * top + b * ((1 - a) * values[j + 1, i] + a * values[j + 1, i + 1])


@pytest.mark.parametrize("parallel", [False, True])
def test_the_exported_pyramid_is_the_papers(tmp_path, parallel):
    levels = [level(seed) for seed in range(3)]
    paths = [tmp_path / f"modelL{i}.t7" for i in range(3)]
    for path, layers in zip(paths, levels):
        write(path, layers, parallel)
    found = [spynet_onnx.convolutions(path) for path in paths]
    for mine, read in zip(levels, found):
        for (kernel, bias), (kernel_read, bias_read) in zip(mine, read):
            np.testing.assert_array_equal(kernel, kernel_read)
            np.testing.assert_array_equal(bias, bias_read)
    session = onnxruntime.InferenceSession(spynet_onnx.network(found).SerializeToString())
    grey = [textured_image((24, 40), seed=s) / np.float32(255) for s in range(6)]
    images = np.stack(grey).astype(np.float32)
    (flow,) = session.run(None, {"images": np.stack([images, images[::-1]])})
    for one, result in zip((images, images[::-1]), flow):
        expected = forward(one.astype(float), levels)
        assert np.abs(expected).max() > 1
        np.testing.assert_allclose(result, expected, atol=2e-3)
