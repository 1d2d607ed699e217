"""Who is compared in `egomotion.py`: our estimators, and rivals at their best on calibration data."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from calibration_plan import FOREST
from flights import Flight, rendered
from flowlik.comparison.baselines import PNP, RADII_PX, Pnp, sweep
from flowlik.datasets.base import ImageSequence
from flowlik.egomotion import EgoMotion, Estimator, KnownDepth, lcmsac, mle, ransac
from flowlik.flow import describe, flow_method, method_label
from flowlik.geometry.motion import relative_motion
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood
from flowlik.measurement.features import measure_features
from flowlik.support.files import read_json, write_json

METHODS = ("farneback", "lucas-kanade", "dis")
RECOMMENDED = "lcmsac-index"
RADIUS_PX = 0.5
"""RANSAC's, as in the paper."""

SWEPT_PAIRS = 15
GATES = (None, 2.0, 50.0)
"""Textures tried: none, and the paper's 50 as a mean over the window and as the sum over its 25 pixels."""

SWEPT = (Flight(FOREST, "training", 6.0, 12), Flight(FOREST, "training", 6.0, 0, 12, 4))
"""Calibration flights from which the pairs come on which gates and radii are settled."""

Pairs = list[tuple[KnownDepth, RigidTransform]]


@dataclass(frozen=True)
class Variants:
    """Everyone of one flow method: ours by name, and the rivals."""

    method: str
    ours: tuple[Estimator, ...]
    rivals: dict[str, Pnp] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        return (*(e.name for e in self.ours), *self.rivals)

    @property
    def signals(self) -> tuple[str, ...]:
        """What the index model needs measured."""
        return tuple(sorted({s for e in self.ours for s in e.likelihood.signals}))

    def motions(self, residual: KnownDepth, seed: int) -> dict[str, EgoMotion | RigidTransform | None]:
        found: dict[str, EgoMotion | RigidTransform | None] = {
            e.name: e.estimate(residual, seed) for e in self.ours
        }
        return {**found, **{name: rival(residual) for name, rival in self.rivals.items()}}

    def motions_over(
        self, pairs: Iterable[tuple[KnownDepth, *tuple[object, ...]]], seed: int = 0
    ) -> dict[str, list[EgoMotion | RigidTransform | None]]:
        """Everyone's motions over the pairs of `residuals` or `residuals_of_flight`, by name."""
        found: dict[str, list[EgoMotion | RigidTransform | None]] = {name: [] for name in self.names}
        for k, (residual, *_) in enumerate(pairs):
            for name, motion in self.motions(residual, seed + k).items():
                found[name].append(motion)
        return found


def variants(method: str, cache: Path) -> Variants:
    """Our estimators with the models that ship, and the rivals as the sweep left them."""
    index, texture = load_likelihood(method), texture_model(method)
    swept = settled(method, cache)
    gate = swept["gate"]
    ours = (
        ransac(RADIUS_PX),
        replace(ransac(RADIUS_PX, gate=gate), name="ransac-gated"),
        lcmsac(texture, gate=gate),
        mle(texture, gate=gate),
        replace(lcmsac(index, gate=swept["index_gate"]), name="lcmsac-index"),
        replace(mle(index, gate=swept["index_gate"]), name="mle-index"),
    )
    return Variants(method, ours, {name: Pnp(**swept[name]) for name in ("opencv", "poselib")})


def texture_model(method: str) -> FlowLikelihood:
    """The paper's model of a method, on the same vectors as the index: the paper's solver finds the same."""
    return replace(load_likelihood(f"{method}-lcm"), method=describe(flow_method(method)))


def settled(method: str, cache: Path) -> dict:
    """Gates of both models and the best of either library: least median error on calibration flights."""
    path = cache / f"rivals-{method}.json"
    known = read_json(path) if path.is_file() else {}
    assert isinstance(known, dict)
    if "index_gate" not in known:
        pairs = [pair for flight in SWEPT for pair in residuals_of_flight(flight, method, cache)]
        chosen = np.linspace(0, len(pairs) - 1, SWEPT_PAIRS).astype(int)
        pairs = [pairs[i] for i in chosen]
        known = known or {"gate": _best_gate(texture_model(method), pairs), **_best_rivals(pairs)}
        write_json(path, known | {"index_gate": _best_gate(load_likelihood(method), pairs)})
    return read_json(path)


def residuals_of_flight(flight: Flight, method: str, cache: Path, kitti_poses: Path | None = None) -> Pairs:
    """Residuals with the true motions, of all pairs within the flight's runs."""
    runs = rendered(flight, cache, kitti_poses)
    firsts = [k for block in runs.blocks(flight.seed) for k in block.firsts]
    return [(residual, true) for residual, true, _ in residuals(runs, method, firsts, flight.seed)]


def residuals(
    sequence: ImageSequence, method: str, firsts: list[int], seed: int = 0
) -> Iterator[tuple[KnownDepth, RigidTransform, float]]:
    """Residual, true motion and seconds of measurement of pairs of neighbouring frames."""
    flow, index = flow_method(method), load_likelihood(method)
    for k in firsts:
        images = sequence.image(k), sequence.image(k + 1)
        start = time.perf_counter()
        m = measure_features(*images, flow, index.texture, seed + k, index.signals)
        residual = KnownDepth.of(m, sequence.camera, sequence.depth(k))
        seconds = time.perf_counter() - start
        yield residual, relative_motion(sequence.T_n_c(k), sequence.T_n_c(k + 1)), seconds


def _best_gate(likelihood: FlowLikelihood, pairs: Pairs) -> float | None:
    def median(gate: float | None) -> float:
        estimator = lcmsac(likelihood, gate=gate)
        return float(np.median([translation_error(estimator.estimate(r, 0).T_k_prev, T) for r, T in pairs]))

    return min(GATES, key=median)


def _best_rivals(pairs: Pairs) -> dict[str, dict]:
    best = {}
    for library in ("opencv", "poselib"):
        tried = [
            sweep(Pnp(name, gate=gate), pairs, RADII_PX)
            for name in PNP
            if name.startswith(library)
            for gate in (None, GATES[-1])
        ]

        def median(rival: Pnp) -> float:
            return float(np.median([translation_error(rival(r), T) for r, T in pairs]))

        best[library] = asdict(min(tried, key=median))
    return best


def translation_error(estimated: RigidTransform | None, true: RigidTransform) -> float:
    """Length of the translation's error [m]; a motion not found stands still."""
    found = np.zeros(3) if estimated is None else estimated.translation
    return float(np.linalg.norm(found - true.translation))


def label(method: str) -> str:
    """Name of a flow method in records."""
    return method_label(describe(flow_method(method)))
