"""What else is asked of a calibration without truth: a pair of true flow, a wrong camera, no start at all.

python benchmarks/without_truth_checks.py pair --kitti-2012 FOLDER --own own/models/MODEL.json --out RUN
python benchmarks/without_truth_checks.py camera --cache CACHE --kitti-poses POSES --out RUN
python benchmarks/without_truth_checks.py start --kitti KITTI --out RUN
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from flights import Flight, rendered
from flowlik.calibration import calibration_pixels
from flowlik.datasets import open_sequence
from flowlik.datasets.flow_files import read_flow
from flowlik.egomotion import lcmsac
from flowlik.flow import flow_method
from flowlik.flow.base import Image
from flowlik.geometry.camera import Distortion, Pinhole
from flowlik.likelihood.model_file import load_likelihood
from flowlik.measurement.masking import measure_clear
from flowlik.measurement.measurements import Measurements
from flowlik.report import finish
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder
from flowlik.self_supervision import (
    Reading,
    learn_without_truth,
    pass_over,
    seen_pairs,
    truthless_form,
    truthless_signals,
)

GRID = 6000
DRIVE = Flight("driving", "05", 0.0, 208, 12, 5, "truthless")
CAMERAS = {
    "right": {}, "cx +1 px": {"cx": 1.0}, "cx +2 px": {"cx": 2.0}, "cx +4 px": {"cx": 4.0},
    "cx +8 px": {"cx": 8.0}, "focal +1 %": {"f": 0.01}, "focal +3 %": {"f": 0.03},
    "focal +10 %": {"f": 0.1}, "k1 -0.005": {"k1": -0.005}, "k1 -0.02": {"k1": -0.02},
}  # fmt: skip


def all_names(*models: object) -> tuple[str, ...]:
    names = [name for model in models for name in model.schedule.index.covariates]  # type: ignore[attr-defined]
    return tuple(dict.fromkeys(["texture", *names]))


def on_a_pair(options: argparse.Namespace, run: RunFolder) -> None:
    """Errors across the lines of the fundamental matrix of the true flow of KITTI 2012's pair."""
    folder = options.kitti_2012
    name = next((folder / "flow_noc").glob("*_10.png")).name
    images = tuple(
        cv2.imread(str(folder / "image_0" / name.replace("_10", n)), cv2.IMREAD_GRAYSCALE)
        for n in ("_10", "_11")
    )
    flow = read_flow(folder / "flow_noc" / name)
    known = np.isfinite(flow).all(axis=-1)
    v, u = np.nonzero(known)
    begin = np.stack([u, v], axis=-1).astype(np.float64)
    end = begin + flow[known]
    some = np.random.default_rng(options.seed).permutation(len(begin))[:20_000]
    F, held = cv2.findFundamentalMat(begin[some], end[some], cv2.FM_LMEDS)
    print("true flow", len(begin), "within", held.mean(), flush=True)
    models = {
        "shipped": load_likelihood(options.model),
        "epipolar": load_likelihood(options.model, "epipolar"),
    }
    models |= {"own": load_likelihood(options.own)} if options.own else {}
    method = flow_method(models["shipped"].method or {})
    signals = truthless_signals(method, "epipolar", models["shipped"])
    rng = np.random.default_rng(options.seed)
    pixels = calibration_pixels(images[0], method, rng, GRID, GRID)
    m = measure_clear(images, method, models["shipped"].texture, None, pixels, signals)
    at = np.rint(m.pixels).astype(int)
    inside = known[at[:, 1], at[:, 0]]
    m, at = m.select(inside), at[inside]
    true = flow[at[:, 1], at[:, 0]]
    lines = np.column_stack([m.pixels, np.ones(len(m))]) @ F.T
    normal = lines[:, :2] / np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    z = ((m.flow - true) * normal).sum(axis=1)
    print("vectors", len(m), flush=True)
    for label, model in models.items():
        x = model.schedule.index.along(m, normal)
        values = {"nll": float(-model.log_prob(z, x).mean())}
        for level in (0.5, 0.68, 0.9, 0.95):
            values[f"coverage_{100 * level:.0f}"] = float(np.mean(np.abs(z) <= model.bound(x, level)))
        tell(run, label, "KITTI 2012/000045", values, len(z), options, against="true flow")


def seen_by(m: Measurements, camera: Pinhole, other: Pinhole, k1: float) -> Measurements:
    """Measurements of a camera whose intrinsics are not what one thinks, as one sees them."""

    def seen(pixels: np.ndarray) -> np.ndarray:
        rays = camera.rays(pixels)
        rays[:, :2] = Distortion(k1).distort(rays[:, :2])
        return other.v2p(rays)

    first, last = seen(m.pixels), seen(m.pixels + m.flow)
    return replace(m, pixels=first, flow=last - first)


