from collections.abc import Callable

import numpy as np
import pytest

from flowlik.simulation.render import Prototype
from flowlik.simulation.things import broadleaf, bush, conifer, fern, grass_tuft, rock
from flowlik.simulation.things._leaves import BLADE, CLUSTER, LANCEOLATE, LOBED, NEEDLES, OVATE, PALMATE

BARK, LEAF = 3, 5
Maker = Callable[[np.random.Generator], Prototype]
MAKERS: dict[str, Maker] = {
    **{f"broadleaf-{k}": lambda rng, k=k: broadleaf(rng, 3000, BARK, LEAF, species=k) for k in range(5)},
    "far-broadleaf": lambda rng: broadleaf(rng, 800, BARK, LEAF, twigs=False),
    "spruce": lambda rng: conifer(rng, 3000, BARK, LEAF, pine=False),
    "pine": lambda rng: conifer(rng, 3000, BARK, LEAF, pine=True),
    "bush": lambda rng: bush(rng, 700, BARK, LEAF),
    "grass": lambda rng: grass_tuft(rng, 80, LEAF),
    "fern": lambda rng: fern(rng, LEAF),
    "rock": lambda rng: rock(rng, BARK),
}
LEAFY = [name for name in MAKERS if name != "rock"]
TREES = [name for name in MAKERS if name.startswith("broadleaf") or name in ("spruce", "pine")]


def made(name: str, seed: int = 1) -> Prototype:
    return MAKERS[name](np.random.default_rng(seed))


def leaf_area_m2(prototype: Prototype) -> float:
    """Sum of length times width."""
    leaves = prototype.foliage
    assert leaves is not None
    sizes = [np.linalg.norm(part.astype(float), axis=1) for part in (leaves.along, leaves.across)]
    return float(4 * (sizes[0] * sizes[1]).sum())


@pytest.mark.parametrize("name", MAKERS)
def test_meshes_are_sound(name: str) -> None:
    mesh = made(name).mesh
    assert np.isfinite(mesh.vertices).all() and np.isfinite(mesh.uv).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-4)
    if len(mesh.triangles):
        assert mesh.triangles.min() >= 0 and mesh.triangles.max() < len(mesh.vertices)
    assert set(mesh.materials) <= {BARK, LEAF}


@pytest.mark.parametrize("name", LEAFY)
def test_leaves_are_sound(name: str) -> None:
    leaves = made(name).foliage
    assert leaves is not None and leaves.material == LEAF
    np.testing.assert_allclose(np.linalg.norm(leaves.normals, axis=1), 1, atol=1e-4)
    half_m, wide_m = (np.linalg.norm(part, axis=1) for part in (leaves.along, leaves.across))
    assert (np.abs((leaves.along * leaves.across).sum(axis=1)) < 1e-4 * half_m * wide_m + 1e-9).all()
    assert (wide_m <= 1.01 * half_m).all()
    assert leaves.shade.min() > 0 and leaves.shade.max() <= 1


@pytest.mark.parametrize("shape", [OVATE, LOBED, LANCEOLATE, PALMATE, CLUSTER, NEEDLES, BLADE])
def test_leaf_shapes_fit_the_renderer_and_their_own_units(shape) -> None:
    assert 4 < len(shape.triangles) <= 16 and len(shape.vertices) <= 16
    assert set(shape.triangles.ravel()) == set(range(len(shape.vertices)))
    reach = np.abs(shape.vertices).max(axis=0)
    assert (reach[:2] > 0.75).all() and (reach[:2] < 1.4).all() and reach[2] < 0.8
    # not flat: up close it catches the light in more than one way
    assert np.ptp(shape.vertices[:, 2]) > 0.1


@pytest.mark.parametrize("name", TREES)
def test_trees_are_tall_and_rooted(name: str) -> None:
    tree = made(name)
    trunk = tree.mesh.vertices[: 14 * 15]
    foot = trunk[trunk[:, 1] > -0.1]
    assert tree.mesh.vertices[:, 1].max() == pytest.approx(0.6, abs=0.05)
    assert np.linalg.norm(foot[:, [0, 2]], axis=1).max() < 1.0
    assert -22 < tree.mesh.vertices[:, 1].min() < -7


