from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from flowlik.errors import DataError
from flowlik.flow import Farneback, describe
from flowlik.flow.base import DenseFlow
from flowlik.image.texture import TextureDefinition, eigenbasis, structure_tensor
from flowlik.measurement.measurements import attach_texture, measure, stratified_pixels
from tests.helpers import textured_image

SHAPE = (60, 90)
IMAGE = textured_image(SHAPE)


@dataclass(frozen=True)
class KnownFlow(DenseFlow):
    """Flow (u / 10, v / 10) at pixel (u, v), unknown in the first rows."""

    name: ClassVar[str] = "known"
    unknown_rows: int = 0

    def dense(self, previous, current):
        v, u = np.indices(previous.shape)
        flow = np.stack([u, v], axis=-1).astype(np.float32) / 10
        flow[: self.unknown_rows] = np.nan
        return flow


def test_errors_are_measured_less_true_first_along_the_larger_gradient():
    bars = np.repeat(np.arange(40, dtype=np.uint8)[:, None] * 3, 50, axis=1)  # changes along v only
    m = attach_texture(bars, np.array([[20.0, 15]]), np.array([[1.0, 2]]), Farneback())
    z = m.errors(np.array([[0.25, 0.0]]))
    sign = m.R_i_e[0, 1, 0]  # e1 = (0, sign), e2 = (-sign, 0)
    np.testing.assert_allclose(z, [[sign * 2, -sign * 0.75]], atol=1e-12)


def test_errors_in_the_image_basis_are_flow_less_truth():
    m = measure(IMAGE, textured_image(SHAPE, shift=(1.2, -0.7)), Farneback())
    z = m.errors(np.broadcast_to([1.2, -0.7], m.flow.shape))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", m.R_i_e, z), m.flow - [1.2, -0.7], atol=1e-12)
    assert np.median(np.abs(z)) < 0.1


@pytest.mark.parametrize("which", [np.array([5, 3, 3]), np.arange(40) % 3 == 0], ids=["index", "mask"])
def test_selection_keeps_all_fields_together(which):
    pixels = np.floor(np.random.default_rng(0).uniform([0, 0], [90, 60], (40, 2)))
    m = measure(IMAGE, IMAGE, KnownFlow(), pixels=pixels)
    part = m.select(which)
    again = measure(IMAGE, IMAGE, KnownFlow(), pixels=pixels[which])
    assert len(part) == len(again)
    for name in ("pixels", "flow", "R_i_e"):
        np.testing.assert_array_equal(getattr(part, name), getattr(again, name))
    np.testing.assert_array_equal(part.t, again.t)


def test_what_has_no_flow_is_left_out_and_counted():
    m = measure(IMAGE, IMAGE, KnownFlow(unknown_rows=7))
    assert m.lost == 7 * SHAPE[1]
    assert len(m) == IMAGE.size - m.lost
    np.testing.assert_allclose(m.flow, m.pixels / 10, rtol=1e-6)


def test_measurements_carry_texture_and_its_definition():
    definition = TextureDefinition(window=7)
    m = measure(IMAGE, IMAGE, KnownFlow(), definition, np.array([[10.0, 20], [33, 44]]))
    t, R_i_e = eigenbasis(structure_tensor(IMAGE, definition)[[20, 44], [10, 33]])
    np.testing.assert_allclose(m.t, t, rtol=1e-12)
    np.testing.assert_allclose(m.R_i_e, R_i_e, atol=1e-12)
    assert (m.texture, m.method) == (definition, describe(KnownFlow()))


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        ((IMAGE, IMAGE[:, :-1]), "differ in size: 90x60 and 89x60"),
        ((IMAGE, IMAGE.astype(float)), "grey uint8"),
        ((IMAGE[..., None], IMAGE), "grey uint8"),
    ],
)
def test_images_that_do_not_fit_are_refused(pair, message):
    with pytest.raises(DataError, match=message):
        measure(*pair, Farneback())


@pytest.mark.parametrize("pixels", [[[-1.0, 5]], [[5, 59.5]], [[np.nan, 5]], [[89.1, 0]]])
def test_pixels_outside_the_image_are_refused(pixels):
    with pytest.raises(DataError, match="inside the image"):
        measure(IMAGE, IMAGE, Farneback(), pixels=np.array(pixels))


def test_pixels_of_a_wrong_shape_are_refused():
    with pytest.raises(DataError, match=r"\(N, 2\)"):
        measure(IMAGE, IMAGE, Farneback(), pixels=np.zeros((4, 3)))


@pytest.mark.parametrize(("shape", "count"), [((480, 640), 4000), ((100, 333), 50), ((60, 90), 1200)])
def test_stratified_pixels_cover_the_image_evenly(shape, count):
    drawn = [stratified_pixels(shape, count, np.random.default_rng(seed)) for seed in range(20)]
    assert np.mean([len(pixels) for pixels in drawn]) == pytest.approx(count, rel=0.05)
    pixels = np.concatenate(drawn)
    np.testing.assert_array_equal(pixels, np.rint(pixels))
    assert pixels.min() >= 2
    assert (pixels <= [shape[1] - 3, shape[0] - 3]).all()
    # quarters of the inner image, borders included, hold a quarter each
    quarters = np.histogram2d(*pixels.T, bins=2, range=[(2, shape[1] - 2), (2, shape[0] - 2)])[0]
    np.testing.assert_allclose(quarters / len(pixels), 0.25, atol=0.03)


def test_one_stratified_pixel_lies_in_each_cell():
    pixels = stratified_pixels((104, 204), 200, np.random.default_rng(0))  # cells of 10 px
    cells = np.floor((pixels - 2) / 10)
    assert len(np.unique(cells, axis=0)) == len(pixels) == 200


@pytest.mark.parametrize(("shape", "count"), [((4, 100), 10), ((100, 100), 0)])
def test_pixels_that_cannot_be_placed_are_refused(shape, count):
    with pytest.raises(DataError, match="cannot place"):
        stratified_pixels(shape, count, np.random.default_rng(0))
