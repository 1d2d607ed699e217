"""Flow PNGs as each data set writes them; every reader of the others would see another flow."""

import cv2
import numpy as np
import pytest

from flowlik.datasets.flow_files import read_flow, write_kitti_flow
from flowlik.datasets.flow_png import PNG_CODINGS
from flowlik.datasets.tartanair import encode_flow
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole

SHAPE = (30, 40)
VGA = (480, 640)


def some_flow(shape=SHAPE) -> np.ndarray:
    return np.random.default_rng(0).normal((3, -5), 2, (*shape, 2))


def write(path, red, green, blue):
    """PNG of three 16-bit channels, named as a viewer shows them."""
    assert cv2.imwrite(str(path), np.dstack([blue, green, red]).astype(np.uint16))
    return path


def codes(flow, scale):
    return np.moveaxis(np.rint(flow * scale) + 2**15, -1, 0)


def kitti(path, flow, scale=64, valid=1):
    """KITTI's development kit: red u, green v, blue valid."""
    return write(path, *codes(flow, scale), np.full(flow.shape[:2], valid))


def tartanair(path, flow, mask=0):
    """TartanAir's tools hand u, v, mask to OpenCV, which takes them for blue, green, red."""
    u, v = codes(flow, 64)
    return write(path, np.broadcast_to(mask, u.shape), v, u)


def virtual_kitti(path, flow):
    size = np.array(flow.shape[1::-1]) - 1
    u, v = np.moveaxis(np.rint((flow / size + 1) * (2**16 - 1) / 2), -1, 0)
    return write(path, u, v, np.full(flow.shape[:2], 1))


@pytest.mark.parametrize("shape", [SHAPE, (376, 1241)])
def test_kittis_is_known(tmp_path, shape):
    flow = some_flow(shape)
    np.testing.assert_allclose(read_flow(kitti(tmp_path / "a.png", flow)), flow, atol=1 / 128)


def test_tartanairs_is_known(tmp_path):
    flow = some_flow()
    mask = np.random.default_rng(1).choice([0, 1, 10, 100, 200], SHAPE)
    found = read_flow(tartanair(tmp_path / "a.png", flow, mask))
    np.testing.assert_array_equal(np.isnan(found).any(axis=-1), mask == 200)
    np.testing.assert_allclose(found[mask < 200], flow[mask < 200], atol=1 / 128)


def test_all_of_tartanairs_seen_again_is_known(tmp_path):
    flow = some_flow(VGA)
    np.testing.assert_allclose(read_flow(tartanair(tmp_path / "a.png", flow)), flow, atol=1 / 128)


def test_the_simulations_own_is_known(tmp_path):
    """What `flowlik simulate` writes is TartanAir's."""
    flow, visible = some_flow(), np.random.default_rng(2).random(SHAPE) < 0.8
    flow[:2] = np.nan
    cv2.imwrite(str(tmp_path / "a.png"), encode_flow(flow, visible, Pinhole(40, 30, 20, 20, 19.5, 14.5)))
    np.testing.assert_allclose(read_flow(tmp_path / "a.png"), flow, atol=1 / 128)


def test_the_authors_files_are_known(shared_data):
    """TartanAir's own flow is that of its depth and poses; KITTI's has its mean."""
    from flowlik.datasets import open_sequence

    folder = shared_data / "tartanair_v2" / "abs_P000"
    found = read_flow(folder / "flow_lcam_front" / "000002_000003_flow.png")
    apart = np.abs(found - open_sequence(folder).flow(2))
    assert np.nanmedian(apart) < 0.05 and np.isfinite(apart).mean() > 0.99
    kitti_flow = read_flow(shared_data / "flow/kitti2012/training/flow_noc/000045_10.png")
    assert np.isfinite(kitti_flow).all(axis=-1).mean() == pytest.approx(0.224, abs=0.001)


def test_at_dsecs_size_kittis_scale_is_asked_for(tmp_path):
    flow = some_flow(VGA)
    path = kitti(tmp_path / "a.png", flow, 128)
    with pytest.raises(
        DataError, match=r"KITTI.*\(steps of 1/64 px\) or DSEC.*--flow-png kitti or dsec"
    ) as e:
        read_flow(path)
    assert "\n" not in str(e.value)
    np.testing.assert_allclose(read_flow(path, "dsec"), flow, atol=1 / 256)
    np.testing.assert_allclose(read_flow(path, "kitti"), 2 * flow, atol=1 / 128)


def test_flowliks_own_says_that_it_is_kittis(tmp_path):
    flow = some_flow(VGA)
    flow[:9] = np.nan
    write_kitti_flow(tmp_path / "a.png", flow)
    np.testing.assert_allclose(read_flow(tmp_path / "a.png"), flow, atol=1 / 128)
    # the mark is no part of the picture
    image = cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED)
    assert image.dtype == np.uint16 and image.shape == (*VGA, 3)


def test_flow_of_no_valid_pixel_is_unknown(tmp_path):
    nothing = np.zeros(VGA)
    assert np.isnan(read_flow(write(tmp_path / "a.png", nothing, nothing, nothing))).all()


@pytest.mark.parametrize("valid", [255, 65535])
def test_other_marks_of_what_is_valid_are_asked_for(tmp_path, valid):
    flow = some_flow()
    path = kitti(tmp_path / "a.png", flow, valid=valid)
    with pytest.raises(DataError, match=rf"neither KITTI.*up to {valid}.*nor TartanAir.*--flow-png kitti,"):
        read_flow(path)
    np.testing.assert_allclose(read_flow(path, "kitti"), flow, atol=1 / 128)


def test_virtual_kittis_is_in_shares_of_the_image(tmp_path):
    flow = some_flow()
    found = read_flow(virtual_kitti(tmp_path / "a.png", flow), "virtual-kitti")
    np.testing.assert_allclose(found, flow, atol=1e-3)


@pytest.mark.parametrize("coding", ["kitti", "dsec", "virtual-kitti"])
def test_what_the_file_contradicts_is_refused(tmp_path, coding):
    with pytest.raises(DataError, match=rf"no {coding} flow, whose first channel says valid or not"):
        read_flow(tartanair(tmp_path / "a.png", some_flow()), coding)
    with pytest.raises(DataError, match="no TartanAir flow, whose last channel is a mask"):
        read_flow(kitti(tmp_path / "a.png", some_flow()), "tartanair")


def test_an_unknown_coding_is_named(tmp_path):
    with pytest.raises(DataError, match="unknown coding of flow PNGs 'hd1k': known are kitti, dsec"):
        read_flow(kitti(tmp_path / "a.png", some_flow()), "hd1k")
    assert set(PNG_CODINGS) == {"kitti", "dsec", "tartanair", "virtual-kitti"}
