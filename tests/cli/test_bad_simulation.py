"""Simulations that cannot be: exit code 2, one line, and nothing written."""

import pytest

from tests.cli.test_bad_input import refuse

POSE_FILES = {
    "KITTI_0": "# nothing\n",
    "KITTI_1": "1 0 0 0 0 2 0 0 0 0 1 0\n",
    "KITTI_2": "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1\n",
    "KITTI_3": "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 2.4 0 0 1 0\n",
}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("simulate", "moon"), "unknown world 'moon': known are driving, forest, forest-small, grid, planes"),
        (("simulate", "planes", "--trajectory", "spiral"), "unknown trajectory 'spiral': known are curve"),
        (("simulate", "planes", "--trajectory", "KITTI_2"), "poses.txt, line 2: 11 columns, but expected 12"),
        (("simulate", "planes", "--trajectory", "KITTI_1"), "poses.txt, line 1: not a rotation"),
        (("simulate", "planes", "--trajectory", "KITTI_0"), "poses.txt: empty"),
        (("simulate", "planes", "--trajectory", "KITTI_3"), "frame 1 at [0.  2.4 0. ] m is 0.10 m from a"),
        (("simulate", "planes", "--trajectory", "KITTI_3", "--start", "2"), "start 2 is beyond its 2 poses"),
        (("simulate", "planes", "--trajectory", "straight", "--frames", "2000"), "fly fewer frames"),
        (("simulate", "planes", "--width", "0"), "0"),
        (("simulate", "planes", "--fov", "180"), "180"),
        (("simulate", "planes", "--speed", "nan"), "nan"),
        (("simulate", "planes", "--fps", "0"), "impossible frame rate of 0.0 frames/s"),
        (("simulate", "planes", "--stereo-baseline", "0"), "baseline 0.0 m must be positive"),
        (("simulate", "planes", "--stereo-baseline", "40"), "outside the world"),
        (("simulate", "planes", "--traffic", "5"), "world 'planes' has no traffic, only 'driving' has"),
        (("simulate", "planes", "--imu", "xsens"), "unknown IMU 'xsens': known are ideal, adis16448"),
        (("simulate", "planes", "--spoof", "jump:onset_s=1,distance_m=3"), "spoofing is of a GPS, and there"),
    ],
    ids=lambda value: "-".join(value[1:]) if isinstance(value, tuple) else "",
)
def test_options_that_cannot_be(tmp_path, words, message):
    places = {}
    for name, content in POSE_FILES.items():
        places[name] = tmp_path / name / "poses.txt"
        places[name].parent.mkdir()
        places[name].write_text(content)
    out = tmp_path / "out"
    refuse(*(places.get(word, word) for word in words), out=out, message=message)
    assert not out.exists()
