"""Plants: trees, bushes, ferns, grass; each drawn anew from a generator.

They stand with the foot at the origin and grow towards negative y. Materials are indices in the scene's list.
"""

from __future__ import annotations

import numpy as np

from flowlik.simulation.render import Foliage, LeafShape, Mesh, Prototype
from flowlik.simulation.things._leaves import (
    BLADE,
    CLUSTER,
    LANCEOLATE,
    LOBED,
    NEEDLES,
    OVATE,
    PALMATE,
    along_twigs,
    leaves_of,
)
from flowlik.simulation.things._vectors import UP, unit
from flowlik.simulation.things._wood import Branches, Habit, bark_of, grow, roots, side_branches, trunk

_BROAD_LEAVES: tuple[tuple[LeafShape, float], ...] = (
    (OVATE, 0.58),
    (LOBED, 0.62),
    (PALMATE, 0.95),
    (CLUSTER, 0.75),
    (LANCEOLATE, 0.3),
)
"""Shapes and their half width as a share of the half length."""


def broadleaf(
    rng: np.random.Generator,
    leaves: int,
    bark: int,
    leaf: int,
    cover: float = 1.0,
    twigs: bool = True,
    species: int | None = None,
) -> Prototype:
    """Broad-leaved tree of 8 to 15 m, forked or with one trunk.

    Parameters
    ----------
    rng : Generator
        Draws everything.
    leaves : int
        Number of leaves; fewer are larger.
    bark, leaf : int
        Materials.
    cover : float
        Area of all leaves as a share of that of a tree in summer.
    twigs : bool
        Whether the wood is built down to the twigs, else limbs only.
    species : int or None
        Shape of the leaves, 0 to 4; None draws it.
    """
    kind = int(rng.integers(len(_BROAD_LEAVES))) if species is None else species
    height_m = rng.uniform(8, 15)
    radius_m = height_m * rng.uniform(0.013, 0.021)
    forked = rng.random() < 0.45
    stem = trunk(rng, height_m * (0.42 if forked else 0.86), radius_m, 0.055, top=0.6 if forked else 0.2)
    base = rng.uniform(0.28, 0.5)
    if forked:
        fork = Habit(int(rng.integers(2, 4)), (0.9, 1.0), (0.35, 0.45), (1.15, 1.15), 9, 0.1, 0.12, 0.8)
        leaders = side_branches(rng, stem, fork)
        limbs = side_branches(
            rng, leaders, Habit(8, (0.2, 0.98), (1.1, 0.5), (0.52, 0.3), 6, 0.1, 0.16, 0.55)
        )
        limbs_of = [leaders, limbs]
    else:
        limbs = side_branches(
            rng, stem, Habit(20, (base, 0.97), (1.25, 0.55), (0.34, 0.14), 6, 0.1, 0.16, 0.5)
        )
        limbs_of = [limbs]
    boughs = side_branches(rng, limbs, Habit(6, (0.25, 1.0), (0.9, 0.35), (0.6, 0.35), 4, 0.05, 0.25))
    fine = side_branches(rng, boughs, Habit(6, (0.2, 1.0), (1.0, 0.4), (0.6, 0.4), points=2))
    broken = Habit(4, (0.25, 0.9 * base + 0.1), (1.3, 1.1), (0.03, 0.03), 3, 0.05, 0.2, 0.3)
    stubs = side_branches(rng, stem, broken)
    wood = [_trunk_of(rng, stem, 14 if twigs else 7, bark)]
    if twigs:
        # leaves hide most of the twigs
        wood += [bark_of(branches, 6, bark) for branches in (*limbs_of, stubs)]
        wood += [bark_of(boughs.coarser(2), 3, bark), bark_of(fine.every(3), 3, bark)]
    else:
        wood += [bark_of(branches.coarser(2), 3, bark) for branches in limbs_of]
    shape, flatness = _BROAD_LEAVES[kind]
    size_m = 0.105 * np.sqrt(7000 * cover / max(leaves, 1) * 0.6 / flatness) * (height_m / 12)
    foliage = _leaves_on(rng, [fine, boughs], leaves, size_m, flatness, shape, leaf)
    return Prototype(Mesh.joined(wood), foliage)


