"""Evidence about a likelihood: records and figure arrays of a sketch, in the paper's own form."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Seq
from typing import Any

import numpy as np

from flowlik.calibration.sketch import ErrorSketch, bin_centres, magnitude_centres, merge_all, x_edges
from flowlik.camera import Array
from flowlik.evaluation.goodness import (
    CONFIDENCES,
    KolmogorovSmirnov,
    block_interval,
    coverage,
    kolmogorov_smirnov,
    negative_log_likelihood,
    nll_interval,
    outside_range,
)
from flowlik.flow import method_label
from flowlik.likelihood import FlowLikelihood
from flowlik.records import Record, protocol
from flowlik.tables import magnitude_nodes

SHOWN_LEVELS = ((0.3, 1.0), (3.0, 10.0), (30.0, 100.0), (300.0, 1000.0))
OUTSIDE_WARNING = 0.10


def goodness_records(
    blocks: Seq[ErrorSketch],
    likelihood: FlowLikelihood,
    dataset: str,
    seed: int | None,
    least_components: int = 100_000,
    least_frames: int = 30,
    **keys: object,
) -> list[Record]:
    """Figures of a likelihood on sketched errors: NLL, K-S, coverage, share outside the calibrated range.

    Parameters
    ----------
    blocks : sequence of ErrorSketch
        Sketches of runs of frames, resampled for the intervals.
    likelihood : FlowLikelihood
        Model.
    dataset : str
        Name of the data.
    seed : int or None
        Seed of the data and of the bootstrap.
    least_components, least_frames : int
        What a texture level needs to be counted in the K-S median.
    **keys
        Further keys of the protocol.
    """
    sketch = merge_all(blocks)
    ks = kolmogorov_smirnov(sketch, likelihood, least_components, least_frames)
    rng = np.random.default_rng(seed)
    filled = [block for block in blocks if block.total]
    nll_low, nll_high = nll_interval(filled, likelihood, rng)
    ks_interval = "none"
    if ks.counted.any():
        ks_low, ks_high = block_interval(
            filled, lambda s: kolmogorov_smirnov(s, likelihood, least_components, least_frames).median, rng
        )
        ks_interval = f"{ks_low:.4f} … {ks_high:.4f}"
    excluded = ", ".join(f"{count} {reason}" for reason, count in sketch.excluded.items() if count)
    note = protocol(**keys, frames=sketch.pairs, excluded=excluded or "none")
    levels = f"≥{least_components} components from ≥{least_frames} frames"
    counted = (
        note
        + "; "
        + protocol(
            levels=levels,
            counted=f"{int(ks.counted.sum())} of {int((ks.counts > 0).sum())}",
            counted_share=f"{ks.counted_share:.3f}",
        )
    )
    method = method_label(likelihood.method) if likelihood.method else None

    def record(metric: str, value: float, unit: str, note: str) -> Record:
        return Record(
            metric,
            value,
            unit,
            dataset,
            method,
            likelihood.family.name,
            likelihood.schedule.name,
            None,
            sketch.total,
            seed,
            note,
        )

    interval = "interval_95"
    return [
        record(
            "nll",
            negative_log_likelihood(sketch, likelihood),
            "nat",
            note + "; " + protocol(**{interval: f"{nll_low:.4f} … {nll_high:.4f}", "bootstrap": "blocks"}),
        ),
        record(
            "ks_median",
            ks.median,
            "",
            counted + "; " + protocol(**{interval: ks_interval, "bootstrap": "blocks"}),
        ),
        record("ks_max", ks.maximum, "", counted),
        record("ks_signed_median", ks.signed_median, "", counted),
        record("ks_weighted_mean", ks.weighted_mean, "", note),
        *(record(f"coverage_{c * 100:.0f}", coverage(sketch, likelihood, c), "", note) for c in CONFIDENCES),
        record("outside_fraction", outside_range(sketch, likelihood), "", note),
    ]


def outside_warning(fraction: float, what: str) -> str | None:
    """Warning that a model does not fit the images, where the share outside its range exceeds 10 %."""
    if fraction <= OUTSIDE_WARNING:
        return None
    return (
        f"{what}: {100 * fraction:.0f} % of the error components lie outside the texture range the model was "
        "calibrated on; it does not know these images, calibrate on similar ones"
    )


def error_over_texture(sketch: ErrorSketch, likelihood: FlowLikelihood) -> dict[str, Array]:
    """Arrays of the paper's Fig. 4: counts over texture and abs(z), with the model's 90 % bound."""
    centres = bin_centres(sketch.index)
    counts, edges = sketch.magnitude_counts, magnitude_nodes()
    # halve the resolution in error and texture: a picture needs no more
    counts = counts.reshape(len(counts) // 2, 2, -1, 4).sum(axis=(1, 3))
    return {
        "texture_edges": np.exp(x_edges(sketch.index)[::2]),
        "error_edges": edges[::4],
        "counts": counts,
        "bound_texture": np.exp(centres),
        "bound_90": likelihood.bound(centres, 0.9),
    }


def table(sketch: ErrorSketch, likelihood: FlowLikelihood) -> dict[str, Any]:
    """Arrays of the paper's Fig. 5 (look-up table): parameters at the knots, and where the data is."""
    return {
        "knots": np.exp(likelihood.schedule.knots),
        "values": likelihood.schedule.values.T,
        "names": np.array([p.name for p in likelihood.family.parameters]),
        "units": np.array([p.unit for p in likelihood.family.parameters]),
        "texture_edges": np.exp(x_edges(sketch.index)),
        "counts_per_texture": sketch.counts.sum(axis=(1, 2)),
    }


