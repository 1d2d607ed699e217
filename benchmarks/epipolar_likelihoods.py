"""Three readings of the epipolar likelihood on the same pairs of images: noise of split halves, and time."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from epipolar_refinement import refine_convolution, refine_profile
from flowlik.datasets import open_sequence
from flowlik.egomotion import Epipolar, mle
from flowlik.evaluation.motion.split_half import direction_noise_mrad, rotation_noise_mdeg
from flowlik.flow import flow_method
from flowlik.likelihood.model_file import load_likelihood
from flowlik.measurement.features import measure_features
from flowlik.measurement.halves import halves


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of a sequence")
    parser.add_argument("--model", type=Path, required=True, help="model calibrated in simulation")
    parser.add_argument("--pairs", type=int, default=10)
    options = parser.parse_args()

    sequence, likelihood = open_sequence(options.data), load_likelihood(options.model)
    method, index = flow_method(likelihood.method or {}), likelihood.schedule.index
    estimator = mle(likelihood)
    found: dict[str, list[list[RigidTransform]]] = {"along n": [], "convolution": [], "own depth": []}
    seconds = dict.fromkeys(found, 0.0)
    for k in np.linspace(1, len(sequence) - 1, options.pairs).astype(int):
        m = measure_features(
            sequence.image(k - 1), sequence.image(k), method, likelihood.texture, k, index.signals
        )
        rows: dict[str, list[RigidTransform]] = {name: [] for name in found}
        for half in halves(m.pixels):
            residual = Epipolar.of(m.select(half), sequence.camera)
            start = time.process_time()
            begin = estimator.estimate(residual, seed=k).T_k_prev.as_matrix()[:3]
            seconds["along n"] += time.process_time() - start
            rows["along n"].append(begin)
            for name, refine in (("convolution", refine_convolution), ("own depth", refine_profile)):
                start = time.process_time()
                rows[name].append(refine(residual, likelihood, begin))
                seconds[name] += time.process_time() - start
        for name, pair in rows.items():
            found[name].append([RigidTransform.from_matrix(np.vstack([T, [0, 0, 0, 1]])) for T in pair])
    print(f"{sequence.name}, {options.pairs} pairs, {options.model.stem}: noise of split halves")
    for name, pairs in found.items():
        first, second = (RigidTransform.concatenate([pair[i] for pair in pairs]) for i in (0, 1))
        direction, rotation = direction_noise_mrad(first, second), rotation_noise_mdeg(first, second)
        each = 1e3 * seconds[name] / (2 * options.pairs)
        print(f"{name:<12} {direction:6.3f} mrad {rotation:6.2f} x 0.001 deg {each:8.0f} CPU-ms")


if __name__ == "__main__":
    main()
