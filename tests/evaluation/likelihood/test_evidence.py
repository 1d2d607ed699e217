import numpy as np
import pytest
from scipy.integrate import trapezoid

from flowlik.calibration import ErrorSketch
from flowlik.evaluation.likelihood import _evidence as evidence
from flowlik.evaluation.likelihood._goodness import Counting
from flowlik.likelihood.families import LaplaceCauchy
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index, Schedule
from tests.helpers import KNOTS, lcm_likelihood

MODEL = lcm_likelihood(method={"name": "synthetic"})
BLOCKS, PER_BLOCK = 6, 40_000


def draw(seed: int, n: int = PER_BLOCK, widen: float = 1.0):
    """Textures and errors of the model itself, or wider ones."""
    rng = np.random.default_rng(seed)
    texture = np.exp(rng.uniform(KNOTS[0], KNOTS[-1], n))
    return texture, widen * MODEL.sample(np.log(texture), rng), rng


def block(seed: int, widen: float = 1.0) -> ErrorSketch:
    texture, z, rng = draw(seed, widen=widen)
    return ErrorSketch.of(Index(), {"texture": texture}, z, np.ones(len(z)), rng, {"no truth": 3, "lost": 0})


@pytest.fixture(scope="module")
def blocks():
    return [block(seed) for seed in range(BLOCKS)]


@pytest.fixture(scope="module")
def sketch(blocks):
    return evidence.merge_all(blocks)


def records_of(blocks, counting=Counting(1000, 2), **keys):
    found = evidence.goodness_records(blocks, MODEL, "drawn", 5, counting, **keys)
    return {record.metric: record for record in found}


def test_errors_of_the_model_itself_are_judged_good(blocks):
    records = records_of(blocks, split="test")
    x, z = (np.concatenate(a) for a in zip(*[(np.log(t), z) for t, z, _ in map(draw, range(BLOCKS))]))
    assert records["nll"].value == pytest.approx(-MODEL.log_prob(z, x).mean(), abs=0.01)
    assert records["ks_median"].value < 0.02 and records["ks_max"].value < 0.05
    for level in (50, 68, 90, 95, 99):
        assert records[f"coverage_{level}"].value == pytest.approx(level / 100, abs=0.005)
    assert records["outside_fraction"].value < 0.02
    for record in records.values():
        assert (record.dataset, record.flow, record.family) == ("drawn", "synthetic", "lcm")
        assert (record.schedule, record.seed, record.count) == ("texture", 5, BLOCKS * PER_BLOCK)
        assert record.protocol.startswith(f"split=test; frames={BLOCKS}; excluded={3 * BLOCKS} no truth")
    assert "levels=≥1000 components from ≥2 frames" in records["ks_median"].protocol
    low, high = (
        float(number)
        for number in records["nll"].protocol.split("interval_95=")[1].split(";")[0].split(" … ")
    )
    assert low < records["nll"].value < high


def test_errors_of_another_population_are_not(blocks):
    good, wide = records_of(blocks), records_of([block(seed, widen=3.0) for seed in range(2)])
    assert wide["ks_median"].value > 0.2
    assert wide["nll"].value > good["nll"].value + 0.3
    assert wide["coverage_90"].value < 0.8


def test_levels_with_too_little_are_not_counted(blocks, recwarn):
    records = records_of(blocks[:2], counting=Counting(10**9))
    assert records["ks_median"].value is None and records["ks_max"].value is None
    assert "counted=0 of" in records["ks_median"].protocol
    assert "interval_95=none" in records["ks_median"].protocol
    assert records["ks_weighted_mean"].value < 0.05
    assert not recwarn.list


def test_one_run_of_frames_has_no_interval(blocks):
    records = records_of(blocks[:1], counting=Counting(1000, 1))
    assert "interval_95=none" in records["nll"].protocol
    assert "interval_95=none" in records["ks_median"].protocol
    assert records["ks_median"].value < 0.05


@pytest.mark.parametrize(("pairs", "warned"), [(5, True), (19, True), (20, False)])
def test_little_data_are_told_with_counts(pairs, warned):
    """Each block is one image pair of 40 000 components at 36 texture levels."""
    data = evidence.merge_all([block(seed) for seed in range(pairs)])
    warning = evidence.little_data_warning(data, "drawn")
    assert (warning is not None) == warned
    if warning is not None:
        assert f"drawn: little data, {PER_BLOCK * pairs} error components from {pairs} image pairs" in warning
        assert "0 % in those of ≥10000 components from ≥20 frames and 0 %" in warning
        assert "≥100000 components from ≥30 frames" in warning


