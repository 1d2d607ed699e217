import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flowlik.errors import DataError
from flowlik.results.records import FILE_KEYS, Record, protocol, read_records, select, write_records

text = st.text(max_size=10)
optional_text = st.none() | text
records = st.builds(
    Record,
    metric=text,
    value=st.none() | st.floats(),
    unit=text,
    dataset=optional_text,
    flow=optional_text,
    family=optional_text,
    schedule=optional_text,
    estimator=optional_text,
    count=st.none() | st.integers(0, 10**12),
    seed=st.none() | st.integers(0, 2**63),
    protocol=text,
)


@given(st.lists(records, max_size=5))
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read_back(tmp_path, rows):
    write_records(tmp_path / "metrics.json", rows)
    assert read_records(tmp_path / "metrics.json") == rows


def test_file_holds_the_agreed_keys_and_null_where_one_does_not_apply(tmp_path):
    write_records(tmp_path / "m.json", [Record("drift_percent", np.float32(0.5), "%", count=np.int64(3))])
    (row,) = json.loads((tmp_path / "m.json").read_text())
    assert tuple(row) == FILE_KEYS
    assert (row["value"], row["count"], row["seed"]) == (0.5, 3, None)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_not_finite_becomes_none_and_the_protocol_says_so(value):
    record = Record("nll", value, "nat", protocol="frames=3")
    assert record.value is None
    assert record.protocol == "frames=3; value=not-finite"


def test_protocol_text():
    assert protocol(metric="kitti", scale=None, frames=300, causal=True, gate=0.5) == (
        "metric=kitti; frames=300; causal=true; gate=0.5"
    )
    with pytest.raises(ValueError, match="gate"):
        protocol(gate="a;b")


def test_select_by_any_fields():
    rows = [Record("nll", 1.0, "nat", flow="a"), Record("nll", 2.0, "nat", flow="b"), Record("ks", 3.0, "")]
    assert select(rows, metric="nll", flow="b") == [rows[1]]
    assert select(rows, flow=None) == [rows[2]]
    assert select(rows) == rows
    with pytest.raises(ValueError, match="no field colour"):
        select(rows, colour="red")


GOOD = {**dict.fromkeys(FILE_KEYS), "metric": "nll", "unit": "nat", "protocol": ""}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"metric": "nll"}, "not a list"),
        ([3], "record 0: expected the keys"),
        ([GOOD, {"metric": "nll"}], "record 1: expected the keys"),
        ([{**GOOD, "colour": 1}], "expected the keys"),
        ([{**GOOD, "value": "1"}], "value must be"),
        ([{**GOOD, "value": True}], "value must be"),
        ([{**GOOD, "count": 1.5}], "count must be"),
        ([{**GOOD, "metric": None}], "metric must be"),
    ],
)
def test_what_are_no_records_is_a_data_error(tmp_path, content, message):
    (tmp_path / "m.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match=message):
        read_records(tmp_path / "m.json")
