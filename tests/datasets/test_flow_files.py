import struct

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from flowlik.datasets import read_grey
from flowlik.datasets.flow_files import read_flow, write_flo, write_kitti_flow
from flowlik.errors import DataError

from .fakes import write_pfm


def some_flow(seed: int = 0, shape: tuple[int, int] = (13, 17)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    flow = rng.normal(0, 30, (*shape, 2))
    flow[rng.random(shape) < 0.3] = np.nan
    return flow


flows = arrays(
    np.float32,
    st.tuples(st.integers(1, 5), st.integers(1, 5), st.just(2)),
    elements=st.floats(-500, 500, width=32) | st.just(np.nan),
)
quickly = settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def unknown_as_a_whole(flow):
    flow = flow.astype(np.float64)
    flow[np.isnan(flow).any(axis=-1)] = np.nan
    return flow


@given(flows)
@quickly
def test_flo_keeps_float32_exactly(tmp_path, flow):
    write_flo(tmp_path / "f.flo", flow)
    np.testing.assert_array_equal(read_flow(tmp_path / "f.flo"), unknown_as_a_whole(flow))


@given(flows)
@quickly
def test_kitti_keeps_flow_to_half_a_step(tmp_path, flow):
    write_kitti_flow(tmp_path / "f.png", flow)
    np.testing.assert_allclose(read_flow(tmp_path / "f.png"), unknown_as_a_whole(flow), rtol=0, atol=0.5 / 64)


def test_flo_bytes_are_middleburys(tmp_path):
    values = [1.5, -2, 1e9, 0, 3, 1e10]
    (tmp_path / "f.flo").write_bytes(
        struct.pack("<f", 202021.25) + struct.pack("<ii", 3, 1) + struct.pack("<6f", *values)
    )
    np.testing.assert_array_equal(read_flow(tmp_path / "f.flo"), [[[1.5, -2], [np.nan] * 2, [np.nan] * 2]])


def test_kitti_channels_are_u_v_valid(tmp_path):
    codes = np.array([[[32768 + 64, 32768 - 32, 1], [40000, 40000, 0]]], np.uint16)  # R, G, B
    cv2.imwrite(str(tmp_path / "f.png"), codes[..., ::-1])
    np.testing.assert_array_equal(read_flow(tmp_path / "f.png"), [[[1, -0.5], [np.nan, np.nan]]])


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int16])
def test_npy(tmp_path, dtype):
    flow = np.arange(12).reshape(2, 3, 2).astype(dtype)
    np.save(tmp_path / "f.npy", flow)
    back = read_flow(tmp_path / "f.npy")
    assert back.dtype == np.float64
    np.testing.assert_array_equal(back, flow)


