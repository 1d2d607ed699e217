"""Kernels at speed: LCMSAC against OpenCV's PnP, texture against its twin, sketching against numpy's."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from flowlik.calibration import ErrorSketch
from flowlik.calibration._kernels import count
from flowlik.calibration.sketch import LEVELS, X_BINS, Z_BINS, x_edges
from flowlik.egomotion import KnownDepth, lcmsac
from flowlik.flow import Farneback, describe
from flowlik.image.texture import eigenbasis, structure_tensor
from flowlik.likelihood.families import LaplaceCauchy
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index, Schedule
from flowlik.likelihood.tables import magnitude_nodes
from flowlik.measurement.measurements import measure, stratified_pixels
from flowlik.results.records import Record, protocol, write_records
from flowlik.simulation import simulate
from timing import ratio


def model() -> FlowLikelihood:
    """A plausible table; speed does not depend on its values."""
    knots = np.log(np.geomspace(0.1, 2000, 12))
    scale = np.clip(2 * np.exp(-0.5 * knots), 0.04, 3)
    values = np.stack([2 / np.pi * np.arctan(1 / scale), 2 * scale, np.full(12, 0.6)])
    return FlowLikelihood(LaplaceCauchy(), Schedule(Index(), knots, values), method=describe(Farneback()))


def estimation(radius_px: float) -> tuple[float, float, float]:
    """200 hypotheses over 4000 points with refinement, against solvePnPRansac at 200 iterations."""
    sequence = simulate(frames=2, seed=7)
    rng = np.random.default_rng(0)
    pixels = stratified_pixels((sequence.camera.height, sequence.camera.width), 4000, rng)
    m = measure(sequence.image(0), sequence.image(1), Farneback(), pixels=pixels)
    residual = KnownDepth.of(m, sequence.camera, sequence.depth(0))
    # no early stop on either side
    estimator = replace(lcmsac(model()), most_hypotheses=200, success=1 - 1e-15)
    points = sequence.camera.p2v(residual.measurements.pixels) / residual.rho[:, None]
    ends = residual.measurements.pixels + residual.measurements.flow

    def opencv() -> None:
        cv2.solvePnPRansac(
            points, ends, sequence.camera.K, None, iterationsCount=200, reprojectionError=radius_px,
            confidence=1 - 1e-15,
        )  # fmt: skip

    return ratio(lambda: estimator.estimate(residual, 0), opencv)


def texture() -> tuple[float, float, float]:
    """Structure tensor and eigenbasis of a frame against cv2.cornerEigenValsAndVecs."""
    image = simulate(frames=2, seed=7).image(0)
    return ratio(lambda: eigenbasis(structure_tensor(image)), lambda: cv2.cornerEigenValsAndVecs(image, 5, 3))


def sketch(same_bins: bool) -> tuple[float, float, float]:
    """Two million components against numpy's histogram2d, which counts x once where a sketch counts thrice.

    Either of the same bins, or numpy's fastest case: uniform bins of the logarithm, which it need not search.
    """
    rng = np.random.default_rng(0)
    index, n = Index(), 2_000_000
    x, z, sign = rng.uniform(-4, 11, n), rng.standard_cauchy(n), np.ones(n)
    empty = ErrorSketch.empty(index)
    edges = np.concatenate([-magnitude_nodes()[::-1], magnitude_nodes()])
    bins = X_BINS, Z_BINS

    def histogram() -> None:
        if same_bins:
            np.histogram2d(x, z * sign, bins=(x_edges(index), edges))
        else:
            np.histogram2d(x, np.log(np.abs(z)), bins=bins, range=((-4.6, 11.5), (-9.7, 6.9)))

    def ours() -> None:
        first, width = index.low, index.high - index.low
        count(
            x, x, z, sign, first, X_BINS / width, first, LEVELS / width, empty.counts, empty.by_level,
            empty.errors,
        )  # fmt: skip

    return ratio(ours, histogram, repeats=5)


def dense_pair() -> Record:
    """Components a second of processor time that one core sketches of a 640 x 360 pair, reservoir and all."""
    rng = np.random.default_rng(0)
    shape = (360 * 640, 2)
    texture, z = {"texture": 10 ** rng.uniform(-1, 4, shape)}, rng.standard_cauchy(shape)
    sign = rng.choice([-1.0, 1.0], shape)
    times = []
    for seed in range(20):
        start = time.process_time()
        ErrorSketch.of(Index(), texture, z, sign, np.random.default_rng(seed))
        times.append(time.process_time() - start)
    note = protocol(case="sketch of a dense pair", time="processor", statistic="median")
    return Record("components_per_second", z.size / np.median(times), "1/s", count=z.size, protocol=note)


CASES = {
    "lcmsac / solvePnPRansac 0.5 px": lambda: estimation(0.5),
    "lcmsac / solvePnPRansac 2 px": lambda: estimation(2.0),
    "texture / cornerEigenValsAndVecs": texture,
    "sketch / histogram2d, same bins": lambda: sketch(True),
    "sketch / histogram2d, uniform log bins": lambda: sketch(False),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="folder for metrics.json")
    out = parser.parse_args().out
    records = []
    print(f"{'case':<40} {'ours ms':>9} {'theirs ms':>10} {'ratio':>7}")
    for name, case in CASES.items():
        ours, theirs, quotient = case()
        print(f"{name:<40} {ours:9.2f} {theirs:10.2f} {quotient:7.3f}", flush=True)
        note = (
            f"case={name}; ours_ms={ours:.3f}; theirs_ms={theirs:.3f}; statistic=median of interleaved runs"
        )
        records.append(Record("time_ratio", quotient, "", protocol=note))
    records.append(dense_pair())
    print(f"sketch of a dense pair: {records[-1].value / 1e6:.1f} million components a second")
    if out:
        write_records(out / "metrics.json", records)


if __name__ == "__main__":
    main()