def distributions(sketch: ErrorSketch, likelihood: FlowLikelihood) -> dict[str, Array]:
    """Arrays of the paper's Fig. 5: empirical against fitted densities of signed errors at some textures."""
    edges, centres, x = magnitude_nodes()[::8], magnitude_centres(), bin_centres(sketch.index)
    edges[0] = 0.0  # the first bin holds all errors below it
    middles = 0.5 * (edges[:-1] + edges[1:])
    widths = np.diff(edges)
    density = likelihood.family.pdf(centres, likelihood.schedule.theta(x)[:, :, None])
    levels, zs, empirical, fitted = [], [], [], []
    for low, high in SHOWN_LEVELS:
        inside = (x >= np.log(low)) & (x < np.log(high))
        counts = sketch.counts[inside].sum(axis=0).reshape(2, -1, 8).sum(axis=2)
        total = counts.sum()
        if total < 1000:
            continue
        share = sketch.counts[inside].sum(axis=(1, 2)) / total
        model = (share @ density[inside]).reshape(-1, 8).mean(axis=1)
        levels.append((low, high))
        zs.append(np.concatenate([-middles[::-1], middles]))
        empirical.append(np.concatenate([counts[0, ::-1] / widths[::-1], counts[1] / widths]) / total)
        fitted.append(np.concatenate([model[::-1], model]))
    return {
        "level_edges": np.array(levels),
        "z": np.array(zs),
        "empirical": np.array(empirical),
        "fitted": np.array(fitted),
    }


def goodness(
    sketch: ErrorSketch, likelihoods: Mapping[str, FlowLikelihood], least_components: int, least_frames: int
) -> dict[str, Any]:
    """Arrays of the paper's Fig. 6: K-S of every family over texture."""
    results = {
        name: kolmogorov_smirnov(sketch, likelihood, least_components, least_frames)
        for name, likelihood in likelihoods.items()
    }
    first: KolmogorovSmirnov = next(iter(results.values()))
    shown = first.counts > 0
    return {
        "texture": first.texture[shown],
        "families": np.array(list(results)),
        "ks": np.array([ks.statistic[shown] for ks in results.values()]),
        "counted": first.counted[shown],
        "counts": first.counts[shown],
    }


def reliability(sketch: ErrorSketch, likelihoods: Mapping[str, FlowLikelihood]) -> dict[str, Any]:
    """Arrays of a reliability diagram: nominal against observed coverage."""
    nominal = np.array([0.1, 0.2, 0.3, 0.4, *CONFIDENCES[:1], 0.6, *CONFIDENCES[1:2], 0.8, *CONFIDENCES[2:]])
    return {
        "nominal": nominal,
        "names": np.array(list(likelihoods)),
        "observed": np.array(
            [[coverage(sketch, m, float(c)) for c in nominal] for m in likelihoods.values()]
        ),
    }
