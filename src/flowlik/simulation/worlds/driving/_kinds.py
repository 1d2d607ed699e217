"""What stands along roads: a few drawings of each kind of thing, of which worlds hold copies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flowlik.simulation.render import Mesh, Prototype
from flowlik.simulation.things import (
    OVAL,
    Maker,
    billboard,
    bollard,
    broadleaf,
    bush,
    car,
    conifer,
    facade_block,
    fence,
    gantry,
    garden_wall,
    grass_tuft,
    guard_rail,
    hedge,
    house,
    lorry,
    railing,
    street_lamp,
    traffic_sign,
    van,
)
from flowlik.simulation.worlds.driving._materials import POSTER_PERIOD_M, material
from flowlik.support.arrays import Array

SEGMENT_M = {"hedge": 2.0, "fence": 4.0, "wall": 4.0, "railing": 4.0, "guard-rail": 4.0}
"""Lengths of the pieces of which boundaries are made."""

_CLEAR_M = 3.6
"""Height below which street trees have no leaves."""


@dataclass(frozen=True, eq=False)
class Kinds:
    """Drawings of things, and where they are in the list of prototypes.

    Attributes
    ----------
    prototypes : tuple of Prototype
        All drawings.
    numbers : dict of str to tuple of int
        Indices of the drawings of each kind.
    half_sizes_m : array (P, 2)
        Half size of each drawing's mesh along x and z [m], about the origin.
    """

    prototypes: tuple[Prototype, ...]
    numbers: dict[str, tuple[int, ...]]
    half_sizes_m: Array

    def pick(self, rng: np.random.Generator, kind: str) -> int:
        """Index of one drawing of a kind, at random."""
        return int(rng.choice(self.numbers[kind]))

    def picks(self, rng: np.random.Generator, kind: str, count: int) -> NDArray[np.int64]:
        """Indices (count,) of drawings of a kind, at random."""
        return rng.choice(np.array(self.numbers[kind], np.int64), count)


def make_kinds(seed: int, leaves: int) -> Kinds:
    """Draw everything that may stand along roads.

    Parameters
    ----------
    seed : int
        Draws everything.
    leaves : int
        Leaves of a street tree; trees farther from the road have fewer, larger ones.
    """
    makers = _makers(leaves)
    prototypes: list[Prototype] = []
    numbers: dict[str, tuple[int, ...]] = {}
    for k, (kind, (count, make)) in enumerate(makers.items()):
        numbers[kind] = tuple(range(len(prototypes), len(prototypes) + count))
        for i in range(count):
            made = make(np.random.default_rng([seed, 31, k, i]), i)
            prototypes.append(Prototype(made) if isinstance(made, Mesh) else made)
    return Kinds(tuple(prototypes), numbers, np.array([_half_size(p) for p in prototypes]))


def _pruned(tree: Prototype, height_m: float) -> Prototype:
    """Tree without the leaves below some height [m]."""
    if tree.foliage is None:
        return tree
    leaves = tree.foliage
    keep = leaves.centres[:, 1] < -height_m
    parts = {name: getattr(leaves, name)[keep] for name in ("centres", "along", "across", "normals", "shade")}
    return Prototype(tree.mesh, replace(leaves, **parts))


def _plain(tree: Prototype) -> Prototype:
    """Tree with leaves of only four triangles each."""
    return tree if tree.foliage is None else Prototype(tree.mesh, replace(tree.foliage, shape=OVAL))


_Made = Mesh | Prototype
_Make = Callable[[np.random.Generator, int], _Made]


def _makers(leaves: int) -> dict[str, tuple[int, _Make]]:
    """How many drawings of each kind there are, and what draws the i-th of them."""
    m = material
    few = max(leaves * 3 // 5, 4)
    greens = [m("leaf-dark"), m("leaf"), m("leaf-light"), m("leaf"), m("leaf-dark")]
    bark = m("bark")
    hedge_m = (0.9, 1.2, 1.6, 2.0)

    def vehicle(make: Maker, paints: tuple[str, ...]) -> _Make:
        return lambda rng, i: make(rng, m(paints[i % len(paints)]), m("glass"), m("tyre"), m("shadow"))

    def villa(rng: np.random.Generator, i: int) -> Mesh:
        wall = m("brick") if i % 4 == 3 else m("plaster")
        size = rng.uniform([8.5, 7.5], [13.0, 10.5])
        return house(rng, wall, m("roof"), m("window"), size[0], size[1], int(rng.integers(1, 4)))

    def block(rng: np.random.Generator, i: int) -> Mesh:
        facade = m(("facade-a", "facade-b", "facade-c")[i % 3])
        width_m = 3.0 * int(rng.integers(3, 6))
        return facade_block(
            rng, facade, m("trim"), m("roof"), width_m, rng.uniform(9, 12), int(rng.integers(2, 5))
        )

    def avenue(rng: np.random.Generator, i: int) -> Prototype:
        return _pruned(broadleaf(rng, leaves, bark, greens[i], 1.7, species=i), _CLEAR_M)

    def boundary(make: Callable[[float, float, int, int], Mesh], kind: str, a: str, b: str) -> _Make:
        return lambda rng, i: make(SEGMENT_M[kind], rng.uniform(0.8, 1.7), m(a), m(b))

    return {
        "car": (12, vehicle(car, ("silver", "black", "white", "grey"))),
        "van": (3, vehicle(van, ("white", "silver", "grey"))),
        "lorry": (2, vehicle(lorry, ("white", "grey"))),
        "house": (12, villa),
        "block": (9, block),
        "avenue": (5, avenue),
        "garden": (5, lambda rng, i: broadleaf(rng, few, bark, greens[i], 1.4, False, i)),
        "tree": (5, lambda rng, i: _plain(broadleaf(rng, few, bark, greens[i], 1.5, False, i))),
        "conifer": (3, lambda rng, i: conifer(rng, few * 3 // 5, bark, m("needle"), 1.2, False)),
        "bush": (5, lambda rng, i: _plain(bush(rng, few // 5, bark, greens[i], 1.5))),
        "tuft": (3, lambda rng, i: grass_tuft(rng, 60, m("blade"))),
        "hedge": (4, lambda rng, i: hedge(rng, m("hedge-core"), m("hedge"), SEGMENT_M["hedge"], hedge_m[i])),
        "fence": (3, boundary(fence, "fence", "fence", "post")),
        "wall": (3, boundary(garden_wall, "wall", "plaster", "trim")),
        "railing": (2, lambda rng, i: railing(SEGMENT_M["railing"], rng.uniform(0.9, 1.4), m("post"))),
        "lamp": (1, lambda rng, i: street_lamp(m("metal"), m("light"))),
        "sign": (8, lambda rng, i: traffic_sign(rng, m("face"), m("metal"), POSTER_PERIOD_M)),
        "billboard": (3, lambda rng, i: billboard(rng, m("face"), m("metal"), POSTER_PERIOD_M)),
        "bollard": (1, lambda rng, i: bollard(m("light"), m("dark"))),
        "guard-rail": (1, lambda rng, i: guard_rail(SEGMENT_M["guard-rail"], m("metal"))),
        "gantry": (2, lambda rng, i: gantry(16.0, m("face"), m("metal"), POSTER_PERIOD_M)),
    }  # fmt: skip


def _half_size(prototype: Prototype) -> Array:
    vertices = prototype.mesh.vertices
    return np.abs(vertices[:, [0, 2]]).max(axis=0) if len(vertices) else np.full(2, 0.3)
