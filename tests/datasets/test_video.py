import pickle
import struct
import subprocess
import sys

import cv2
import numpy as np
import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets._video import Video
from flowlik.datasets.base import notes_of
from flowlik.datasets.selection import select_frames
from flowlik.errors import DataError, MissingFieldError
from flowlik.geometry.camera import Pinhole

from .fakes import picture

WIDTH, HEIGHT, FRAMES = 64, 48, 25


def frame(k: int) -> np.ndarray:
    """A picture whose mean tells its number."""
    return (picture(k, WIDTH, HEIGHT) // 8 + np.uint8(8 * k)).astype(np.uint8)


def write_video(path, code):
    """Twenty frames a second."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 20, (WIDTH, HEIGHT))
    if not writer.isOpened():
        pytest.skip(f"this OpenCV writes no {path.suffix}")
    for k in range(FRAMES):
        writer.write(cv2.cvtColor(frame(k), cv2.COLOR_GRAY2BGR))
    writer.release()


@pytest.fixture(params=[("avi", "MJPG"), ("mp4", "mp4v")], ids=["avi", "mp4"])
def video(tmp_path, request):
    suffix, code = request.param
    path = tmp_path / f"walk.{suffix}"
    write_video(path, code)
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


def with_stamps(path, durations_ms, keep_edits=False):
    """Rewrite how long each frame of an mp4 that OpenCV wrote is shown: its table comes after the frames."""
    data = bytearray(path.read_bytes())
    if not keep_edits:
        data = data.replace(b"edts", b"free")
    at = data.index(b"stts") - 4
    old = int.from_bytes(data[at : at + 4], "big")
    rows = b"".join(struct.pack(">II", 1, ms) for ms in durations_ms)
    new = struct.pack(">I4sII", 16 + len(rows), b"stts", 0, len(durations_ms)) + rows
    for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
        start = data.index(name, data.index(b"moov")) - 4
        size = int.from_bytes(data[start : start + 4], "big")
        data[start : start + 4] = struct.pack(">I", size + len(new) - old)
    data[at : at + old] = new
    scale = data.index(b"mdhd") + 16
    data[scale : scale + 8] = struct.pack(">II", 1000, sum(durations_ms))
    path.write_bytes(data)


def test_times_are_the_containers_stamps(tmp_path):
    path = tmp_path / "phone.mp4"
    write_video(path, "mp4v")
    durations = [33, 34, 67, 1000] + [33] * (FRAMES - 4)
    with_stamps(path, durations)
    sequence = open_sequence(path)
    assert (len(sequence), sequence.times_source) == (FRAMES, "container")
    expected = np.concatenate([[0], np.cumsum(durations[:-1])]) / 1000
    assert [sequence.timestamp(k) for k in range(FRAMES)] == pytest.approx(list(expected), abs=1e-3)
    assert sequence.image(3).mean() == pytest.approx(frame(3).mean(), abs=3)
    with pytest.raises(DataError, match=f"no frame {FRAMES}"):
        sequence.timestamp(FRAMES)
    told = open_sequence(path, frames_per_second=20)
    assert (told.timestamp(4), told.times_source) == (0.2, "frame/20s")


def test_stamps_that_do_not_advance_are_refused_or_skipped(tmp_path):
    path = tmp_path / "phone.mp4"
    write_video(path, "mp4v")
    with_stamps(path, [33, 33, 0] + [33] * (FRAMES - 3))
    with pytest.raises(DataError, match=r"phone\.mp4, time stamps .*must increase, but number 2"):
        open_sequence(path).timestamp(0)
    chosen, skipped = select_frames(open_sequence(path, lenient=True), skip_bad=True)
    assert (len(chosen), [bad.frame for bad in skipped]) == (FRAMES - 1, [3])


def test_sound_that_is_longer_than_the_film_is_no_damage(tmp_path):
    path = tmp_path / "film.mkv"
    write_video(path, "mp4v")
    data = bytearray(path.read_bytes())
    at = data.index(b"\x44\x89\x88") + 3  # Matroska's duration is that of everything, sound too
    data[at : at + 8] = struct.pack(">d", 10 * struct.unpack(">d", data[at : at + 8])[0])
    path.write_bytes(data)
    sequence = open_sequence(path)
    assert cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT) > 5 * FRAMES
    assert len(sequence) == FRAMES
    assert sequence.timestamp(10) == pytest.approx(0.5, abs=1e-3)
    path.write_bytes(data[: int(0.7 * len(data))])
    with pytest.raises(DataError, match=r"film\.mkv: not a readable video .truncated"):
        open_sequence(path)


def test_a_film_that_ends_before_its_header_says_is_told(tmp_path):
    path = tmp_path / "phone.mp4"
    write_video(path, "mp4v")
    assert notes_of(open_sequence(path)) == ()
    with_stamps(path, [100] * FRAMES, keep_edits=True)  # its edit list shows the first 1.25 s
    sequence = open_sequence(path)
    assert len(sequence) == 13
    (note,) = notes_of(sequence)
    assert "its header claims 2.50 s, frames up to 1.20 s can be decoded" in note


def test_a_name_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "a.avi"
    write_video(path, "MJPG")
    path = path.rename(tmp_path / "caf\udce9.avi")
    with pytest.raises(DataError, match="a video's name must be UTF-8"):
        open_sequence(path)
