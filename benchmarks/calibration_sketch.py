"""Whether a sketch is good enough to forget the samples, and a fit of it as good as a fit of them.

Raw components are drawn in chunks from a known Laplace-Cauchy mixture over texture. Log score and K-S of the
fitted model are computed from the sketch, and from the raw samples by code that shares nothing with it but
the model. A plain scipy fit of raw samples is held against the fit of a sketch of the same samples.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from flowlik.calibration import ErrorSketch, fit
from flowlik.calibration._fit import place_knots
from flowlik.calibration.sketch import level_edges
from flowlik.evaluation.likelihood import Counting, kolmogorov_smirnov, negative_log_likelihood
from flowlik.likelihood.families import LaplaceCauchy
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index, Schedule
from flowlik.results.records import Record, protocol, write_records

FAMILY = LaplaceCauchy()
CHUNK = 1_000_000
RAW_FIT = 2_000_000
LEAST = 100_000
Samples = tuple[np.ndarray, np.ndarray]


def truth() -> Schedule:
    """A table like those of real flow; it bends between its knots, as real errors do."""
    x = np.linspace(np.log(0.05), np.log(5e3), 40)
    scale = 2.5 / (1 + np.exp(0.9 * (x - 2))) + 0.03
    weight = 0.75 - 0.3 / (1 + np.exp(x - 3))
    # the family's own parameters: beta from lambda = tan(pi beta / 2), gamma, w
    return Schedule(Index(), x, np.stack([2 / np.pi * np.arctan(1 / scale), 1.5 * scale, weight]))


def chunks(components: int, seed: int) -> Iterator[Samples]:
    """Texture and errors [px] in chunks, the same ones each time."""
    table = truth()
    for i, first in enumerate(range(0, components, CHUNK)):
        rng = np.random.default_rng([seed, i])
        n = min(CHUNK, components - first)
        x = rng.normal(np.log(30.0), 1.6, n).clip(np.log(0.02), np.log(2e4))
        beta, gamma, weight = table.theta(x)
        laplace = rng.laplace(size=n) / np.tan(np.pi / 2 * beta)
        yield np.exp(x), np.where(rng.random(n) < weight, laplace, gamma * rng.standard_cauchy(n))


def sketch(samples: Iterator[Samples]) -> ErrorSketch:
    """Sketch of chunks."""
    merged = ErrorSketch.empty(Index())
    for i, (t, z) in enumerate(samples):
        found = ErrorSketch.of(Index(), {"texture": t}, z, np.ones(len(z)), np.random.default_rng(i))
        merged = merged.merge(found)
    return merged


def raw_nll(samples: Iterator[Samples], model: FlowLikelihood) -> float:
    """Mean negative log-likelihood [nat] of the samples themselves."""
    total, count = 0.0, 0
    for t, z in samples:
        total -= float(model.family.logpdf(z, model.schedule.theta(np.log(t))).sum())
        count += len(z)
    return total / count


def raw_ks(components: int, seed: int, model: FlowLikelihood, levels: list[int]) -> list[float]:
    """K-S of abs(z) at texture levels from the sorted samples; the model's side averages 400 of their x."""
    edges = level_edges()
    found: dict[int, list[Samples]] = {level: [] for level in levels}
    for t, z in chunks(components, seed):
        of = np.searchsorted(edges, t, side="right") - 1
        for level in levels:
            mine = of == level
            found[level].append((t[mine], np.abs(z[mine]).astype(np.float32)))
    statistics = []
    grid = np.concatenate([[0.0], np.geomspace(1e-6, 1e6, 6000)])
    for level in levels:
        t, magnitude = (np.concatenate(part) for part in zip(*found.pop(level)))
        theta = model.schedule.theta(np.log(np.quantile(t, (np.arange(400) + 0.5) / 400)))
        predicted = np.mean([model.family.magnitude_cdf(grid, of_x) for of_x in theta.T], axis=0)
        at_samples = np.interp(np.sort(magnitude), grid, predicted)
        rank = np.arange(len(magnitude) + 1) / len(magnitude)
        above, below = np.abs(rank[1:] - at_samples).max(), np.abs(rank[:-1] - at_samples).max()
        statistics.append(float(max(above, below)))
    return statistics


