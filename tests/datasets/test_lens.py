"""Lenses: which are refused for which images, and undistorted images as a pinhole would have seen them."""

from functools import cache

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.datasets import Lens, open_sequence
from flowlik.datasets._frames import DepthFrames
from flowlik.datasets._lens_models import BrownConrady, DoubleSphere, KannalaBrandt
from flowlik.datasets.next_frame import motion_to_next, true_flow
from flowlik.datasets.undistorted import Undistorted
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.image.sampling import sample_inverse_depth

W, H = 96, 64
BARREL = Lens(60.0, 60.0, 47.5, 31.5, BrownConrady((-0.3, 0.1, 0.001, -0.002)), (W, H))
PINCUSHION = Lens(60.0, 60.0, 47.5, 31.5, BrownConrady((0.3, 0.05, 0.001, -0.002)), (W, H))
FISHEYE = Lens(50.0, 50.0, 46.0, 33.0, KannalaBrandt((0.05, -0.01, 0.002, -0.0005)), (W, H))
SPHERES = Lens(45.0, 45.5, 48.0, 30.0, DoubleSphere(-0.2, 0.6), (W, H))
LENSES = [BARREL, PINCUSHION, FISHEYE, SPHERES]
IDS = ["barrel", "pincushion", "fisheye", "double sphere"]
each_lens = pytest.mark.parametrize("lens", LENSES, ids=IDS)


def grid(width=W, height=H):
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(float)


def seen_by_opencv(lens, points):
    """Pixels at which true points are seen: by OpenCV, and of the double sphere by the paper's formula."""
    K, origin = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]]), np.zeros((2, 3))
    rays = np.column_stack([points, np.ones(len(points))])
    if isinstance(lens.model, DoubleSphere):
        xi, alpha = lens.model.xi, lens.model.alpha
        shifted = xi * np.linalg.norm(rays, axis=1) + 1
        below = alpha * np.hypot(np.linalg.norm(points, axis=1), shifted) + (1 - alpha) * shifted
        return points / below[:, None] * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    project = cv2.fisheye.projectPoints if isinstance(lens.model, KannalaBrandt) else cv2.projectPoints
    return project(rays[:, None], *origin, K, np.array(lens.model.coefficients))[0][:, 0]


def pattern(pixels):
    return 128 + 60 * np.sin(pixels[..., 0] / 7) * np.cos(pixels[..., 1] / 9)


