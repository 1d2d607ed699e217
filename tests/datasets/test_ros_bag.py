"""Images of bags: their order and times, 16 bits, and depth."""

import numpy as np
import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets.base import notes_of
from flowlik.datasets.selection import select_frames
from flowlik.errors import DataError, MissingFieldError

from .ros_bags import Message, make_bag

H, W, N = 24, 32, 8
TIMES = 100 + 0.1 * np.arange(N)


def grey(k, dtype=np.uint8):
    return np.random.default_rng(k).integers(0, 256, (H, W)).astype(dtype)


RECEIVED = 100 + TIMES


def images(stamps, received=RECEIVED):
    return [Message(t, r, "mono8", grey(k)) for k, (t, r) in enumerate(zip(stamps, received))]


def order_of(sequence):
    """Which of the images written each frame is."""
    return [next(k for k in range(N) if (sequence.image(i) == grey(k)).all()) for i in range(len(sequence))]


def times_of(sequence):
    return np.array([sequence.timestamp(k) for k in range(len(sequence))])


def test_times_are_those_of_the_headers(tmp_path):
    sequence = open_sequence(make_bag(tmp_path / "bag", images(TIMES)))
    assert (order_of(sequence), sequence.times_source, notes_of(sequence)) == (list(range(N)), "header", ())
    np.testing.assert_allclose(times_of(sequence), TIMES, atol=1e-6)


def test_images_received_late_are_put_in_order(tmp_path):
    received = 200 + 0.1 * np.arange(N)
    received[3] += 0.25
    sequence = open_sequence(make_bag(tmp_path / "bag", images(TIMES, received)))
    assert (order_of(sequence), sequence.times_source) == (list(range(N)), "header")


@pytest.mark.parametrize("unset", [[5], [0], list(range(N))], ids=["one", "the first", "all"])
def test_stamps_never_set_leave_the_times_of_receipt(tmp_path, unset):
    stamps = TIMES.copy()
    stamps[unset] = 0
    sequence = open_sequence(make_bag(tmp_path / "bag", images(stamps)))
    assert (order_of(sequence), sequence.times_source) == (list(range(N)), "receipt")
    np.testing.assert_allclose(times_of(sequence), 200 + 0.1 * np.arange(N), atol=1e-6)
    (note,) = notes_of(sequence)
    assert f"{len(unset)} of {N} header stamps are zero, so that times are those of receipt" in note


def test_a_stamp_of_another_clock_leaves_the_times_of_receipt(tmp_path):
    stamps = TIMES.copy()
    stamps[:2] = 3.0, 3.1  # before the clock was set: earlier, and in their place
    assert open_sequence(make_bag(tmp_path / "a", images(stamps))).times_source == "header"
    stamps[6] = 3.2
    sequence = open_sequence(make_bag(tmp_path / "b", images(stamps, 200 + np.arange(N))))
    assert (order_of(sequence), sequence.times_source) == (list(range(N)), "receipt")
    assert "contradict the order of receipt by up to 4 s" in notes_of(sequence)[0]


def test_equal_stamps_are_refused_or_skipped(tmp_path):
    stamps = TIMES.copy()
    stamps[5] = stamps[4]
    path = make_bag(tmp_path / "bag", images(stamps))
    with pytest.raises(DataError, match=r"but number 4 is 100\.4 s and the next 100\.4 s"):
        open_sequence(path)
    chosen, skipped = select_frames(open_sequence(path, lenient=True), skip_bad=True)
    assert order_of(chosen) == [0, 1, 2, 3, 4, 6, 7]
    assert [bad.frame for bad in skipped] == [5]


@pytest.mark.parametrize("big", [False, True], ids=["little", "big"])
@pytest.mark.parametrize(("most", "shift"), [(255, 0), (1023, 2), (4095, 4), (16383, 6), (65535, 8)])
def test_sixteen_bits_become_eight_by_one_shift_for_all_frames(tmp_path, most, shift, big):
    """The first frames are dark: the shift is that of the brightest value in the bag."""
    values = [(grey(k).astype(float) / 255 * most / (1 if k == 5 else 4)).astype(np.uint16) for k in range(N)]
    values[5][0, 0] = most
    messages = [Message(t, t, "mono16", v, big) for t, v in zip(TIMES, values)]
    sequence = open_sequence(make_bag(tmp_path / "bag", messages))
    for k in range(N):
        np.testing.assert_array_equal(sequence.image(k), values[k] >> shift)
    (note,) = notes_of(sequence)
    assert f"reach {most}, so the upper 8 of {shift + 8} bits are read (value >> {shift})" in note


