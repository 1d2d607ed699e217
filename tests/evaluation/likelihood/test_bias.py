import numpy as np
import pytest

from flowlik.calibration import ErrorSketch
from flowlik.calibration.sketch import level_centres
from flowlik.evaluation.likelihood._bias import CAP_PX, LOW_TEXTURE, bias, bias_arrays, bias_records
from flowlik.likelihood.schedule import Index
from tests.evaluation.population import draw, sketch_of


def test_bias_is_that_of_raw_samples():
    values, z = draw()
    z = np.where(values["texture"] < LOW_TEXTURE, z - 0.5, z)
    found = {r.metric: r for r in bias_records(sketch_of(values, z), "drawn", "synthetic", 3, split="test")}
    low = values["texture"] < LOW_TEXTURE
    for suffix, e in (("", z), ("_low_texture", z[low])):
        assert found["negative_share" + suffix].value == pytest.approx(np.mean(e < 0), abs=1e-3)
        assert found["signed_median" + suffix].value == pytest.approx(np.median(e), abs=0.01)
        capped = np.clip(e, -CAP_PX, CAP_PX).mean()
        assert found["signed_mean" + suffix].value == pytest.approx(capped, abs=0.02)
        assert found["negative_share" + suffix].count == len(e)
    assert found["signed_mean"].unit == "px" and found["signed_mean"].protocol.startswith(
        "split=test; frames=1"
    )


def test_a_mirrored_population_has_the_mirrored_bias():
    values, z = draw(n=20_000)
    there, back = (bias(sketch_of(values, e).errors.sum(axis=0, keepdims=True)) for e in (z - 0.1, 0.1 - z))
    assert there.negative[0] == pytest.approx(1 - back.negative[0])
    assert there.median[0] == pytest.approx(-back.median[0])
    assert there.mean[0] == pytest.approx(-back.mean[0])


def test_levels_without_components_are_left_out(recwarn):
    values, z = draw(n=20_000)
    sketch = sketch_of(values, z)
    arrays = bias_arrays(sketch)
    assert len(arrays["texture"]) == (sketch.errors.sum(axis=(1, 2)) > 0).sum() < len(level_centres())
    assert all(np.isfinite(column).all() for column in arrays.values())
    empty = bias_records(ErrorSketch.empty(Index()), "none", None, None)
    assert all(r.value is None and "reason=no components" in r.protocol for r in empty)
    assert not recwarn.list
