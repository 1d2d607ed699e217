"""YAML files about a body."""

import numpy as np
import pytest

from flowlik.datasets.initial_state import read_initial_state, read_turn_on
from flowlik.errors import DataError

GOOD = """T_n_b: [1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1]
velocity_n_mps: [0.5, 0, -1]
attitude_sd_rad: 0.01
velocity_sd_mps: [0.1, 0.2, 0.3]
position_sd_m: 1.5
"""


def write(tmp_path, text):
    path = tmp_path / "start.yaml"
    path.write_text(text)
    return path


def test_a_start_is_read(tmp_path):
    found = read_initial_state(write(tmp_path, GOOD))
    np.testing.assert_array_equal(found.T_n_b.translation, [1, 2, 3])
    np.testing.assert_array_equal(found.velocity_n_mps, [0.5, 0, -1])
    np.testing.assert_array_equal(found.deviations, [0.01] * 3 + [0.1, 0.2, 0.3] + [1.5] * 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD.replace("position_sd_m", "position_sd"), "position_sd_m is missing"),
        (GOOD.replace("0.01", "0"), "attitude_sd_rad must be above 0"),
        (GOOD.replace("0.01", "small"), "attitude_sd_rad is 'small', not a finite number"),
        (GOOD.replace("[0.5, 0, -1]", "[0.5, 0]"), "velocity_n_mps has 2 numbers, expected 3"),
        (GOOD.replace("[1, 0, 0, 1", "[2, 0, 0, 1"), "T_n_b"),
    ],
)
def test_a_bad_start_is_one_line(tmp_path, text, message):
    with pytest.raises(DataError, match=message):
        read_initial_state(write(tmp_path, text))


def test_turn_on_deviations_have_no_default(tmp_path):
    both = "gyroscope_turn_on_sd: 0.01\naccelerometer_turn_on_sd: 0.2\n"
    assert read_turn_on(write(tmp_path, both)) == (0.01, 0.2)
    with pytest.raises(DataError, match="accelerometer_turn_on_sd is missing"):
        read_turn_on(write(tmp_path, both.partition("\n")[0]))
    with pytest.raises(DataError, match="gyroscope_turn_on_sd must be above 0"):
        read_turn_on(write(tmp_path, both.replace("0.01", "0")))
