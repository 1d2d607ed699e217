"""Pairs of images keep their own flow, whatever is missing, double or swapped; none is taken for another."""

import shutil

import numpy as np
import pytest

from flowlik.datasets import open_sequence, truth_doubts
from flowlik.errors import DataError
from tests.helpers import textured_image

from .fakes import make_chairs, make_kitti_flow, make_middlebury_flow, make_stereo, picture, save, write_pfm

LAYOUTS = {
    "kitti-flow": (make_kitti_flow, "image_2/000000_10.png", "image_2/000000_11.png"),
    "middlebury-flow": (make_middlebury_flow, "Army/frame10.png", "Army/frame11.png"),
    "middlebury-stereo": (make_stereo, "im0.png", "im1.png"),
    "flying-chairs": (make_chairs, "00001_img1.ppm", "00001_img2.ppm"),
}
"""Of each format the fake, and names of the first pair's images."""


@pytest.fixture(params=LAYOUTS)
def layout(request, tmp_path):
    """Format, folder, and the first pair's images."""
    make, *images = LAYOUTS[request.param]
    folder = make(tmp_path)
    return request.param, folder, [folder / name for name in images]


@pytest.mark.parametrize("which", [0, 1])
def test_an_image_in_two_formats_is_refused(layout, which):
    """Nothing tells which of them the flow is of."""
    name, folder, images = layout
    twin = images[which].with_suffix(".jpg")
    save(twin, picture(3))
    with pytest.raises(DataError, match="; keep one of them") as caught:
        open_sequence(folder, name)
    assert twin.name in str(caught.value)
    assert images[which].name in str(caught.value)


@pytest.mark.parametrize("which", [0, 1])
def test_an_image_without_its_partner_is_refused(layout, which):
    name, folder, images = layout
    images[which].unlink()
    if which == 0 and name == "middlebury-flow":  # a scene is known by its first image: the other is left
        assert len(open_sequence(folder, name)) == 2
        return
    with pytest.raises(DataError, match=r"the partner of|not both there|no stereo pair"):
        open_sequence(folder, name)


@pytest.mark.parametrize(
    ("name", "file"), [("kitti-flow", "image_2/000001_11.png"), ("flying-chairs", "00002_img2.ppm")]
)
def test_two_files_of_one_number_are_refused(tmp_path, name, file):
    folder = LAYOUTS[name][0](tmp_path)
    copy = folder / file.replace("0000", "0")
    shutil.copy(folder / file, copy)
    with pytest.raises(DataError, match=f"({copy.name}|{(folder / file).name}); keep one of them"):
        open_sequence(folder, name)


def test_chairs_of_three_images_or_without_flow_are_refused(tmp_path):
    folder = make_chairs(tmp_path)
    shutil.copy(folder / "00001_img1.ppm", folder / "00002_img0.ppm")
    with pytest.raises(DataError, match=r"three images \(00002_img0\.ppm, 00002_img1\.ppm, 00002_img2\.ppm"):
        open_sequence(folder)
    (folder / "00002_img0.ppm").unlink()
    (folder / "00002_flow.flo").unlink()
    with pytest.raises(DataError, match=r"00002_img1\.ppm: its flow 00002_flow\.flo is not there"):
        open_sequence(folder)


def test_a_gap_in_the_numbers_of_pairs_is_none(tmp_path):
    """Each pair is alone: what is left keeps its own flow."""
    folder = make_chairs(tmp_path)
    for end in ("img1.ppm", "img2.ppm", "flow.flo"):
        shutil.move(folder / f"00001_{end}", folder / f"00010_{end}")
    sequence = open_sequence(folder)
    np.testing.assert_array_equal(sequence.image(2), picture(10))
    np.testing.assert_array_equal(sequence.image(0), picture(20))


def test_kitti_flow_as_jpeg(tmp_path):
    folder = make_kitti_flow(tmp_path)
    expected = open_sequence(folder).flow(2)
    for path in (folder / "image_2").iterdir():
        path.rename(path.with_suffix(".jpg"))
    np.testing.assert_array_equal(open_sequence(folder).flow(2), expected)
    assert open_sequence(folder).visible(0).any()


def test_left_and_right_of_a_stereo_pair_swapped(tmp_path):
    left, right = (textured_image((120, 160), shift=(shift, 0)) for shift in (0, -4))
    folder = tmp_path / "scene"
    save(folder / "im0.png", left)
    save(folder / "im1.png", right)
    write_pfm(folder / "disp0.pfm", np.full(left.shape, 4.0))
    assert truth_doubts(open_sequence(folder)) == ()
    save(folder / "im0.png", right)
    save(folder / "im1.png", left)
    (doubt,) = truth_doubts(open_sequence(folder))
    assert "do not move as its true flow says: 8" in doubt