FORMS = {
    "(2, H, W)": lambda flow: flow.transpose(2, 0, 1),
    "(1, 2, H, W)": lambda flow: flow.transpose(2, 0, 1)[None],
    "(1, H, W, 2)": lambda flow: flow[None],
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("suffix", ["npy", "npz"])
def test_components_may_come_first(tmp_path, form, suffix):
    flow = some_flow().astype(np.float32)
    (np.save if suffix == "npy" else np.savez)(tmp_path / f"f.{suffix}", FORMS[form](flow))
    np.testing.assert_array_equal(read_flow(tmp_path / f"f.{suffix}"), flow)


def test_npz_holds_flow_and_what_is_valid(tmp_path):
    flow, valid = np.nan_to_num(some_flow()), np.random.default_rng(1).random((13, 17)) < 0.5
    np.savez_compressed(tmp_path / "f.npz", flow=flow.transpose(2, 0, 1), valid=valid)
    np.testing.assert_array_equal(read_flow(tmp_path / "f.npz"), np.where(valid[..., None], flow, np.nan))


@pytest.mark.parametrize(
    "arrays",
    [
        {"u": np.zeros((3, 4)), "v": np.zeros((3, 4))},
        {"flow": np.zeros((3, 4, 2)), "mask": np.zeros((3, 4))},
        {"flow": np.zeros((3, 4, 2)), "valid": np.zeros((4, 3))},
        {"flow": np.zeros((3, 4, 2)), "valid": np.zeros((3, 4), complex)},
        {"flow": np.zeros((3, 4))},
        {},
    ],
)
def test_npz_of_other_arrays_is_refused(tmp_path, arrays):
    np.savez(tmp_path / "f.npz", **arrays)
    with pytest.raises(DataError, match=r"f\.npz: .*(expected|valid|shape)"):
        read_flow(tmp_path / "f.npz")


def test_pfm_has_three_channels_and_rows_run_upwards(tmp_path):
    """FlyingThings3D's: u, v, 0."""
    flow = some_flow().astype(np.float32)
    write_pfm(tmp_path / "f.pfm", np.dstack([flow, np.zeros((13, 17))]))
    np.testing.assert_array_equal(read_flow(tmp_path / "f.pfm"), flow)
    (tmp_path / "g.pfm").write_bytes(b"PF 1 2 1\n" + np.array([3, 4, 0, 1, 2, 0], ">f4").tobytes())
    np.testing.assert_array_equal(read_flow(tmp_path / "g.pfm"), [[[1, 2]], [[3, 4]]])


def test_pfm_that_is_no_flow(tmp_path):
    write_pfm(tmp_path / "f.pfm", np.ones((3, 4, 3)))
    with pytest.raises(DataError, match="third channel of a flow is zero"):
        read_flow(tmp_path / "f.pfm")
    (tmp_path / "f.pfm").write_bytes(b"Pf 1 1 -1\n" + bytes(4))
    with pytest.raises(DataError, match="of three channels"):
        read_flow(tmp_path / "f.pfm")


@pytest.mark.parametrize("suffix", ["npy", "npz", "pfm"])
def test_large_values_are_unknown_in_every_format(tmp_path, suffix):
    flow = np.array([[[1.0, 2.0], [1e10, 3.0]]])
    if suffix == "pfm":
        write_pfm(tmp_path / "f.pfm", np.dstack([flow, np.zeros((1, 2))]))
    else:
        (np.save if suffix == "npy" else np.savez)(tmp_path / f"f.{suffix}", flow)
    np.testing.assert_array_equal(read_flow(tmp_path / f"f.{suffix}"), [[[1, 2], [np.nan, np.nan]]])


def test_npy_infinite_is_unknown(tmp_path):
    np.save(tmp_path / "f.npy", np.array([[[1.0, np.inf], [2.0, 3.0]]]))
    np.testing.assert_array_equal(read_flow(tmp_path / "f.npy"), [[[np.nan, np.nan], [2, 3]]])


@pytest.mark.parametrize("flow", [np.zeros((3, 2)), np.zeros((3, 4, 3)), np.zeros((0, 4, 2))])
@pytest.mark.parametrize("write", [write_flo, write_kitti_flow])
def test_other_shapes_are_not_written(tmp_path, write, flow):
    with pytest.raises(DataError, match="shape"):
        write(tmp_path / "f", flow)


@pytest.mark.parametrize("value", [-512.1, 512.0])
def test_kitti_holds_no_larger_flow(tmp_path, value):
    with pytest.raises(DataError, match="-512 to 512"):
        write_kitti_flow(tmp_path / "f.png", np.full((2, 2, 2), value))


WRITERS = {
    "flo": write_flo,
    "png": write_kitti_flow,
    "npy": np.save,
    "npz": np.savez_compressed,
    "pfm": lambda path, flow: write_pfm(path, np.dstack([flow, np.zeros(flow.shape[:2])])),
}


@pytest.mark.parametrize("suffix", WRITERS)
def test_every_truncation_is_refused(tmp_path, suffix):
    path = tmp_path / f"f.{suffix}"
    WRITERS[suffix](path, some_flow())
    assert read_flow(path).shape == (13, 17, 2)
    data = path.read_bytes()
    for length in [*range(0, len(data) - 1, max(1, len(data) // 30)), len(data) - 1]:
        path.write_bytes(data[:length])
        with pytest.raises(DataError, match=path.name):
            read_flow(path)


@pytest.mark.parametrize("size", [(-1, 4), (0, 4), (2**31 - 1, 2**31 - 1), (100_000, 1)])
def test_impossible_flo_sizes(tmp_path, size):
    (tmp_path / "f.flo").write_bytes(b"PIEH" + struct.pack("<ii", *size) + b"\0" * 64)
    with pytest.raises(DataError, match="impossible size"):
        read_flow(tmp_path / "f.flo")


def test_a_flo_header_that_promises_more_than_there_is(tmp_path):
    (tmp_path / "f.flo").write_bytes(b"PIEH" + struct.pack("<ii", 99_999, 99_999) + b"\0" * 64)
    with pytest.raises(DataError, match="truncated"):
        read_flow(tmp_path / "f.flo")


def test_an_npy_header_that_promises_more_than_there_is(tmp_path):
    np.save(tmp_path / "f.npy", np.zeros((2, 2, 2)))
    data = (tmp_path / "f.npy").read_bytes()
    huge = data.replace(b"(2, 2, 2), }         ", b"(99999, 99999, 2), } ")
    assert huge != data
    (tmp_path / "f.npy").write_bytes(huge)
    with pytest.raises(DataError, match="truncated"):
        read_flow(tmp_path / "f.npy")


@pytest.mark.parametrize(
    "array", [np.array([{}], dtype=object), np.zeros((3, 4)), np.zeros((2, 2, 2), complex), np.array(["a"])]
)
def test_other_arrays_are_no_flow(tmp_path, array):
    np.save(tmp_path / "f.npy", array, allow_pickle=True)
    with pytest.raises(DataError, match=r"f\.npy"):
        read_flow(tmp_path / "f.npy")


def test_other_files_are_no_flow(tmp_path):
    cv2.imwrite(str(tmp_path / "grey.png"), np.zeros((4, 4), np.uint8))
    cv2.imwrite(str(tmp_path / "colour.png"), np.zeros((4, 4, 3), np.uint8))
    for name, message in [
        ("grey.png", "three 16-bit channels"),
        ("colour.png", "three 16-bit channels"),
        ("flow.mat", "unknown flow format"),
        ("none.flo", "no such flow file"),
        ("a.flo5", r"HDF5 is not read; convert it by numpy.save.'a.npy', h5py.File.'a.flo5'"),
    ]:
        with pytest.raises(DataError, match=message):
            read_flow(tmp_path / name)


def picture(channels: int) -> np.ndarray:
    noise = np.random.default_rng(0).integers(0, 256, (60, 80, channels), dtype=np.uint8)
    return cv2.GaussianBlur(noise, (5, 5), 1.5).reshape(60, 80, channels)


@pytest.mark.parametrize(
    ("suffix", "channels"),
    [("png", 1), ("png", 3), ("jpg", 1), ("jpg", 3), ("pgm", 1), ("ppm", 3), ("bmp", 1), ("webp", 3)],
)
def test_every_truncated_image_is_refused(tmp_path, capfd, suffix, channels):
    path = tmp_path / f"i.{suffix}"
    assert cv2.imwrite(str(path), picture(channels))
    data = path.read_bytes()
    assert read_grey(path).shape == (60, 80)
    for length in [*range(0, len(data) - 1, len(data) // 40), len(data) - 1]:
        path.write_bytes(data[:length])
        with pytest.raises(DataError, match="not a readable image"):
            read_grey(path)
    if suffix in ("png", "jpg"):
        assert capfd.readouterr().err == ""


def test_a_damaged_png_is_refused(tmp_path):
    path = tmp_path / "i.png"
    cv2.imwrite(str(path), picture(1))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(DataError, match="damaged"):
        read_grey(path)


@pytest.mark.parametrize(
    "data", [b"", b"hello", b"\xff\xd8\xff\xd9", b"P5 10", b"P5 # no end", b"P6\n2 x 255\n"]
)
def test_what_is_no_image_is_refused(tmp_path, data):
    (tmp_path / "i.png").write_bytes(data)
    with pytest.raises(DataError, match="not a readable image"):
        read_grey(tmp_path / "i.png")
    with pytest.raises(DataError, match="no such image"):
        read_grey(tmp_path / "none.png")
    with pytest.raises(DataError, match="cannot be read"):
        read_grey(tmp_path)


@pytest.mark.parametrize("suffix", ["png", "ppm", "bmp"])
def test_colour_becomes_grey_rounded_once(tmp_path, suffix):
    image = picture(3)
    cv2.imwrite(str(tmp_path / f"i.{suffix}"), image)
    expected = image.astype(np.float64) @ [0.114, 0.587, 0.299]  # B, G, R
    assert np.abs(read_grey(tmp_path / f"i.{suffix}") - expected).max() <= 0.502


def test_grey_images_stay_as_they_are(tmp_path):
    image = picture(1)[..., 0]
    cv2.imwrite(str(tmp_path / "i.png"), image)
    np.testing.assert_array_equal(read_grey(tmp_path / "i.png"), image)


def test_middlebury_flow_explains_its_images(shared_data):
    folder = shared_data / "flow/middlebury/RubberWhale"
    flow = read_flow(folder / "flow10.flo")
    first, second = read_grey(folder / "frame10.png"), read_grey(folder / "frame11.png")
    assert flow.shape == (*first.shape, 2)
    known = np.isfinite(flow[..., 0])
    assert np.abs(flow[known]).max() < 10
    assert (
        warped_error(first, second, flow)[known].mean()
        < 0.5 * np.abs(first - second.astype(float))[known].mean()
    )


def test_kitti_flow_explains_its_images(shared_data):
    folder = shared_data / "flow/kitti2012/training"
    flow = read_flow(folder / "flow_noc/000045_10.png")
    first, second = (read_grey(folder / f"image_0/000045_{k}.png") for k in (10, 11))
    known = np.isfinite(flow[..., 0])
    assert known.mean() == pytest.approx(0.224, abs=5e-4)
    assert (
        warped_error(first, second, flow)[known].mean()
        < 0.5 * np.abs(first - second.astype(float))[known].mean()
    )


def warped_error(first, second, flow):
    v, u = np.mgrid[: first.shape[0], : first.shape[1]]
    ends = np.nan_to_num(flow + np.dstack([u, v])).astype(np.float32)
    warped = cv2.remap(second, ends[..., 0], ends[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.abs(warped.astype(float) - first)


@pytest.mark.parametrize(
    "header", [b"{'descr': (\n", b"{'descr': '<f8', 'x': [1, ", b"\x00\x00", b"{'descr': }"]
)
def test_an_npy_header_that_is_no_python(tmp_path, header):
    """NumPy's parser lets errors of Python's tokenizer through."""
    data = header.ljust(117) + b"\n"
    (tmp_path / "f.npy").write_bytes(b"\x93NUMPY\x01\x00" + len(data).to_bytes(2, "little") + data)
    with pytest.raises(DataError, match="not a readable"):
        read_flow(tmp_path / "f.npy")
