import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from flowlik.errors import DataError
from flowlik.image.texture import (
    TextureDefinition,
    derivatives,
    eigenbasis,
    sample_tensor,
    structure_tensor,
    tensors_at,
)
from flowlik.support import threads

NOISE = np.random.default_rng(0).integers(0, 256, (37, 53), dtype=np.uint8)
SCHARR = np.array([[-3, 0, 3], [-10, 0, 10], [-3, 0, 3]]) / 32


def twin(image, window):
    """Structure tensor in scipy; its ``mirror`` is OpenCV's BORDER_REFLECT_101."""
    gx, gy = (ndimage.correlate(image.astype(float), k, mode="mirror") for k in (SCHARR, SCHARR.T))
    products = (gx * gx, gx * gy, gy * gy)
    return np.stack([ndimage.uniform_filter(p, window, mode="mirror") for p in products], axis=-1)


@pytest.mark.parametrize("window", [1, 3, 5, 9])
@pytest.mark.parametrize("shape", [(37, 53), (9, 9), (12, 40)])
def test_structure_tensor_agrees_with_scipy_up_to_the_borders(window, shape):
    image = np.ascontiguousarray(NOISE[: shape[0], : shape[1]])
    S = structure_tensor(image, TextureDefinition(window=window))
    np.testing.assert_allclose(S, twin(image, window), rtol=1e-12, atol=1e-9)


