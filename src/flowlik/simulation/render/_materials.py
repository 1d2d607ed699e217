"""What surfaces look like: grey reflectance from layers of texture, mixtures, and relief."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Layer:
    """A tileable texture on a surface.

    Parameters
    ----------
    texture : str
        Name of a tile in `flowlik.simulation.render._textures.tiles`.
    period_m : float
        Size of one tile [m].
    amplitude : float
        The surface's reflectance is multiplied by ``1 + amplitude * (2 * tile - 1)``, tile within 0 to 1.
    """

    texture: str
    period_m: float
    amplitude: float


@dataclass(frozen=True)
class Surface:
    """A matt surface; its reflectance is the mean times every layer's factor.

    Parameters
    ----------
    reflectance : float
        Mean share of the light sent back, 0 to 1.
    layers : tuple of Layer
        At most three, of different periods, so that there is detail at every distance.
    relief_m : float
        Height [m] of the first layer's tile from black to white: tilts the shading normal.
    """

    reflectance: float
    layers: tuple[Layer, ...] = ()
    relief_m: float = 0.0


@dataclass(frozen=True)
class Material:
    """One or more surfaces; a mesh's paint says which of them is seen where.

    Parameters
    ----------
    surfaces : tuple of Surface
        Paint i shows surface i, i + 0.5 an even mixture of i and i + 1.
    fray : Layer or None
        Breaks up the boundaries: adds ``amplitude * (2 * tile - 1)`` to the paint.
    translucency : float
        Share of the sun's light that comes through from behind, for leaves.
    variation : float
        Each leaf's or copy's reflectance is multiplied by a random factor within 1 -+ variation.
    """

    surfaces: tuple[Surface, ...]
    fray: Layer | None = None
    translucency: float = 0.0
    variation: float = 0.0