def conifer(
    rng: np.random.Generator,
    leaves: int,
    bark: int,
    leaf: int,
    cover: float = 1.0,
    twigs: bool = True,
    pine: bool | None = None,
) -> Prototype:
    """Spruce with boughs almost to the ground, or pine with a bare trunk below its crown; 10 to 17 m.

    `leaves` counts sprays of needles, `pine` None draws the kind; the other parameters are those of
    `broadleaf`.
    """
    is_pine = rng.random() < 0.4 if pine is None else pine
    height_m = rng.uniform(10, 17)
    stem = trunk(rng, height_m, height_m * rng.uniform(0.011, 0.017), 0.05 if is_pine else 0.02, top=0.08)
    if is_pine:
        limbs = side_branches(
            rng, stem, Habit(34, (0.55, 0.99), (1.45, 0.5), (0.2, 0.07), 5, 0.1, 0.14, 0.35)
        )
        boughs = side_branches(rng, limbs, Habit(7, (0.35, 1.0), (0.8, 0.4), (0.5, 0.3), 3, 0.12, 0.2))
    else:
        low = rng.uniform(0.1, 0.22)
        limbs = side_branches(
            rng, stem, Habit(90, (low, 0.99), (1.75, 0.95), (0.2, 0.03), 5, 0.04, 0.05, 0.22)
        )
        boughs = side_branches(rng, limbs, Habit(7, (0.2, 1.0), (0.9, 0.5), (0.42, 0.22), 3, -0.08, 0.1))
    dead = side_branches(rng, stem, Habit(14, (0.14, 0.55), (1.5, 1.3), (0.05, 0.08), 3, -0.05, 0.15, 0.12))
    wood = [
        _trunk_of(rng, stem, 14 if twigs else 7, bark),
        bark_of(limbs.coarser(2 if twigs else 4), 3, bark),
    ]
    if twigs:
        wood += [bark_of(dead.coarser(2), 3, bark), bark_of(boughs.every(4).coarser(2), 3, bark)]
    size_m = 0.13 * np.sqrt(7000 * cover / max(leaves, 1)) * (height_m / 13)
    foliage = _leaves_on(rng, [boughs, limbs], leaves, size_m, 0.75, NEEDLES, leaf, level=0.7)
    return Prototype(Mesh.joined(wood), foliage)


def bush(rng: np.random.Generator, leaves: int, bark: int, leaf: int, cover: float = 1.0) -> Prototype:
    """Shrub of about 1.5 m: stems from one root, twigs, leaves; parameters are those of `broadleaf`."""
    count = int(rng.integers(7, 12))
    around = rng.uniform(0, 2 * np.pi, count)
    out = rng.uniform(0.25, 1.0, count)
    directions = np.column_stack([out * np.cos(around), -np.ones(count), out * np.sin(around)])
    starts = np.column_stack([0.06 * np.cos(around), np.full(count, 0.15), 0.06 * np.sin(around)])
    lengths = rng.uniform(0.9, 1.7, count)
    stems = grow(rng, starts, directions, lengths, rng.uniform(0.008, 0.016, count), 6, -0.03, 0.12)
    fine = side_branches(rng, stems, Habit(7, (0.25, 1.0), (0.9, 0.4), (0.42, 0.22), 3, 0.05, 0.2))
    shape, flatness = _BROAD_LEAVES[int(rng.integers(len(_BROAD_LEAVES)))]
    size_m = 0.055 * np.sqrt(1200 * cover / max(leaves, 1) * 0.6 / flatness)
    foliage = _leaves_on(rng, [fine, stems], leaves, size_m, flatness, shape, leaf)
    return Prototype(
        Mesh.joined([bark_of(stems, 3, bark), bark_of(fine.every(2).coarser(2), 3, bark)]), foliage
    )