def test_texture_does_not_depend_on_the_number_of_threads(monkeypatch):
    image = np.random.default_rng(4).integers(0, 256, (450, 300), dtype=np.uint8)
    results = []
    for number in (1, 2):
        monkeypatch.setattr(threads, "THREADS", number)
        S = structure_tensor(image)
        results.append((S, *eigenbasis(S)))
    for one, two in zip(*results):
        np.testing.assert_array_equal(one, two)
    np.testing.assert_allclose(results[0][0], twin(image, 5), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(("axis", "e1"), [(1, [1, 0]), (0, [0, 1])])
def test_a_unit_ramp_has_one_gradient_of_one(axis, e1):
    ramp = np.indices((20, 30))[axis].astype(np.uint8)
    t, R_i_e = eigenbasis(structure_tensor(ramp)[5:-5, 5:-5])
    np.testing.assert_array_equal(t[..., 0], 1)
    np.testing.assert_array_equal(t[..., 1], 0)
    np.testing.assert_allclose(np.abs(R_i_e[..., 0]), np.broadcast_to(e1, t.shape), atol=1e-15)


def test_eigenvalues_and_eigenvectors_agree_with_numpy():
    S = structure_tensor(NOISE)
    t, R_i_e = eigenbasis(S)
    matrices = S[..., [0, 1, 1, 2]].reshape(*S.shape[:2], 2, 2)
    values, vectors = np.linalg.eigh(matrices)
    np.testing.assert_allclose(t, values[..., ::-1], rtol=1e-9)
    along = np.einsum("...ij,...ij->...j", R_i_e, vectors[..., ::-1])
    np.testing.assert_allclose(np.abs(along), 1, atol=1e-12)


def test_interior_eigenvalues_agree_with_opencv_up_to_its_documented_scale():
    t, R_i_e = eigenbasis(structure_tensor(NOISE))
    result = cv2.cornerEigenValsAndVecs(NOISE, 5, -1)
    # OpenCV divides derivatives by 2^2 * block * 2 * 255 and sums over the block
    scale = (4 * 5 * 2 * 255) ** 2 / (25 * 32**2)
    inner = np.s_[3:-3, 3:-3]
    np.testing.assert_allclose(np.sort(result[inner][..., :2] * scale), np.sort(t[inner]), rtol=1e-4)
    e1 = np.einsum("...i,...i->...", result[inner][..., 2:4], R_i_e[inner][..., 0])
    distinct = t[inner][..., 0] > 1.1 * t[inner][..., 1]
    np.testing.assert_allclose(np.abs(e1[distinct]), 1, atol=1e-4)


# nothing between 0 and the least a tensor of whole grey values can be
entries = st.just(0.0) | st.floats(1e-6, 1e5)
tensors = st.tuples(entries, st.floats(-1, 1), entries).map(
    lambda s: np.array([[s[0], s[1] * np.sqrt(s[0] * s[2]), s[2]]])
)


@given(tensors)
def test_every_tensor_is_rebuilt_by_a_rotation(S):
    t, R = (a[0] for a in eigenbasis(S))
    assert t[0] >= t[1] >= 0
    np.testing.assert_allclose(R @ R.T, np.eye(2), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1, abs=1e-12)
    xx, xy, yy = S[0]
    np.testing.assert_allclose(R @ np.diag(t) @ R.T, [[xx, xy], [xy, yy]], atol=1e-9 * max(t[0], 1e-300))


def test_the_eigenbasis_of_isotropic_tensors_is_the_identity():
    values = np.append(np.random.default_rng(3).uniform(0, 1e4, 1000), 0)
    t, R_i_e = eigenbasis(np.stack([values, 0 * values, values], axis=-1))
    np.testing.assert_allclose(t, np.stack([values, values], axis=-1), rtol=1e-15)
    assert (t[:, 0] >= t[:, 1]).all()
    np.testing.assert_array_equal(R_i_e, np.broadcast_to(np.eye(2), R_i_e.shape))


def test_sub_pixel_samples_are_bilinear_and_clamped():
    S = structure_tensor(NOISE)
    pixels = np.random.default_rng(1).uniform([-3, -3], [56, 40], (300, 2))
    expected = [ndimage.map_coordinates(S[..., c], pixels.T[::-1], order=1, mode="nearest") for c in range(3)]
    np.testing.assert_allclose(sample_tensor(S, pixels), np.transpose(expected), rtol=1e-12, atol=1e-9)
    np.testing.assert_array_equal(sample_tensor(S, np.array([[52.0, 36], [0, 0]])), [S[36, 52], S[0, 0]])


@pytest.mark.parametrize("window", [1, 3, 5, 9])
@pytest.mark.parametrize("count", [15, 2000])
def test_tensors_at_a_few_pixels_are_those_of_the_whole_image_to_the_bit(window, count):
    definition = TextureDefinition(window=window)
    rng = np.random.default_rng(5)
    pixels = np.concatenate(
        [rng.uniform([-2, -2], [54, 38], (count, 2)), [[0, 0], [52, 36], [52, 0], [0.5, 36]]]
    )
    expected = sample_tensor(structure_tensor(NOISE, definition), pixels)
    np.testing.assert_array_equal(tensors_at(NOISE, pixels, definition), expected)
    np.testing.assert_array_equal(tensors_at(NOISE, pixels, definition, derivatives(NOISE)), expected)


def test_tensors_of_a_single_row_are_those_of_the_whole_image():
    row, definition = NOISE[:1], TextureDefinition(window=1)
    pixels = np.array([[3.5, 0.0], [40, 0]])
    expected = sample_tensor(structure_tensor(row, definition), pixels)
    np.testing.assert_array_equal(tensors_at(row, pixels, definition), expected)


def test_sampling_keeps_tensors_positive_semi_definite():
    pixels = np.random.default_rng(2).uniform([0, 0], [52, 36], (2000, 2))
    xx, xy, yy = sample_tensor(structure_tensor(NOISE), pixels).T
    assert (xx * yy - xy**2 >= 0).all()


@pytest.mark.parametrize("window", [0, -3, 4])
def test_an_impossible_window_is_refused(window):
    with pytest.raises(DataError, match="window"):
        TextureDefinition(window=window)


def test_an_unknown_derivative_is_refused():
    with pytest.raises(DataError, match="'sobel'"):
        TextureDefinition(derivative="sobel")


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (NOISE.astype(np.float32), "grey uint8"),
        (NOISE[..., None].repeat(3, axis=2), "grey uint8"),
        (NOISE[:4], "smaller than the texture window"),
    ],
)
def test_what_is_no_grey_image_is_refused(image, message):
    with pytest.raises(DataError, match=message):
        structure_tensor(image)
