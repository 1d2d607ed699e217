"""A camera that stands still before almost no texture: does anyone drift?"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from egomotion_variants import label, residuals, variants
from flowlik.egomotion import EgoMotion
from flowlik.geometry.trajectory import chain
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder
from flowlik.simulation import Sensor, simulate
from flowlik.support.progress import Progress

SEED = 210
# so little light that the image spans some 50 grey levels
GAIN = 0.03


def hover(run: RunFolder, cache: Path, methods: tuple[str, ...], frames: int, progress: Progress) -> None:
    """Fly nowhere; records of the distance from the start, and the figure of the way there."""
    sequence = simulate("planes", "hover", frames, seed=SEED, sensor=Sensor(gain=GAIN))
    timestamps = np.array([sequence.timestamp(k) for k in range(frames)])
    for method in methods:
        everyone = variants(method, cache)
        pairs = residuals(sequence, method, list(range(frames - 1)))
        found = everyone.motions_over(progress(pairs, f"{method} hovering", frames - 1))
        positions, unsolved = [], []
        print(f"\nhovering before little texture, {method}: distance from the start [mm]")
        for name, motions in found.items():
            lost = np.array([m is None or (isinstance(m, EgoMotion) and not m.solved) for m in motions])
            steps = [
                RigidTransform.identity() if gone else getattr(m, "T_k_prev", m)
                for m, gone in zip(motions, lost)
            ]
            path = chain(steps).translation
            positions.append(path)
            unsolved.append([False, *lost])
            end, most = (1e3 * f(np.linalg.norm(path, axis=1)) for f in (lambda d: d[-1], np.max))
            # as if the steps' errors were independent: those of neighbours cancel, since they share a frame
            told = [m.covariance[3:, 3:] for m in motions if isinstance(m, EgoMotion) and m.solved]
            sigma = 1e3 * float(np.sqrt(np.trace(np.sum(told, axis=0)))) if told else np.nan
            expected = f"   standard deviation told {sigma:.2f}" if told else ""
            print(
                f"{name:<16} end {end:8.3f}   farthest {most:8.3f}{expected}   unsolved {lost.mean():.0%}",
                flush=True,
            )
            note = protocol(sensor_gain=GAIN, told_sigma_m=f"{sigma / 1e3:.3g}" if told else None)
            keys = {"estimator": name, "count": frames, "seed": SEED, "protocol": note}
            base = Record("hover_end_m", end / 1e3, "m", sequence.name, label(method), **keys)
            run.records += [base, replace(base, metric="hover_farthest_m", value=most / 1e3)]
        run.save(
            "trajectories", f"{method}-hover",
            {"names": list(found), "positions": np.array(positions), "timestamps": timestamps, "unit": "m",
             "truth": np.zeros((frames, 3)), "unsolved": np.array(unsolved)},
        )  # fmt: skip