def test_luma_of_nv12(tmp_path):
    colour = np.full((H // 2, W), 77, np.uint8)
    messages = [Message(t, t, "nv12", np.vstack([grey(k), colour])) for k, t in enumerate(TIMES)]
    assert order_of(open_sequence(make_bag(tmp_path / "bag", messages))) == list(range(N))
    cut = [Message(0, 1, "nv12", grey(0)), Message(1, 2, "nv12", grey(1))]
    cut = [m._replace(values=m.values[: H * 3 // 4]) for m in cut]  # a height of H / 2, and enough bytes
    assert open_sequence(make_bag(tmp_path / "b", cut)).image(0).shape == (H // 2, W)


def depth_mm(k):
    depth = np.random.default_rng(100 + k).integers(500, 5000, (H, W)).astype(np.uint16)
    depth[0, 0] = 0
    return depth


def depths(encoding, times):
    for k, t in enumerate(times):
        values = depth_mm(k) if encoding == "16UC1" else (depth_mm(k) / 1000).astype(np.float32)
        yield Message(t, 200 + t - 100, encoding, values, topic="/cam/depth")


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_depth_is_in_metres_whatever_its_units(tmp_path, encoding):
    """The depth camera runs beside: one depth is missing, and one comes twice near an image."""
    times = np.delete(TIMES, 3) + 0.004
    times = np.insert(times, 5, times[4] + 0.007)
    path = make_bag(tmp_path / "bag", [*images(TIMES), *depths(encoding, times)])
    with pytest.raises(DataError, match="several topics of images, choose one by --topic"):
        open_sequence(path)
    sequence = open_sequence(path, depth_topic="/cam/depth")
    assert sequence.topic == "/cam/image_raw"
    assert order_of(sequence) == [0, 1, 2, 4, 5, 6, 7]
    for k, which in enumerate([0, 1, 2, 3, 4, 6, 7]):
        expected = np.where(depth_mm(which) > 0, depth_mm(which) / 1000, np.nan)
        np.testing.assert_allclose(sequence.depth(k), expected, rtol=1e-6)
    assert "1 of 8 images have no depth within 0.02 s and are left out" in notes_of(sequence)[0]
    with pytest.raises(MissingFieldError, match="give its topic by --depth-topic"):
        open_sequence(path, topic="/cam/image_raw").depth(0)


def test_depth_that_does_not_fit_is_refused(tmp_path):
    def opened(name, *messages):
        return open_sequence(make_bag(tmp_path / name, [*images(TIMES), *messages]), depth_topic="/cam/depth")

    with pytest.raises(DataError, match=r"depth must be 16UC1 .millimetres. or 32FC1 .metres., not 'mono16'"):
        opened("a", *(m._replace(encoding="mono16") for m in depths("16UC1", TIMES))).depth(0)
    small = [m._replace(values=m.values[::2, ::2]) for m in depths("16UC1", TIMES)]
    with pytest.raises(DataError, match="16 x 12 pixels, but the image, to which depth must be registered"):
        opened("b", *small).depth(0)
    with pytest.raises(DataError, match=r"no depth on /cam/depth within 0\.02 s of an image"):
        opened("c", *depths("16UC1", TIMES + 0.05))
    with pytest.raises(DataError, match="no images on /x to take as depth, but on /cam/image_raw"):
        open_sequence(make_bag(tmp_path / "d", images(TIMES)), depth_topic="/x")
    with pytest.raises(DataError, match=r"encoding '16UC1' is not read .as depth: --depth-topic., known are"):
        open_sequence(make_bag(tmp_path / "e", list(depths("16UC1", TIMES))))
