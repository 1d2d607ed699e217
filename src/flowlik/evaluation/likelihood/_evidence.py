"""Evidence about a likelihood: records and figure arrays of a sketch, in the paper's own form."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Seq
from dataclasses import dataclass
from typing import Any

import numpy as np

from flowlik.calibration.sketch import (
    LEVELS,
    ErrorSketch,
    bin_centres,
    level_centres,
    level_edges,
    magnitude_centres,
    merge_all,
    x_edges,
)
from flowlik.evaluation.likelihood._goodness import (
    CONFIDENCES,
    Counting,
    KolmogorovSmirnov,
    block_interval,
    coverage,
    kolmogorov_smirnov,
    level_bound,
    negative_log_likelihood,
    nll_interval,
    outside_range,
)
from flowlik.flow import method_label
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.tables import magnitude_nodes
from flowlik.results.records import Record, protocol
from flowlik.support.arrays import Array

SHOWN_LEVELS = tuple((10 ** (decade - 0.5), 10.0**decade) for decade in range(4))
OUTSIDE_WARNING = 0.10
QUICK_COUNTING, COUNTED_SHARE = Counting(10_000, 20), 0.95

Sketched = tuple[ErrorSketch, FlowLikelihood]
"""A model, and a population of errors over the model's own index."""


