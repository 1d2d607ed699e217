"""What surfaces along roads look like."""

from __future__ import annotations

from flowlik.simulation.render import Layer, Material, Surface

POSTER_PERIOD_M = 4.0
"""Period of the tile of signs and posters."""

_ROAD = Surface(
    0.125, (Layer("asphalt", 3.1, 1.0), Layer("road-wear", 19.0, 1.0), Layer("gravel", 4.3, 0.4)), 0.006
)
_LAWN = Surface(0.1, (Layer("grass", 1.9, 1.0), Layer("macro", 11.0, 0.45)), 0.012)
_WILD = Surface(0.09, (Layer("grass", 2.9, 1.0), Layer("litter", 1.9, 0.6), Layer("macro", 23.0, 0.5)), 0.02)
_SETTS = Surface(0.17, (Layer("paving", 1.3, 0.8), Layer("macro", 7.0, 0.35)), 0.004)


def _plain(reflectance: float, layers: tuple[Layer, ...] = (), variation: float = 0.0) -> Material:
    return Material((Surface(reflectance, layers),), variation=variation)


def _paint(reflectance: float, variation: float) -> Material:
    return _plain(reflectance, (Layer("car-paint", 3.1, 0.5),), variation)


def _relief(reflectance: float, layers: tuple[Layer, ...], relief_m: float, variation: float) -> Material:
    return Material((Surface(reflectance, layers, relief_m),), variation=variation)


def _leaf(reflectance: float, translucency: float = 0.4) -> Material:
    return Material(
        (Surface(reflectance, (Layer("leaf", 0.2, 0.5),)),), translucency=translucency, variation=0.35
    )


def _bark(reflectance: float) -> Material:
    layers = (Layer("bark", 0.9, 0.8), Layer("macro", 3.3, 0.3))
    return Material((Surface(reflectance, layers, relief_m=0.015),), variation=0.2)


def _facade(style: str, reflectance: float) -> Material:
    layers = (Layer(f"facade-{style}", 6.0, 0.95), Layer("macro", 23.0, 0.15), Layer("plaster", 1.9, 0.2))
    return _plain(reflectance, layers, variation=0.3)


MATERIALS = {
    "asphalt": Material((_ROAD,)),
    "kerb": _plain(0.3, (Layer("concrete", 1.3, 0.5), Layer("macro", 5.0, 0.3))),
    "strip": Material((_SETTS, _LAWN), fray=Layer("litter", 2.3, 0.4)),
    "paving": Material((Surface(0.22, (Layer("paving", 2.9, 0.7), Layer("macro", 17.0, 0.35)), 0.003),)),
    "gravel": _plain(0.2, (Layer("gravel", 1.7, 0.7), Layer("macro", 9.0, 0.4))),
    "ground": Material((_LAWN, _WILD), fray=Layer("litter", 3.1, 0.5)),
    "marking": _plain(0.5, (Layer("asphalt", 1.1, 0.45), Layer("macro", 3.7, 0.4))),
    "land": Material(
        (
            Surface(0.13, (Layer("macro", 310.0, 0.6), Layer("grass", 37.0, 0.4))),
            Surface(0.06, (Layer("canopy", 57.0, 0.85), Layer("macro", 190.0, 0.5))),
        ),
        fray=Layer("macro", 210.0, 0.8),
    ),
    "plaster": _plain(0.42, (Layer("plaster", 2.3, 0.5), Layer("macro", 17.0, 0.1)), variation=0.4),
    "brick": _relief(0.2, (Layer("brick", 2.0, 0.7), Layer("macro", 9.0, 0.3)), 0.005, 0.25),
    "roof": _relief(0.13, (Layer("roof-tiles", 3.0, 0.75), Layer("macro", 8.0, 0.3)), 0.02, 0.4),
    "window": Material((Surface(0.08, (Layer("glass", 4.7, 0.9),)), Surface(0.5))),
    "facade-a": _facade("a", 0.38),
    "facade-b": _facade("b", 0.42),
    "facade-c": _facade("c", 0.24),
    "trim": _plain(0.4, (Layer("concrete", 2.1, 0.4),), variation=0.3),
    "fence": _relief(0.2, (Layer("fence", 2.0, 0.8), Layer("macro", 7.0, 0.4)), 0.01, 0.4),
    "post": _plain(0.12, (Layer("macro", 1.3, 0.3),)),
    "metal": _plain(0.28, (Layer("concrete", 0.9, 0.3),), variation=0.2),
    "light": _plain(0.6, (Layer("macro", 1.1, 0.15),)),
    "dark": _plain(0.03),
    "face": _plain(0.5, (Layer("posters", POSTER_PERIOD_M, 1.0),)),
    "white": _paint(0.55, 0.1),
    "silver": _paint(0.3, 0.25),
    "grey": _paint(0.12, 0.4),
    "black": _paint(0.025, 0.3),
    "glass": _plain(0.05, (Layer("glass", 3.3, 0.9),)),
    "tyre": Material((Surface(0.025), Surface(0.35, (Layer("concrete", 0.5, 0.5),)))),
    "shadow": Material((Surface(0.02, (Layer("asphalt", 1.7, 0.4),)), _ROAD)),
    "bark": _bark(0.13),
    "leaf-dark": _leaf(0.07),
    "leaf": _leaf(0.1),
    "leaf-light": _leaf(0.14),
    "needle": _leaf(0.06, 0.25),
    "hedge": _leaf(0.09),
    "hedge-core": _plain(0.06, (Layer("hedge", 1.7, 1.0), Layer("macro", 5.0, 0.4))),
    "blade": _leaf(0.14),
}  # fmt: skip
"""Materials by name; reflectances are luma."""


def material(name: str) -> int:
    """Index of a material in the scene's list."""
    return list(MATERIALS).index(name)
