from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowlik.calibration import ErrorSketch, load_sketch, merge_all, save_sketch
from flowlik.calibration import sketch as bins
from flowlik.errors import CalibrationError, DataError
from flowlik.likelihood.schedule import TEXTURE_RANGE, Index, Input, Term
from flowlik.likelihood.tables import magnitude_nodes

INDEX = Index()


def samples(n: int, seed: int = 0):
    """Texture, errors and signs over and beyond the range of the bins."""
    rng = np.random.default_rng(seed)
    texture, z = 10 ** rng.uniform(-3, 6, n), 10 ** rng.uniform(-6, 4, n) * rng.choice([-1, 1], n)
    return {"texture": texture}, z, rng.choice([-1.0, 1.0], n)


def sketch(n: int, seed: int, excluded=None) -> ErrorSketch:
    return ErrorSketch.of(INDEX, *samples(n, seed), np.random.default_rng(seed), excluded)


def equal(a: ErrorSketch, b: ErrorSketch) -> bool:
    arrays = all(
        np.array_equal(getattr(a, f), getattr(b, f))
        for f in ("counts", "by_level", "errors", "frames", "keys", "rows")
    )
    fields = ("index", "pairs", "columns", "excluded")
    return arrays and all(getattr(a, f) == getattr(b, f) for f in fields)


def test_bins_are_as_fine_as_the_definitions_ask():
    edges, nodes = bins.x_edges(INDEX), magnitude_nodes()
    assert (edges[0], edges[-1]) == pytest.approx((np.log(1e-2), np.log(1e5)))
    assert len(edges) - 1 == 4 * bins.LEVELS
    np.testing.assert_allclose(bins.level_edges(), np.geomspace(1e-2, 1e5, 7 * 8 + 1))
    assert nodes[0] <= 1e-4
    assert nodes[-1] >= 1e3
    assert (nodes[1:] / nodes[:-1]).max() < 10 ** (1 / 20)


def test_counts_agree_with_a_histogram():
    covariates, z, sign = samples(50_000)
    found = ErrorSketch.of(INDEX, covariates, z, sign, np.random.default_rng(0))
    nodes = magnitude_nodes()
    x = np.clip(np.log(covariates["texture"]), *np.log([1e-2, 9.999e4]))
    magnitude = np.clip(np.abs(z).astype(np.float32), nodes[0], nodes[-1])
    for side, chosen in enumerate((z * sign < 0, z * sign >= 0)):
        expected, _, _ = np.histogram2d(x[chosen], magnitude[chosen], [bins.x_edges(INDEX), nodes])
        np.testing.assert_array_equal(found.counts[:, side], expected)
    assert found.total == 50_000
    np.testing.assert_array_equal(found.magnitude_counts, found.counts[:, 0] + found.counts[:, 1])
    # four bins of x make a level
    by_level = found.counts.reshape(bins.LEVELS, 4, 2, -1).sum(axis=1)
    np.testing.assert_array_equal(found.errors, by_level)
    np.testing.assert_array_equal(found.by_level.sum(axis=0), found.counts.sum(axis=(1, 2)))
    np.testing.assert_array_equal(found.by_level.sum(axis=1), by_level.sum(axis=(1, 2)))
    np.testing.assert_array_equal(found.frames, by_level.any(axis=(1, 2)))


@pytest.mark.parametrize(
    ("z", "sign", "side"),
    [(-2.0, 1.0, 0), (2.0, -1.0, 0), (2.0, 1.0, 1), (-2.0, -1.0, 1), (0.0, 1.0, 1), (0.0, -1.0, 1)],
)
def test_flow_that_falls_short_is_negative(z, sign, side):
    texture = {"texture": np.array([[10.0]])}
    found = ErrorSketch.of(INDEX, texture, np.array([[z]]), np.array([[sign]]), np.random.default_rng(0))
    assert found.counts[:, side].sum() == 1
    np.testing.assert_array_equal(found.rows, [[10.0, z * sign]])


@settings(max_examples=10, deadline=None)
@given(st.permutations(range(5)), st.integers(0, 4))
def test_merging_is_associative_and_commutative(order, split):
    # five times 9 000 rows overflow the reservoir of 20 000
    parts = [sketch(9_000, seed, {"no flow": seed, f"reason {seed % 2}": 1}) for seed in range(5)]
    expected = merge_all(parts)
    shuffled = [parts[i] for i in order]
    found = merge_all(shuffled[: split + 1])
    for part in [merge_all(shuffled[split + 1 :])] if split < 4 else []:
        found = found.merge(part)
    assert equal(found, expected)
    assert found.pairs == 5
    assert found.excluded == {"no flow": 10, "reason 0": 3, "reason 1": 2}


def test_the_reservoir_is_a_fair_bounded_choice_of_rows():
    parts = [sketch(n, seed) for seed, n in enumerate((30_000, 60_000))]
    merged = parts[0].merge(parts[1])
    assert len(merged.rows) == len(merged.keys) == bins.RESERVOIR_ROWS
    given = [(c["texture"], np.round(z * sign, 6)) for c, z, sign in (samples(30_000, 0), samples(60_000, 1))]
    truth = {row for rows in given for row in zip(*rows)}
    assert all(tuple(row) in truth for row in merged.rows)
    of_first = np.isin(merged.rows[:, 0], given[0][0]).mean()
    assert of_first == pytest.approx(1 / 3, abs=0.015)