def goodness_records(
    blocks: Seq[ErrorSketch],
    likelihood: FlowLikelihood,
    dataset: str,
    seed: int | None,
    counting: Counting = Counting(),
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
    counting : Counting
        What a texture level needs to be counted in the K-S median.
    **keys
        Further keys of the protocol.
    """
    sketch = merge_all(blocks)
    ks = kolmogorov_smirnov(sketch, likelihood, counting)
    rng = np.random.default_rng(seed)
    filled = [block for block in blocks if block.total]
    nll_range = ks_range = "none"
    if len(filled) > 1:
        nll_low, nll_high = nll_interval(filled, likelihood, rng)
        nll_range = f"{nll_low:.4f} … {nll_high:.4f}"
    if len(filled) > 1 and ks.counted.any():
        ks_low, ks_high = block_interval(
            filled, lambda s: kolmogorov_smirnov(s, likelihood, counting).median, rng
        )
        ks_range = f"{ks_low:.4f} … {ks_high:.4f}"
    record = Recorder(likelihood, dataset, seed, sketch.total)
    note = protocol(**keys, **what_was_kept(sketch))
    counted = note + "; " + protocol(**what_was_counted(ks, counting))
    interval = "interval_95"
    return [
        record(
            "nll",
            negative_log_likelihood(sketch, likelihood),
            "nat",
            note + "; " + protocol(**{interval: nll_range, "bootstrap": "blocks"}),
        ),
        record(
            "ks_median",
            ks.median,
            "",
            counted + "; " + protocol(**{interval: ks_range, "bootstrap": "blocks"}),
        ),
        record("ks_max", ks.maximum, "", counted),
        record("ks_signed_median", ks.signed_median, "", counted),
        record("ks_weighted_mean", ks.weighted_mean, "", note),
        *(record(f"coverage_{c * 100:.0f}", coverage(sketch, likelihood, c), "", note) for c in CONFIDENCES),
        record("outside_fraction", outside_range(sketch, likelihood), "", note),
    ]


@dataclass(frozen=True)
class Recorder:
    """Makes records of one model on one population."""

    likelihood: FlowLikelihood
    dataset: str
    seed: int | None
    count: int

    def __call__(self, metric: str, value: float | None, unit: str, note: str) -> Record:
        """Record of a metric."""
        method = self.likelihood.method
        return Record(
            metric, value, unit, self.dataset, method_label(method) if method else None,
            self.likelihood.family.name, self.likelihood.schedule.name, None, self.count, self.seed, note,
        )  # fmt: skip


def what_was_kept(sketch: ErrorSketch) -> dict[str, object]:
    """Keys of the protocol: image pairs, and what was left out."""
    excluded = ", ".join(f"{count} {reason}" for reason, count in sketch.excluded.items() if count)
    return {"frames": sketch.pairs, "excluded": excluded or "none"}


def what_was_counted(ks: KolmogorovSmirnov, counting: Counting) -> dict[str, object]:
    """Keys of the protocol: what a texture level needed to be counted, and how many did."""
    return {
        "levels": str(counting),
        "counted": f"{int(ks.counted.sum())} of {int((ks.counts > 0).sum())}",
        "counted_share": f"{ks.counted_share:.3f}",
    }


def little_data_warning(sketch: ErrorSketch, what: str) -> str | None:
    """Warning with counts where too few components stand at texture levels that conventions would count.

    Counted levels must hold 95 % of all components: of 1e5 components from 30 image pairs each, in quick
    runs of 1e4 from 20. The warning begins where even the latter do not.
    """
    counts = sketch.by_level.sum(axis=1)

    def share(counting: Counting) -> float:
        return float(counts[counting.counted(counts, sketch.frames)].sum() / max(counts.sum(), 1))

    if share(QUICK_COUNTING) >= COUNTED_SHARE:
        return None
    quick, full = (f"{100 * share(c):.0f} % in those of {c}" for c in (QUICK_COUNTING, Counting()))
    return (
        f"{what}: little data, {sketch.total} error components from {sketch.pairs} image pairs. Conventions "
        f"ask for {100 * COUNTED_SHARE:.0f} % of them in texture levels that count, and here are {quick} and "
        f"{full}: take figures as rough, or add pairs"
    )


def outside_warning(fraction: float, what: str) -> str | None:
    """Warning that a model does not fit the images, where the share outside its range exceeds 10 %."""
    if fraction <= OUTSIDE_WARNING:
        return None
    return (
        f"{what}: {100 * fraction:.0f} % of the error components lie outside the range the model was "
        "calibrated on; it does not know these images, calibrate on similar ones"
    )


def error_over_texture(sketch: ErrorSketch, likelihood: FlowLikelihood) -> dict[str, Array]:
    """Arrays of the paper's Fig. 4: counts over texture and abs(z), with the model's 90 % bound."""
    filled = sketch.by_level.any(axis=1)
    return {
        "texture_edges": level_edges(),
        "error_edges": magnitude_nodes()[::4],
        # a picture needs no more resolution
        "counts": sketch.errors.sum(axis=1).reshape(LEVELS, -1, 4).sum(axis=2),
        "bound_texture": level_centres()[filled],
        "bound_90": level_bound(sketch, likelihood, 0.9)[filled],
    }


def table_arrays(
    sketch: ErrorSketch, likelihood: FlowLikelihood, resampled: Array | None = None
) -> dict[str, Any]:
    """Arrays of the paper's Fig. 5 (look-up table): parameters at the knots, and where the data is.

    With tables (B, P, M) of `flowlik.calibration.bootstrap` also the central 95 % of these.
    """
    index = sketch.index
    arrays = {
        # a constant table has its knots far out
        "knots": np.exp(np.clip(likelihood.schedule.knots, index.low, index.high)),
        "values": likelihood.schedule.values.T,
        "names": np.array([p.name for p in likelihood.family.parameters]),
        "units": np.array([p.unit for p in likelihood.family.parameters]),
        "coordinate": np.array(index.name),
        "edges": np.exp(x_edges(index)),
        "counts": sketch.counts.sum(axis=(1, 2)),
    }
    if resampled is not None:
        low, high = np.percentile(resampled, [2.5, 97.5], axis=0)
        arrays |= {"low": low.T, "high": high.T}
    return arrays


def distributions(sketch: ErrorSketch, likelihood: FlowLikelihood) -> dict[str, Array]:
    """Arrays of the paper's Fig. 5: empirical against fitted densities of signed errors at some textures."""
    edges, centres, texture = magnitude_nodes()[::8], magnitude_centres(), level_centres()
    edges[0] = 0.0  # the first bin holds all errors below it
    middles = 0.5 * (edges[:-1] + edges[1:])
    widths = np.diff(edges)
    theta = likelihood.schedule.theta(bin_centres(sketch.index))
    density = likelihood.family.pdf(centres, theta[:, :, None])
    levels, zs, empirical, fitted = [], [], [], []
    for low, high in SHOWN_LEVELS:
        inside = (texture > low) & (texture < high)
        counts = sketch.errors[inside].sum(axis=0).reshape(2, -1, 8).sum(axis=2)
        total = counts.sum()
        if total < 1000:
            continue
        model = (sketch.by_level[inside].sum(axis=0) / total @ density).reshape(-1, 8).mean(axis=1)
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
    models: Mapping[str, Sketched],
    counting: Counting = Counting(),
    floor: KolmogorovSmirnov | None = None,
) -> dict[str, Any]:
    """Arrays of the paper's Fig. 6: K-S of every model over texture.

    Parameters
    ----------
    models : mapping of str to (ErrorSketch, FlowLikelihood)
        Models, and one population of errors over each model's own index.
    counting : Counting
        What a level needs to be counted.
    floor : KolmogorovSmirnov, optional
        Of `held_out_floor`, drawn beneath.
    """
    results = [kolmogorov_smirnov(*pair, counting) for pair in models.values()]
    first = results[0]
    shown = first.counts > 0
    arrays = {
        "texture": first.texture[shown],
        "families": np.array(list(models)),
        "ks": np.array([ks.statistic[shown] for ks in results]),
        "counted": first.counted[shown],
        "counts": first.counts[shown],
    }
    if floor is not None:
        arrays["floor"] = np.where(floor.counted, floor.statistic, np.nan)[shown]
    return arrays


def reliability(models: Mapping[str, Sketched]) -> dict[str, Any]:
    """Arrays of a reliability diagram: nominal against observed coverage of every model."""
    nominal = np.array([0.1, 0.2, 0.3, 0.4, *CONFIDENCES[:1], 0.6, *CONFIDENCES[1:2], 0.8, *CONFIDENCES[2:]])
    return {
        "nominal": nominal,
        "names": np.array(list(models)),
        "observed": np.array([[coverage(*pair, float(c)) for c in nominal] for pair in models.values()]),
    }
