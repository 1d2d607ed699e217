import io
import struct
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flowlik.datasets import open_sequence
from flowlik.datasets._disparity import read_disparity
from flowlik.datasets._middlebury import MiddleburyStereo
from flowlik.datasets.base import frame_pairs
from flowlik.datasets.flow_files import read_flow
from flowlik.errors import DataError, MissingFieldError

from .fakes import HEIGHT, WIDTH, make_stereo, picture, save, write_pfm

VALUES = np.array([[1.5, np.inf, 3], [4, np.nan, -6]])
KNOWN = np.array([[1.5, np.nan, 3], [4, np.nan, -6]])


@pytest.mark.parametrize("little", [True, False])
def test_pfm_rows_run_upwards_in_either_byte_order(tmp_path, little):
    write_pfm(tmp_path / "d.pfm", VALUES, little)
    np.testing.assert_array_equal(read_disparity(tmp_path / "d.pfm"), KNOWN)


def test_pfm_bytes(tmp_path):
    (tmp_path / "d.pfm").write_bytes(b"Pf 1 2 -1\n" + np.array([1, 2], "<f4").tobytes())
    np.testing.assert_array_equal(read_disparity(tmp_path / "d.pfm"), [[2], [1]])


@pytest.mark.parametrize("suffix", ["pfm", "flo"])
def test_a_signalling_nan_is_unknown(tmp_path, suffix, recwarn):
    values = np.array([0x7F800001, 0x3F800000], "<u4").tobytes()
    header = b"Pf 1 2 -1\n" if suffix == "pfm" else b"PIEH" + struct.pack("<ii", 1, 1)
    (tmp_path / f"d.{suffix}").write_bytes(header + values)
    found = (read_disparity if suffix == "pfm" else read_flow)(tmp_path / f"d.{suffix}")
    assert np.isnan(found.ravel()[-1])
    assert not recwarn.list


@pytest.mark.parametrize("write", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["<f4", ">f8"])
def test_npz(tmp_path, write, order, dtype):
    write(tmp_path / "d.npz", VALUES.astype(dtype, order=order))
    np.testing.assert_array_equal(read_disparity(tmp_path / "d.npz"), KNOWN)


