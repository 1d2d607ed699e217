import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from flowlik.cli._options import Format
from flowlik.datasets import FORMATS, guess_format, open_sequence
from flowlik.datasets.base import PairSequence, frame_pairs
from flowlik.errors import DataError

from .fakes import make_chairs, make_kitti_flow, make_middlebury_flow, make_sintel, make_stereo, picture, save
from .test_euroc import make_euroc
from .test_image_folder import make_folder
from .test_rgbd import make_seven_scenes, make_tum

MAKERS = {
    "sintel": make_sintel,
    "kitti-flow": make_kitti_flow,
    "middlebury-flow": make_middlebury_flow,
    "middlebury-stereo": make_stereo,
    "flying-chairs": make_chairs,
    "seven-scenes": make_seven_scenes,
    "tum-rgbd": make_tum,
    "euroc": make_euroc,
    "image-folder": make_folder,
}


@pytest.mark.parametrize("name", MAKERS)
def test_every_layout_is_guessed_and_opened(tmp_path, name):
    folder = MAKERS[name](tmp_path)
    assert guess_format(folder) == name
    for sequence in (open_sequence(folder), open_sequence(str(folder), name)):
        assert sequence.name.startswith(f"{name}/")
        k = frame_pairs(sequence)[0]
        assert sequence.image(k).dtype == sequence.image(k + 1).dtype == np.uint8


def test_guessing_knows_all_formats(tmp_path):
    assert set(FORMATS) == {*MAKERS, "kitti", "kitti-raw", "tartanair", "video", "ros"}
    (tmp_path / "film.MP4").write_bytes(b"")
    assert guess_format(tmp_path / "film.MP4") == "video"
    (tmp_path / "notes.txt").write_text("hello")
    for path in (tmp_path / "notes.txt", tmp_path):
        with pytest.raises(DataError, match="not the folder of a known data set") as caught:
            guess_format(path)
        assert all(f"{name}: " in str(caught.value) for name in FORMATS)


@pytest.mark.parametrize("name", ["sintel", "kitti-flow", "middlebury-flow", "flying-chairs", "euroc"])
def test_formats_with_a_camera_of_their_own_or_none_take_none(tmp_path, name):
    folder = MAKERS[name](tmp_path)
    with pytest.raises(DataError, match="only seven-scenes, tum-rgbd, ros, video, image-folder take one"):
        open_sequence(folder, camera="50,20,15")
    with pytest.raises(DataError, match="only video, image-folder take one"):
        open_sequence(folder, frames_per_second=10)


@pytest.mark.parametrize("name", MAKERS)
def test_another_layout_is_one_error(tmp_path, name):
    save(tmp_path / "a/deep/i.png", picture(0))
    for path in (tmp_path, tmp_path / "a/deep/i.png", tmp_path / "none"):
        with pytest.raises(DataError, match=str(path)):
            open_sequence(path, name)


def test_help_and_documentation_name_every_format():
    documented = (Path(__file__).parents[2] / "docs/datasets.md").read_text()
    for name in FORMATS:
        assert f"`{name}`" in documented
        assert re.search(rf"[ ,]{name}[,. ]", get_args(Format)[1].help)


def test_pairs_of_any_length():
    class Frames:
        def __init__(self, n):
            self.n = n

        def __len__(self):
            return self.n

    class Pairs(PairSequence, Frames):
        pass

    assert [list(frame_pairs(Frames(n))) for n in range(4)] == [[], [], [0], [0, 1]]
    assert [list(frame_pairs(Pairs(n))) for n in (0, 2, 4)] == [[], [0], [0, 2]]
