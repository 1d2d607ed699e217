import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.simulation import IDEAL_SENSOR
from flowlik.simulation._noise import TILE_PX
from flowlik.simulation.flight import TRAJECTORIES
from flowlik.simulation.flight._trajectories import training
from flowlik.simulation.worlds.planes import PlanesWorld
from flowlik.simulation.worlds.planes._hall import DISPLAY_GAMMA, HALL_HIGH_M, HALL_LOW_M
from flowlik.simulation.worlds.planes._rectangles import distances_m, pixel_bounds
from flowlik.simulation.worlds.planes._textures import make_textures

TILTED = RigidTransform.from_components(
    [1.3, -0.4, 20.0], Rotation.from_euler("YXZ", [25, -12, 8], degrees=True)
)


def test_depth_of_the_empty_hall_is_the_analytic_one(camera: Pinhole) -> None:
    depth = PlanesWorld(rectangles=0).render(TILTED, camera).depth
    rays_n = TILTED.rotation.apply(camera.rays(camera.pixel_grid()))
    # slab method: the way out of a box along a ray
    exits = np.where(rays_n > 0, HALL_HIGH_M - TILTED.translation, HALL_LOW_M - TILTED.translation) / rays_n
    np.testing.assert_allclose(depth.ravel(), exits.min(axis=1), rtol=1e-9)


def test_depth_meets_a_surface_and_nothing_stands_before_it(camera: Pinhole) -> None:
    world = PlanesWorld()
    depth = world.render(TILTED, camera).depth
    pixels = camera.pixel_grid()[::37]
    rays = camera.rays(pixels)
    points = TILTED.apply(rays * depth.ravel()[::37, None])
    nearest_m = distances_m(points, world.surfaces).min(axis=1)
    assert nearest_m.max() < 1e-9
    # brute force over every plane, in world axes
    surfaces, origin = world.surfaces, TILTED.translation
    rays_n = TILTED.rotation.apply(rays)
    along = rays_n @ surfaces.axes[:, 0].T
    reach = np.einsum("ri,ri->r", surfaces.axes[:, 0], surfaces.centres_m - origin) / along
    hits = origin + reach[..., None] * rays_n[:, None]
    local = np.einsum("rij,nrj->nri", surfaces.axes[:, 1:], hits - surfaces.centres_m)
    on_it = (np.abs(local) <= surfaces.half_sizes_m).all(axis=-1) & (reach > 0)
    first = np.where(on_it, reach, np.inf).min(axis=1)
    np.testing.assert_allclose(depth.ravel()[::37], first, rtol=1e-9)


def test_pixel_bounds_hold_every_visible_point(camera: Pinhole) -> None:
    world, rng = PlanesWorld(), np.random.default_rng(0)
    surfaces = world.surfaces
    bounds = pixel_bounds(surfaces, TILTED, camera)
    for i in range(len(surfaces)):
        local = rng.uniform(-1, 1, (500, 2)) * surfaces.half_sizes_m[i]
        points = surfaces.centres_m[i] + local @ surfaces.axes[i, 1:]
        pixels = camera.v2p(TILTED.inv().apply(points))
        u, v = pixels[camera.contains(pixels)].T
        assert ((u >= bounds[i, 0]) & (u <= bounds[i, 1]) & (v >= bounds[i, 2]) & (v <= bounds[i, 3])).all()


def test_same_bytes_for_any_number_of_threads(camera: Pinhole, monkeypatch: pytest.MonkeyPatch) -> None:
    frames = []
    for threads in (1, 2, 3):
        monkeypatch.setattr("flowlik.support.threads.THREADS", threads)
        frames.append(PlanesWorld().render(TILTED, camera))
    assert len({frame.radiance.tobytes() for frame in frames}) == 1
    assert len({frame.depth.tobytes() for frame in frames}) == 1


def test_another_seed_is_another_world(camera: Pinhole) -> None:
    assert not np.array_equal(PlanesWorld(0).surfaces.centres_m, PlanesWorld(1).surfaces.centres_m)
    assert PlanesWorld(3).mover_poses(1.0) is None
    assert PlanesWorld(3) == PlanesWorld(3) and hash(PlanesWorld(3)) == hash(PlanesWorld(3))


def test_radiance_is_what_the_ideal_sensor_shows_as_the_painted_grey(camera: Pinhole) -> None:
    radiance = PlanesWorld().render(TILTED, camera).radiance
    assert radiance.dtype == np.float32
    assert radiance.min() > 0 and radiance.max() < 1
    grey = IDEAL_SENSOR.signal(radiance, camera)
    np.testing.assert_allclose(grey, 255 * radiance.astype(np.float64) ** (1 / DISPLAY_GAMMA), atol=1e-3)
    # painted between 1 and 254 about a mean in the middle
    assert grey.min() >= 1 and grey.max() <= 254 and grey.std() > 20 and 90 < grey.mean() < 165


def test_image_does_not_depend_on_where_the_pixels_lie(camera: Pinhole) -> None:
    """A camera shifted by half a pixel, averaged over neighbours, sees the camera's own mean brightness."""
    world = PlanesWorld(samples=32)
    shifted = Pinhole(camera.width, camera.height, camera.fx, camera.fy, camera.cx - 0.5, camera.cy)
    image, moved = (IDEAL_SENSOR.signal(world.render(TILTED, c).radiance, c) for c in (camera, shifted))
    between = (image[:, :-1] + image[:, 1:]) / 2
    gradient = image[:, 1:] - image[:, :-1]
    shift_px = (gradient * (moved[:, :-1] - between)).sum() / (gradient**2).sum()
    assert abs(shift_px) < 0.01


@pytest.mark.parametrize("name", TRAJECTORIES)
@pytest.mark.parametrize("seed", range(4))
def test_every_trajectory_keeps_clear(name: str, seed: int) -> None:
    poses = TRAJECTORIES[name](600, 6.0, 60.0, seed)
    assert PlanesWorld(seed).clearance(poses.translation).min() > 1.0


def test_clearance_is_negative_outside() -> None:
    clearance_m = PlanesWorld().clearance(np.array([[0, 0, 0], [0, 3.5, 0], [0, 0, 200.0]]))
    assert clearance_m[0] == pytest.approx(2.5)
    assert clearance_m[1] == pytest.approx(-1.0) and clearance_m[2] < 0


def test_there_are_occlusions_and_near_things(camera: Pinhole) -> None:
    world, poses = PlanesWorld(), training(400)
    depths = np.stack([world.render(poses[k], camera).depth for k in (0, 100, 200, 300)])
    steps = np.maximum(depths[:, :, 1:], depths[:, :, :-1]) / np.minimum(depths[:, :, 1:], depths[:, :, :-1])
    assert (steps > 1.3).mean() > 0.002
    assert np.quantile(depths, 0.01) < 4 and np.quantile(depths, 0.99) > 30


def test_tiles_match_at_their_borders_and_mips_keep_the_mean() -> None:
    textures = make_textures(0)
    for row in textures.pyramids:
        tile = row[: TILE_PX**2].reshape(TILE_PX, TILE_PX)
        assert np.abs(tile).max() <= 1
        inner = np.abs(np.diff(tile, axis=0)).mean()
        assert np.abs(tile[0] - tile[-1]).mean() < 2 * inner
        assert row[-1] == pytest.approx(tile.mean(), abs=1e-4)


@pytest.mark.parametrize("bad", [{"seed": -1}, {"rectangles": -1}, {"samples": 0}])
def test_impossible_worlds_are_refused(bad: dict[str, int]) -> None:
    with pytest.raises(DataError, match="impossible"):
        PlanesWorld(**bad)
