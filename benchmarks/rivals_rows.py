"""Flow vectors with truth for `rivals.py`: of the standard flights, and of real pairs.

    python benchmarks/rivals_rows.py --cache FLIGHTS --rows ROWS --data DATA --methods lucas-kanade dis ...

ROWS keeps one file a method and source. Of each flight a few pairs are measured, at the same stratified
pixels by every method; Lucas-Kanade with windows of 9 to 31 px too, an ensemble.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

import calibration as sources
from calibration_plan import CALIBRATION
from flights import Flight, Runs
from flowlik.calibration import Block, index_form
from flowlik.datasets import open_sequence
from flowlik.datasets.base import frame_pairs
from flowlik.flow import LucasKanade, describe, flow_method, method_label
from flowlik.flow.base import FlowMethod
from flowlik.image.sampling import sample_flow
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.covariates import covariate
from flowlik.measurement.measurements import Measurements, measure, stratified_pixels
from flowlik.support.arrays import Array
from flowlik.support.files import atomic_write

PIXELS = 1500
PAIRS_A_FLIGHT = 2
PAIRS_A_SOURCE = 5
WINDOWS = (9, 15, 21, 27, 31)
SIGNALS = ("discrepancy", "patch-discrepancy", "residual", "spread", "standard-error")
WIDTHS = (2, 2, 0, 0, 3)
REAL = {name: folder for name, folder in sources.REAL.items() if "soft truth" not in name}


@dataclass(frozen=True)
class Rows:
    """Flow vectors of one source: flow and truth (N, 2) [px], texture (N, 2), eigenbasis (N, 2, 2), signals.

    Signals that the method's index does not have are NaN. ``pair`` (N,) numbers the image pairs; ``ensemble``
    (N, K, 2) is the flow of K variants, or empty.
    """

    flow: Array
    truth: Array
    t: Array
    R_i_e: Array
    pair: Array
    discrepancy: Array
    patch_discrepancy: Array
    residual: Array
    spread: Array
    standard_error: Array
    ensemble: Array

    @property
    def measurements(self) -> Measurements:
        signals = {name: getattr(self, name.replace("-", "_")) for name in SIGNALS}
        pixels = np.zeros_like(self.flow)
        return Measurements(pixels, self.flow, self.R_i_e, self.t, TextureDefinition(), {}, signals)

    def select(self, which: Array) -> Rows:
        return Rows(*(getattr(self, f.name)[which] for f in fields(self)))

    def finite(self) -> Rows:
        """Rows whose ensemble, where there is one, is known."""
        return self.select(np.isfinite(self.ensemble).all(axis=(1, 2)))

    def some(self, most: int) -> Rows:
        """At most so many rows, chosen at random."""
        return self.select(np.random.default_rng(0).permutation(len(self.flow))[:most])

    @classmethod
    def join(cls, parts: list[Rows]) -> Rows:
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))

    def save(self, path: Path) -> None:
        with atomic_write(path, "wb") as file:
            np.savez(file, **{f.name: np.float32(getattr(self, f.name)) for f in fields(self)})

    @classmethod
    def load(cls, path: Path) -> Rows:
        with np.load(path) as data:
            return cls(*(np.float64(data[f.name]) for f in fields(cls)))


def rows_of(sequence, firsts, method: FlowMethod, seed: int) -> Rows | None:
    """Rows of some image pairs, whose true ends lie in the image."""
    found = []
    form = index_form(method)
    wanted = {signal for name in form.covariates for signal in covariate(name).signals} | {"residual"}
    for number, k in enumerate(firsts):
        pair = sequence.image(k), sequence.image(k + 1)
        pixels = stratified_pixels(pair[0].shape, PIXELS, np.random.default_rng([seed, k]))
        m = measure(*pair, method, pixels=pixels, signals=wanted)
        truth = sample_flow(sequence.flow(k), m.pixels)
        height, width = pair[0].shape
        with np.errstate(invalid="ignore"):
            kept = ((m.pixels + truth >= 0) & (m.pixels + truth <= [width - 1, height - 1])).all(axis=1)
        variants = ()
        if isinstance(method, LucasKanade):
            variants = [replace(method, window=window) for window in WINDOWS]
        m, truth = m.select(kept), truth[kept]
        flows = [variant.measure_at(*pair, m.pixels) for variant in variants]
        ensemble = np.stack(flows, axis=1) if flows else np.zeros((len(m), 0, 2))
        signals = [
            m.signals.get(name, np.full((len(m), width) if width else len(m), np.nan))
            for name, width in zip(SIGNALS, WIDTHS)
        ]
        found.append(Rows(m.flow, truth, m.t, m.R_i_e, np.full(len(m), number), *signals, ensemble))
    return Rows.join(found) if found else None


def flight_firsts(flight: Flight, runs: Runs) -> list[int]:
    """First frames of a few pairs, spread over a flight's places."""
    blocks: list[Block] = runs.blocks(flight.seed)
    which = np.linspace(0, len(blocks) - 1, PAIRS_A_FLIGHT).round().astype(int)
    return [blocks[i].firsts[0] for i in which]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cache", type=Path, required=True, help="rendered flights")
    parser.add_argument("--rows", type=Path, required=True, help="folder of the rows")
    parser.add_argument("--data", type=Path, required=True, help="real images, as docs/datasets.md has them")
    parser.add_argument("--methods", nargs="+", required=True, help="names of flow methods")
    options = parser.parse_args()
    for name in options.methods:
        method = flow_method(name)
        folder = options.rows / method_label(describe(method))
        folder.mkdir(parents=True, exist_ok=True)
        for source, path in REAL.items():
            file = folder / f"{source}.npz"
            if not file.is_file():
                sequence = open_sequence(options.data / path)
                firsts = list(frame_pairs(sequence))[:PAIRS_A_SOURCE]
                rows_of(sequence, firsts, method, 0).save(file)
                print(file, flush=True)
        for flight in CALIBRATION:
            file, frames = folder / f"{flight.name}.npz", options.cache / f"{flight.name}.npz"
            if file.is_file() or not frames.is_file():
                continue
            runs = Runs(frames)
            rows_of(runs, flight_firsts(flight, runs), method, flight.seed).save(file)
            print(file, flush=True)


if __name__ == "__main__":
    main()
