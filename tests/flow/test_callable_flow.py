import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import flowlik
from flowlik.errors import DataError, ModelError
from flowlik.flow import (
    PRESETS,
    CallableFlow,
    Farneback,
    LucasKanade,
    check_record,
    confirmed_method,
    describe,
    flow_method,
    method_label,
)
from flowlik.flow._callable_flow import CallableFeatures, find
from flowlik.flow.base import DenseFlow
from flowlik.likelihood.model_file import load_likelihood, save_likelihood
from flowlik.measurement.measurements import measure
from tests.helpers import lcm_likelihood, textured_image

SHAPE = (48, 64)
PREVIOUS, CURRENT = textured_image(SHAPE), textured_image(SHAPE, shift=(1.0, 0.5))
PIXELS = np.array([[3.0, 4], [20.5, 30.25], [70, 2]])

OWN = """
from dataclasses import dataclass
import numpy as np
from flowlik.flow import Farneback, LucasKanade
from flowlik.flow.base import DenseFlow

imported = True

def constant(previous, current):
    previous[:] = 0  # spoils what it was given
    flow = np.full((*current.shape, 2), 1.5, np.float32)
    flow[0] = np.inf
    return flow

def huge(previous, current):
    return np.full((*current.shape, 2), 1e300)

class Network:
    made = 0
    def __init__(self):
        Network.made += 1
    def __call__(self, previous, current):
        return np.full((*current.shape, 2), 2.5)

def make():
    return Network()

@dataclass(frozen=True)
class Fast(DenseFlow):
    name = "fast"
    value: float = 3.5
    def dense(self, previous, current):
        return np.full((*current.shape, 2), self.value)

class Points:
    def measure(self, previous, current):
        pixels = np.array([[1.0, 2], [5, 6]])
        return pixels, self.measure_at(previous, current, pixels)
    def measure_at(self, previous, current, pixels):
        return 0.5 * pixels

class box:
    fast = Fast(4.5)

network = Network()
wide = Farneback(window=31)
number = 7
text = "two images"

def one(image): pass
def three(a, b, c): pass
def fails(a, b):
    raise ValueError("no weights\\nfound")
def flat(a, b): return np.zeros(a.shape)
def whole(a, b): return np.zeros((*a.shape, 2), int)
def complex_(a, b): return np.zeros((*a.shape, 2), complex)
def small(a, b): return np.zeros((*np.array(a.shape) // 2, 2))
def planar(a, b): return np.zeros((2, *a.shape))
def ragged(a, b): return [[1.0], [1.0, 2.0]]
def nothing(a, b): pass
class Broken:
    def __init__(self):
        raise OSError("no such file")
class Odd:
    def measure(self, a, b): return np.zeros((3, 2))
    def measure_at(self, a, b, pixels): return np.zeros((len(pixels) + 1, 2))
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Current folder with the module `own`; afterwards nothing of it is left imported."""
    before, path = set(sys.modules), list(sys.path)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(OWN)
    find.cache_clear()
    yield tmp_path
    find.cache_clear()
    sys.path[:] = path
    for name in set(sys.modules) - before:
        if name.startswith("own"):
            del sys.modules[name]


@pytest.mark.parametrize(
    ("name", "value"),
    [("constant", 1.5), ("network", 2.5), ("Network", 2.5), ("make", 2.5), ("Fast", 3.5), ("box.fast", 4.5)],
)
def test_a_dense_flow_of_any_kind(name, value):
    method = flow_method(f"own:{name}")
    assert method == CallableFlow(f"own:{name}")
    assert isinstance(method, DenseFlow)
    flow = method.dense(PREVIOUS, CURRENT)
    assert flow.dtype == np.float32
    assert (flow[1:] == value).all()
    np.testing.assert_array_equal(
        method.measure_at(PREVIOUS, CURRENT, PIXELS)[1:], [[value] * 2, [np.nan] * 2]
    )


