import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import ClassVar

import numpy as np
import pytest

from flowlik.calibration import Task, fit_likelihood, merge_all, pair_errors, sketch_blocks, split_blocks
from flowlik.calibration._pairs import calibration_pixels
from flowlik.errors import CalibrationError
from flowlik.flow import Farneback, LucasKanade, describe
from flowlik.flow.base import DenseFlow
from flowlik.geometry.camera import Pinhole
from flowlik.image.texture import TextureDefinition, structure_tensor
from flowlik.likelihood.families import FAMILIES
from flowlik.simulation import SimulatedSequence, simulate
from flowlik.support.versions import versions

METHODS = (Farneback(), LucasKanade())
TASKS = [Task(method) for method in METHODS]


@pytest.fixture(scope="module")
def sequence() -> SimulatedSequence:
    camera = Pinhole.from_fov(96, 64, 120.0)
    return simulate("planes", "training", frames=6, speed_mps=12.0, seed=1, camera=camera)


class Unknown:
    """A sequence whose truth is unknown in the left quarter."""

    def __init__(self, sequence):
        self.sequence, self.camera, self.name = sequence, sequence.camera, "unknown"

    def __len__(self):
        return len(self.sequence)

    def image(self, k):
        return self.sequence.image(k)

    def flow(self, k):
        flow = self.sequence.flow(k)
        flow[:, : flow.shape[1] // 4] = np.nan
        return flow


@dataclass(frozen=True)
class ConstantFlow(DenseFlow):
    """The same flow everywhere, and none in the first rows."""

    name: ClassVar[str] = "constant"
    u: float = 0.0
    v: float = 0.0
    lost_rows: int = 0

    def dense(self, previous, current):
        flow = np.full((*previous.shape, 2), (self.u, self.v), np.float32)
        flow[: self.lost_rows] = np.nan
        return flow


def test_errors_and_what_is_left_out_agree_with_numpy(sequence):
    data, method, k = Unknown(sequence), Farneback(), 2
    found = pair_errors(data, k, method)
    truth, measured = data.flow(k), method.dense(data.image(k), data.image(k + 1)).astype(float)
    height, width = truth.shape[:2]
    v, u = np.mgrid[0:height, 0:width]
    known = np.isfinite(truth[..., 0])
    end_u, end_v = u + truth[..., 0], v + truth[..., 1]
    with np.errstate(invalid="ignore"):
        stays = (end_u >= 0) & (end_u <= width - 1) & (end_v >= 0) & (end_v <= height - 1)
    kept = known & stays
    assert 0 < kept.sum() < known.sum() < known.size
    np.testing.assert_array_equal(found.measurements.pixels, np.stack([u[kept], v[kept]], axis=-1))
    assert found.excluded == {
        "no flow": 0, "no truth": (~known).sum(), "leaves the image": (known & ~stays).sum(),
    }  # fmt: skip

    # eigenvectors, smallest last, of the structure tensor by numpy
    S = structure_tensor(data.image(k))[kept]
    t, vectors = np.linalg.eigh(S[:, [[0, 1], [1, 2]]])
    t, vectors = t[:, ::-1], vectors[:, :, ::-1]
    np.testing.assert_allclose(found.measurements.t, t, rtol=1e-6, atol=1e-6)
    error = (measured - truth)[kept]
    along, z = (np.einsum("nij,ni->nj", vectors, a) for a in (measured[kept], error))
    distinct = t[:, 0] > 1.05 * t[:, 1]
    assert distinct.mean() > 0.9
    short = np.where(along < 0, -z, z)
    np.testing.assert_allclose((found.sign * found.z)[distinct], short[distinct], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found.z, axis=1), np.linalg.norm(error, axis=1), atol=1e-9)


def test_occluded_pixels_stay(sequence):
    found = pair_errors(sequence, 0, Farneback())
    column, row = found.measurements.pixels.astype(int).T
    assert (~sequence.visible(0)[row, column]).sum() > 0


@pytest.mark.parametrize("scale", [0.5, 1.5])
def test_flow_that_falls_short_has_negative_signed_errors(sequence, scale):
    class Scaled(Unknown):
        def flow(self, k):
            return np.full((*self.image(k).shape, 2), (2.0, -3.0))

    found = pair_errors(Scaled(sequence), 0, ConstantFlow(2.0 * scale, -3.0 * scale))
    signed = found.sign * found.z
    assert (signed <= 1e-9).all() if scale < 1 else (signed >= -1e-9).all()
    np.testing.assert_allclose(np.linalg.norm(found.z, axis=1), 0.5 * np.hypot(2, 3))


