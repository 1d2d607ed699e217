import numpy as np
import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets._sintel import Sintel
from flowlik.datasets.base import frame_pairs
from flowlik.datasets.flow_files import write_flo
from flowlik.errors import DataError, MissingFieldError

from .fakes import HEIGHT, WIDTH, make_sintel, photometric_errors, picture, save


def test_a_scene_of_a_pass(tmp_path):
    sequence = open_sequence(make_sintel(tmp_path))
    assert sequence.name == "sintel/alley_9-clean"
    assert (len(sequence), frame_pairs(sequence)) == (3, range(2))
    np.testing.assert_array_equal(sequence.image(1), picture(2))


def test_invalid_is_unknown_and_occluded_keeps_its_flow(tmp_path):
    sequence = Sintel(make_sintel(tmp_path))
    flow, visible = sequence.flow(1), sequence.visible(1)
    assert np.isnan(flow[0]).all()
    assert (flow[1:] == 2).all()
    assert not visible[:, 0].any()
    assert visible[:, 1:].all()


def test_what_sintel_lacks(tmp_path):
    sequence = Sintel(make_sintel(tmp_path))
    with pytest.raises(MissingFieldError, match="sintel/alley_9-clean: this data set has no camera"):
        _ = sequence.camera
    for field, read in [
        ("poses", sequence.T_n_c),
        ("depth", sequence.depth),
        ("times", sequence.timestamp),
    ]:
        with pytest.raises(MissingFieldError, match=f"no {field}"):
            read(0)
    with pytest.raises(DataError, match="no frame 3, there are 3 frames"):
        sequence.flow(2)


def test_a_test_scene_has_no_flow(tmp_path):
    save(tmp_path / "test/clean/cave_9/frame_0001.png", picture(0))
    save(tmp_path / "test/clean/cave_9/frame_0002.png", picture(1))
    sequence = open_sequence(tmp_path / "test/clean/cave_9", "sintel")
    for read in (sequence.flow, sequence.visible):
        with pytest.raises(MissingFieldError, match="no true flow"):
            read(0)


def test_bad_scenes(tmp_path):
    folder = make_sintel(tmp_path)
    root = tmp_path / "training"
    sequence = Sintel(folder)
    write_flo(root / "flow/alley_9/frame_0001.flo", np.zeros((HEIGHT, WIDTH + 1, 2)))
    with pytest.raises(DataError, match=r"frame_0001\.flo: 41 x 30 pixels, but the image has 40 x 30"):
        sequence.flow(0)
    save(root / "occlusions/alley_9/frame_0001.png", picture(0, WIDTH, HEIGHT + 1))
    with pytest.raises(DataError, match=r"occlusions.*frame_0001\.png: 40 x 31 pixels"):
        sequence.visible(0)
    (root / "invalid/alley_9/frame_0002.png").unlink()
    with pytest.raises(DataError, match=r"invalid.*frame_0002\.png: no such file"):
        sequence.flow(1)
    save(folder / "frame_0002.png", picture(0, WIDTH + 3))
    with pytest.raises(DataError, match=r"frame_0002\.png: 43 x 30 pixels, but the first image"):
        sequence.image(1)
    (folder / "frame_0003.png").write_bytes((folder / "frame_0003.png").read_bytes()[:-20])
    with pytest.raises(DataError, match=r"frame_0003\.png: not a readable image"):
        sequence.image(2)
    (folder / "frame_0002.png").unlink()
    with pytest.raises(DataError, match=r"missing between frame_0001\.png and frame_0003\.png"):
        Sintel(folder)
    (folder / "frame_0002.png").mkdir()
    save(folder / "frame_x.png", picture(0))
    with pytest.raises(DataError, match=r"frame_x\.png: images must be named"):
        Sintel(folder)
    with pytest.raises(DataError, match="expected one scene such as training/clean/alley_1"):
        Sintel(root)
    with pytest.raises(DataError, match="no such folder"):
        Sintel(root / "none")


@pytest.mark.parametrize(
    ("scene", "before", "after"),
    [("clean/alley_1", 9.4, 1.9), ("final/alley_1", 6.4, 1.1), ("clean/alley_2", 5.5, 1.3),
     ("final/cave_2", 9.7, 1.9)],
)  # fmt: skip
def test_real_flow_explains_its_images(shared_data, scene, before, after):
    sequence = open_sequence(shared_data / "flow/sintel/training" / scene)
    errors = photometric_errors(sequence.image(0), sequence.image(1), sequence.flow(0), sequence.visible(0))
    assert errors == pytest.approx((before, after), abs=0.1)
