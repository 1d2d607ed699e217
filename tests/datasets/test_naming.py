"""Images in the order of their names, whoever named them."""

from pathlib import Path

import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets._image_folder import ImageFolder
from flowlik.datasets.naming import in_order
from flowlik.errors import DataError

from .fakes import picture, save

ORDERS = {
    "numbers": ["1.png", "2.JPG", "10.bmp", "11.png"],
    "times as Python writes them": ["9.95.png", "12.0.png", "12.05.png", "12.1.png", "12.15.png", "12.2.png"],
    "epoch times": ["1305031102.175304.png", "1305031102.2.png", "1305031102.21.png", "1305031103.0.png"],
    "fixed decimals": ["t_0.00.png", "t_0.05.png", "t_0.10.png", "t_10.00.png"],
    "quarters": ["0.0.png", "0.25.png", "0.5.png", "0.75.png", "1.0.png"],
    "versions that count": ["v1.8.png", "v1.9.png", "v1.10.png", "v1.11.png"],
    "nanoseconds without their zeros": ["12.5000000.png", "12.50000000.png", "12.100000000.png", "13.5.png"],
    "whole and half": ["1.png", "1.5.png", "2.png"],
    "copies": ["IMG_20231115_170430.jpg", "IMG_20231115_170430 (1).jpg", "IMG_20231115_170430 (2).jpg",
               "IMG_20231115_170431.jpg", "IMG_20231115_170431 (1).jpg"],
    "a first one without a number": ["frame.png", "frame2.png", "frame10.png"],
    "dates": ["2023.11.9.png", "2023.11.10.png", "2023.12.1.png"],
}  # fmt: skip


@pytest.mark.parametrize("names", ORDERS.values(), ids=ORDERS)
def test_order_of_names(names):
    for shuffled in (names[::-1], sorted(names), names[1::2] + names[::2]):
        assert [path.name for path in in_order(Path(name) for name in shuffled)] == names


@pytest.mark.parametrize("twice", [("1.png", "1.jpg"), ("1.png", "01.png"), ("0.5.png", "0.50.bmp")])
def test_two_images_of_one_place_are_refused(twice):
    with pytest.raises(DataError, match=r"this is also .*; keep one of them"):
        in_order(Path(name) for name in (*twice, "0.05.png", "3.png"))


def make_every_second(root):
    for k in range(0, 8, 2):
        save(root / f"frame_{k}.png", picture(k))
    return root


@pytest.mark.parametrize(
    ("rows", "expected"),
    [([0, 1, 2.5, 3], [0, 1, 2.5, 3]), (range(10, 20), [10, 12, 14, 16]), (range(10, 17), [10, 12, 14, 16])],
    ids=["a row an image", "a row for every number and more", "a row for every number"],
)
def test_times_are_those_of_the_numbers(tmp_path, rows, expected):
    folder = make_every_second(tmp_path / "walk")
    (folder / "times.txt").write_text("".join(f"{t}\n" for t in rows))
    sequence = open_sequence(folder)
    assert [sequence.timestamp(k) for k in range(4)] == expected


def test_times_that_fit_neither_images_nor_numbers_are_refused(tmp_path):
    folder = make_every_second(tmp_path / "walk")
    for count in (3, 5, 6):
        (folder / "times.txt").write_text("".join(f"{t}\n" for t in range(count)))
        with pytest.raises(
            DataError, match=f"{count} times for the 4 images numbered 0 to 6, expected 4 or 7"
        ):
            ImageFolder(folder)
    save(folder / "last.png", picture(9))
    with pytest.raises(DataError, match=r"6 times for the 5 images$"):
        ImageFolder(folder)


def test_a_name_that_is_not_text_is_read_and_printable(tmp_path):
    folder = make_every_second(tmp_path / "plain").rename(tmp_path / "caf\udce9")
    sequence = open_sequence(folder)
    assert sequence.name == "image-folder/caf\\udce9"
    assert sequence.image(1).shape == picture(2).shape
