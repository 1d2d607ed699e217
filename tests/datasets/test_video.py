import pickle
import subprocess
import sys

import cv2
import numpy as np
import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets.video import Video
from flowlik.errors import DataError, MissingFieldError
from flowlik.geometry.camera import Pinhole

from .fakes import picture

WIDTH, HEIGHT, FRAMES = 64, 48, 25


def frame(k: int) -> np.ndarray:
    """A picture whose mean tells its number."""
    return (picture(k, WIDTH, HEIGHT) // 8 + np.uint8(8 * k)).astype(np.uint8)


@pytest.fixture(params=[("avi", "MJPG"), ("mp4", "mp4v")], ids=["avi", "mp4"])
def video(tmp_path, request):
    suffix, code = request.param
    path = tmp_path / f"walk.{suffix}"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 20, (WIDTH, HEIGHT))
    if not writer.isOpened():
        pytest.skip(f"this OpenCV writes no {suffix}")
    for k in range(FRAMES):
        writer.write(cv2.cvtColor(frame(k), cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def test_frames_come_in_any_order(video):
    sequence = open_sequence(video, camera="50,32,24")
    assert (sequence.name, len(sequence)) == ("video/walk", FRAMES)
    assert sequence.camera == Pinhole(WIDTH, HEIGHT, 50, 50, 32, 24)
    assert sequence.timestamp(5) == pytest.approx(0.25)
    for k in [0, 1, 5, 4, 2, 24, 23, 3, 3, 10, 0]:
        image = sequence.image(k)
        assert (image.shape, image.dtype) == ((HEIGHT, WIDTH), np.uint8)
        assert image.mean() == pytest.approx(frame(k).mean(), abs=3)
    with pytest.raises(MissingFieldError, match="no true flow"):
        sequence.flow(0)


@pytest.mark.parametrize("k", [-1, FRAMES, FRAMES + 10])
def test_frames_outside(video, k):
    with pytest.raises(DataError, match=f"no frame {k}, there are {FRAMES} frames in .*walk"):
        Video(video).image(k)


def test_a_video_reaches_another_process(video):
    sequence = Video(video)
    expected = [sequence.image(k) for k in range(4)]
    again = pickle.loads(pickle.dumps(sequence))
    for k in (3, 0, 2):
        np.testing.assert_array_equal(again.image(k), expected[k])


def test_a_rate_may_be_given_and_a_camera_is_asked_for(video):
    sequence = open_sequence(video, frames_per_second=10)
    assert sequence.timestamp(5) == 0.5
    with pytest.raises(MissingFieldError, match="give one by --camera: f,cx,cy"):
        _ = sequence.camera
    with pytest.raises(DataError, match="frame rate 0"):
        Video(video, frames_per_second=0)


def test_truncated_videos_are_one_error(video):
    data = video.read_bytes()
    for share in (0, 0.01, 0.1, 0.5):
        video.write_bytes(data[: int(share * len(data))])
        with pytest.raises(DataError, match=rf"{video.name}: .*(not a readable video|can be decoded)"):
            len(Video(video))


def test_the_decoder_does_not_complain_beside_the_error(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"\0\0\0\x18ftypmp42" + bytes(100))
    code = f"from flowlik.datasets import open_sequence; open_sequence({str(tmp_path / 'a.mp4')!r})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "a.mp4: not a readable video" in run.stderr.splitlines()[-1]
    assert run.stderr.startswith("Traceback")


def test_other_files_are_no_video(tmp_path):
    (tmp_path / "a.mp4").write_text("hello " * 1000)
    with pytest.raises(DataError, match=r"a\.mp4: not a readable video"):
        open_sequence(tmp_path / "a.mp4")
    with pytest.raises(DataError, match="no such video file"):
        Video(tmp_path / "none.mp4")
    with pytest.raises(DataError, match="no such video file"):
        Video(tmp_path)
