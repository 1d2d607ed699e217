import numpy as np
import pytest
from scipy import stats

from flowlik.evaluation.likelihood._pit import BINS, pit, pit_arrays
from tests.evaluation.population import MODEL, OVER_INDEX, draw, sketch_of


@pytest.mark.parametrize("model", [MODEL, OVER_INDEX], ids=["texture", "index"])
@pytest.mark.parametrize("widen", [1.0, 0.5, 3.0])
def test_a_sketch_tells_the_pit_of_raw_samples(model, widen):
    values, z = draw(model)
    z = widen * z + 0.02
    u = model.cdf(z, model.schedule.index.combine(values))
    found = pit(sketch_of(values, z, model.schedule.index), model)
    raw = np.histogram(u, BINS, (0, 1))[0] / len(u)
    np.testing.assert_allclose(found.shares, raw, atol=1.5e-3)
    assert found.shares.sum() == pytest.approx(1)
    assert found.ks == pytest.approx(stats.kstest(u, "uniform").statistic, abs=3e-3)
    assert found.deviation == pytest.approx(np.abs(BINS * raw - 1).max(), abs=0.03)


def test_the_pit_of_the_model_itself_is_flat():
    found = pit(sketch_of(*draw()), MODEL)
    assert found.deviation < 0.1 and found.ks < 0.01


def test_errors_that_fall_short_lie_to_the_left():
    values, z = draw()
    density = pit_arrays({"lcm": (sketch_of(values, -np.abs(z)), MODEL)})["density"][0]
    assert density[: BINS // 2] == pytest.approx(2, abs=0.2) and (density[BINS // 2 :] == 0).all()


def test_zeros_and_errors_beyond_the_bins_lie_in_the_middle_and_at_the_ends():
    values, _ = draw(n=1000)
    zero = pit(sketch_of(values, np.zeros(1000)), MODEL).shares
    far = pit(sketch_of(values, np.full(1000, -1e6)), MODEL).shares
    assert zero[BINS // 2] == pytest.approx(1) and far[0] == pytest.approx(1)
