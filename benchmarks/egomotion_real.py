"""Real depth: TartanAir's pairs and 7-Scenes, everyone on the same points."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from egomotion_table import Flown, _flown, with_interval
from egomotion_variants import label, residuals, variants
from flowlik.datasets import open_sequence
from flowlik.evaluation.motion import true_trajectory
from flowlik.results.records import Record, protocol
from flowlik.support.progress import Progress

DATA = {"TartanAir": ("tartanair_v2/abs_P000", "exact"), "7-Scenes": ("sevenscenes", "soft")}
"""Path of each below --data, and what its truth is worth: 7-Scenes' poses are KinectFusion's."""


def real_part(data: Path, cache: Path, methods: tuple[str, ...], progress: Progress) -> list[Record]:
    """Per-frame errors of everyone."""
    records = []
    for name, (path, worth) in DATA.items():
        if not (data / path).exists():
            print(f"no {name} at {path}: left out")
            continue
        sequence = open_sequence(data / path)
        count = len(sequence)
        truth = true_trajectory(sequence, count)
        assert truth is not None
        for method in methods:
            everyone = variants(method, cache)
            pairs = residuals(sequence, method, list(range(count - 1)))
            motions = everyone.motions_over(progress(pairs, f"{method} on {name}", count - 1))
            print(f"\n{name} ({count - 1} pairs, {worth} truth), {method}: median error [interval]")
            for n in everyone.names:
                records += _of(_flown(motions[n], truth), name, method, n, worth)
    return records


def _of(flown: Flown, dataset: str, method: str, name: str, worth: str) -> list[Record]:
    found, shown = [], []
    for metric, unit, errors in (
        ("trans", "m", flown.errors.translation_m), ("rot", "deg", flown.errors.rotation_deg),
    ):  # fmt: skip
        value, low, high = with_interval([errors], lambda e: float(np.median(e)))
        note = protocol(residual="depth", truth=worth, align="none", interval_95=f"{low:.4g} … {high:.4g}")
        found.append(
            Record(f"rpe_{metric}_median_{unit}", value, unit, dataset, label(method), estimator=name,
                   count=len(errors), protocol=note)
        )  # fmt: skip
        shown.append(f"{1e3 * value:8.3f} m{unit} [{1e3 * low:.3f} … {1e3 * high:.3f}]")
    lost = float(flown.unsolved.mean())
    found.append(
        Record(
            "unsolved_fraction", lost, "", dataset, label(method), estimator=name, count=len(flown.unsolved)
        )
    )
    print(f"{name:<16} " + "   ".join(shown) + f"   unsolved {lost:.0%}", flush=True)
    return found