def test_what_is_not_finite_is_unknown_and_the_images_stay_as_they_are():
    m = measure(PREVIOUS, CURRENT, flow_method("own:constant"))
    assert m.lost == SHAPE[1]
    assert (m.flow == 1.5).all()
    np.testing.assert_array_equal(PREVIOUS, textured_image(SHAPE))
    assert m.t.max() > 1
    assert np.isnan(flow_method("own:huge").dense(PREVIOUS, CURRENT)).all()


def test_a_sparse_flow():
    method = flow_method("own:Points")
    assert method == CallableFeatures("own:Points")
    assert not isinstance(method, DenseFlow)
    pixels, flow = method.measure(PREVIOUS, CURRENT)
    np.testing.assert_array_equal(flow, 0.5 * pixels)
    np.testing.assert_array_equal(method.measure_at(PREVIOUS, CURRENT, PIXELS), 0.5 * PIXELS)


def test_an_object_is_made_once():
    for _ in range(3):
        flow_method("own:Network").dense(PREVIOUS, CURRENT)
    assert sys.modules["own"].Network.made == 2  # the module makes one itself


def test_a_built_in_method_with_other_parameters_is_recorded_as_what_it_is():
    method = flow_method("own:wide")
    assert method == Farneback(window=31)
    assert flow_method(describe(method)) == method


def test_packages_and_names_in_them(folder):
    (folder / "own_package").mkdir()
    (folder / "own_package" / "inner.py").write_text("from own import constant")
    assert flow_method("own_package.inner:constant").dense(PREVIOUS, CURRENT)[5, 5, 0] == 1.5


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("own:", "'own:' is not the name of an object"),
        (":constant", "is not the name of an object"),
        ("./own.py:constant", "is not the name of an object"),
        ("own:constant:x", "is not the name of an object"),
        ("own:constant()", "is not the name of an object"),
        ("own:missing", r"own:missing: cannot be imported \(AttributeError: .*has no attribute 'missing'"),
        ("own_missing:f", r"own_missing:f: cannot be imported \(ModuleNotFoundError: No module named"),
        ("own.inner:f", r"own.inner:f: cannot be imported \(ModuleNotFoundError"),
        ("own:Broken", r"own:Broken: cannot be imported \(OSError: no such file\)"),
        ("own:number", "own:number: an object of int is neither a callable of two images nor a flow method"),
        ("own:text", "an object of str is neither a callable of two images nor a flow method"),
        ("own:one", "an object of function is neither"),
        ("own:three", "an object of function is neither"),
        ("own", "unknown flow method 'own': known are farneback, .* package.module:object"),
    ],
)
def test_what_is_no_flow_is_refused_by_name(name, message):
    with pytest.raises(ModelError, match=message) as caught:
        flow_method(name)
    assert "\n" not in str(caught.value)
    assert ("cannot be imported" in message) == (caught.value.__cause__ is not None)


@pytest.mark.parametrize("content", ["def f(:", "import nowhere_to_be_found", "raise SystemExit(3)", "1 / 0"])
def test_a_module_that_cannot_be_imported(folder, content):
    (folder / "own_bad.py").write_text(content)
    with pytest.raises(ModelError, match=r"own_bad:f: cannot be imported \(") as caught:
        flow_method("own_bad:f")
    assert "\n" not in str(caught.value)
    assert caught.value.__cause__ is not None


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("fails", r"failed on two images \(ValueError: no weights found, line \d+ of own.py\)"),
        ("flat", r"must return a floating array \(48, 64, 2\), not float64 \(48, 64\)"),
        ("whole", r"not int64 \(48, 64, 2\)"),
        ("complex_", r"not complex128 \(48, 64, 2\)"),
        ("small", r"not float64 \(24, 32, 2\)"),
        ("planar", r"not float64 \(2, 48, 64\)"),
        ("ragged", "returned an object of list, not an array"),
        ("nothing", "not an object of NoneType"),
    ],
)
def test_a_callable_that_fails_is_one_line_with_its_name(name, message):
    with pytest.raises(DataError, match=message) as caught:
        flow_method(f"own:{name}").measure(PREVIOUS, CURRENT)
    assert str(caught.value).startswith(f"own:{name}: ")
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value.__cause__, ValueError) == (name in ("fails", "ragged"))