@pytest.mark.parametrize("name", TREES)
def test_trunks_spread_into_roots(name: str) -> None:
    vertices = made(name).mesh.vertices[: 14 * 15]
    radius = np.linalg.norm(vertices[:, [0, 2]], axis=1)
    below, above = vertices[:, 1] > -0.3, (vertices[:, 1] < -0.8) & (vertices[:, 1] > -1.8)
    assert radius[below].max() > 1.4 * np.median(radius[above])


@pytest.mark.parametrize("name", TREES)
def test_the_first_leaves_stand_for_all(name: str) -> None:
    leaves = made(name).foliage
    assert leaves is not None and len(leaves) == 3000
    few, spread = leaves.centres[:300], leaves.centres.std(axis=0)
    assert (np.abs(few.mean(axis=0) - leaves.centres.mean(axis=0)) < 0.25 * spread).all()
    np.testing.assert_allclose(few.std(axis=0), spread, rtol=0.2)


@pytest.mark.parametrize("name", [name for name in TREES if name.startswith("broad")])
def test_leaves_grow_on_twigs(name: str) -> None:
    tree = made(name)
    assert tree.foliage is not None
    stems = tree.foliage.centres - tree.foliage.along
    to_wood = np.linalg.norm(stems[:200, None] - tree.mesh.vertices[None], axis=2).min(axis=1)
    assert np.median(to_wood) < 0.4 and to_wood.max() < 1.5


@pytest.mark.parametrize("make", [broadleaf, conifer, bush])
def test_fewer_leaves_cover_as_much_and_cover_scales_the_area(make) -> None:
    many, few = (make(np.random.default_rng(2), count, BARK, LEAF) for count in (4000, 1000))
    half = make(np.random.default_rng(2), 2000, BARK, LEAF, 0.5)
    assert leaf_area_m2(few) == pytest.approx(leaf_area_m2(many), rel=0.1)
    assert leaf_area_m2(half) == pytest.approx(0.5 * leaf_area_m2(many), rel=0.1)


@pytest.mark.parametrize("make", [broadleaf, conifer, bush])
def test_plants_can_be_bare(make) -> None:
    assert make(np.random.default_rng(2), 0, BARK, LEAF).foliage is None


def test_shade_is_deeper_inside_a_crown() -> None:
    leaves = made("broadleaf-0").foliage
    assert leaves is not None
    middle = np.median(leaves.centres, axis=0)
    far = np.linalg.norm((leaves.centres - middle) / leaves.centres.std(axis=0), axis=1)
    inside, outside = leaves.shade[far < 0.8].mean(), leaves.shade[far > 2].mean()
    assert inside < 0.7 * outside


@pytest.mark.parametrize("name", MAKERS)
def test_the_same_generator_makes_the_same_plant(name: str) -> None:
    first, again, other = made(name), made(name), made(name, seed=2)
    parts = [(p.mesh.vertices, p.foliage.centres if p.foliage else None) for p in (first, again, other)]
    np.testing.assert_array_equal(parts[0][0], parts[1][0])
    np.testing.assert_array_equal(parts[0][1], parts[1][1])
    which = 1 if name == "grass" else 0
    assert not np.array_equal(parts[0][which], parts[2][which])


def test_rocks_are_partly_buried_and_closed() -> None:
    mesh = made("rock").mesh
    assert mesh.vertices[:, 1].max() > 0.05 and mesh.vertices[:, 1].min() < -0.2
    _, where = np.unique(np.round(mesh.vertices, 4), axis=0, return_inverse=True)
    corners = where.reshape(-1)[mesh.triangles]
    edges = np.sort(np.concatenate([corners[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    _, uses = np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0, return_counts=True)
    assert (uses == 2).all()
