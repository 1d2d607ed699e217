"""What is masked is not measured: neither found as corners, nor drawn, nor seen by a window."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from flowlik.calibration._pairs import calibration_pixels, pair_errors
from flowlik.datasets import Lens, open_sequence
from flowlik.datasets._lens_models import BrownConrady
from flowlik.datasets._masked import Masked
from flowlik.datasets.selection import Selection
from flowlik.datasets.undistorted import Undistorted
from flowlik.egomotion import ransac
from flowlik.errors import DataError
from flowlik.flow import DIS, Farneback, LucasKanade
from flowlik.image.texture import TextureDefinition
from flowlik.measurement.features import measure_features
from flowlik.odometry.keyframes import moving_frames
from flowlik.odometry.loop import run_odometry
from flowlik.odometry.odometry import Odometry
from tests.datasets import room
from tests.helpers import textured_image

SHAPE, MOVE = (120, 160), np.array([3.0, 1.0])
TEXTURE = TextureDefinition()
MIDDLE = LucasKanade(anchor="middle")  # vectors stand where they were measured
REACH = {"lucas-kanade": 10, "farneback": 9, "dis": 4}
METHODS = [MIDDLE, Farneback(), DIS()]


def usable_pixels() -> np.ndarray:
    """All but a hood below and a spot."""
    usable = np.ones(SHAPE, bool)
    usable[85:] = False
    usable[20:26, 70:80] = False
    return usable


def images(seed: int = 0, hood: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """A scene that moves by MOVE, and a hood of its own, which does not."""
    found = textured_image(SHAPE, seed), textured_image(SHAPE, seed, tuple(MOVE))
    for image in found:
        image[~usable_pixels()] = textured_image(SHAPE, hood)[~usable_pixels()]
    return found


def holds_only(usable: np.ndarray, pixels: np.ndarray, reach: int) -> bool:
    """Whether windows around all pixels, cut at the image's border, hold usable pixels only."""
    return all(
        usable[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1].all()
        for u, v in np.rint(pixels).astype(int)
    )


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_no_window_holds_what_is_masked(method):
    usable, reach = usable_pixels(), REACH[method.name]
    m = measure_features(*images(), method, TEXTURE, usable=usable)
    assert len(m) > 80
    assert holds_only(usable, m.pixels, reach)
    ends = m.pixels + m.flow
    inside = ((ends >= 0) & (ends <= [SHAPE[1] - 1, SHAPE[0] - 1])).all(axis=1)
    assert holds_only(usable, ends[inside], reach)
    everywhere = measure_features(*images(), method, TEXTURE)
    assert not holds_only(usable, everywhere.pixels, reach)


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_a_hood_that_does_not_move_is_not_measured(method):
    for usable, least, most in ((usable_pixels(), 0.0, 0.02), (None, 0.2, 1.0)):
        m = measure_features(*images(), method, TEXTURE, usable=usable)
        with_the_hood = np.linalg.norm(m.flow, axis=1) < 1
        assert least <= with_the_hood.mean() <= most


@pytest.mark.parametrize("method", METHODS[1:], ids=lambda m: m.name)
def test_texture_is_the_same_whatever_the_masked_pixels_show(method):
    usable = usable_pixels()
    first, second = (measure_features(*images(hood=hood), method, TEXTURE, usable=usable) for hood in (5, 6))
    at = [{tuple(p): t for p, t in zip(m.pixels, m.t)} for m in (first, second)]
    both = at[0].keys() & at[1].keys()
    assert len(both) > 0.9 * len(first)
    assert all((at[0][p] == at[1][p]).all() for p in both)


def test_errors_of_a_calibration_are_those_of_usable_pixels(tmp_path):
    made = room.flight()
    hood = made.images[0][150:]
    seen = [np.vstack([image[:150], hood]) for image in made.images]
    sequence = open_sequence(room.write_tartanair(tmp_path / "a", replace(made, images=seen)))
    usable = np.zeros(seen[0].shape, bool)
    usable[:150] = True
    for method in (MIDDLE, Farneback()):
        rng = np.random.default_rng(0)
        pixels = calibration_pixels(sequence.image(3), method, rng, 4000)
        masked, whole = (
            pair_errors(s, 3, method, pixels=pixels) for s in (Masked(sequence, usable), sequence)
        )
        assert holds_only(usable, masked.measurements.pixels, REACH[method.name])
        assert np.median(np.abs(masked.z)) < 0.05
        assert np.quantile(np.abs(masked.z), 0.9) < 0.5 < np.quantile(np.abs(whole.z), 0.9)