@each_lens
def test_maps_say_where_the_lens_shows_a_pixel(lens):
    camera = lens.pinhole((H, W))
    columns, rows = lens.maps((H, W))
    points = (grid() - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    expected = seen_by_opencv(lens, points).reshape(H, W, 2)
    np.testing.assert_allclose(np.stack([columns, rows], axis=-1), expected, atol=1e-4)


@each_lens
def test_the_pinhole_keeps_the_scale_at_the_principal_point(lens):
    camera = lens.pinhole((H, W))
    assert (camera.cx, camera.cy) == (lens.cx, lens.cy)
    near = np.array([[lens.cx, lens.cy], [lens.cx + 1e-3, lens.cy], [lens.cx, lens.cy + 1e-3]])
    moved = lens.straighten(near, (H, W)) - near
    np.testing.assert_allclose(moved[1:] - moved[0], 0, atol=1e-5)


@each_lens
def test_an_undistorted_image_is_what_a_pinhole_would_have_seen(lens):
    """A distorted image of a known one, where it shows it; elsewhere it is black, and said to be."""
    seen = lens.straighten(grid(), (H, W)).reshape(H, W, 2)
    shown = np.isfinite(seen).all(axis=-1)
    distorted = np.where(shown, pattern(seen).round(), 77).astype(np.uint8)
    found, valid = lens.undistort(distorted), lens.valid((H, W))
    assert np.abs(found - pattern(grid().reshape(H, W, 2)))[valid].max() < 3
    columns, rows = lens.maps((H, W))
    beyond = (columns < -2) | (columns > W + 1) | (rows < -2) | (rows > H + 1)
    assert (found[beyond] == 0).all()
    assert not (beyond & valid).any()


def test_what_a_pincushion_does_not_show_is_not_valid():
    valid = PINCUSHION.valid((H, W))
    assert 0.5 < valid.mean() < 0.95
    assert valid[32, 48]
    assert not valid[[0, 0, -1, -1], [0, -1, 0, -1]].any()
    assert BARREL.valid((H, W)).all()


@each_lens
def test_straightened_pixels_are_seen_where_they_were(lens):
    straight = lens.straighten(grid(), (H, W))
    known = np.isfinite(straight).all(axis=1)
    assert known.mean() > 0.9
    camera = lens.pinhole((H, W))
    points = (straight[known] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    np.testing.assert_allclose(seen_by_opencv(lens, points), grid()[known], atol=1e-5)


@each_lens
def test_flow_is_straightened_at_both_ends(lens):
    """Flow of a plane in front, as the lens shows it, becomes the pinhole's, which is the same everywhere."""
    shape, move = (H, W), np.array([1.5, -0.8])
    straight = lens.straighten(grid(), shape)
    camera = lens.pinhole(shape)
    points = (straight + move - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    known = np.isfinite(points).all(axis=1)
    flow = np.full((H * W, 2), np.nan)
    flow[known] = seen_by_opencv(lens, points[known]) - grid()[known]
    found = lens.straighten_flow(flow.reshape(H, W, 2))
    valid = lens.valid(shape)
    assert np.isnan(found[~valid]).all()
    inner = valid & np.isfinite(found).all(axis=-1)
    assert inner.sum() > 0.95 * valid.sum()
    np.testing.assert_allclose(found[inner], np.tile(move, (inner.sum(), 1)), atol=0.01)
    wrong = flow.reshape(H, W, 2)[inner] - move
    assert np.nanmax(np.abs(wrong)) > 0.2


def test_a_lens_of_no_distortion_changes_nothing():
    lens = Lens(60.0, 60.0, 47.5, 31.5)
    image = np.random.default_rng(0).integers(0, 255, (H, W), np.uint8)
    assert not lens.distorts
    np.testing.assert_array_equal(lens.undistort(image), image)
    np.testing.assert_allclose(lens.straighten(grid(), (H, W)), grid(), atol=1e-9)


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        (Lens(60, 60, 48, 32, size=(97, 64)), "of 97 x 64 pixels, these are 96 x 64; .*--resize"),
        (Lens(60, 60, 96, 64, size=(W, H)), r"principal point \(96, 64\) outside of the image"),
        (Lens(60, 60, -1, 32, size=(W, H)), r"principal point \(-1, 32\) outside of the image"),
        (Lens(60, 60, 24, 16), "far from the middle of the image, .* 96 x 64 pixels, and no size is given"),
        (Lens(60, 60, 47.5, 39), "far from the middle"),
        (Lens(60, 60, 64, 43), "far from the middle"),
        (Lens(60, 60, 47.5, 31.5, BrownConrady((-0.8, 0, 0, 0))), "turns back 26 px from the"),
        (Lens(60, 60, 47.5, 31.5, KannalaBrandt((-0.9, 0, 0, 0))), "turns back 2. px from the"),
    ],
)  # fmt: skip
def test_a_lens_that_is_not_of_these_images_is_refused(lens, message):
    for use in (lens.pinhole, lens.maps, lens.valid):
        with pytest.raises(DataError, match=message):
            use((H, W))


def test_a_camera_for_half_or_twice_the_size_is_never_taken():
    """The images' size is not in KITTI's calib.txt, nor in numbers: another scale shows by the middle."""
    right = Lens(700, 700, 607.2, 185.2)
    assert right.pinhole((376, 1241)).fx == 700
    for scale in (0.5, 0.75, 1.25, 1.5, 2.0):
        with pytest.raises(DataError, match=r"outside of the image|far from the middle"):
            right.pinhole((round(376 * scale), round(1241 * scale)))


EUROC = BrownConrady((-0.283408, 0.073959, 0.000194, 1.8e-5))
TUM = BrownConrady((0.2624, -0.9531, -0.0054, 0.0026, 1.1633))
RAW_KITTI = BrownConrady((-0.3728, 0.2037, 0.0022, 0.0014, -0.0723))
KINECT = BrownConrady((0.514, -2.697, 9e-4, -3e-4, 1.497, 0.391, -2.517, 1.425))
T265 = KannalaBrandt((-0.00763, 0.0448, -0.0426, 0.00791))
KNOWN = {
    "EuRoC": Lens(458.65, 457.3, 367.2, 248.4, EUROC, (752, 480)),
    "TUM": Lens(517.3, 516.5, 318.6, 255.3, TUM, (640, 480)),
    "KITTI raw": Lens(984.2, 980.8, 690, 233.2, RAW_KITTI, (1392, 512)),
    "a Kinect's": Lens(607.3, 607.2, 638, 367.1, KINECT, (1280, 720)),
    "a T265's": Lens(286.4, 286.3, 417.2, 403.0, T265, (848, 800)),
    "TUM VI": Lens(158.28, 158.27, 254.96, 256.88, DoubleSphere(-0.172, 0.593), (512, 512)),
}


@pytest.mark.parametrize("name", KNOWN)
def test_lenses_that_there_are_are_taken(name):
    """Real ones, some of which turn back, beyond what their images show."""
    lens = KNOWN[name]
    assert lens.valid(lens.size[::-1]).mean() > 0.9


def test_a_distortion_may_turn_back_beyond_what_the_pinhole_looks_at():
    """At 42 px of 57 to the corner, but the undistorted image ends before it comes so far."""
    lens = Lens(60, 60, 47.5, 31.5, BrownConrady((-0.3, 0.0, 0.0, 0.0)), (W, H))
    assert lens.valid((H, W)).all()


def test_mirrored_pixels_beyond_the_limit_are_not_shown():
    """A pincushion whose radius leaves the image, and at larger ones comes back through its middle."""
    lens = Lens(16, 16, 47.5, 31.5, BrownConrady((0.6, -0.06, 0, 0)), (W, H))
    points = (grid() - (47.5, 31.5)) / 16
    beyond = np.linalg.norm(points, axis=1) >= lens.model.limit
    mirrored = seen_by_opencv(lens, points) * beyond[:, None]
    back = beyond & (mirrored > 2).all(axis=1) & (mirrored < (W - 3, H - 3)).all(axis=1)
    assert back.sum() > 10
    assert not lens.valid((H, W)).ravel()[beyond].any()
    assert (lens.undistort(np.full((H, W), 200, np.uint8)).ravel()[beyond] == 0).all()


class Plane(DepthFrames):
    camera = BARREL.pinhole((H, W))

    def depth(self, k):
        return np.full((H, W), 2.0)

    def T_n_c(self, k):
        return RigidTransform.from_translation([0.1 * k, 0, 0])


@pytest.fixture
def plane(tmp_path):
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((H, W), 100, np.uint8))
    return Plane("plane", sorted(tmp_path.iterdir()))


