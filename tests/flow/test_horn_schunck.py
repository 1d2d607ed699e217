import cv2
import numpy as np
import pytest
from scipy import ndimage, sparse

from flowlik.errors import ModelError
from flowlik.flow import HornSchunck, _kernels, flow_method
from flowlik.support import threads
from tests.helpers import textured_image

SHAPE = (61, 84)
PREVIOUS = textured_image(SHAPE)


def relax(flow, gu, gv, residual, inverse, omega, colour, first, last):
    """Plain numpy twin of the kernel; of all rows."""
    assert (first, last) == (0, len(flow))
    beyond = np.pad(flow, ((1, 1), (1, 1), (0, 0)), mode="edge")
    mean = (beyond[1:-1, :-2] + beyond[1:-1, 2:] + beyond[:-2, 1:-1] + beyond[2:, 1:-1]) / 4
    g = np.stack([gu, gv], axis=-1)
    solved = mean - g * ((np.sum(g * mean, axis=-1) + residual) * inverse)[..., None]
    chosen = np.indices(residual.shape).sum(axis=0) % 2 == colour
    flow[chosen] += omega * (solved - flow)[chosen]


def warp_cubic(image, flow, first, last, warped):
    """Plain numpy twin of the kernel, by Catmull-Rom's matrix."""
    rows, columns = np.indices(image.shape)
    u, v = columns + flow[..., 0].astype(float), rows + flow[..., 1].astype(float)
    inside = (u >= 0) & (v >= 0) & (u <= image.shape[1] - 1) & (v <= image.shape[0] - 1)
    u, v = np.where(inside, u, 0), np.where(inside, v, 0)
    matrix = np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]]) / 2
    weights = [((x % 1)[..., None] ** np.arange(4)) @ matrix for x in (u, v)]
    around = np.arange(-1, 3)
    x = np.clip(np.floor(u).astype(int)[..., None] + around, 0, image.shape[1] - 1)
    y = np.clip(np.floor(v).astype(int)[..., None] + around, 0, image.shape[0] - 1)
    patches = image[y[..., :, None], x[..., None, :]]
    warped[:] = np.where(inside, np.einsum("hwj,hwi,hwji->hw", weights[1], weights[0], patches), np.nan)


def equations(rng):
    """Gradients and residual of a random linear problem, some pixels without data."""
    gu, gv, residual = rng.normal(0, 8, (3, *SHAPE)).astype(np.float32)
    gu[:20, :30] = gv[:20, :30] = 0
    return gu, gv, residual


@pytest.mark.parametrize("colour", [0, 1])
def test_relaxation_is_its_numpy_twin(colour):
    rng = np.random.default_rng(0)
    gu, gv, residual = equations(rng)
    flow = rng.normal(0, 2, (*SHAPE, 2)).astype(np.float32)
    inverse = 1 / (np.float32(400) + gu**2 + gv**2)
    twin = flow.copy()
    for half_sweep, target in ((_kernels.relax, flow), (relax, twin)):
        half_sweep(target, gu, gv, residual, inverse, np.float32(1.9), colour, 0, len(flow))
    np.testing.assert_allclose(flow, twin, atol=1e-5)


def test_warping_is_its_numpy_twin():
    rng = np.random.default_rng(1)
    image = rng.normal(128, 30, SHAPE).astype(np.float32)
    flow = rng.normal(0, 6, (*SHAPE, 2)).astype(np.float32)
    flow[::7] = np.rint(flow[::7])
    warped, twin = np.empty_like(image), np.empty_like(image)
    _kernels.warp_cubic(image, flow, 0, len(image), warped)
    warp_cubic(image, flow, 0, len(image), twin)
    np.testing.assert_array_equal(np.isnan(warped), np.isnan(twin))
    np.testing.assert_allclose(warped, twin, atol=1e-3)
    assert 0.01 < np.isnan(twin).mean() < 0.5


