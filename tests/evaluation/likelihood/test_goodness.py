import numpy as np
import pytest
from scipy import stats

from flowlik.calibration import ErrorSketch
from flowlik.evaluation.likelihood import _goodness as goodness
from flowlik.evaluation.likelihood._goodness import Counting
from flowlik.likelihood.families import LaplaceCauchy
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index, Schedule
from tests.helpers import KNOTS, LCM_VALUES, lcm_likelihood
from tests.likelihood.test_likelihood import every_model

MODEL = lcm_likelihood()
WRONG = FlowLikelihood(LaplaceCauchy(), Schedule(Index(), KNOTS, LCM_VALUES[:, ::-1].copy()))


def sketch_of(x, z, sign=1.0) -> ErrorSketch:
    sign = np.broadcast_to(sign, z.shape)
    return ErrorSketch.of(Index(), {"texture": np.exp(x)}, z, sign, np.random.default_rng(0))


def draw(model, n=200_000, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.uniform(np.log(0.02), np.log(9e4), n)
    return x, model.sample(x, rng)


@every_model
def test_a_sketch_scores_as_raw_samples_do(model):
    x, z = draw(model)
    z = np.clip(z, -1000, 1000)
    sketch = sketch_of(x, z)
    assert goodness.negative_log_likelihood(sketch, model) == pytest.approx(
        -model.log_prob(z, x).mean(), abs=1e-3
    )
    for confidence in goodness.CONFIDENCES:
        inside = np.mean(np.abs(z) <= model.bound(x, confidence))
        assert goodness.coverage(sketch, model, confidence) == pytest.approx(inside, abs=1e-3)
        assert inside == pytest.approx(confidence, abs=4e-3)


@every_model
def test_samples_of_the_model_itself_differ_by_chance_only(model):
    ks = goodness.kolmogorov_smirnov(sketch_of(*draw(model)), model, Counting(1000, 1))
    assert ks.counted.sum() > 50
    # Kolmogorov's distribution: median 0.83, and 2.2 once in ten thousand
    scaled = (ks.statistic * np.sqrt(ks.counts))[ks.counted]
    assert 0.65 < np.median(scaled) < 1.0
    assert scaled.max() < 2.2
    assert ks.maximum == ks.statistic[ks.counted].max()
    assert ks.median == np.median(ks.statistic[ks.counted])
    assert ks.signed_median < 1.3 * ks.median


def test_a_wrong_model_is_far_off():
    ks = goodness.kolmogorov_smirnov(sketch_of(*draw(MODEL)), WRONG, Counting(1000, 1))
    assert ks.median > 0.2
    assert ks.maximum > 0.4
    filled = ks.counts > 0
    assert ks.weighted_mean == pytest.approx(np.average(ks.statistic[filled], weights=ks.counts[filled]))


def test_a_level_agrees_with_scipy():
    model = FlowLikelihood(LaplaceCauchy(), Schedule.constant(np.array([0.9, 0.5, 0.6])))
    other = FlowLikelihood(LaplaceCauchy(), Schedule.constant(np.array([0.85, 0.7, 0.6])))
    rng = np.random.default_rng(1)
    x = rng.uniform(np.log(1e-2), np.log(1e5), 100_000)
    z = model.sample(x, rng)
    ks = goodness.kolmogorov_smirnov(sketch_of(x, z), other, Counting(1, 1))
    level = np.floor((x / np.log(10) + 2) * 8).astype(int)
    for i in (0, 17, 55):
        chosen = z[level == i]
        expected = stats.kstest(
            np.abs(chosen), lambda b: other.family.magnitude_cdf(b, np.array([0.85, 0.7, 0.6]))
        )
        assert ks.counts[i] == len(chosen)
        # the largest difference may stand within a bin
        assert ks.statistic[i] == pytest.approx(expected.statistic, abs=4e-3)
        signed = stats.kstest(chosen, lambda v: other.cdf(v, 0.0))
        assert ks.signed[i] == pytest.approx(signed.statistic, abs=5e-3)
        assert ks.texture[i] == pytest.approx(10 ** (-2 + (i + 0.5) / 8))


def test_only_the_signed_statistic_sees_a_bias_of_sign():
    x, z = draw(MODEL)
    biased = np.where(np.random.default_rng(3).random(len(z)) < 0.8, -np.abs(z), np.abs(z))
    even, uneven = (
        goodness.kolmogorov_smirnov(sketch_of(x, e), MODEL, Counting(1000, 1)) for e in (z, biased)
    )
    np.testing.assert_allclose(uneven.statistic, even.statistic)
    assert even.signed_median < 0.03
    assert uneven.signed_median == pytest.approx(0.3, abs=0.02)


def test_errors_beyond_the_outermost_bin_are_no_misfit():
    broad = FlowLikelihood(LaplaceCauchy(), Schedule.constant(np.array([0.5, 200.0, 0.01])))
    x, z = draw(broad)
    assert np.mean(np.abs(z) > 1024) > 0.1
    ks = goodness.kolmogorov_smirnov(sketch_of(x, z), broad, Counting(1000, 1))
    scaled = np.maximum(ks.statistic, ks.signed)[ks.counted] * np.sqrt(ks.counts[ks.counted])
    assert scaled.max() < 2.2


def test_the_sign_of_the_flow_decides_what_falls_short():
    x, z = draw(MODEL, 50_000)
    flipped = goodness.kolmogorov_smirnov(sketch_of(x, -np.abs(z), sign=-1.0), MODEL, Counting(100, 1))
    straight = goodness.kolmogorov_smirnov(sketch_of(x, np.abs(z)), MODEL, Counting(100, 1))
    np.testing.assert_array_equal(flipped.signed, straight.signed)


def test_levels_with_too_little_are_shown_but_not_counted():
    rng = np.random.default_rng(0)
    parts = []
    for _ in range(3):  # three image pairs; high texture in the first alone
        x = rng.uniform(0, 2, 5000) if parts else rng.uniform(0, 9, 20_000)
        parts.append(sketch_of(x, MODEL.sample(x, rng)))
    sketch = parts[0].merge(parts[1]).merge(parts[2])
    few = goodness.kolmogorov_smirnov(sketch, MODEL, Counting(500, 3))
    assert 0 < few.counted.sum() < (few.counts > 0).sum()
    assert (few.texture[few.counted] < np.exp(2.3)).all()
    assert few.counted_share == few.counts[few.counted].sum() / sketch.total
    assert np.isfinite(few.statistic[few.counts > 0]).all()
    assert np.isnan(few.statistic[few.counts == 0]).all()
    none = goodness.kolmogorov_smirnov(sketch, MODEL)
    assert np.isnan([none.median, none.maximum, none.signed_median]).all()
    assert none.counted_share == 0


def test_the_share_outside_the_calibrated_range_is_told():
    x = np.concatenate([np.full(30, KNOTS[0] - 0.5), np.full(50, 2.0), np.full(20, KNOTS[-1] + 0.5)])
    assert goodness.outside_range(sketch_of(x, np.ones(100)), MODEL) == 0.5


def test_an_interval_over_blocks_covers_the_truth_and_narrows():
    def interval(count):
        blocks = [sketch_of(*draw(MODEL, 400, seed)) for seed in range(count)]
        return goodness.block_interval(
            blocks, lambda s: goodness.coverage(s, MODEL, 0.9), np.random.default_rng(0), replicates=60
        )

    (low_few, high_few), (low, high) = interval(5), interval(60)
    assert low < 0.9 < high
    assert high - low < high_few - low_few
    # the width of a binomial interval over 24 000 components
    assert high - low == pytest.approx(2 * 1.96 * np.sqrt(0.09 / 24_000), rel=0.4)


def test_the_floor_is_the_two_sample_statistic():
    (x, z), (y, w) = draw(MODEL, 60_000), draw(MODEL, 60_000, 1)
    w = 1.2 * w + 0.05
    floor = goodness.held_out_floor(sketch_of(x, z), sketch_of(y, w), Counting(500, 1))
    level, other = (np.floor((a / np.log(10) + 2) * 8).astype(int) for a in (x, y))
    for i in (5, 20, 50):
        a, b = z[level == i], w[other == i]
        assert floor.statistic[i] == pytest.approx(stats.ks_2samp(np.abs(a), np.abs(b)).statistic, abs=0.01)
        assert floor.signed[i] == pytest.approx(stats.ks_2samp(a, b).statistic, abs=0.01)
        assert floor.counts[i] == min(len(a), len(b))
    assert floor.median == np.median(floor.statistic[floor.counted])
    same = goodness.held_out_floor(sketch_of(x, z), sketch_of(x, z), Counting(500, 1))
    assert same.maximum == 0


def test_the_bound_of_a_level_holds_its_share_of_all_errors():
    x, z = draw(MODEL)
    bounds = goodness.level_bound(sketch_of(x, z), MODEL, 0.9)
    level = np.floor((x / np.log(10) + 2) * 8).astype(int)
    for i in (5, 30, 50):
        assert np.mean(np.abs(z[level == i]) <= bounds[i]) == pytest.approx(0.9, abs=0.02)