def test_depth_is_undistorted_with_the_images(plane):
    """A frontal plane keeps its depth, and its flow is that of the pinhole camera."""
    sequence = Undistorted(plane, BARREL)
    flow = sequence.flow(0)
    known = np.isfinite(flow).all(axis=-1)
    assert known.all()
    np.testing.assert_allclose(flow[known], np.tile([-3.0, 0.0], (known.sum(), 1)), atol=1e-12)
    assert sequence.visible(0)[32, 48]


def test_an_undistorted_sequence_says_which_pixels_are_shown(plane):
    sequence = Undistorted(plane, PINCUSHION)
    assert sequence.camera == PINCUSHION.pinhole((H, W))
    np.testing.assert_array_equal(sequence.valid, PINCUSHION.valid((H, W)))
    np.testing.assert_array_equal(sequence.mask(1), sequence.valid)
    assert (sequence.image(0)[sequence.valid] == 100).all()
    assert (sequence.image(0)[~sequence.valid] < 100).mean() > 0.5
    np.testing.assert_array_equal(np.isfinite(sequence.depth(0)), sequence.valid)


def test_a_folder_is_undistorted_as_it_is_read(tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 255, (H, W), np.uint8), (0, 0), 2)
    for k in range(3):
        cv2.imwrite(str(folder / f"{k}.png"), image)
    path = tmp_path / "camera.yaml"
    k1, k2, p1, p2 = BARREL.model.coefficients
    path.write_text(
        f"cam0:\n  camera_model: pinhole\n  distortion_model: radtan\n  resolution: [96, 64]\n"
        f"  intrinsics: [60, 60, 47.5, 31.5]\n  distortion_coeffs: [{k1}, {k2}, {p1}, {p2}]\n"
    )
    for camera in (path, str(path), f"{path}:cam0", BARREL):
        sequence = open_sequence(folder, camera=camera, frames_per_second=10)
        assert sequence.camera == BARREL.pinhole((H, W))
        np.testing.assert_array_equal(sequence.image(1), BARREL.undistort(image))
    assert (len(sequence), sequence.timestamp(2), sequence.times_source) == (3, 0.2, "frame/10s")
    with pytest.raises(DataError, match="no depth"):
        sequence.depth(0)
    with pytest.raises(DataError, match=r"camera\.yaml: no camera cam1, there are cam0"):
        open_sequence(folder, camera=f"{path}:cam1")
    path.write_text(path.read_text().replace("96, 64", "96, 65"))
    with pytest.raises(DataError, match="made for images of 96 x 65 pixels, these are 96 x 64"):
        open_sequence(folder, camera=path)
    with pytest.raises(DataError, match="no such file; expected f,cx,cy"):
        open_sequence(folder, camera="none.yaml")


