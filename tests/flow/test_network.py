"""A network in an ONNX file: what its graph tells, what the self-test finds, and what is refused."""

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flowlik.calibration import index_form
from flowlik.errors import DataError, MissingExtraError, ModelError
from flowlik.flow import OnnxFlow, confirmed_method, describe, flow_method, method_label, onnx_flow
from flowlik.flow._onnx_graph import graph_form
from flowlik.flow._onnx_self_test import KnownMotion, explain
from flowlik.flow.base import samplers
from flowlik.likelihood.covariates import covariate
from flowlik.likelihood.model_file import load_likelihood, save_likelihood
from flowlik.measurement.measurements import measure
from tests.flow.networks import Form, matcher
from tests.helpers import lcm_likelihood, textured_image

SIZE = (64, 96)
FIXED = Form(size=SIZE)
FREE = Form()
SAID = {"range": (0, 1), "threads": 1}  # no other range is tried
SHIFT = np.array([3.0, -1.0])
PAIR = textured_image(SIZE), textured_image(SIZE, shift=tuple(SHIFT))
INNER = (slice(12, -12), slice(12, -12))


@pytest.fixture(scope="module", autouse=True)
def small_self_test():
    """Graphs of free size are tested on a small image."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("flowlik.flow._onnx_file.SIZE", SIZE)
        yield


@pytest.fixture(scope="module")
def fixed(tmp_path_factory) -> Path:
    return matcher(tmp_path_factory.mktemp("network") / "fixed.onnx", FIXED)


@pytest.fixture(scope="module")
def free(tmp_path_factory) -> Path:
    return matcher(tmp_path_factory.mktemp("network") / "free.onnx", replace(FREE, variance=True))


def median_error(method: OnnxFlow, pair=PAIR) -> float:
    return float(np.median(np.linalg.norm(method.dense(*pair)[INNER] - SHIFT, axis=-1)))


@pytest.mark.parametrize(
    "form",
    [
        FIXED,
        replace(FIXED, inputs="two", colours=3),
        replace(FIXED, inputs="two", channels_last=True, flow_last=True),
        replace(FIXED, inputs="axis", pairs=2),
        replace(FIXED, inputs="axis", colours=3, channels_last=True),
        replace(FIXED, inputs="batch", colours=3),
        replace(FIXED, colours=3, channels_last=True),
        replace(FIXED, earlier=True),
        replace(FIXED, part=2),
    ],
    ids=str,
)
def test_a_graph_tells_how_it_takes_images(tmp_path, form):
    method = onnx_flow(matcher(tmp_path / "net.onnx", form), **SAID)
    assert method.dense(*PAIR).shape == (*SIZE, 2)
    assert median_error(method) < 0.3


@pytest.mark.parametrize(
    ("white", "conventions"),
    [(255.0, {"range": (0, 255)}), (1.0, {"scale": 1}), (4.4, {"normalise": "imagenet"})],
)
def test_values_in_the_range_that_is_said(tmp_path, white, conventions):
    path = matcher(tmp_path / "net.onnx", replace(FIXED, values=white))
    assert median_error(onnx_flow(path, **conventions)) < 0.3


def test_conventions_beside_the_file_and_on_the_command_line(tmp_path):
    path = matcher(tmp_path / "my.net.onnx", replace(FIXED, values=255.0))
    Path(f"{path}.json").write_text(json.dumps({"range": [0, 255], "label": "other"}))
    assert (onnx_flow(path).high, onnx_flow(path).label) == (255, "other")
    named = flow_method(f"onnx:{path},range=-1..254,multiple=8,label=third,output=flow,threads=1")
    assert (named.low, named.high, named.multiple, named.label) == (-1, 254, 8, "third")
    assert (named.output, named.threads) == ("flow", 1)


@pytest.mark.parametrize(
    ("conventions", "message"),
    [
        ({"axes": "vu"}, r"u and v are swapped \(`axes`: vu\)"),
        ({"scale": -1.0}, r"the sign is the other one \(`scale`: -1\)"),
        ({"order": "current-first"}, r"the images are in the other order \(`order`: current-first\)"),
        ({"axes": "vu", "scale": -1.0}, "u and v are swapped, and the sign is the other one"),
        ({"axes": "vu", "order": "current-first"}, "u and v are swapped, and the images are in the other"),
        ({"scale": 8.0}, r"a shift of 4, -2 px comes back as 3\d.*the scale is another \(`scale`: times 0.1"),
    ],
)
def test_the_self_test_names_the_convention_that_is_wrong(fixed, conventions, message):
    """A right network, wrongly described, is a network of the other convention, rightly described."""
    with pytest.raises(ModelError, match=f"fixed.onnx: the self-test fails: .*{message}") as caught:
        onnx_flow(fixed, **SAID, **conventions)
    assert "\n" not in str(caught.value)


def test_the_self_test_names_the_range_that_does_better(tmp_path):
    path = matcher(tmp_path / "net.onnx", replace(FIXED, values=255.0))
    with pytest.raises(ModelError, match=r"to 0\.\d+ px with 0 to 255 \(`range`: 0..255\)"):
        onnx_flow(path)
    with pytest.raises(ModelError, match=r"self-test fails: .*\(`range`, `normalise`, `output`\?\)"):
        onnx_flow(path, range=(0, 0.1))


def test_the_known_motion_is_known_both_ways():
    motion = KnownMotion.of((96, 128))
    v, u = np.mgrid[0:96, 0:128]
    turn = 2 * np.pi / 64
    back_u = u + motion.back[..., 0]
    forth = 4 + 1.5 * np.sin(turn * back_u)
    np.testing.assert_allclose(forth, -motion.back[..., 0], atol=1e-9)
    assert explain(motion.flow, motion).convention == ""
    assert explain(3 * motion.flow[..., ::-1], motion).factor == pytest.approx(3)
    # the images' motion is that flow: grey values at both ends agree
    at = np.rint(np.stack([u, v], axis=-1) + motion.flow).astype(int)[20:-20, 20:-20]
    ends = motion.current[at[..., 1], at[..., 0]].astype(float)
    there = motion.previous[20:-20, 20:-20].astype(float)
    assert np.corrcoef(ends.ravel(), there.ravel())[0, 1] > 0.9


def test_tiny_numbers_stay_numbers_outside_the_network(fixed):
    onnx_flow(fixed, **SAID).dense(*PAIR)
    assert (np.array([1e-310]) * 0.5 > 0).all()


def test_images_of_other_sizes(free, fixed):
    method = onnx_flow(free, multiple=32, **SAID)
    pair = [image[:51, :83] for image in PAIR]
    assert method.dense(*pair).shape == (51, 83, 2)
    assert median_error(method, pair) < 0.3
    small = [image[:40, :60] for image in PAIR]
    assert median_error(onnx_flow(fixed, **SAID), small) < 0.3
    large = textured_image((128, 192)), textured_image((128, 192), shift=(6, 4))
    with pytest.raises(DataError, match=r"fixed.onnx: takes images of 96x64, not of 192x128 \(`fit`: resize"):
        onnx_flow(fixed, **SAID).dense(*large)
    flow = onnx_flow(fixed, fit="resize", **SAID).dense(*large)
    np.testing.assert_allclose(np.median(flow[24:-24, 24:-24], axis=(0, 1)), [6, 4], atol=0.5)


def test_both_ways_are_one_call_where_the_graph_allows(free, fixed, monkeypatch):
    calls = []
    for path, ways in ((free, [2]), (fixed, [2])):
        method = onnx_flow(path, multiple=32, **SAID)
        ready = method.ready()
        run = type(ready).run
        monkeypatch.setattr(
            type(ready), "run", lambda self, pairs, run=run: calls.append(len(pairs)) or run(self, pairs)
        )
        at = samplers(method, *PAIR, both=True)
        pixels = np.array([[40.0, 30], [50, 32]])
        there, back = at.there(pixels), at.back(pixels)
        assert calls == ways
        np.testing.assert_allclose(there, method.measure_at(*PAIR, pixels), atol=1e-3)
        np.testing.assert_allclose(back, method.measure_at(*PAIR[::-1], pixels), atol=1e-3)
        monkeypatch.undo()
        calls.clear()


def test_a_batch_that_is_fixed(tmp_path):
    one = onnx_flow(matcher(tmp_path / "one.onnx", replace(FIXED, pairs=1)), **SAID)
    two = onnx_flow(matcher(tmp_path / "two.onnx", replace(FIXED, pairs=2)), **SAID)
    maps = [method.maps([PAIR, PAIR[::-1], PAIR]) for method in (one, two)]
    for a, b in zip(*maps):
        np.testing.assert_allclose(a.flow, b.flow, atol=1e-4)
    np.testing.assert_array_equal(maps[1][0].flow, maps[1][2].flow)


def test_the_networks_own_uncertainty_is_a_covariate(free):
    method = onnx_flow(free, multiple=32, **SAID, uncertainty="variance", uncertainty_is="variance")
    assert index_form(method).covariates[-1] == "own-uncertainty"
    flat = [np.where(np.arange(96) < 40, 128, image).astype(np.uint8) for image in PAIR]
    m = measure(*flat, method, pixels=np.array([[20.0, 32], [70, 32]]), signals=["own-uncertainty"])
    own = m.signals["own-uncertainty"]
    assert own.shape == (2, 2)
    assert (own[0] > 2).all()  # where there is nothing to see any shift is as good: 3.7 px
    assert (own[1] < 1).all()
    along = covariate("own-uncertainty").along(m, np.array([[1.0, 0], [0.6, 0.8]]))
    np.testing.assert_allclose(along, [own[0, 0], np.hypot(0.6 * own[1, 0], 0.8 * own[1, 1])])
    with pytest.raises(ModelError, match="tells no uncertainty of its own"):
        measure(*PAIR, onnx_flow(free, multiple=32, **SAID), signals=["own-uncertainty"])
    with pytest.raises(ModelError, match=r"no output 'other' is an uncertainty of 1 or 2 channels: variance"):
        replace(method, uncertainty="other").dense(*PAIR)


@pytest.mark.parametrize(
    ("kind", "values", "sigma"),
    [
        ("scale", [0.5], 0.5),
        ("log-scale", [np.log(0.5)], 0.5),
        ("variance", [0.25], 0.5),
        ("log-variance", [np.log(0.25)], 0.5),
        ("mixture", [0.0, 0.0, np.log(0.25), np.log(0.5)], np.sqrt(0.0625 + 0.25)),
    ],
)
def test_what_an_uncertainty_holds(kind, values, sigma):
    from flowlik.flow.network import _SIGMAS

    found = _SIGMAS[kind](np.array(values, np.float32).reshape(1, 1, 1, -1))
    np.testing.assert_allclose(found.ravel(), sigma, rtol=1e-6)


def test_a_model_file_names_the_network_and_needs_its_file(fixed, tmp_path):
    method = onnx_flow(fixed, **SAID)
    save_likelihood(lcm_likelihood(method=describe(method)), tmp_path / "model.json")
    model = load_likelihood(tmp_path / "model.json")
    assert "path" not in model.method
    assert "threads" not in model.method
    assert str(fixed.parent) not in (tmp_path / "model.json").read_text()
    assert method_label(model.method) == "fixed"
    with pytest.raises(ModelError, match="give --method onnx:FILE of the network 'fixed'"):
        flow_method(model.method)
    assert confirmed_method(model.method, f"onnx:{fixed},range=0..1,threads=1") == method
    with pytest.raises(ModelError, match="the same network, but multiple is 8, not 64"):
        confirmed_method(model.method, f"onnx:{fixed},range=0..1,multiple=8")
    other = matcher(tmp_path / "fixed.onnx", replace(FIXED, earlier=True))
    with pytest.raises(ModelError, match="its file has the SHA-256"):
        confirmed_method(model.method, f"onnx:{other},range=0..1")
    with pytest.raises(DataError, match="it is not said where its file is"):
        OnnxFlow("fixed", "0").dense(*PAIR)
    with pytest.raises(DataError, match="its content has changed"):
        replace(method, sha256="0" * 64).dense(*PAIR)


def test_it_can_be_sent_to_another_process(fixed):
    method = onnx_flow(fixed, **SAID)
    assert pickle.loads(pickle.dumps(method)) == method


@pytest.mark.parametrize(
    ("inputs", "size"),
    [
        ([("a", [1, 6, 64, 96], "tensor(float)")], (64, 96)),
        ([("a", ["n", 2, 3, "h", "w"], "tensor(float16)")], (None, None)),
        ([("a", [1, "h", "w", 3], "tensor(uint8)"), ("b", [1, "h", "w", 3], "tensor(uint8)")], (None, None)),
        ([("a", [1, 2, "h", 640], "tensor(double)")], (None, 640)),
    ],
)
def test_sizes_that_a_graph_tells(inputs, size):
    assert graph_form(Path("net.onnx"), inputs).size == size


@pytest.mark.parametrize(
    "inputs",
    [
        [("a", [1, 3, 64, 96], "tensor(float)")],
        [("a", [1, "c", "h", "w"], "tensor(float)")],
        [("a", [1, 6, 64, 96], "tensor(int64)")],
        [("a", [6, 64, 96], "tensor(float)")],
        [("a", [1, 3, 64, 96], "tensor(float)"), ("b", [1, 1, 64, 96], "tensor(float)")],
        [("a", [1, 3, 64, 96], "tensor(float)")] * 3,
        [],
    ],
)
def test_a_graph_of_other_inputs_is_refused(inputs):
    with pytest.raises(ModelError, match=r"net.onnx: its inputs are not two images: .*expected one of"):
        graph_form(Path("net.onnx"), inputs)


def test_bad_files_are_one_line(tmp_path, fixed, free):
    (tmp_path / "text.onnx").write_text("no network")
    nan = matcher(tmp_path / "nan.onnx", replace(FIXED, tail="nan"))
    json_file = tmp_path / "listed.onnx"
    json_file.write_bytes(fixed.read_bytes())
    Path(f"{json_file}.json").write_text("[1]")
    for words, kind, message in (
        (tmp_path / "missing.onnx", DataError, "no such file of a network"),
        (tmp_path / "text.onnx", ModelError, "not an ONNX network that onnxruntime loads"),
        (nan, DataError, "its flow is not finite at any pixel"),
        (json_file, DataError, "conventions of a network are an object, not list"),
        (
            f"{fixed},output=other",
            ModelError,
            r"no output 'other' is a flow of two channels.*flow \[1, 2, 64",
        ),
        (f"{fixed},colour=rgb", ModelError, "no convention of a network is colour; known are range, "),
        (f"{fixed},range=5", ModelError, r"a network's range is two numbers, such as 0..255"),
        (f"{fixed},axes=xy", ModelError, "axes must be one of uv, vu, not 'xy'"),
        (f"{fixed},multiple=0", ModelError, "multiple must be a whole number above 0"),
        (f"{fixed},label=a/b", ModelError, "a network's label has letters"),
    ):
        with pytest.raises(kind, match=message) as caught:
            flow_method(f"onnx:{words}")
        assert "\n" not in str(caught.value)


def test_a_size_that_a_free_graph_cannot_take(tmp_path):
    path = matcher(tmp_path / "net.onnx", replace(FREE, part=2))
    method = onnx_flow(path, multiple=32, **SAID)
    odd = [image[:63, :95] for image in PAIR]
    with pytest.raises(ModelError, match=r"no output is a flow .* of the images' size or a half"):
        replace(method, multiple=1).dense(*odd)


def test_without_the_extra_it_is_one_line(fixed, monkeypatch):
    def lacking(name):
        raise ImportError(name)

    from flowlik.flow import _onnx_graph

    _onnx_graph.network.cache_clear()
    monkeypatch.setattr("flowlik.support.extras.import_module", lacking)
    with pytest.raises(MissingExtraError, match=r"needs onnxruntime: pip install 'flowlik\[onnx\]'"):
        onnx_flow(fixed, **SAID)
