import warnings

import numpy as np
import pytest

from flowlik.errors import DataError
from flowlik.image.depth import ImplausibleDepthWarning, check_depth_z

SCENE = np.random.default_rng(0).uniform(2, 9, (48, 64))


def unknown(depth, share, value):
    return np.where(np.random.default_rng(1).random(depth.shape) < share, value, depth)


@pytest.mark.parametrize("dtype", [np.uint16, np.int32, np.uint8, bool, complex, object])
def test_only_floats_are_metres(dtype):
    with pytest.raises(DataError, match=r"metres along z in an array of floats, not .*1000 where") as caught:
        check_depth_z((1000 * SCENE).astype(dtype))
    assert "\n" not in str(caught.value)
    with pytest.raises(DataError, match="not list"):
        check_depth_z(SCENE.tolist())


@pytest.mark.parametrize(
    "depth",
    [
        SCENE,
        SCENE.astype(np.float32),
        SCENE.ravel(),
        100 * SCENE,
        unknown(SCENE, 0.9, 0.0),
        unknown(SCENE, 0.9, np.nan),
        unknown(SCENE, 1.0, np.inf),
        np.where(np.arange(64) == 0, -1.0, SCENE)[:1, :0],
    ],
)
def test_plausible_depth_is_left_alone(depth):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_depth_z(depth)


@pytest.mark.parametrize(
    ("depth", "message"),
    [
        (1000 * SCENE, "beyond 1000 m: millimetres, not metres"),
        (unknown(1000 * SCENE, 0.7, 0.0), "millimetres"),
        (0 * SCENE, "no depth is known"),
        (np.nan * SCENE, "no depth is known"),
        (-SCENE, "negative"),
        (unknown(SCENE, 0.1, -1.0), "negative"),
    ],
)
@pytest.mark.parametrize("shape", [(48, 64), (48 * 64,)])
def test_implausible_depth_is_said(depth, message, shape):
    with pytest.warns(ImplausibleDepthWarning, match=message):
        check_depth_z(depth.reshape(shape))
