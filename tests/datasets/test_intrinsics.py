"""Cameras typed on the command line: what is no camera of these images is refused."""

import pytest

from flowlik.datasets import Lens
from flowlik.datasets.intrinsics import given_lens
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole

SHAPE = (720, 1280)


@pytest.mark.parametrize(
    ("camera", "expected"),
    [
        ("900,640,360", Lens(900, 900, 640, 360)),
        (" 900.5, 640.25, 360 ", Lens(900.5, 900.5, 640.25, 360)),
        ("900,910,640,360", Lens(900, 910, 640, 360)),
        ((900, 910, 640, 360), Lens(900, 910, 640, 360)),
        (Pinhole(1280, 720, 900, 910, 100, 360), Lens(900, 910, 100, 360, size=(1280, 720))),
    ],
)
def test_cameras(camera, expected):
    assert given_lens(camera, SHAPE) == expected


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ("900,5,640,360", "focal lengths 900 and 5 differ, .*decimals have a point, not a comma"),
        ("684,752,640,360", "focal lengths 684 and 752 differ"),  # 684.752
        ("900,640,5,360", "focal lengths 900 and 640 differ"),
        ("700,710,640,5", "far from the middle"),
        ("900,5,640,5,360", "5 numbers, expected f,cx,cy or fx,fy,cx,cy .*decimals have a point"),
        ("900,5,640,5,360,5", "6 numbers"),
        ("900,5;640,5;360,5", "'5;640' is not a finite number"),
        ("640,360,900", "outside of the image"),
        ("900,1280,720", "outside of the image"),
        ("450,320,180", "far from the middle of the image, these are 1280 x 720 pixels"),
        ("900,nan,360", "'nan' is not a finite number"),
        ("-900,640,360", "impossible camera"),
        ("camera.yaml", "no such file; expected f,cx,cy"),
        ("a,b/camera.yaml", "no such file; expected f,cx,cy"),
        ("900", "no such file; expected f,cx,cy"),
        ((1, 2), "2 numbers"),
    ],
)
def test_what_is_no_camera_of_these_images(camera, message):
    with pytest.raises(DataError, match=message) as caught:
        given_lens(camera, SHAPE)
    assert "\n" not in str(caught.value)


def test_a_file_may_have_any_name(tmp_path):
    """Commas, colons and no suffix: what is there as a file is one."""
    for name in ("1,2,3", "a:b", "camera"):
        (tmp_path / name).write_text("900 900 640 360\n")
        assert given_lens(str(tmp_path / name), SHAPE) == Lens(900, 900, 640, 360)
