"""Masks: a user's file, and that it follows the images through a lens, resizing and a selection."""

import cv2
import numpy as np
import pytest

from flowlik.datasets import mask_of, masked, open_sequence, resized, select_frames
from flowlik.datasets._mask_file import read_mask
from flowlik.datasets._masked import Masked
from flowlik.errors import DataError

from .fakes import HEIGHT, WIDTH, make_kitti_flow, picture, save
from .test_lens import FISHEYE, PINCUSHION, H, W, grid

HOOD = np.ones((H, W), bool)
HOOD[50:, 20:70] = False


@pytest.fixture
def folder(tmp_path):
    for k in range(3):
        save(tmp_path / f"images/{k}.png", picture(k, W, H))
    return tmp_path / "images"


def hood(path):
    return save(path, np.where(HOOD, np.uint8(255), np.uint8(0)))


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("a.png", lambda m: m),
        ("a.png", lambda m: cv2.cvtColor(m, cv2.COLOR_GRAY2BGR)),
        ("a.png", lambda m: m.astype(np.uint16) * 257),
        ("a.png", lambda m: np.dstack([m, m, m, np.full_like(m, 255)])),
        ("a.pgm", lambda m: m),
        ("a.tif", lambda m: m),
    ],
)
def test_any_black_and_white_image_is_a_mask(tmp_path, name, change):
    path = save(tmp_path / name, change(np.where(HOOD, np.uint8(255), np.uint8(0))))
    np.testing.assert_array_equal(read_mask(path, (H, W)), HOOD)


def test_jpegs_rim_is_not_held_against_it(tmp_path):
    found = read_mask(hood(tmp_path / "a.jpg"), (H, W))
    assert (found != HOOD).mean() < 0.02


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((H, W), np.uint8), "0.00% of the pixels are white, the largest value is 0"),
        (HOOD.astype(np.uint8), "0.00% of the pixels are white, the largest value is 1: a mask is white"),
        (np.full((H, W), 128, np.uint8), r"not black and white \(100% of the pixels are between"),
        (np.tile(np.arange(W, dtype=np.uint8) * 2, (H, 1)), "not black and white"),
        (np.full((H, W + 1), 255, np.uint8), "97 x 64 pixels, but the image has 96 x 64"),
    ],
)
def test_what_is_no_mask_is_refused(tmp_path, image, message):
    with pytest.raises(DataError, match=rf"mask\.png: {message}"):
        read_mask(save(tmp_path / "mask.png", image), (H, W))


def test_a_missing_or_damaged_mask(tmp_path):
    with pytest.raises(DataError, match="no such image file"):
        read_mask(tmp_path / "none.png", (H, W))
    (tmp_path / "a.png").write_bytes(hood(tmp_path / "b.png").read_bytes()[:60])
    with pytest.raises(DataError, match="not a readable image"):
        read_mask(tmp_path / "a.png", (H, W))


def test_a_sequence_without_mask_has_none(folder):
    sequence = open_sequence(folder)
    assert mask_of(sequence, 0) is None
    assert masked(sequence, None) is sequence
    assert mask_of(resized(sequence, "0.5"), 0) is None


def test_a_mask_is_that_of_every_frame(folder, tmp_path):
    sequence = masked(open_sequence(folder, camera="60,47.5,31.5"), hood(tmp_path / "hood.png"))
    for k in range(3):
        np.testing.assert_array_equal(mask_of(sequence, k), HOOD)
        np.testing.assert_array_equal(sequence.image(k), picture(k, W, H))
    assert sequence.camera.fx == 60
    chosen, _ = select_frames(sequence, 1)
    np.testing.assert_array_equal(mask_of(chosen, 1), HOOD)
    left = np.tile(np.where(np.arange(W) < 40, np.uint8(255), np.uint8(0)), (H, 1))
    again = masked(sequence, save(tmp_path / "left.png", left))
    np.testing.assert_array_equal(mask_of(again, 0), HOOD & (left > 0))


@pytest.mark.parametrize("lens", [PINCUSHION, FISHEYE], ids=["pincushion", "fisheye"])
def test_a_mask_goes_through_the_lens_with_the_images(folder, tmp_path, lens):
    """It is drawn over the images as they are: what is masked there is masked where the pinhole sees it."""
    plain = open_sequence(folder, camera=lens)
    sequence = masked(plain, hood(tmp_path / "hood.png"))
    assert sequence.camera == plain.camera
    np.testing.assert_array_equal(sequence.image(0), plain.image(0))
    usable, valid = mask_of(sequence, 0), mask_of(plain, 0)
    assert not (usable & ~valid).any()
    straight = lens.straighten(grid(), (H, W))
    at = np.rint(straight[~HOOD.ravel()])
    inside = np.isfinite(at).all(axis=1) & (at >= 0).all(axis=1) & (at <= (W - 1, H - 1)).all(axis=1)
    column, row = at[inside].astype(int).T
    assert len(row) > 100
    assert not usable[row, column].any()
    far = cv2.erode(HOOD.astype(np.uint8), np.ones((5, 5))).astype(bool)
    columns, rows = (np.rint(m).clip(0, side - 1).astype(int) for m, side in zip(lens.maps((H, W)), (W, H)))
    np.testing.assert_array_equal(usable[far[rows, columns]], valid[far[rows, columns]])


def test_a_mask_shrinks_with_the_images(folder, tmp_path):
    path = hood(tmp_path / "hood.png")
    for sequence in (resized(masked(open_sequence(folder), path), "0.5"),
                     masked(resized(open_sequence(folder), "0.5"), path)):  # fmt: skip
        found = mask_of(sequence, 0)
        assert found.shape == sequence.image(0).shape == (H // 2, W // 2)
        np.testing.assert_array_equal(found, HOOD[::2, ::2])
    third = mask_of(resized(masked(open_sequence(folder), path), "32x21"), 0)
    # a pixel with any masked one in its footprint of 3 x 3.05 is masked
    assert not third[16:, 6:24].any()
    assert third[:16].all()


def test_a_mask_of_another_size(folder, tmp_path):
    sequence = open_sequence(folder)
    with pytest.raises(DataError, match=r"40 x 30 pixels, but the image has 96 x 64"):
        masked(sequence, save(tmp_path / "small.png", np.full((HEIGHT, WIDTH), 255, np.uint8)))
    with pytest.raises(DataError, match="a mask of 40 x 30 pixels for images of 96 x 64"):
        Masked(sequence, np.ones((HEIGHT, WIDTH), bool))
    pairs = open_sequence(make_kitti_flow(tmp_path / "kitti"))
    white = masked(pairs, save(tmp_path / "white.png", np.full((HEIGHT, WIDTH), 255, np.uint8)))
    assert white.mask(0).all()
    with pytest.raises(DataError, match="frame 2: a mask of 40 x 30 pixels for images of 42 x 30"):
        white.mask(2)