class SeenThrough(DepthFrames):
    """A simulated flight of twice the size, as a lens or, for comparison, a pinhole camera shows it."""

    camera = None

    def __init__(self, flight, camera, lens=None):
        self.flight, self.camera, self.name = flight, camera, "seen"
        self.shape = (camera.height, camera.width)
        fine = (grid(2 * camera.width, 2 * camera.height) + 0.5) / 2 - 0.5
        self.fine, self.coarse = (
            ((p if lens is None else lens.straighten(p, self.shape)) + 0.5) * 2 - 0.5
            for p in (fine, grid(camera.width, camera.height))
        )

    def __len__(self):
        return len(self.flight)

    def image(self, k):
        at = self.fine.astype(np.float32).reshape(2 * self.shape[0], 2 * self.shape[1], 2)
        large = cv2.remap(self.flight.image(k), at[..., 0], at[..., 1], cv2.INTER_CUBIC)
        return cv2.resize(large, self.shape[::-1], interpolation=cv2.INTER_AREA)

    def depth(self, k):
        with np.errstate(divide="ignore"):
            return 1 / sample_inverse_depth(self.flight.depth(k), self.coarse).reshape(self.shape)

    def timestamp(self, k):
        return self.flight.timestamp(k)

    def T_n_c(self, k):
        return self.flight.T_n_c(k)

    def flow(self, k):
        return true_flow(self.camera, self.depth(k), motion_to_next(self, k))


FLIGHT_LENSES = [
    Lens(80, 80, 121, 78, BrownConrady((-0.1, 0.01, 0.001, -0.002)), (240, 160)),
    Lens(80, 80, 121, 78, KannalaBrandt((0.05, -0.01, 0.002, -0.0005)), (240, 160)),
    Lens(72, 72, 121, 78, DoubleSphere(-0.1, 0.55), (240, 160)),
]


@pytest.fixture(scope="module")
def flight():
    from flowlik.simulation import simulate

    found = simulate("planes", "curve", frames=4, camera=Pinhole(480, 320, 160, 160, 242.5, 156.5), seed=2)
    found.image, found.depth = cache(found.image), cache(found.depth)  # seen through seven lenses
    return found


def drift_and_coverage(sequence):
    """Drift [%] of odometry with depth, and the share of errors within their 90 % interval."""
    from flowlik.calibration import pair_errors
    from flowlik.egomotion import lcmsac
    from flowlik.flow import confirmed_method
    from flowlik.likelihood.model_file import load_likelihood
    from flowlik.odometry.loop import run_odometry
    from flowlik.odometry.odometry import Odometry

    model = load_likelihood("lucas-kanade")
    method = confirmed_method(model.method, None)
    odometry = Odometry(sequence.camera, method, lcmsac(model))
    for _ in run_odometry(sequence, odometry, "depth"):
        pass
    poses = [sequence.T_n_c(0).inv() * sequence.T_n_c(k) for k in range(len(sequence))]
    length = np.linalg.norm(np.diff([T.translation for T in poses], axis=0), axis=1).sum()
    drift = 100 * np.linalg.norm(odometry.poses[-1].translation - poses[-1].translation) / length
    errors = pair_errors(sequence, 0, method, model.texture, grid(240, 160)[::7], model.signals)
    within = np.abs(errors.z) <= model.bound(model.coordinate(errors.measurements), 0.9)
    return drift, within.mean()


def test_a_flight_through_each_lens_drifts_no_more_than_without(flight):
    camera = Pinhole(240, 160, 80, 80, 121, 78)
    drift, coverage = drift_and_coverage(SeenThrough(flight, camera))
    assert drift < 3
    assert coverage > 0.9
    for lens in FLIGHT_LENSES:
        assert lens.pinhole((160, 240)) == camera
        seen = SeenThrough(flight, camera, lens)
        undistorted_drift, undistorted_coverage = drift_and_coverage(Undistorted(seen, lens))
        wrong_drift, wrong_coverage = drift_and_coverage(seen)
        assert undistorted_drift < drift + 1 < wrong_drift / 2
        assert undistorted_coverage > 0.84 > wrong_coverage + 0.1