def test_blocks_without_errors_do_not_disturb(blocks):
    some, empty = blocks[:2], ErrorSketch.empty(Index())
    assert records_of([*some, empty])["nll"] == records_of(some)["nll"]


@pytest.mark.parametrize(("fraction", "warned"), [(0.0, False), (0.10, False), (0.101, True), (1.0, True)])
def test_warning_of_images_a_model_does_not_know(fraction, warned):
    message = evidence.outside_warning(fraction, "these images")
    assert (message is not None) is warned
    if warned:
        assert message.startswith(f"these images: {100 * fraction:.0f} % of the error components lie outside")


def test_arrays_of_error_over_texture(sketch):
    arrays = evidence.error_over_texture(sketch, MODEL)
    assert arrays["counts"].sum() == sketch.total
    shape = (len(arrays["texture_edges"]) - 1, len(arrays["error_edges"]) - 1)
    assert arrays["counts"].shape == shape
    assert (np.diff(arrays["texture_edges"]) > 0).all() and (np.diff(arrays["error_edges"]) > 0).all()
    # nine tenths of each column of the map lie below the bound drawn over it
    below, total = 0, 0
    for low, high, column in zip(arrays["texture_edges"], arrays["texture_edges"][1:], arrays["counts"]):
        bound = np.interp(np.sqrt(low * high), arrays["bound_texture"], arrays["bound_90"])
        below += np.interp(bound, arrays["error_edges"][1:], np.cumsum(column))
        total += column.sum()
    assert below / total == pytest.approx(0.9, abs=0.01)


def test_arrays_of_the_table(sketch):
    arrays = evidence.table_arrays(sketch, MODEL)
    np.testing.assert_allclose(arrays["knots"], np.exp(KNOTS))
    assert arrays["values"].shape == (len(KNOTS), len(arrays["names"])) == (len(KNOTS), len(arrays["units"]))
    assert arrays["counts"].sum() == sketch.total and str(arrays["coordinate"]) == "texture"
    resampled = MODEL.schedule.values + np.linspace(-1, 1, 41)[:, None, None]
    banded = evidence.table_arrays(sketch, MODEL, resampled)
    np.testing.assert_allclose(banded["high"] - arrays["values"], 0.95)
    np.testing.assert_allclose(arrays["values"] - banded["low"], 0.95)
    constant = FlowLikelihood(LaplaceCauchy(), Schedule.constant(np.array([0.9, 0.5, 0.6])))
    assert np.isfinite(evidence.table_arrays(sketch, constant)["knots"]).all()


def test_empirical_and_fitted_densities_agree_and_integrate_to_one(sketch):
    arrays = evidence.distributions(sketch, MODEL)
    assert len(arrays["level_edges"]) == len(evidence.SHOWN_LEVELS)
    for z, empirical, fitted in zip(arrays["z"], arrays["empirical"], arrays["fitted"]):
        assert (np.diff(z) > 0).all()
        for density in (empirical, fitted):
            assert trapezoid(density, z) == pytest.approx(1, abs=0.05)
        frequent = empirical > 0.05 * empirical.max()
        assert np.median(np.abs(fitted[frequent] / empirical[frequent] - 1)) < 0.1


def test_levels_without_data_are_not_shown():
    texture, z, rng = draw(0, n=20_000)
    few = texture <= 3
    sketch = ErrorSketch.of(Index(), {"texture": texture[few]}, z[few], np.ones(few.sum()), rng)
    np.testing.assert_array_equal(
        evidence.distributions(sketch, MODEL)["level_edges"], evidence.SHOWN_LEVELS[:1]
    )


def test_arrays_of_goodness_and_coverage(sketch):
    models = {"lcm": (sketch, MODEL), "again": (sketch, lcm_likelihood())}
    goodness = evidence.goodness(models, Counting(1000, 2))
    assert goodness["ks"].shape == (2, len(goodness["texture"]))
    np.testing.assert_array_equal(*goodness["ks"])
    assert goodness["counts"].sum() == sketch.total and (goodness["counts"] > 0).all()
    reliability = evidence.reliability(models)
    assert list(reliability["names"]) == ["lcm", "again"]
    assert (np.diff(reliability["nominal"]) > 0).all()
    np.testing.assert_allclose(reliability["observed"][0], reliability["nominal"], atol=0.01)
