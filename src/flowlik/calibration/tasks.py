"""Blocks of image pairs and what is sketched of them: the units of a calibration's work."""

from __future__ import annotations

from dataclasses import dataclass

from flowlik.datasets.base import ImageSequence
from flowlik.flow.base import FlowMethod
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.covariates import covariate
from flowlik.likelihood.schedule import Index


@dataclass(frozen=True)
class Block:
    """A run of image pairs of one sequence, by their first frames: the unit of parallel work."""

    sequence: ImageSequence
    firsts: range
    seed: int


@dataclass(frozen=True)
class Task:
    """What to sketch of every image pair: one sketch for each index of a method's errors.

    Attributes
    ----------
    method : FlowMethod
        Flow.
    indices : tuple of Index
        One sketch each, all of the same measurements.
    keep : tuple of str
        Covariates that the reservoirs keep besides those of the indices, from which an index can be learned.
    texture : TextureDefinition
        Definition of texture.
    pixels : int or None
        About so many stratified pixels of a dense method's image; None for all. A sparse method is measured
        on a grid and at its corners.

    Raises
    ------
    ModelError
        If a covariate is unknown, when signals are asked for.
    """

    method: FlowMethod
    indices: tuple[Index, ...] = (Index(),)
    keep: tuple[str, ...] = ()
    texture: TextureDefinition = TextureDefinition()  # noqa: RUF009
    pixels: int | None = None

    @property
    def covariates(self) -> tuple[str, ...]:
        """Every covariate that is measured, texture first."""
        needed = dict.fromkeys(name for index in self.indices for name in index.covariates)
        return tuple(dict.fromkeys(["texture", *needed, *self.keep]))

    @property
    def signals(self) -> tuple[str, ...]:
        """Every signal that must be measured."""
        return tuple(sorted({s for name in self.covariates for s in covariate(name).signals}))
