from dataclasses import replace

import pytest

from flowlik.report._tables import format_value, tables
from flowlik.results.records import Record
from tests.report.fake_run import records


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.0, "0"),
        (0.02134, "0.02134"),
        (12.5, "12.5"),
        (1234567.0, "1\u202f234\u202f567"),
        (1e-7, "1e-07"),
        (-3.0, "-3"),
    ],
)
def test_values_are_printed_for_readers(value, text):
    assert format_value(value) == text


def test_every_record_stands_in_exactly_one_cell():
    many = [
        *records(),
        *(replace(r, seed=2) for r in records()),
        *(replace(r, protocol="align=x") for r in records()),
    ]
    cells = [cell for table in tables(many) for row in table.rows for cell in row.cells]
    assert sum(bool(cell.text) for cell in cells) == len(many)


def test_rows_are_what_was_measured_and_columns_the_metrics():
    fit, motion, *_ = tables(records())
    assert fit.title == "How well the error model fits"
    assert fit.keys == ("family",)
    assert fit.common == "dataset planes, flow Farnebäck, schedule texture, seed 1"
    assert [row.keys[-1] for row in fit.rows] == ["paper's", "log-logistic", "Gaussian"]
    assert [row.cells[0].text for row in fit.rows] == ["0.0213", "0.0521", "0.28"]
    assert [(c.label, c.unit) for c in motion.columns] == [("Drift", "%"), ("Median translation error", "m")]


def test_a_missing_value_says_why():
    fit = tables(records())[0]
    cell = fit.rows[0].cells[-1]
    assert cell.text == "–" and cell.hint == "no value: too few components"
    assert Record("x", float("nan"), "").reason == "no value: not-finite"
    assert Record("x", None, "").reason == "no value was recorded"


def test_protocols_are_listed_once_and_marked_where_they_differ():
    motion = tables(records())[1]
    assert motion.notes == ("align=none", "align=none; scale=depth")
    assert motion.columns[0].notes == (1,)
    assert [row.cells[1].notes for row in motion.rows] == [(2,), (1,)]


def test_equal_keys_of_another_protocol_get_their_own_row():
    first = Record("drift_percent", 1.0, "%", protocol="a=1")
    second = replace(first, value=2.0, protocol="a=2")
    other = replace(second, metric="t_err_percent", value=3.0)
    rows = tables([first, second, other])[0].rows
    assert [[c.text for c in row.cells] for row in rows] == [["1", ""], ["2", "3"]]


def test_a_metric_without_any_counted_level_says_why():
    empty = Record("ks_median", None, "", protocol="levels=≥100 components from ≥30 frames; counted=0 of 43")
    assert empty.reason == "no value: too little data, no texture level has ≥100 components from ≥30 frames"


def test_no_records_make_no_tables():
    assert tables([]) == []
