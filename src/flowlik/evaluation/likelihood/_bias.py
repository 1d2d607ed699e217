"""Bias: does the flow fall short, as the paper finds of Farnebäck's at low texture? From a sketch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowlik.calibration.sketch import ErrorSketch, level_centres, magnitude_centres
from flowlik.likelihood.tables import magnitude_nodes
from flowlik.results.records import Record, protocol
from flowlik.support.arrays import Array

CAP_PX = 100.0
LOW_TEXTURE = 10**1.75
"""The texture level edge next to the paper's gate, t = 50."""


@dataclass(frozen=True)
class Bias:
    """Asymmetry of the signed error ``s z`` of some populations (L,); NaN where there are no components.

    Attributes
    ----------
    negative : array (L,)
        Share of errors below 0, where the flow falls short; 0.5 without bias.
    median, mean : array (L,)
        Of ``s z`` [px], in the mean capped at 100 px either way.
    median_magnitude : array (L,)
        Of abs(z) [px], to compare with.
    """

    negative: Array
    median: Array
    mean: Array
    median_magnitude: Array


def bias(errors: NDArray[np.int64]) -> Bias:
    """Bias of populations of signed errors, counts (L, 2, Z) as a sketch has."""
    edges = magnitude_nodes()
    edges[0] = 0.0
    total = errors.sum(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        share = errors / total[:, None, None]
        signed = np.concatenate([share[:, 0, ::-1], share[:, 1]], axis=1)
        below = np.pad(np.cumsum(signed, axis=1), ((0, 0), (1, 0)))
        of_magnitude = np.pad(np.cumsum(share.sum(axis=1), axis=1), ((0, 0), (1, 0)))
    signed_edges = np.concatenate([-edges[:0:-1], edges])
    capped = np.minimum(magnitude_centres(), CAP_PX)
    return Bias(
        share[:, 0].sum(axis=1),
        np.array([np.interp(0.5, row, signed_edges) for row in below]),
        (share[:, 1] - share[:, 0]) @ capped,
        np.array([np.interp(0.5, row, edges) for row in of_magnitude]),
    )


def bias_arrays(sketch: ErrorSketch) -> dict[str, Any]:
    """Arrays of the figure of bias over texture."""
    counts = sketch.errors.sum(axis=(1, 2))
    shown = counts > 0
    found = bias(sketch.errors[shown])
    return {
        "texture": level_centres()[shown],
        "negative": found.negative,
        "median": found.median,
        "mean": found.mean,
        "median_magnitude": found.median_magnitude,
        "counts": counts[shown],
    }


def bias_records(
    sketch: ErrorSketch, dataset: str, flow: str | None, seed: int | None, **keys: object
) -> list[Record]:
    """Share of errors that fall short, and the signed error's median and mean: of all, and at low texture.

    Further keys go to the protocol.
    """
    low = level_centres() < LOW_TEXTURE
    records = []
    for suffix, levels, texture in (("", slice(None), "all"), ("_low_texture", low, f"<{LOW_TEXTURE:.3g}")):
        errors = sketch.errors[levels].sum(axis=0, keepdims=True)
        found, count = bias(errors), int(errors.sum())
        note = protocol(**keys, frames=sketch.pairs, texture=texture, cap_px=CAP_PX)
        if not count:
            note += "; " + protocol(reason="no components")
        records += [
            Record(name + suffix, float(value[0]) if count else None, unit, dataset, flow, None, None, None,
                   count, seed, note)
            for name, value, unit in (
                ("negative_share", found.negative, ""),
                ("signed_median", found.median, "px"),
                ("signed_mean", found.mean, "px"),
            )
        ]  # fmt: skip
    return records
