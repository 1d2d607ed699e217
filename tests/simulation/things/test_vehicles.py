import numpy as np
import pytest

from flowlik.simulation.render import Mesh
from flowlik.simulation.things import Maker, car, lorry, van
from flowlik.simulation.things._vehicles import SHADOW_HEIGHT_M

PAINT, GLASS, TYRE, SHADOW = range(4)
SIZES_M = {car: (3.5, 5.0, 1.3, 1.65), van: (4.4, 5.7, 1.8, 2.3), lorry: (7.0, 10.5, 3.1, 3.8)}
"""Least and greatest length and height."""


def drawn(make: Maker, seed: int = 0) -> Mesh:
    return make(np.random.default_rng(seed), PAINT, GLASS, TYRE, SHADOW)


def of(mesh: Mesh, material: int) -> np.ndarray:
    return mesh.vertices[np.unique(mesh.triangles[mesh.materials == material])]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("make", [car, van, lorry])
def test_vehicles_have_usual_sizes_and_stand_on_their_wheels(make: Maker, seed: int) -> None:
    mesh = drawn(make, seed)
    body = np.concatenate([of(mesh, PAINT), of(mesh, TYRE)])
    low_l, high_l, low_h, high_h = SIZES_M[make]
    assert low_l < np.ptp(body[:, 2]) < high_l
    assert low_h < -body[:, 1].min() < high_h
    assert 1.6 < np.ptp(body[:, 0]) < 2.9
    # no wheel in the air or in the ground
    assert of(mesh, TYRE)[:, 1].max() == pytest.approx(0.0, abs=0.012)
    assert of(mesh, PAINT)[:, 1].max() < -0.15


@pytest.mark.parametrize("make", [car, van, lorry])
def test_vehicles_are_the_same_on_both_sides(make: Maker) -> None:
    vertices = drawn(make).vertices
    mirrored = vertices * np.array([-1, 1, 1], np.float32)

    def sort(v: np.ndarray) -> np.ndarray:
        return v[np.lexsort(np.round(v, 3).T)]

    distances = np.linalg.norm(vertices[:, None] - mirrored[None], axis=-1).min(axis=1)
    assert (distances < 0.07).mean() > 0.97
    assert abs(sort(vertices)[:, 0].mean()) < 0.03


@pytest.mark.parametrize("make", [car, van, lorry])
def test_the_contact_shadow_is_dark_below_and_fades_to_the_road(make: Maker) -> None:
    mesh = drawn(make)
    rows = np.unique(mesh.triangles[mesh.materials == SHADOW])
    shadow, paint = mesh.vertices[rows], mesh.paint[rows]
    np.testing.assert_allclose(shadow[:, 1], -SHADOW_HEIGHT_M)
    body = of(mesh, PAINT)
    assert paint[(np.abs(shadow[:, 0]) > np.abs(body[:, 0]).max() - 0.1)].min() == 1.0
    assert paint.min() == 0.0


@pytest.mark.parametrize("make", [car, van])
def test_normals_point_out(make: Maker) -> None:
    mesh = drawn(make)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    faces = np.isin(mesh.materials, (PAINT, GLASS))
    corners = mesh.vertices[mesh.triangles[faces]]
    middle = np.array([0, -0.7, corners[..., 2].mean()])
    away = corners.mean(axis=1) - middle
    shading = mesh.normals[mesh.triangles[faces]].mean(axis=1)
    outwards = (away * shading).sum(axis=1) > 0
    # mirrors stand free
    assert outwards.mean() > 0.9


@pytest.mark.parametrize("make", [car, van, lorry])
def test_windscreens_are_glass_and_lie_ahead(make: Maker) -> None:
    mesh = drawn(make)
    glass = of(mesh, GLASS)
    assert glass[:, 1].max() < -0.7
    paint = of(mesh, PAINT)
    assert glass[:, 2].max() > paint[:, 2].mean()
    assert drawn(make).vertices.tobytes() == mesh.vertices.tobytes()