@pytest.mark.parametrize("n", [0, 5, 25_000, 100_000])
def test_the_reservoir_holds_the_rows_of_smallest_keys(n):
    covariates, z, sign = samples(n)
    found = ErrorSketch.of(INDEX, covariates, z, sign, np.random.default_rng(5))
    keys = np.random.default_rng(5).random(n)
    order = np.argsort(keys)[: bins.RESERVOIR_ROWS]
    np.testing.assert_array_equal(found.keys, keys[order])
    np.testing.assert_array_equal(
        found.rows, np.stack([covariates["texture"], np.round(z * sign, 6)], axis=1)[order]
    )
    # keys that are all alike large, as no generator gives them
    np.testing.assert_array_equal(bins._smallest(1 + keys), order)


TWO = Index(
    (Input("texture", 1e-2, 1e4), Input("discrepancy", 1e-3, 1e2)),
    (Term(("texture",), -0.5), Term(("discrepancy",), 0.3), Term(("texture", "discrepancy"), 0.02)),
    offset=0.7,
    low=-9.0,
    high=7.0,
)


def test_the_reservoir_keeps_every_covariate_it_is_given():
    index = TWO
    covariates = {"texture": np.arange(1.0, 7).reshape(3, 2), "discrepancy": np.arange(6.0).reshape(3, 2)}
    z = 10 * np.arange(6.0).reshape(3, 2)
    found = ErrorSketch.of(index, covariates, z, np.ones((3, 2)), np.random.default_rng(0))
    rows = found.rows[np.argsort(found.rows[:, 0])]
    np.testing.assert_array_equal(
        rows, np.stack([np.arange(1.0, 7), np.arange(6.0), 10 * np.arange(6.0)], axis=1)
    )


def test_sketches_over_different_indices_do_not_merge():
    with pytest.raises(CalibrationError, match="different indices"):
        sketch(10, 0).merge(ErrorSketch.empty(TWO))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("where", ["z", "texture"])
def test_what_is_not_finite_is_not_sketched(bad, where):
    covariates, z, sign = samples(10)
    {"z": z, "texture": covariates["texture"]}[where][3] = bad
    with pytest.raises(CalibrationError, match="finite"):
        ErrorSketch.of(INDEX, covariates, z, sign, np.random.default_rng(0))


def test_a_saved_sketch_comes_back_as_it_was(tmp_path):
    before = sketch(30_000, 1, {"no truth": 7})
    save_sketch(before, tmp_path / "sketch.npz")
    assert equal(load_sketch(tmp_path / "sketch.npz"), before)


def test_a_damaged_file_is_a_data_error(tmp_path):
    path = tmp_path / "sketch.npz"
    save_sketch(sketch(300, 0), path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for trial in range(300):
        damaged = bytearray(whole)
        if trial % 2:
            damaged = damaged[: rng.integers(len(whole))]
        else:
            damaged[rng.integers(len(whole))] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        try:
            load_sketch(path)  # a flipped bit of the archive's bookkeeping may do no harm
        except DataError as error:
            refused += 1
            assert str(error).startswith(f"{path}: ")
            assert "\n" not in str(error)
    assert refused > 250


def test_files_that_are_no_sketch_are_data_errors(tmp_path):
    for name, save in (
        ("text.npz", lambda p: p.write_text("no sketch")),
        ("empty.npz", lambda p: p.touch()),
        ("array.npz", lambda p: np.save(p.open("wb"), np.zeros(3))),
        ("other.npz", lambda p: np.savez(p, counts=np.zeros(3))),
        ("list.npz", lambda p: np.savez(p, header="[1]")),
    ):
        save(tmp_path / name)
        with pytest.raises(DataError, match=f"{name}: not a flowlik sketch"):
            load_sketch(tmp_path / name)
    with pytest.raises(DataError, match="cannot read"):
        load_sketch(tmp_path / "none.npz")


def test_a_sketch_of_other_bins_is_a_data_error(tmp_path):
    before = sketch(100, 0)
    save_sketch(replace(before, counts=before.counts[:-1]), tmp_path / "s")
    with pytest.raises(DataError, match="other bins"):
        load_sketch(tmp_path / "s")


def test_a_learned_index_is_counted_over_its_own_range_and_over_texture():
    rng = np.random.default_rng(3)
    n = 40_000
    covariates = {"texture": 10 ** rng.uniform(-3, 6, n), "discrepancy": 10 ** rng.uniform(-4, 3, n)}
    covariates["discrepancy"][:100] = np.inf
    z = 10 ** rng.uniform(-4, 2, n) * rng.choice([-1, 1], n)
    found = ErrorSketch.of(TWO, covariates, z, np.ones(n), rng)
    x = np.clip(TWO.combine(covariates), TWO.low, TWO.high - 1e-9)
    level = np.clip((np.log(covariates["texture"]) - TEXTURE_RANGE[0]) / np.log(10) * 8, 0, bins.LEVELS - 1)
    expected, _, _ = np.histogram2d(level, x, [np.arange(bins.LEVELS + 1), bins.x_edges(TWO)])
    np.testing.assert_array_equal(found.by_level, expected)
    np.testing.assert_array_equal(found.errors.sum(axis=(0, 1)), found.magnitude_counts.sum(axis=0))
    assert found.columns == ("texture", "discrepancy")


def test_a_sketch_over_another_index_is_that_of_its_reservoir():
    rng = np.random.default_rng(4)
    n = 5_000
    covariates = {"texture": 10 ** rng.uniform(-2, 5, n), "discrepancy": 10 ** rng.uniform(-3, 2, n)}
    z, sign = np.round(rng.normal(size=n), 6), rng.choice([-1.0, 1.0], n)
    found = ErrorSketch.of(INDEX, covariates, z, sign, rng, {"no truth": 2}).over(TWO)
    direct = ErrorSketch.of(TWO, covariates, z, sign, rng, {"no truth": 2})
    for name in ("counts", "by_level", "errors", "frames"):
        np.testing.assert_array_equal(getattr(found, name), getattr(direct, name))
    assert (found.index, found.pairs, found.excluded) == (TWO, 1, {"no truth": 2})