def raw_fit(samples: Samples, knots: np.ndarray) -> tuple[Schedule, float]:
    """Plain maximum likelihood on raw samples by scipy, as one would write it; table and its NLL [nat]."""
    t, z = samples
    x = np.log(t)
    interval = np.clip(np.searchsorted(knots, x) - 1, 0, len(knots) - 2)
    right = np.clip((x - knots[interval]) / np.diff(knots)[interval], 0, 1)
    shape = (len(FAMILY.parameters), len(knots))

    def objective(flat: np.ndarray) -> tuple[float, np.ndarray]:
        free = flat.reshape(shape)
        values = FAMILY.to_theta(free)
        theta = values[:, interval] * (1 - right) + values[:, interval + 1] * right
        log_prob, slope = FAMILY.logpdf_and_gradient(z, theta)
        by_knot = np.stack([
            np.bincount(interval, row * (1 - right), len(knots))
            + np.bincount(interval + 1, row * right, len(knots))
            for row in slope
        ])  # fmt: skip
        return -log_prob.mean(), (-by_knot / len(z) * FAMILY.link_derivative(free)).ravel()

    whole = FAMILY.start(np.abs(z[:20_000]), np.full(min(len(z), 20_000), 1.0))
    start = FAMILY.to_free(np.repeat(np.asarray(whole)[:, None], len(knots), axis=1))
    result = minimize(objective, start.ravel(), jac=True, method="L-BFGS-B", options={"maxiter": 500})
    return Schedule(Index(), knots, FAMILY.to_theta(result.x.reshape(shape))), float(result.fun)


def costs(work: Callable[[], Any]) -> tuple[Any, float, float]:
    """Result, processor time [s] and peak of what was allocated [MB]."""
    tracemalloc.start()
    start = time.process_time()
    result = work()
    seconds = time.process_time() - start
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return result, seconds, peak


def records(components: int = 50_000_000, raw: int = RAW_FIT, seed: int = 0) -> list[Record]:
    """Errors of what is computed from a sketch, and what the fit of raw samples costs instead.

    Parameters
    ----------
    components : int
        Raw components to sketch and to hold the sketch against.
    raw : int
        Components that are fitted without a sketch; scipy needs them all in memory.
    seed : int
        Seed of the samples.
    """
    keys = {"dataset": "known mixture", "family": FAMILY.name, "schedule": "texture", "seed": seed}

    def record(metric: str, value: float, unit: str, count: int, **note: object) -> Record:
        return Record(metric, value, unit, **keys, count=count, protocol=protocol(**note))

    whole = sketch(chunks(components, seed))
    model = FlowLikelihood(FAMILY, fit(whole, FAMILY)[0])
    found = []
    nll = raw_nll(chunks(components, seed), model)
    of_sketch = negative_log_likelihood(whole, model)
    found.append(record("sketch_nll_error", of_sketch - nll, "nat", components, raw=nll))

    ks = kolmogorov_smirnov(whole, model, Counting(LEAST, 1))
    levels = [int(level) for level in np.flatnonzero(ks.counted)]
    gaps = ks.statistic[levels] - raw_ks(components, seed, model, levels)
    worst = float(np.abs(gaps).max())
    found.append(
        record("sketch_ks_error", worst, "", components, statistic="worst level", levels=len(levels))
    )

    parts = list(chunks(raw, seed + 1))
    few = tuple(np.concatenate(part) for part in zip(*parts))
    knots = place_knots(sketch(iter(parts)))
    (ours, _), fit_s, fit_mb = costs(lambda: fit(sketch(iter(parts)), FAMILY, knots))
    (_, their_nll), raw_s, raw_mb = costs(lambda: raw_fit(few, knots))
    our_nll = raw_nll(iter([few]), FlowLikelihood(FAMILY, ours))
    raw_mb += sum(part.nbytes for part in few) / 1e6
    note = {"ours": "sketch and fit", "theirs": "scipy on raw samples", "theirs_nll": their_nll}
    found += [
        record("raw_fit_nll_gap", our_nll - their_nll, "nat", raw, **note),
        record("raw_fit_time_ratio", raw_s / fit_s, "", raw, ours_s=fit_s, theirs_s=raw_s, time="processor"),
        record("raw_fit_memory_ratio", raw_mb / fit_mb, "", raw, ours_mb=fit_mb, theirs_mb=raw_mb),
    ]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="folder for metrics.json")
    parser.add_argument("--quick", action="store_true", help="2 million components")
    options = parser.parse_args()
    found = records(2_000_000, 200_000) if options.quick else records()
    for record in found:
        print(f"{record.metric:<22} {record.value:12.5g} {record.unit:<4} {record.protocol}")
    if options.out:
        write_records(options.out / "metrics.json", found)


if __name__ == "__main__":
    main()
