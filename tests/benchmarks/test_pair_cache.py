import sys
from pathlib import Path

import numpy as np
import pytest

from flowlik.errors import DataError
from tests.helpers import lcm_likelihood, make_scene, random_motion

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from pair_cache import PairCache


def test_measurements_are_made_once_and_come_back_as_they_were(tmp_path):
    rng = np.random.default_rng(0)
    m = make_scene(random_motion(rng), rng, n=20, likelihood=lcm_likelihood()).measurements
    plan = {"method": m.method, "texture": m.texture.describe(), "seed": 1}
    made = []

    def make():
        made.append(1)
        return m

    for _ in range(2):
        found = PairCache(tmp_path / "05", plan).get(3, make)
        assert (found.texture, found.method, found.lost) == (m.texture, m.method, m.lost)
        for name in ("pixels", "flow", "R_i_e", "t"):
            np.testing.assert_array_equal(getattr(found, name), getattr(m, name))
        assert found.signals.keys() == m.signals.keys()
        for name, values in m.signals.items():
            np.testing.assert_array_equal(found.signals[name], values)
    assert len(made) == 1
    with pytest.raises(DataError, match="measurements of something else"):
        PairCache(tmp_path / "05", plan | {"seed": 2})
