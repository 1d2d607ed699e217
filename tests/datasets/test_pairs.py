import pickle

import numpy as np
import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets._flying_chairs import FlyingChairs
from flowlik.datasets._kitti_flow import KittiFlow
from flowlik.datasets._middlebury import MiddleburyFlow
from flowlik.datasets.base import PairSequence, frame_pairs
from flowlik.datasets.flow_files import write_flo, write_kitti_flow
from flowlik.errors import DataError, MissingFieldError

from .fakes import (
    HEIGHT,
    WIDTH,
    make_chairs,
    make_kitti_flow,
    make_middlebury_flow,
    photometric_errors,
    picture,
    save,
    some_flow,
)


@pytest.mark.parametrize("images", ["image_2", "image_0", "colored_0"])
def test_kitti_flow_is_a_set_of_pairs(tmp_path, images):
    sequence = open_sequence(make_kitti_flow(tmp_path, images))
    assert isinstance(sequence, PairSequence)
    assert sequence.name == f"kitti-flow/{2015 if images == 'image_2' else 2012}-training"
    assert (len(sequence), list(frame_pairs(sequence))) == (4, [0, 2])
    for k, i in [(2, 1), (0, 0)]:
        shape = (HEIGHT, WIDTH + 2 * i)
        assert sequence.image(k).shape == sequence.image(k + 1).shape == shape
        truth = some_flow(i, WIDTH + 2 * i)
        np.testing.assert_allclose(sequence.flow(k), truth, atol=0.5 / 64)
    assert not sequence.visible(2)[:, : WIDTH // 2 + 1].any()
    assert sequence.visible(2)[3:, WIDTH // 2 + 1 :].all()


def test_pairs_begin_at_even_frames(tmp_path):
    sequence = KittiFlow(make_kitti_flow(tmp_path))
    with pytest.raises(DataError, match="frames 1 and 2 are no pair"):
        sequence.flow(1)
    for read in (sequence.image, sequence.flow):
        with pytest.raises(DataError, match="no frame 4, there are 4 frames"):
            read(4)


def test_pairs_reach_another_process(tmp_path):
    sequence = pickle.loads(pickle.dumps(KittiFlow(make_kitti_flow(tmp_path))))
    assert sequence.flow(2).shape == (HEIGHT, WIDTH + 2, 2)
    assert frame_pairs(sequence) == range(0, 3, 2)


def test_kitti_flow_without_occluded_pixels_or_without_truth(tmp_path):
    folder = make_kitti_flow(tmp_path)
    for path in (folder / "flow_occ").iterdir():
        path.unlink()
    (folder / "flow_occ").rmdir()
    sequence = KittiFlow(folder)
    np.testing.assert_array_equal(np.isfinite(sequence.flow(2)[..., 0]), sequence.visible(2))
    (folder / "flow_noc").rename(folder / "elsewhere")
    with pytest.raises(MissingFieldError, match=r"no true flow for 000000_10\.png"):
        KittiFlow(folder).flow(0)
    with pytest.raises(MissingFieldError, match="no visibility"):
        KittiFlow(folder).visible(0)


def test_bad_kitti_flow(tmp_path):
    folder = make_kitti_flow(tmp_path)
    sequence = KittiFlow(folder)
    write_kitti_flow(folder / "flow_occ/000000_10.png", some_flow(0, WIDTH, HEIGHT + 1))
    with pytest.raises(DataError, match=r"flow_occ.*40 x 31 pixels, but 000000_10\.png has 40 x 30"):
        sequence.flow(0)
    save(folder / "flow_occ/000001_10.png", picture(0))
    with pytest.raises(DataError, match="three 16-bit channels"):
        sequence.flow(2)
    (folder / "flow_occ/000001_10.png").unlink()
    with pytest.raises(DataError, match="no such flow file"):
        sequence.flow(2)
    save(folder / "image_2/000000_11.png", picture(0, WIDTH + 1))
    with pytest.raises(DataError, match=r"000000_11\.png: 41 x 30 pixels, but 000000_10\.png has 40 x 30"):
        sequence.image(1)
    (folder / "image_2/000001_11.png").unlink()
    with pytest.raises(DataError, match=r"000001_11\.png: no such image, the partner of"):
        KittiFlow(folder)
    for path in (folder / "image_2").iterdir():
        path.unlink()
    with pytest.raises(DataError, match=r"no images NNNNNN_10\.png"):
        KittiFlow(folder)
    (folder / "image_2").rmdir()
    with pytest.raises(DataError, match="no folder image_2 or image_0 or colored_0"):
        KittiFlow(folder)
    with pytest.raises(DataError, match="no such folder"):
        KittiFlow(folder / "none")


@pytest.mark.parametrize("apart", [False, True])
def test_middlebury_scenes(tmp_path, apart):
    folder = make_middlebury_flow(tmp_path, apart)
    one, both = open_sequence(folder / "Army"), open_sequence(folder)
    assert (one.name, len(one)) == ("middlebury-flow/Army", 2)
    assert (both.name, list(frame_pairs(both))) == ("middlebury-flow/other-data", [0, 2])
    np.testing.assert_allclose(one.flow(0), some_flow(), rtol=1e-6)
    np.testing.assert_array_equal(both.image(1), picture(11))
    with pytest.raises(MissingFieldError, match="no camera"):
        _ = one.camera
    with pytest.raises(MissingFieldError, match="no true flow"):
        both.flow(2)


def test_bad_middlebury_scenes(tmp_path):
    folder = make_middlebury_flow(tmp_path)
    write_flo(folder / "Army/flow10.flo", some_flow(0, WIDTH, HEIGHT - 1))
    with pytest.raises(DataError, match=r"flow10\.flo: 40 x 29 pixels, but frame10\.png has 40 x 30"):
        MiddleburyFlow(folder / "Army").flow(0)
    (folder / "Army/frame11.png").unlink()
    with pytest.raises(DataError, match=r"frame11\.png: no such image"):
        MiddleburyFlow(folder).image(1)
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match=r"neither frame10\.png nor folders with one"):
        MiddleburyFlow(tmp_path / "empty")
    with pytest.raises(DataError, match="no such folder"):
        MiddleburyFlow(tmp_path / "none")


@pytest.mark.parametrize(
    "names",
    [("_img1.ppm", "_img2.ppm", "_flow.flo"), ("img0.ppm", "img1.ppm", "flow.flo"),
     ("_img1.png", "_img2.png", "_flow.flo")],
)  # fmt: skip
def test_flying_chairs_names(tmp_path, names):
    sequence = open_sequence(make_chairs(tmp_path, names))
    assert (len(sequence), list(frame_pairs(sequence))) == (4, [0, 2])
    assert sequence.name == "flying-chairs/data"
    np.testing.assert_array_equal(sequence.image(3), picture(21))
    np.testing.assert_allclose(sequence.flow(2), some_flow(2), rtol=1e-6)


def test_flying_chairs_may_be_opened_one_folder_up(tmp_path):
    assert len(open_sequence(make_chairs(tmp_path).parent)) == 4


def test_bad_flying_chairs(tmp_path):
    folder = make_chairs(tmp_path)
    data = (folder / "00001_flow.flo").read_bytes()
    (folder / "00001_flow.flo").write_bytes(data[:-8])
    with pytest.raises(DataError, match=r"00001_flow\.flo: .* \(truncated\?\)"):
        FlyingChairs(folder).flow(0)
    (folder / "00002_img2.ppm").unlink()
    with pytest.raises(DataError, match=r"00002_flow\.flo: its images .* are not both there"):
        FlyingChairs(folder)
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match=r"no NNNNN_flow\.flo"):
        FlyingChairs(tmp_path / "empty")
    with pytest.raises(DataError, match="no such folder"):
        FlyingChairs(tmp_path / "none")


@pytest.mark.parametrize(
    ("folder", "name", "before", "after"),
    [
        ("flow/kitti2012/training", "kitti-flow/2012-training", 14.0, 5.1),
        ("flow/middlebury/RubberWhale", "middlebury-flow/RubberWhale", 5.6, 1.3),
        ("flow/flyingchairs", "flying-chairs/flyingchairs", 10.4, 5.8),
        ("stereo/motorcycle", "middlebury-stereo/motorcycle", 37.7, 7.3),
    ],
)
def test_real_flow_explains_its_images(shared_data, folder, name, before, after):
    sequence = open_sequence(shared_data / folder)
    assert (sequence.name, frame_pairs(sequence)) == (name, range(0, 1, 2))
    errors = photometric_errors(sequence.image(0), sequence.image(1), sequence.flow(0))
    assert errors == pytest.approx((before, after), abs=0.15)
