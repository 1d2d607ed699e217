import struct

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flowlik.datasets import read_grey
from flowlik.datasets._images import decode_image
from flowlik.datasets._truncation import claimed_size
from flowlik.errors import DataError

from .fakes import claim_png, picture

SUFFIXES = ("png", "jpg", "pgm", "ppm", "bmp", "tiff", "webp", "gif")


def encoded(suffix: str) -> bytes:
    image = picture(0, 41, 30)
    if suffix in ("ppm", "gif"):
        image = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    found, data = cv2.imencode(f".{suffix}", image)
    assert found
    return data.tobytes()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_size_is_known_from_the_header(suffix):
    try:
        data = encoded(suffix)
    except cv2.error:
        pytest.skip(f"this OpenCV writes no {suffix}")
    assert claimed_size(data) == (41, 30)


@pytest.mark.parametrize("quality", [cv2.IMWRITE_WEBP_QUALITY])
@pytest.mark.parametrize("level", [50, 101])
def test_size_of_lossy_and_lossless_webp(quality, level):
    data = cv2.imencode(".webp", picture(0, 41, 30), [quality, level])[1].tobytes()
    assert claimed_size(data) == (41, 30)


def huge(suffix: str) -> bytes:
    """The same file with a header that claims 60000 x 60000 pixels."""
    data = encoded(suffix)
    side = 60_000
    if suffix == "png":
        return claim_png(side, side)
    if suffix == "jpg":
        return data.replace(struct.pack(">HH", 30, 41), struct.pack(">HH", side, side))
    if suffix in ("pgm", "ppm"):
        return data.replace(b"41 30", f"{side} {side}".encode())
    if suffix == "bmp":
        return data.replace(struct.pack("<ii", 41, 30), struct.pack("<ii", side, side))
    raise AssertionError


@pytest.mark.parametrize("suffix", ["png", "jpg", "pgm", "ppm", "bmp"])
def test_a_header_that_claims_a_huge_image_is_refused(tmp_path, suffix):
    path = tmp_path / f"i.{suffix}"
    path.write_bytes(huge(suffix))
    with pytest.raises(DataError, match=rf"i\.{suffix}: its header claims 60000 x 60000 pixels"):
        read_grey(path)


def test_a_png_that_cannot_hold_what_it_claims_is_not_whole(tmp_path):
    (tmp_path / "i.png").write_bytes(claim_png(10_000, 10_000))
    with pytest.raises(DataError, match=r"i\.png: not a readable image"):
        read_grey(tmp_path / "i.png")


def test_an_even_image_compresses_as_far_as_png_can(tmp_path):
    cv2.imwrite(str(tmp_path / "i.png"), np.zeros((4000, 4000), np.uint8), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    assert read_grey(tmp_path / "i.png").shape == (4000, 4000)


def test_a_huge_file_is_not_read(tmp_path):
    with (tmp_path / "i.png").open("wb") as file:
        file.truncate(2**30 + 1)
    with pytest.raises(DataError, match="more than 1024 MiB"):
        read_grey(tmp_path / "i.png")


@given(
    st.sampled_from(["png", "jpg", "pgm", "bmp", "tiff", "webp"]),
    st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255)), max_size=6),
    st.integers(0, 400),
)
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_headers_end_in_one_error_at_worst(tmp_path, suffix, changes, length):
    data = bytearray(encoded(suffix))
    for at, value in changes:
        data[at] = value
    path = tmp_path / f"i.{suffix}"
    path.write_bytes(data[: 2000 - length])
    try:
        assert decode_image(path, cv2.IMREAD_UNCHANGED).size <= 2**29
    except DataError as error:
        assert path.name in str(error)