def test_a_sparse_flow_of_the_wrong_shape():
    method = flow_method("own:Odd")
    with pytest.raises(
        DataError, match=r"own:Odd: must measure pixels and flow, two arrays \(N, 2\), not float64"
    ):
        method.measure(PREVIOUS, CURRENT)
    with pytest.raises(
        DataError, match=r"own:Odd: must return a floating array \(3, 2\), not float64 \(4, 2\)"
    ):
        method.measure_at(PREVIOUS, CURRENT, PIXELS)


def test_a_model_file_imports_nothing_until_its_object_is_confirmed(folder):
    method = flow_method("own:constant")
    save_likelihood(lcm_likelihood(method=describe(method)), folder / "model.json")
    del sys.modules["own"]
    find.cache_clear()
    model = load_likelihood(folder / "model.json")
    assert model.method == {"name": "callable", "object": "own:constant"}
    for given, message in (
        (None, "is not flowlik's own: give --method own:constant if you trust that code"),
        ("farneback", "not for 'farneback': give --method own:constant"),
    ):
        with pytest.raises(ModelError, match=message):
            confirmed_method(model.method, given)
    with pytest.raises(ModelError, match="is not flowlik's own"):
        flow_method(model.method)
    assert "own" not in sys.modules
    with pytest.raises(ModelError, match="not for 'own:network'"):
        confirmed_method(model.method, "own:network")
    confirmed = confirmed_method(model.method, "own:constant")
    model.check(measure(PREVIOUS, CURRENT, confirmed))
    with pytest.raises(ModelError, match="the model is for the flow"):
        model.check(measure(PREVIOUS, CURRENT, flow_method("own:network")))


@pytest.mark.parametrize("record", [{"object": "os"}, {"object": 7}, {}, {"object": "a:b", "more": 1}])
def test_a_record_edited_to_nonsense_is_refused(record):
    with pytest.raises(ModelError, match=r"unknown flow method|is not the name of an object"):
        check_record({"name": "callable", **record})


def test_built_in_methods_need_no_confirmation():
    assert confirmed_method(describe(LucasKanade())) == LucasKanade()
    assert confirmed_method(describe(LucasKanade()), "lucas-kanade") == LucasKanade()
    with pytest.raises(ModelError, match="leave out --method"):
        confirmed_method(describe(LucasKanade()), "lucas-kanade-11")


def test_a_method_can_be_sent_to_another_process():
    method = flow_method("own:constant")
    assert pickle.loads(pickle.dumps(method)) == method


def test_labels_tell_methods_apart_and_can_be_file_names():
    labels = [method_label(describe(method)) for method in PRESETS.values()]
    assert labels == [name.removesuffix("-opencv") for name in PRESETS]
    assert method_label(describe(Farneback(window=31))) == "farneback"
    assert method_label({"name": "callable", "object": "a.b:c.d"}) == "a.b.c.d"


@pytest.mark.parametrize("options", [[], ["-P"]])
def test_the_current_folder_is_importable_unless_python_forbids_it(folder, options):
    """As a console script is started: from a file elsewhere, the current folder not on the path."""
    script = folder / "elsewhere" / "script.py"
    script.parent.mkdir()
    script.write_text("from flowlik.flow import flow_method\nprint(flow_method('own:constant'))")
    path = str(Path(flowlik.__file__).parents[1])
    run = subprocess.run([sys.executable, *options, script], capture_output=True, text=True, cwd=folder,
                         env={**os.environ, "PYTHONPATH": path})  # fmt: skip
    assert ("CallableFlow(object='own:constant')" in run.stdout) == (not options), run.stderr