def test_the_sweeps_solve_the_linear_equations():
    gu, gv, residual = equations(np.random.default_rng(2))
    flow = np.zeros((*SHAPE, 2), np.float32)
    HornSchunck(alpha=4, iterations=900)._solve(flow, gu, gv, residual)
    # -s * Laplacian with free borders, and the data term's 2x2 blocks
    paths = [sparse.diags_array([-np.ones(n - 1), -np.ones(n - 1)], offsets=[-1, 1]) for n in SHAPE]
    paths = [path - sparse.diags_array(path.sum(axis=1)) for path in paths]
    laplacian = sparse.kron(paths[0], sparse.eye_array(SHAPE[1])) + sparse.kron(
        sparse.eye_array(SHAPE[0]), paths[1]
    )
    a, b, c = (x.astype(float).ravel() for x in (gu, gv, residual))
    products = [[sparse.diags_array(x * y) for y in (a, b)] for x in (a, b)]
    smooth = sparse.kron(sparse.eye_array(2), 16 * laplacian)
    system = (smooth + sparse.block_array(products)).tocsc()
    exact = sparse.linalg.spsolve(system, -np.concatenate([a * c, b * c]))
    np.testing.assert_allclose(flow.reshape(-1, 2).T.ravel(), exact, atol=2e-4)


def test_the_whole_method_is_its_twin(monkeypatch):
    current = textured_image(SHAPE, shift=(3.2, -1.4))
    flow = HornSchunck().dense(PREVIOUS, current)
    monkeypatch.setattr(_kernels, "relax", relax)
    monkeypatch.setattr(_kernels, "warp_cubic", warp_cubic)
    np.testing.assert_allclose(flow, HornSchunck().dense(PREVIOUS, current), atol=2e-3)


@pytest.mark.parametrize(
    ("shift", "median"),
    [((0.4, 0.3), 1), ((0.4, 0.3), 5), ((2.3, -1.1), 1), ((2.3, -1.1), 5), ((-7.6, 4.2), 5)],
)
def test_a_translation_is_found(shift, median):
    current = textured_image((120, 160), shift=shift)
    flow = HornSchunck(median=median).dense(textured_image((120, 160)), current)
    error = np.linalg.norm(flow - shift, axis=-1)[12:-12, 12:-12]
    assert error.mean() < 0.05
    assert np.percentile(error, 95) < 0.05


def test_a_zoom_is_found():
    centre, scale = np.array([79.5, 59.5]), 1.03
    image = textured_image((120, 160)).astype(np.float32)
    v, u = np.indices(image.shape, dtype=float)
    back = [(x - c) / scale + c for x, c in ((v, centre[1]), (u, centre[0]))]
    zoomed = np.clip(np.rint(ndimage.map_coordinates(image, back, order=3)), 0, 255).astype(np.uint8)
    truth = (scale - 1) * np.stack([u - centre[0], v - centre[1]], axis=-1)
    error = np.linalg.norm(HornSchunck().dense(image.astype(np.uint8), zoomed) - truth, axis=-1)
    assert np.median(error[12:-12, 12:-12]) < 0.05


@pytest.mark.parametrize("shape", [SHAPE, (1, 1), (1, 40), (2, 3)])
def test_a_constant_image_does_not_move(shape):
    flat = np.full(shape, 77, np.uint8)
    assert (HornSchunck().dense(flat, flat) == 0).all()


def test_what_leaves_the_image_is_filled_in():
    wide = textured_image((120, 200))
    flow = HornSchunck().dense(wide[:, 40:], wide[:, 30:-10])
    assert np.isfinite(flow).all()
    np.testing.assert_allclose(np.median(flow[:, -8:], axis=(0, 1)), [10, 0], atol=0.5)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_the_number_of_threads_changes_nothing(monkeypatch, workers):
    previous, current = textured_image((200, 120)), textured_image((200, 120), shift=(1.5, 0.5))
    expected = HornSchunck().dense(previous, current)
    monkeypatch.setattr(threads, "THREADS", workers)
    before = cv2.getNumThreads()
    try:
        cv2.setNumThreads(workers)
        np.testing.assert_array_equal(HornSchunck().dense(previous, current), expected)
    finally:
        cv2.setNumThreads(before)


@pytest.mark.parametrize("parameters", [{"relaxation": 2.0}, {"median": 4}, {"median": 7}])
def test_parameters_it_cannot_run_with_are_refused(parameters):
    with pytest.raises(ModelError, match="relaxation must be below 2 and median 1, 3 or 5"):
        flow_method({"name": "horn-schunck", **parameters})
