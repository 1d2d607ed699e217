import numpy as np
import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets._image_folder import ImageFolder
from flowlik.datasets.base import frame_pairs
from flowlik.errors import DataError, MissingFieldError
from flowlik.geometry.camera import Pinhole

from .fakes import HEIGHT, WIDTH, picture, save


def make_folder(root):
    """Images 1, 2, 10 and 11, of which two are in colour; other files beside them."""
    for k, name in enumerate(["1.png", "2.JPG", "10.bmp", "11.png"]):
        save(root / "walk" / name, picture(k))
    (root / "walk/notes.txt").write_text("hello")
    (root / "walk/.hidden.png").write_text("no image")
    return root / "walk"


def test_images_in_the_order_of_their_numbers(tmp_path):
    sequence = open_sequence(make_folder(tmp_path), camera="50,20,15")
    assert (sequence.name, len(sequence), frame_pairs(sequence)) == ("image-folder/walk", 4, range(3))
    assert [path.name for path in sequence.files] == ["1.png", "2.JPG", "10.bmp", "11.png"]
    np.testing.assert_array_equal(sequence.image(2), picture(2))
    assert sequence.camera == Pinhole(WIDTH, HEIGHT, 50, 50, 20, 15)
    assert sequence.timestamp(3) == 10  # eight are missing before it
    with pytest.raises(MissingFieldError, match="no true flow"):
        sequence.flow(0)


@pytest.mark.parametrize(
    ("camera", "expected"),
    [
        ("50,20,15", (50, 50, 20, 15)),
        (" 50, 51 ,20,15", (50, 51, 20, 15)),
        ((50, 20, 15), (50, 50, 20, 15)),
        (np.array([50, 51, 20, 15.5]), (50, 51, 20, 15.5)),
        (Pinhole(WIDTH, HEIGHT, 1, 2, 3, 4), (1, 2, 3, 4)),
    ],
)
def test_a_camera_is_given_by_its_numbers(tmp_path, camera, expected):
    found = ImageFolder(make_folder(tmp_path), camera).camera
    assert found == Pinhole(WIDTH, HEIGHT, *expected)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ("50,20", "expected f,cx,cy or fx,fy,cx,cy"),
        ("", "expected f,cx,cy"),
        ("a,20,15", "'a' is not a finite number"),
        ("0,20,15", "impossible camera"),
        (Pinhole(WIDTH + 1, HEIGHT, 1, 1, 1, 1), "made for images of 41 x 30 pixels, these are 40 x 30"),
    ],
)
def test_bad_cameras(tmp_path, camera, message):
    with pytest.raises(DataError, match=message):
        ImageFolder(make_folder(tmp_path), camera)


def test_numbers_in_the_wrong_order_are_told(tmp_path):
    with pytest.raises(DataError, match=r"outside of the image.* pixels.*The order is f,cx,cy"):
        ImageFolder(make_folder(tmp_path), "900,20,900")


def test_without_a_camera_it_is_asked_for(tmp_path):
    sequence = open_sequence(make_folder(tmp_path))
    with pytest.raises(
        MissingFieldError, match=r"no camera .give one by --camera: f,cx,cy or fx,fy,cx,cy in pixels"
    ):
        _ = sequence.camera


def test_times_come_from_a_rate_or_a_file(tmp_path):
    folder = make_folder(tmp_path)
    timed = ImageFolder(folder, frames_per_second=20)
    assert (timed.timestamp(3), timed.times_source) == (0.5, "frame/20s")
    assert open_sequence(folder, frames_per_second=20).timestamp(3) == 0.5
    for rate in (0, -1, float("nan"), float("inf")):
        with pytest.raises(DataError, match="frame rate"):
            ImageFolder(folder, frames_per_second=rate)
    (folder / "times.txt").write_text("0\n0.1\n0.3\n0.6\n")
    timed = ImageFolder(folder)
    assert (timed.timestamp(3), timed.times_source) == (0.6, "times.txt")
    (folder / "times.txt").write_text("0\n0.1\n")
    with pytest.raises(DataError, match=r"times\.txt: 2 times for the 4 images .* 4 or 11 or 12"):
        ImageFolder(folder)


def test_bad_folders(tmp_path):
    folder = make_folder(tmp_path)
    save(folder / "11.png", picture(0, WIDTH, HEIGHT + 1))
    with pytest.raises(
        DataError, match=r"11\.png: 40 x 31 pixels, but the first image \(1\.png\) has 40 x 30"
    ):
        ImageFolder(folder).image(3)
    for name in ("11.png", "1.png"):
        (folder / name).write_bytes((folder / name).read_bytes()[:-9])
    with pytest.raises(DataError, match=r"1\.png: not a readable image"):
        ImageFolder(folder)
    with pytest.raises(DataError, match="no images"):
        ImageFolder(tmp_path)
    with pytest.raises(DataError, match="no such folder"):
        ImageFolder(tmp_path / "none")