def grass_tuft(rng: np.random.Generator, blades: int, leaf: int) -> Prototype:
    """Blades of grass of 0.1 to 0.45 m on a patch of about 0.6 m."""
    x, z = rng.normal(0, 0.26, (2, blades))
    roots_m = np.column_stack([x, np.full(blades, 0.03), z])
    half = rng.uniform(0.07, 0.22, (blades, 1)) * np.exp(-(x**2 + z**2) / 0.4)[:, None]
    along = unit(UP + 0.35 * rng.standard_normal((blades, 3)) * [1, 0, 1] + 0.5 * roots_m * [1, 0, 1])
    across = unit(np.cross(along, rng.standard_normal((blades, 3))))
    faces = np.cross(along, across)
    faces *= np.where(faces[:, [1]] > 0, -1.0, 1.0)
    centres = roots_m + half * along
    shade = np.clip(0.35 + 3 * half[:, 0], 0, 0.9)
    normals = unit(faces + 1.2 * UP)
    leaves = leaves_of(centres, half * along, 0.008 * across, normals, shade, BLADE, leaf)
    return Prototype(Mesh.joined([]), leaves)


def fern(rng: np.random.Generator, leaf: int) -> Prototype:
    """Fronds of about 0.7 m, arching out of one root."""
    count, pairs = int(rng.integers(7, 12)), 20
    around = np.arange(count) * 2 * np.pi / count + rng.normal(0, 0.25, count)
    directions = np.column_stack([0.6 * np.cos(around), -np.ones(count), 0.6 * np.sin(around)])
    lengths = rng.uniform(0.5, 0.9, count)
    fronds = grow(
        rng, np.tile([0.0, 0.05, 0.0], (count, 1)), directions, lengths, np.full(count, 0.005), 8, -0.2, 0.05
    )
    share = np.tile(np.linspace(0.18, 0.99, pairs), 2)
    start, tangent, _ = fronds.at(np.broadcast_to(share, (count, 2 * pairs)))
    sides = unit(np.cross(tangent, UP)) * np.repeat([1.0, -1.0], pairs)[:, None]
    half = lengths[:, None, None] * (0.14 * np.sin(np.pi * share**0.55) + 0.012)[:, None]
    along = unit(sides + 0.45 * tangent - 0.12 * UP + 0.06 * rng.standard_normal(start.shape))
    across = unit(np.cross(np.cross(along, tangent), along))
    faces = np.cross(along, across)
    faces *= np.where(faces[..., [1]] > 0, -1.0, 1.0)
    order = rng.permutation(count * 2 * pairs)
    along, across, centres = half * along, 0.2 * half * across, start + half * along
    centres, along, across, normals = (
        part.reshape(-1, 3)[order] for part in (centres, along, across, unit(faces + 0.5 * UP))
    )
    shade = np.clip(np.tile(0.3 + 0.6 * share, count), 0, 0.9)[order]
    leaves = leaves_of(centres, along, across, normals, shade, LANCEOLATE, leaf)
    return Prototype(bark_of(fronds.coarser(3), 3, leaf), leaves)


def _trunk_of(rng: np.random.Generator, stem: Branches, sides: int, bark: int) -> Mesh:
    stem = stem if sides > 10 else stem.coarser(2)
    return bark_of(stem, sides, bark, roots(rng, stem, sides))


def _leaves_on(
    rng: np.random.Generator,
    twigs: list[Branches],
    leaves: int,
    half_length_m: float,
    flatness: float,
    shape: LeafShape,
    material: int,
    level: float = 0.9,
) -> Foliage | None:
    """Leaves along twigs, most of them on the finest, which come first; in random order."""
    if leaves == 0:
        return None
    counts = np.array([len(branches) for branches in twigs]) * 0.35 ** np.arange(len(twigs))
    of_kind = rng.multinomial(leaves, counts / counts.sum())
    places, outward = [], []
    for branches, number in zip(twigs, of_kind):
        which = rng.integers(0, len(branches), number)
        chosen = Branches(branches.points[which], branches.radii[which])
        start, tangent, _ = chosen.at(1 - 0.85 * rng.random((number, 1)) ** 1.3)
        aside = unit(rng.standard_normal((number, 3)))
        places.append(start[:, 0] + 0.6 * half_length_m * aside)
        outward.append(unit(0.6 * tangent[:, 0] + 0.8 * aside))
    order = rng.permutation(leaves)
    return along_twigs(
        rng,
        np.concatenate(places)[order],
        np.concatenate(outward)[order],
        half_length_m,
        flatness,
        shape,
        material,
        level,
    )