def on_wrong_cameras(options: argparse.Namespace, run: RunFolder) -> None:
    """Errors out of fit of a simulated drive, taken to be of a wrong camera."""
    start = load_likelihood(options.model)
    across = load_likelihood(options.model, "epipolar")
    method = flow_method(start.method or {})
    folder = next(c for c in options.cache if (c / f"{DRIVE.name}.npz").is_file())
    sequence = rendered(DRIVE, folder, options.kitti_poses)
    firsts = [k for block in sequence.blocks(DRIVE.seed) for k in block.firsts]
    signals = truthless_signals(method, "epipolar", start)
    pairs = list(seen_pairs(sequence, firsts, method, start.texture, signals, seed=options.seed))
    names = tuple(dict.fromkeys([*all_names(start, across), *truthless_form(method, "epipolar").covariates]))
    for label, change in CAMERAS.items():
        c = sequence.camera
        # what the data says of the camera is off: rays are another camera's
        f = 1 + change.get("f", 0.0)
        true = replace(c, cx=c.cx + change.get("cx", 0.0), fx=f * c.fx, fy=f * c.fy)
        off = [
            p._replace(measurements=seen_by(p.measurements, true, c, change.get("k1", 0.0))) for p in pairs
        ]
        found = pass_over(off, lcmsac(across), names, options.seed)
        reading = Reading.of(across, found.crossed).values()
        reading["size_68_px"] = float(np.quantile(np.abs(np.concatenate([e.z for e in found.crossed])), 0.68))
        print(found.statuses, end=" ")
        tell(run, "epipolar", DRIVE.name, reading, len(found.solved), options, camera=label)


def unknown(previous: Image, current: Image) -> np.ndarray:
    """DIS, as a function that nothing is known of."""
    return np.asarray(flow_method("dis").dense(previous, current))  # type: ignore[union-attr]


def without_a_start(options: argparse.Namespace, run: RunFolder) -> None:
    """DIS calibrated on KITTI 03's frames 0 to 149, begun with its table and with none."""
    sequence = open_sequence(options.kitti / "03")
    firsts = list(range(149))[:: options.every]
    known = load_likelihood("dis")
    for label, begin in (("dis", known), ("none", None)):
        clock = time.perf_counter()
        method = flow_method("dis" if begin else f"{Path(__file__).stem}:unknown")
        signals = truthless_signals(method, "epipolar", begin)
        pairs = list(seen_pairs(sequence, firsts, method, known.texture, signals, seed=options.seed))
        done = learn_without_truth(pairs, method, begin, seed=options.seed)
        reading = Reading.of(done.likelihood, done.last.of(done.held_out)).values()
        print(done.scores, done.last.told, f"{time.perf_counter() - clock:.0f} s", flush=True)
        tell(run, label, "KITTI/03", reading, len(firsts), options, against="other tiles", start=label)


def tell(
    run: RunFolder, label: str, dataset: str, values: dict[str, float], count: int,
    options: argparse.Namespace, **keys: object,
) -> None:  # fmt: skip
    """Record and print figures of a model."""
    note = protocol(model=label, **keys)
    run.records += [
        Record(metric, value, "nat" if metric == "nll" else "px" if metric.endswith("_px") else "",
               dataset, options.model, count=count, seed=options.seed, protocol=note)
        for metric, value in values.items()
    ]  # fmt: skip
    print(f"{dataset} {note} " + " ".join(f"{v:.3f}" for v in values.values()), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    checks = {"pair": on_a_pair, "camera": on_wrong_cameras, "start": without_a_start}
    parser.add_argument("check", choices=checks)
    parser.add_argument("--kitti", type=Path, help="folder of KITTI's sequences, NN each")
    parser.add_argument("--kitti-2012", type=Path, help="folder with image_0 and flow_noc of one pair")
    parser.add_argument("--kitti-poses", type=Path, help="folder of NN.txt")
    parser.add_argument("--cache", type=Path, nargs="+", help="rendered flights")
    parser.add_argument("--own", type=Path, help="model calibrated without truth")
    parser.add_argument("--model", default="lucas-kanade-11", help="shipped model")
    parser.add_argument("--every", type=int, default=1, help="only every so many-th pair")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True, help="run folder")
    options = parser.parse_args()
    run = RunFolder(options.out, "benchmarks/without_truth_checks", {"check": options.check}, options.seed)
    checks[options.check](options, run)
    finish(run)


if __name__ == "__main__":
    main()
