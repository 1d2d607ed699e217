import json

import numpy as np
import pytest

from flowlik.errors import ModelError
from flowlik.likelihood.families import LaplaceCauchy
from flowlik.likelihood.schedule import (
    Index,
    Input,
    Schedule,
    Term,
    check_values,
    index_of_values,
    index_values,
)
from tests.helpers import KNOTS, LCM_VALUES, make_scene, random_motion

SCHEDULE = Schedule(Index(), KNOTS, LCM_VALUES)


def test_parameters_are_linear_between_knots_and_constant_beyond():
    np.testing.assert_allclose(SCHEDULE.theta(KNOTS), LCM_VALUES, rtol=1e-15)
    a, b = KNOTS[1:3]
    between = 0.25 * LCM_VALUES[:, 1] + 0.75 * LCM_VALUES[:, 2]
    np.testing.assert_allclose(SCHEDULE.theta(0.25 * a + 0.75 * b), between, rtol=1e-12)
    np.testing.assert_array_equal(SCHEDULE.theta(-50.0), LCM_VALUES[:, 0])
    np.testing.assert_array_equal(SCHEDULE.theta(50.0), LCM_VALUES[:, -1])
    assert SCHEDULE.theta(np.zeros((2, 5))).shape == (3, 2, 5)


def test_hats_are_the_weights_of_the_knots():
    x = np.random.default_rng(0).uniform(-5, 12, 200)
    hats = SCHEDULE.hats(x)
    np.testing.assert_allclose(LCM_VALUES @ hats, SCHEDULE.theta(x), rtol=1e-12)
    np.testing.assert_allclose(hats.sum(axis=0), 1, rtol=1e-12)


def test_a_constant_schedule_is_the_same_everywhere():
    schedule = Schedule.constant(np.array([0.5, 2.0]))
    np.testing.assert_array_equal(schedule.theta(np.array([-4.6, 0, 11.5])).T, [[0.5, 2.0]] * 3)


def test_the_papers_index_is_the_logarithm_of_texture_with_a_floor():
    t = np.array([[1e4, 3.0], [1e-2, 0.0]])
    np.testing.assert_allclose(Index().combine({"texture": t}), np.log([[1e4, 3.0], [1e-2, 1e-2]]))
    rng = np.random.default_rng(0)
    m = make_scene(random_motion(rng), rng, n=50).measurements
    np.testing.assert_allclose(Index().of(m), np.log(m.t), rtol=1e-12)
    assert Index().name == "texture"


def test_an_index_is_a_weighted_sum_of_logarithms_and_their_products():
    index = Index(
        (Input("texture", 1e-2, 1e4), Input("discrepancy", 0.1)),
        (Term(("texture",), 0.5), Term(("discrepancy",), -2.0), Term(("texture", "discrepancy"), 0.25)),
        offset=1.0,
    )
    covariates = {"texture": np.array([4.0, 9e9]), "discrepancy": np.array([0.0, 0.5]), "other": np.zeros(2)}
    a, b = np.log([4.0, 1e4]), np.log([0.1, 0.5])
    np.testing.assert_allclose(index.combine(covariates), 1 + 0.5 * a - 2 * b + 0.25 * a * b)
    assert (index.name, index.signals) == ("index", ("discrepancy",))
    assert index_of_values(json.loads(json.dumps(index_values(index)))) == index


def test_a_signal_that_was_not_measured_is_named():
    rng = np.random.default_rng(0)
    m = make_scene(random_motion(rng), rng, n=5).measurements
    with pytest.raises(ModelError, match="discrepancy"):
        Index((Input("discrepancy", 0.1),), (Term(("discrepancy",)),)).of(m)


@pytest.mark.parametrize(
    "change",
    [
        {"inputs": (Input("no such thing", 1.0),)},
        {"terms": (Term(("discrepancy",)),)},
        {"terms": ()},
        {"inputs": (Input("texture", 0.0),)},
        {"inputs": (Input("texture", 2.0, 1.0),)},
        {"inputs": (Input("texture", 1.0), Input("texture", 2.0))},
        {"low": 3.0, "high": 2.0},
        {"offset": np.nan},
    ],
)
def test_an_impossible_index_is_refused(change):
    with pytest.raises(ModelError):
        Index(**change)


def test_texture_along_a_normal_is_the_quadratic_form_of_the_tensor():
    rng = np.random.default_rng(1)
    m = make_scene(random_motion(rng), rng, n=50).measurements
    angle = rng.uniform(0, 2 * np.pi, 50)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    S = [R @ np.diag(t) @ R.T for R, t in zip(m.R_i_e, m.t)]
    expected = np.log([n @ s @ n for n, s in zip(normal, S)])
    np.testing.assert_allclose(Index().along(m, normal), expected, rtol=1e-12)
    np.testing.assert_allclose(Index().along(m, m.R_i_e[:, :, 1]), np.log(m.t[:, 1]))


def test_the_share_outside_the_outer_knots_is_told():
    x = np.array([KNOTS[0] - 1, KNOTS[0], 2.0, KNOTS[-1] + 0.1])
    assert SCHEDULE.outside(x) == 0.5
    assert SCHEDULE.outside(np.empty(0)) == 0


@pytest.mark.parametrize(
    ("knots", "values"),
    [
        ([0.0, 1, 1], np.ones((3, 3))),
        ([1.0, 0], np.ones((3, 2))),
        ([0.0], np.ones((3, 1))),
        ([0.0, 1], np.ones((3, 3))),
        ([0.0, 1], np.ones(2)),
        ([0.0, np.nan], np.ones((3, 2))),
        ([0.0, 1], np.array([[1.0, np.nan]])),
        ([0.0, 1], np.array([[1.0, np.inf]])),
    ],
)
def test_an_impossible_table_is_refused(knots, values):
    with pytest.raises(ModelError, match="table"):
        Schedule(Index(), np.array(knots), values)


@pytest.mark.parametrize(
    ("values", "message"),
    [(LCM_VALUES[:2], "3 parameters, the table 2"),
     (np.add(LCM_VALUES, [[0], [0], [1]]), "w_L leaves its bounds"),
     (LCM_VALUES * [[1], [-1], [1]], "gamma leaves its bounds")],
)  # fmt: skip
def test_a_table_must_fit_its_family(values, message):
    with pytest.raises(ModelError, match=message):
        check_values(LaplaceCauchy(), Schedule(Index(), KNOTS, values))