@pytest.mark.parametrize("suffix", ["pfm", "npz"])
def test_every_truncation_is_refused(tmp_path, suffix):
    path = tmp_path / f"d.{suffix}"
    if suffix == "pfm":
        write_pfm(path, np.ones((20, 30)))
    else:
        np.savez_compressed(path, np.random.default_rng(0).normal(size=(20, 30)))
    data = path.read_bytes()
    for length in [*range(0, len(data), max(1, len(data) // 60)), len(data) - 1]:
        path.write_bytes(data[:length])
        with pytest.raises(DataError, match=path.name):
            read_disparity(path)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (b"PF\n2 2\n-1\n", "not a .pfm file of one channel"),
        (b"Pf\n2 x\n-1\n", "not a .pfm file of one channel"),
        (b"Pf\n-2 2\n-1\n", "not a .pfm file of one channel"),
        (b"Pf\n0 2\n-1\n", "impossible header 0 x 2"),
        (b"Pf\n2 2\n0\n", "impossible header"),
        (b"Pf\n2 2\n1-1\n", "impossible header"),
        (b"Pf\n99999999 99999999\n-1\n", "impossible header"),
        (b"Pf\n9999 9999\n-1\n", "truncated"),
    ],
)
def test_bad_pfm_headers(tmp_path, header, message):
    (tmp_path / "d.pfm").write_bytes(header + bytes(16))
    with pytest.raises(DataError, match=message):
        read_disparity(tmp_path / "d.pfm")


def npz_that_claims(path, shape):
    """A small archive whose array has a header of another shape."""
    buffer = io.BytesIO()
    header = {"descr": "<f4", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(buffer, header)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("arr_0.npy", buffer.getvalue() + bytes(64))


@pytest.mark.parametrize("shape", [(99_999, 99_999), (-4, -4), (4,), (0, 4), (2, 2, 4)])
def test_npz_of_an_impossible_shape(tmp_path, shape):
    npz_that_claims(tmp_path / "d.npz", shape)
    with pytest.raises(DataError, match=r"d\.npz: an array .* expected \(H, W\) of floats"):
        read_disparity(tmp_path / "d.npz")


@pytest.mark.parametrize("shape", [(9_999, 9_999), (2, 2)])
def test_npz_that_holds_another_size_than_it_claims(tmp_path, shape):
    npz_that_claims(tmp_path / "d.npz", shape)
    with pytest.raises(DataError, match=r"d\.npz: truncated, or longer"):
        read_disparity(tmp_path / "d.npz")


def test_other_arrays_are_no_disparity(tmp_path):
    np.savez(tmp_path / "two.npz", VALUES, VALUES)
    np.savez(tmp_path / "objects.npz", np.array([[{}]], dtype=object))
    np.savez(tmp_path / "whole.npz", np.ones((2, 2), int))
    for name, message in [
        ("two.npz", "2 arrays, but expected one"),
        ("objects.npz", "expected"),
        ("whole.npz", "of int64, but expected"),
        ("none.npz", "no such disparity file"),
        ("d.png", "unknown disparity format"),
    ]:
        with pytest.raises(DataError, match=message):
            read_disparity(tmp_path / name)


@given(
    st.sampled_from(["pfm", "npz"]), st.lists(st.tuples(st.floats(0, 1), st.binary(max_size=3)), max_size=5)
)
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_disparity_ends_in_one_error_at_worst(tmp_path, suffix, changes):
    path = tmp_path / f"d.{suffix}"
    if suffix == "pfm":
        write_pfm(path, np.ones((2, 3)))
    else:
        np.savez_compressed(path, np.ones((2, 3)))
    data = bytearray(path.read_bytes())
    for where, what in changes:
        at = int(where * (len(data) - 1))
        data[at : at + len(what)] = what
    path.write_bytes(data)
    try:
        assert read_disparity(path).ndim == 2
    except DataError as error:
        assert path.name in str(error)


def test_disparity_is_flow_to_the_left(tmp_path):
    folder = make_stereo(tmp_path)
    sequence = open_sequence(folder)
    assert (sequence.name, len(sequence)) == ("middlebury-stereo/Jadeplant-perfect", 2)
    flow = sequence.flow(0)
    assert (flow[1, 2] == [-(WIDTH + 2), 0]).all()
    assert np.isnan(flow[2, 3]).all()
    assert np.isnan(flow).sum() == 2
    both = open_sequence(tmp_path)
    assert list(frame_pairs(both)) == [0]
    with pytest.raises(MissingFieldError, match="no visibility"):
        both.visible(0)


def test_bad_stereo_scenes(tmp_path):
    folder = make_stereo(tmp_path)
    write_pfm(folder / "disp0.pfm", np.ones((HEIGHT, WIDTH - 1)))
    with pytest.raises(DataError, match=r"disp0\.pfm: 39 x 30 pixels, but im0\.png has 40 x 30"):
        MiddleburyStereo(folder).flow(0)
    (folder / "disp0.pfm").unlink()
    with pytest.raises(MissingFieldError, match="no true flow"):
        MiddleburyStereo(folder).flow(0)
    (folder / "im1.png").unlink()
    with pytest.raises(DataError, match=r"im1\.png: no such image"):
        MiddleburyStereo(folder).image(1)
    (folder / "im0.png").unlink()
    for name in ("a", "b"):
        save(folder / f"{name}_left.png", picture(0))
    with pytest.raises(DataError, match="2 left images"):
        MiddleburyStereo(folder)
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match="no stereo pair"):
        MiddleburyStereo(tmp_path / "empty")
    with pytest.raises(DataError, match="no such folder"):
        MiddleburyStereo(tmp_path / "none")
