from dataclasses import replace

import numpy as np
import pytest

from flowlik.calibration.run import split_blocks
from flowlik.calibration.shared_errors import (
    POWERS,
    _field_errors,
    measured_pairs,
    spread_pairs,
    with_shared_errors,
)
from flowlik.datasets.base import PairSequence
from flowlik.errors import CalibrationError, ModelError
from flowlik.flow import LucasKanade, describe, flow_method
from flowlik.geometry.camera import Pinhole
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.families import Gaussian, LaplaceCauchy
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood, save_likelihood
from flowlik.likelihood.schedule import Schedule
from flowlik.likelihood.shared_errors import SharedErrors
from flowlik.measurement.measurements import Measurements
from flowlik.simulation import simulate

METHOD = LucasKanade()
KNOTS = np.log([1.0, 10000.0])
# sigma from 1 px at texture 1 to 0.02 px at 10 000
MODEL = FlowLikelihood(
    Gaussian(), Schedule(load_likelihood("lucas-kanade-lcm").schedule.index, KNOTS, np.array([[1.0, 0.02]])),
    method=describe(METHOD),
)  # fmt: skip


def vectors(rng: np.random.Generator, n: int = 600) -> Measurements:
    angle = rng.uniform(0, np.pi, n)
    R = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=-1).reshape(n, 2, 2)
    t = -np.sort(-np.exp(rng.uniform(*KNOTS, (n, 2))), axis=1)
    pixels = rng.uniform(0, [640, 360], (n, 2))
    return Measurements(pixels, np.ones((n, 2)), R, t, TextureDefinition(), describe(METHOD))


def power_of(shared: float, pairs: int = 60) -> float:
    """Emphasis with the least field error where a share of every error is one draw an image."""
    rng = np.random.default_rng(0)
    logs = []
    for _ in range(pairs):
        m = vectors(rng)
        x = MODEL.coordinate(m)
        sigma = 1 / np.sqrt(MODEL.fisher(x))
        together = np.einsum("nij,i->nj", m.R_i_e, rng.normal(size=2))
        z = sigma * (np.sqrt(1 - shared) * rng.normal(size=sigma.shape) + np.sqrt(shared) * together)
        logs.append(np.log(_field_errors(MODEL, m, z)))
    return float(POWERS[np.argmin(np.mean(logs, axis=0))])


def test_independent_errors_count_by_their_information():
    assert power_of(0.0) <= 0.1


def test_errors_shared_in_proportion_to_their_width_ask_for_a_power():
    assert power_of(0.05) >= 0.3


def test_field_errors_are_those_of_weighted_least_squares():
    """The plain product's, against numpy's least squares on whitened equations."""
    rng = np.random.default_rng(1)
    m = vectors(rng)
    sigma = 1 / np.sqrt(MODEL.fisher(MODEL.coordinate(m)))
    z = sigma * rng.normal(size=sigma.shape)
    rows, rhs = [], []
    for i in range(len(m)):
        for c in range(2):
            e = m.R_i_e[i, :, c] / sigma[i, c]
            rows.append(np.outer(e, [1.0, *m.pixels[i]]).ravel())
            rhs.append(z[i, c] / sigma[i, c])
    found = np.linalg.lstsq(np.array(rows), np.array(rhs), rcond=None)[0].reshape(2, 3)
    field = np.column_stack([np.ones(len(m)), m.pixels]) @ found.T
    expected = np.sqrt((field**2).sum(axis=1).mean())
    assert _field_errors(MODEL, m, z)[0] == pytest.approx(expected, rel=1e-2)


def test_a_calibrated_model_knows_what_errors_share_and_its_file_keeps_it(tmp_path):
    flight = simulate("planes", "training", 6, 6.0, 1, Pinhole.from_fov(160, 120, 90.0))
    blocks = spread_pairs(flight, 3, seed=1)
    assert [list(block.firsts) for block in blocks] == [[0], [2], [4]]
    pairs = measured_pairs(blocks, METHOD, MODEL.texture)
    assert [len(z) == len(m) <= 1200 for m, z in pairs] == 3 * [True]
    assert with_shared_errors(MODEL, pairs).shared_errors.composite_power == 0
    found = with_shared_errors(MODEL, 7 * pairs)
    assert found.shared_errors.composite_power in POWERS[1:]
    assert found.shared_errors.correlation is not None
    save_likelihood(found, tmp_path / "model.json")
    again = load_likelihood(tmp_path / "model.json")
    assert again.shared_errors.composite_power == found.shared_errors.composite_power
    x = np.linspace(*KNOTS, 5)
    np.testing.assert_allclose(again.composite_weight(x), found.composite_weight(x))


def test_isolated_pairs_are_not_mixed():
    class Pairs(PairSequence):
        def __len__(self):
            return 10

    assert [list(block.firsts) for block in spread_pairs(Pairs(), 3, seed=1)] == [[0], [4], [8]]
    assert [list(block.firsts) for block in spread_pairs(Pairs(), 60, seed=1)] == [[0], [2], [4], [6], [8]]


def test_the_papers_likelihood_keeps_its_product():
    flight = simulate("planes", "training", 3, 6.0, 1, Pinhole.from_fov(160, 120, 90.0))
    paper = load_likelihood("lucas-kanade-lcm")
    assert isinstance(paper.family, LaplaceCauchy)
    pairs = measured_pairs(split_blocks(flight, seed=1), flow_method(paper.method), paper.texture)
    assert with_shared_errors(paper, 20 * pairs).shared_errors.composite_power == 0.0


def test_a_composite_weight_is_a_power_of_the_information():
    model = replace(MODEL, shared_errors=SharedErrors(composite_power=0.5))
    x = np.linspace(*KNOTS, 7)
    f = MODEL.fisher(x)
    np.testing.assert_allclose(model.composite_weight(x), np.sqrt(f / f.max()), rtol=1e-12)
    np.testing.assert_array_equal(MODEL.composite_weight(x), 1.0)
    nodes = model.compiled.x
    weight = model.composite_weight(nodes)[:, None]
    np.testing.assert_allclose(model.composite.weight, weight * model.compiled.weight, rtol=1e-6)
    np.testing.assert_allclose(model.composite.log_prob, weight * model.compiled.log_prob, rtol=1e-6)


@pytest.mark.parametrize("power", [-0.1, 3.5, np.nan])
def test_a_composite_power_out_of_range_is_refused(power):
    with pytest.raises(ModelError, match="composite power"):
        SharedErrors(composite_power=power)


def test_without_pairs_there_is_nothing_to_measure():
    with pytest.raises(CalibrationError, match="no image pairs"):
        with_shared_errors(MODEL, [])
