import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.camera import Pinhole
from flowlik.simulation.render import Daylight, Instances, Material, Scene, Surface, pack_shapes, placed
from flowlik.simulation.render._detail import drawn_leaves
from tests.simulation.render.raster.small_scene import tree

DISTANCES_M = np.geomspace(0.5, 300, 200)


@pytest.fixture(scope="module")
def shapes():
    return pack_shapes([tree(2000)])


def instances(count: int) -> Instances:
    return Instances.of([(0, placed(np.zeros(3)))] * count)


def test_cover_stays_and_changes_are_gradual(shapes):
    fine, leaves, scale = drawn_leaves(shapes, instances(200), DISTANCES_M, 185.0)
    np.testing.assert_allclose(leaves * scale**2, 2000, rtol=1e-12)
    assert fine[0] == 2000 and fine[-1] == 0
    assert leaves[0] == 2000 and leaves[-1] < 100
    assert (np.diff(fine) <= 0).all() and (np.diff(leaves) <= 0).all()


def test_a_step_of_a_frame_changes_few_leaves(shapes):
    near = drawn_leaves(shapes, instances(200), DISTANCES_M, 185.0)
    step = drawn_leaves(shapes, instances(200), DISTANCES_M + 0.1, 185.0)
    far = DISTANCES_M > 5
    assert (np.abs(near[0] - step[0])[far] <= 0.06 * 2000).all()
    assert (np.abs(near[1] - step[1])[far] <= 0.05 * near[1][far] + 1).all()


def test_leaves_cover_as_much_whichever_way_they_are_drawn():
    # one tree from one place, with two focal lengths of one field of view: fine shapes, then fewer rhombi
    scene = Scene.of(
        [tree(2000)], instances(1), [Material((Surface(0.2),))] * 3, Daylight(clouds=0, haze_per_m=0), 0
    )
    view = RigidTransform.from_translation([0, -4, -12])
    covers = []
    for width in (512, 128, 32):
        camera = Pinhole.from_fov(width, width, 40.0)
        frame = scene.render(view, camera)
        sky = scene.render(RigidTransform.from_translation([0, -500, -12]), camera).radiance
        covers.append(float(np.mean(sky - frame.radiance)))
    np.testing.assert_allclose(covers, covers[0], rtol=0.12)
