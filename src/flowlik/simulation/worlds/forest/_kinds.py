"""What the forest is made of: materials, and a few drawings of each kind of thing."""

from __future__ import annotations

import numpy as np

from flowlik.simulation.render import Layer, Material, Prototype, Surface
from flowlik.simulation.things import broadleaf, bush, conifer, fern, grass_tuft, house, rock


def _bark(reflectance: float, texture: str, contrast: float) -> Material:
    layers = (Layer(texture, 0.9, contrast), Layer("macro", 3.3, 0.3), Layer("moss", 1.7, 0.25))
    return Material((Surface(reflectance, layers, relief_m=0.02),), variation=0.2)


def _leaf(reflectance: float, translucency: float = 0.4) -> Material:
    surface = Surface(reflectance, (Layer("leaf", 0.2, 0.5),))
    return Material((surface,), translucency=translucency, variation=0.35)


MATERIALS = {
    "ground": Material(
        (
            Surface(
                0.16, (Layer("litter", 1.9, 0.95), Layer("macro", 13.0, 0.4), Layer("moss", 5.3, 0.45)), 0.02
            ),
            Surface(
                0.2, (Layer("grass", 1.7, 0.75), Layer("macro", 17.0, 0.4), Layer("litter", 6.1, 0.25)), 0.015
            ),
            Surface(
                0.25, (Layer("earth", 2.7, 0.6), Layer("macro", 19.0, 0.35), Layer("gravel", 1.9, 0.2)), 0.01
            ),
        ),
        fray=Layer("moss", 2.3, 0.5),
    ),
    "hills": Material((Surface(0.13, (Layer("canopy", 40.0, 0.9), Layer("macro", 190.0, 0.3))),)),
    "bark": _bark(0.14, "bark", 0.85),
    "bark-pale": _bark(0.26, "bark", 0.5),
    "bark-conifer": _bark(0.15, "bark-conifer", 0.8),
    "leaf-dark": _leaf(0.12),
    "leaf": _leaf(0.17),
    "leaf-light": _leaf(0.23),
    "needle": _leaf(0.11, 0.25),
    "grass": _leaf(0.2),
    "fern": _leaf(0.16),
    "rock": Material(
        (Surface(0.3, (Layer("rock", 1.3, 0.7), Layer("macro", 4.1, 0.35), Layer("moss", 2.9, 0.3)), 0.02),),
        variation=0.25,
    ),
    "plaster": Material(
        (Surface(0.6, (Layer("plaster", 3.0, 0.5), Layer("macro", 11.0, 0.15))),), variation=0.15
    ),
    "brick": Material((Surface(0.28, (Layer("brick", 2.0, 0.6), Layer("macro", 9.0, 0.25)), 0.006),)),
    "roof": Material((Surface(0.2, (Layer("roof-tiles", 3.0, 0.7), Layer("macro", 8.0, 0.3)), 0.02),)),
    "window": Material(
        (Surface(0.08, (Layer("glass", 3.0, 0.8),)), Surface(0.55, (Layer("macro", 2.0, 0.1),)))
    ),
}
"""Reflectances are luma."""


def material(name: str) -> int:
    """Index of a material."""
    return list(MATERIALS).index(name)


def make_kinds(seed: int, leaves: int, foliage: float) -> dict[str, list[Prototype]]:
    """A few drawings of each kind of thing, by name.

    Parameters
    ----------
    seed : int
        Draws everything.
    leaves : int
        Leaves of a tree beside the paths, if foliage is 1; a "far tree" is the same with fewer, larger ones.
    foliage : float
        Number of leaves as a share of the usual.
    """
    wood = ["bark", "bark", "bark-pale", "bark", "bark-pale", "bark"]
    green = ["leaf-dark", "leaf", "leaf", "leaf-light", "leaf-dark", "leaf-light"]

    def trees(share: float, twigs: bool) -> list[Prototype]:
        count = round(leaves * foliage * share)
        broad = [
            broadleaf(_stream(seed, i), count, material(wood[i]), material(green[i]), foliage, twigs, i % 5)
            for i in range(6)
        ]
        needles = [
            conifer(
                _stream(seed, 6 + i),
                count,
                material("bark-conifer"),
                material("needle"),
                foliage,
                twigs,
                i > 1,
            )
            for i in range(4)
        ]
        return broad + needles

    bushes = round(0.2 * leaves * foliage)
    return {
        "tree": trees(1.0, twigs=True),
        "far tree": trees(0.4, twigs=False),
        "bush": [
            bush(_stream(seed, 20 + i), bushes, material("bark"), material(green[i]), foliage)
            for i in range(5)
        ],
        "fern": [fern(_stream(seed, 30 + i), material("fern")) for i in range(3)],
        "grass": [grass_tuft(_stream(seed, 40 + i), 80, material("grass")) for i in range(4)],
        "rock": [rock(_stream(seed, 50 + i), material("rock")) for i in range(4)],
        "stone": [rock(_stream(seed, 60 + i), material("rock"), cells=4) for i in range(3)],
        "house": [_house(_stream(seed, 70 + i), "plaster" if i % 2 == 0 else "brick") for i in range(4)],
    }


def _house(rng: np.random.Generator, wall: str) -> Prototype:
    width_m, depth_m = rng.uniform([7, 6], [11, 8])
    storeys = int(rng.integers(1, 3))
    return Prototype(
        house(rng, material(wall), material("roof"), material("window"), width_m, depth_m, storeys)
    )


def _stream(seed: int, number: int) -> np.random.Generator:
    return np.random.default_rng([seed, 100 + number])
