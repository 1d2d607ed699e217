"""The bias that vectors of one fraction of a pixel share, held against plain loops."""

from dataclasses import replace

import numpy as np
import pytest

from flowlik.egomotion.covariance import SUBPIXEL_CELL_PX, subpixel_variability
from tests.helpers import make_scene, random_motion


@pytest.mark.parametrize(("method", "bias"), [("dis", 0.03), ("lucas-kanade", 0.01)])
@pytest.mark.parametrize("each", [1, 2])
def test_it_is_the_covariance_of_a_score_by_a_bias_a_cell(each, method, bias):
    rng = np.random.default_rng(each)
    scene = make_scene(random_motion(rng), rng, 40)
    # flow of a few whole pixels, so that several vectors share a cell
    flow = rng.uniform(0, 1.5, (40, 2))
    m = replace(scene.measurements, flow=flow, method={"name": method})
    angle = rng.uniform(0, np.pi, 40 * each)
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    J, information = rng.standard_normal((40 * each, 6)), rng.uniform(0, 5, 40 * each)
    expected = np.zeros((6, 6))
    cells = {tuple(np.floor(f / SUBPIXEL_CELL_PX)) for f in flow}
    assert 3 < len(cells) < 20
    for cell in cells:
        members = [i for i in range(40) if tuple(np.floor(flow[i] / SUBPIXEL_CELL_PX)) == cell]
        for axis in range(2):
            pull = sum(
                information[c] * directions[c, axis] * J[c]
                for i in members
                for c in range(each * i, each * i + each)
            )
            expected += bias**2 * np.outer(pull, pull)
    found = subpixel_variability(m, directions, J, information)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())