def through(image: np.ndarray, lens: Lens) -> np.ndarray:
    """What the lens shows of a pinhole camera's image."""
    v, u = np.mgrid[: image.shape[0], : image.shape[1]].astype(np.float64)
    at = lens.straighten(np.column_stack([u.ravel(), v.ravel()]), image.shape).astype(np.float32)
    columns, rows = at.T.reshape(2, *image.shape)
    return cv2.remap(image, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def test_the_black_border_of_an_undistorted_image_is_no_texture(tmp_path):
    """A lens that shows less than the pinhole camera: beyond it images are black to a border that stays."""
    camera, made = room.CAMERA, room.flight()
    lens = Lens(camera.fx, camera.fy, camera.cx, camera.cy, BrownConrady((0.3, 0.0, 0.0, 0.0)))
    seen = [through(image, lens) for image in made.images]
    whole = open_sequence(room.write_tartanair(tmp_path / "a", replace(made, images=seen)))
    sequence = Undistorted(whole, lens)
    valid = lens.valid(seen[0].shape)
    assert 0.02 < 1 - valid.mean() < 0.6
    found = {}
    for masked in (True, False):
        usable = sequence.mask(3) if masked else None
        m = measure_features(sequence.image(3), sequence.image(4), MIDDLE, TEXTURE, usable=usable)
        truth = made.flow(3)[tuple(np.rint(m.pixels).astype(int)[:, ::-1].T)]
        found[masked] = np.abs(m.errors(truth))
    assert np.mean(found[True] < 0.3) > 0.9
    assert np.mean(found[False] < 0.3) < 0.85


def hooded(tmp_path, rows: int):
    """A flight with a hood over the lower part of its images, and the mask of what it leaves."""
    made = room.flight()
    hood = made.images[0][rows:]
    seen = [np.vstack([image[:rows], hood]) for image in made.images]
    usable = np.zeros(seen[0].shape, bool)
    usable[:rows] = True
    return made, open_sequence(room.write_tartanair(tmp_path / "a", replace(made, images=seen))), usable


def test_an_odometry_looks_past_a_hood(tmp_path):
    made, sequence, usable = hooded(tmp_path, 90)
    errors = {}
    for masked in (True, False):
        odometry = Odometry(sequence.camera, LucasKanade(), ransac())
        seen = Masked(sequence, usable) if masked else sequence
        motions = list(run_odometry(seen, odometry, "depth"))
        true = [made.poses[k + 1].inv() * made.poses[k] for k in range(len(motions))]
        apart = [np.linalg.norm(m.T_k_prev.translation - T.translation) for m, T in zip(motions, true)]
        errors[masked] = np.median(apart)
    assert errors[True] < 0.01 < 0.05 < errors[False]


def test_an_odometry_step_by_step_takes_the_same_mask(tmp_path):
    _, sequence, usable = hooded(tmp_path, 90)
    by_loop, by_step = (Odometry(sequence.camera, LucasKanade(), ransac()) for _ in range(2))
    list(run_odometry(Masked(sequence, usable), by_loop, "depth", 4))
    for k in range(4):
        by_step.step(sequence.image(k), sequence.timestamp(k), sequence.depth(k), usable=usable)
    for a, b in zip(by_loop.poses, by_step.poses):
        np.testing.assert_array_equal(a.as_matrix(), b.as_matrix())


def test_parallax_is_that_of_the_scene(tmp_path):
    _, sequence, usable = hooded(tmp_path, 60)
    with pytest.raises(DataError, match="in no frame the image has moved"):
        moving_frames(Selection(sequence, range(14)), LucasKanade(), 1.0)
    kept = moving_frames(Selection(Masked(sequence, usable), range(14)), LucasKanade(), 1.0)
    assert len(kept) > 3