def test_lost_flow_and_given_pixels(sequence):
    found = pair_errors(sequence, 0, ConstantFlow(lost_rows=3))
    assert found.excluded["no flow"] == 3 * sequence.camera.width
    assert len(found.z) + sum(found.excluded.values()) == 96 * 64
    assert (found.sign == 1).all()  # no flow has no direction

    pixels = np.array([[40.0, 30.0], [50.0, 31.0]])
    some = pair_errors(sequence, 0, Farneback(), pixels=pixels)
    np.testing.assert_array_equal(some.measurements.pixels, pixels)


def test_a_sparse_method_is_calibrated_on_a_grid_and_its_corners(sequence):
    image, rng = sequence.image(0), np.random.default_rng(0)
    assert calibration_pixels(image, Farneback(), rng) is None
    pixels = calibration_pixels(image, LucasKanade(), rng)
    assert len(np.unique(pixels, axis=0)) == len(pixels)
    np.testing.assert_array_equal(pixels, np.rint(pixels))
    corners, _ = LucasKanade().measure(image, image)
    rows = set(map(tuple, pixels))
    assert all(tuple(corner) in rows for corner in corners)
    assert len(pixels) > 2 * len(corners)


@pytest.mark.parametrize(
    ("frames", "expected"), [(2, [(0, 2), (2, 4), (4, 5)]), (5, [(0, 5)]), (10, [(0, 5)])]
)
def test_blocks_cover_all_pairs_once(sequence, frames, expected):
    blocks = split_blocks(sequence, seed=7, frames=frames)
    assert [(block.firsts[0], block.firsts[-1] + 1) for block in blocks] == expected
    assert len({block.seed for block in blocks}) == len(blocks)


def reversed_map(function, *lists):
    results = [function(*items) for items in reversed(list(zip(*lists)))]
    return results[::-1]


def test_any_map_gives_the_same_counts(sequence):
    blocks = split_blocks(sequence, seed=3, frames=2)
    serial = list(sketch_blocks(blocks, TASKS))
    assert [[sketch.pairs for sketch in pair] for pair in serial] == [[2, 2], [2, 2], [1, 1]]
    assert pickle.loads(pickle.dumps(blocks[0])).firsts == range(2)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        parallel = list(sketch_blocks(blocks, TASKS, map=pool.map))
    backwards = list(sketch_blocks(blocks, TASKS, map=reversed_map))
    # a pickled pose may differ in its last bit, and so may the reservoir's errors
    for other, tolerance_px in ((backwards, 0.0), (parallel, 1e-9)):
        for mine, theirs in zip(serial, other):
            for a, b in zip(mine, theirs):
                assert_equal(a, b, tolerance_px)
    for i in range(len(METHODS)):
        column = [pair[i] for pair in serial]
        assert_equal(merge_all(column), merge_all(column[::-1]))


def assert_equal(a, b, tolerance_px=0.0):
    for name in ("counts", "by_level", "errors", "frames", "keys"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    np.testing.assert_allclose(a.rows, b.rows, rtol=0, atol=tolerance_px)
    assert (a.pairs, a.excluded) == (b.pairs, b.excluded)


def test_what_a_calibrated_model_tells_of_itself(sequence):
    method, texture = Farneback(), TextureDefinition(window=7)
    sketches = [s[0] for s in sketch_blocks(split_blocks(sequence, 0, 2), [Task(method, texture=texture)])]
    model = fit_likelihood(sketches, FAMILIES["gaussian"], method, texture, {"data": "planes", "seed": 0})
    assert (model.family.name, model.method, model.texture) == ("gaussian", describe(method), texture)
    record = model.provenance
    assert (record["data"], record["seed"], record["pairs"]) == ("planes", 0, 5)
    assert record["components"] == sum(s.total for s in sketches)
    assert record["excluded"] == merge_all(sketches).excluded
    assert record["components"] + 2 * sum(record["excluded"].values()) == 2 * 5 * 96 * 64
    assert record["versions"] == versions()
    assert model.goodness["fit"]["gradient"] < 1e-4


def test_nothing_to_calibrate_from(sequence):
    with pytest.raises(CalibrationError, match="no image pairs"):
        fit_likelihood([], FAMILIES["gaussian"], Farneback())
    few = sketch_blocks(split_blocks(sequence, 0), [Task(LucasKanade())], map=lambda f, *lists: [])
    assert list(few) == []
