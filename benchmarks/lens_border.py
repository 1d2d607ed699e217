"""What the black border of undistorted images does to intervals, and what the mask of the lens takes away.

    python benchmarks/lens_border.py --out RUN

Images of a simulated flight are distorted by a lens that shows less than a pinhole camera, and undistorted
again as `flowlik.open_sequence` does it. Errors of a method's own vectors are held against the true flow and
the 90 % intervals of its shipped model: of those the mask keeps, and of those it drops because a window
holds pixels that the original images do not show.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from flowlik.datasets import Lens
from flowlik.datasets._lens_models import BrownConrady
from flowlik.flow import confirmed_method
from flowlik.geometry.camera import Pinhole
from flowlik.image.masks import clear
from flowlik.image.sampling import at_nearest, sample_flow
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood
from flowlik.measurement.masking import measure_clear, reach
from flowlik.results.records import Record, protocol, write_records
from flowlik.simulation import simulate
from flowlik.support.arrays import Array

CAMERA = Pinhole(640, 480, 517.0, 517.0, 319.5, 239.5)
LENSES = {
    "freiburg1": (0.2624, -0.9531, -0.0054, 0.0026, 1.1633),
    "k1=0.15": (0.15, 0.0, 0.0, 0.0),
}
MODELS = ("lucas-kanade", "farneback", "dis")
PAIRS, MOST, LEVEL = 4, 20_000, 0.9


def seen(image: np.ndarray, lens: Lens) -> np.ndarray:
    """The image (H, W) that the lens makes of what a pinhole camera sees."""
    ends = lens.straighten(CAMERA.pixel_grid().astype(np.float64), image.shape)
    at = ends.astype(np.float32).reshape(*image.shape, 2)
    return cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def held(
    images: tuple[np.ndarray, np.ndarray], truth: Array, model: FlowLikelihood, valid: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Which components (N, 2) lie in their interval, and which vectors (N,) the mask of the lens keeps."""
    method = confirmed_method(model.method or {}, None)
    m = measure_clear(images, method, model.texture, signals=())
    if len(m) > MOST:
        chosen = np.sort(np.random.default_rng(seed).choice(len(m), MOST, replace=False))
        m = m.select(chosen)
    m = measure_clear(images, method, model.texture, pixels=m.pixels, signals=model.signals)
    true = sample_flow(truth, m.pixels)
    known = np.isfinite(true).all(axis=1)
    m, true = m.select(known), true[known]
    where = clear(valid, reach(method, model.texture))
    ends = m.pixels + m.flow
    inside = ((ends >= 0) & (ends <= (CAMERA.width - 1, CAMERA.height - 1))).all(axis=1)
    kept = at_nearest(where, m.pixels)
    kept[inside] &= at_nearest(where, ends[inside])
    return np.abs(m.errors(true)) <= model.bound(model.coordinate(m), LEVEL), kept


def main() -> None:
    """Measure all lenses and models."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path)
    parser.add_argument("--pairs", type=int, default=PAIRS)
    parser.add_argument("--seed", type=int, default=3)
    options = parser.parse_args()
    flight = simulate("planes", "curve", frames=options.pairs + 1, camera=CAMERA, seed=options.seed)
    plain = [flight.image(k) for k in range(len(flight))]
    records = []
    for lens_name, coefficients in LENSES.items():
        lens = Lens(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, BrownConrady(coefficients))
        images = [lens.undistort(seen(image, lens)) for image in plain]
        valid = lens.valid(images[0].shape)
        for name in MODELS:
            model = load_likelihood(Path(name))
            found = [
                held((images[k], images[k + 1]), flight.flow(k), model, valid, options.seed + k)
                for k in range(options.pairs)
            ]
            within, kept = (np.concatenate(part) for part in zip(*found, strict=True))
            for vectors, chosen in (("all", np.ones_like(kept)), ("kept", kept), ("dropped", ~kept)):
                note = protocol(lens=lens_name.replace("=", " "), vectors=vectors, pairs=options.pairs,
                                black_percent=round(100 * float(1 - valid.mean()), 2))  # fmt: skip
                share = float(within[chosen].mean()) if chosen.any() else None
                records.append(
                    Record("coverage_90", share, "", flight.name, name, model.family.name,
                           model.schedule.name, None, 2 * int(chosen.sum()), options.seed, note)
                )  # fmt: skip
                print(
                    f"{lens_name:10} {name:14} {vectors:8} {2 * int(chosen.sum()):7} {share or 0:.3f}",
                    flush=True,
                )
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        write_records(options.out / "metrics.json", records)


if __name__ == "__main__":
    main()
