"""The virtual environment measured: speed, exactness, photometric consistency, naturalness, pictures.

Real pictures and KITTI's poses come from `--data`; what needs them is skipped where they are absent.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import simulation_consistency as consistency
import simulation_exactness as exactness
import simulation_naturalness as naturalness
import simulation_speed as speed
from flowlik.flow import LucasKanade
from flowlik.geometry.camera import Pinhole
from flowlik.results.records import Record, protocol, write_records
from flowlik.simulation import IDEAL_SENSOR, SimulatedSequence, simulate
from simulation_pictures import PictureSet, real_sets, simulated
from simulation_sheets import write_sheets

DATA = Path(os.environ.get("FLOWLIK_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


@dataclass(frozen=True)
class Options:
    """What to measure, and on what."""

    quick: bool
    data: Path | None
    worlds: tuple[str, ...]

    @property
    def kitti_poses(self) -> Path | None:
        """Folder of KITTI's pose files."""
        return None if self.data is None else self.data / "kitti_poses"

    def flights(self, frames: int = 400) -> dict[str, Callable[[], SimulatedSequence]]:
        """Return a flight through every world without sensor effects."""
        found: dict[str, Callable[[], SimulatedSequence]] = {
            world: lambda world=world: simulate(world, "training", frames, sensor=IDEAL_SENSOR)
            for world in ("planes", "grid", "forest")
        }
        if self.kitti_poses is not None:
            street = self.kitti_poses / "00.txt"
            found["driving"] = lambda: simulate("driving", street, frames, sensor=IDEAL_SENSOR)
            found["traffic"] = lambda: simulate("driving", street, frames, sensor=IDEAL_SENSOR, traffic=12)
        return {world: found[world] for world in self.worlds if world in found}


def measure_speed(options: Options) -> Iterator[Record]:
    least = {"forest": 3.0, "driving": 1.2, "forest-small": 12.0}
    most = {"setup_seconds": 8.0, "peak_memory_mb": 900.0}
    sizes = {"forest": "640x360", "driving": "1242x375", "forest-small": "320x180"}
    units = {
        "frames_per_second": "1/s",
        "cpu_seconds_per_frame": "s",
        "setup_seconds": "s",
        "peak_memory_mb": "MB",
    }
    for case in speed.CASES:
        poses = options.kitti_poses / "00.txt" if case == "driving" and options.kitti_poses else None
        if case.split("-")[0] not in options.worlds or (case == "driving" and poses is None):
            continue
        figures = speed.measured(case, 20 if options.quick else 60, poses)
        count = int(figures.pop("frames"))
        for metric, value in figures.items():
            note = {"size": sizes[case], "samples": 16, "sensor": "default", "writing": "none"}
            bound = least[case] if metric == "frames_per_second" else None
            yield _record(
                metric, value, units.get(metric, ""), case, count, bound, most.get(metric), **note
            )  # fmt: skip


def measure_exactness(options: Options) -> Iterator[Record]:
    error, count = exactness.plane_depth_error()
    yield _record("depth_plane_relative_error_max", error, "", "plane", count, most=1e-9)
    for world, fly in options.flights(60).items():
        sequence = fly()
        errors, counts = zip(*(exactness.flow_error(sequence, k) for k in (0, 30, 57)))
        note = {"against": "cv2.projectPoints", "ends": "in the image"}
        yield _record("flow_reprojection_error_max", max(errors), "px", world, sum(counts), most=1e-6, **note)
    if "forest" in options.worlds:
        sequence = simulate("forest", "forest-fig8", 1981)
        camera = Pinhole.from_fov(320, 180, 120.0) if options.quick else sequence.camera
        poses = sequence.poses[100 : 1900 : 900 if options.quick else 300]
        shares = exactness.embree_agreement(sequence.world._scene, poses, camera)
        note = {"against": "Embree", "relative": 1e-4, "statistic": "least of the poses"}
        yield _record("raycast_agreement", min(shares), "", "forest", len(shares), least=0.995, **note)


def measure_consistency(options: Options) -> Iterator[Record]:
    frames = np.linspace(0, 398, 4 if options.quick else 12).astype(int)
    for world, fly in options.flights().items():
        there, back = consistency.there_and_back(fly())
        note = {"sensor": "ideal", "pixels": "visible, depth-smooth"}
        residuals = consistency.pooled([consistency.residuals(there, k) for k in frames])
        count = len(residuals.warped)
        yield _record("warp_residual_median", residuals.median, "grey levels", world, count, most=1.2, **note)
        unwarped = float(np.median(np.abs(residuals.unwarped)))
        yield _record("unwarped_residual_median", unwarped, "grey levels", world, count, **note)
        yield _record("compared_share", residuals.share, "", world, count, **note)
        for method in (LucasKanade(), LucasKanade(anchor="middle")):
            yield from _signed_means((there, back), frames, world, method, note)
        left = np.concatenate([consistency.leftover_flow(there, k, LucasKanade()) for k in frames])
        for axis, name in enumerate("uv"):
            value = float(left[:, axis].mean())
            yield _record(f"lk_leftover_mean_{name}", value, "px", world, len(left), most=0.01, **note)
        step_m, places = (0.05, [0, 130, 260]) if world in ("driving", "traffic") else (0.03, [0, 130, 260])
        creep = consistency.creep(there, places, step_m)
        for n, value in zip(consistency.CREEP_STEPS, creep.residuals):
            note_n = {**note, "motion": "sideways", "step_m": step_m, "steps": n}
            yield _record("sideways_residual_median", value, "grey levels", world, len(places), **note_n)
        yield _record("texture_creep_share", creep.share, "", world, len(places), most=0.01, step_m=step_m)


def _signed_means(
    flights: tuple[SimulatedSequence, SimulatedSequence],
    frames: NDArray[np.int64],
    world: str,
    method: LucasKanade,
    note: dict[str, str],
) -> Iterator[Record]:
    """Lucas-Kanade minus truth on a flight, and pooled with the same flown backwards."""
    errors = [
        np.concatenate([consistency.lucas_kanade_errors(flight, k, method)[0] for k in frames])
        for flight in flights
    ]
    placed = "middle of the patch" if method.anchor == "middle" else "centre of gradient energy"
    note = {**note, "pixels": "visible, depth-smooth, t2 above 3, tracked within 1 px", "placed": placed}
    suffix = "_middle" if method.anchor == "middle" else ""
    for axis, name in enumerate("uv"):
        one_way = float(errors[0][:, axis].mean())
        both = float(np.mean([error[:, axis].mean() for error in errors]))
        metric, count = f"lk_signed_mean_{name}", len(errors[0])
        yield _record(metric + suffix, one_way, "px", world, count, most=0.01, **note)
        count = sum(map(len, errors))
        yield _record(f"{metric}_both_ways{suffix}", both, "px", world, count, most=0.01, **note)


def measure_naturalness(options: Options) -> list[naturalness.Statistics]:
    count = 6 if options.quick else 16
    ours: list[PictureSet] = []
    for world in (w for w in ("planes", "grid", "forest") if w in options.worlds):
        ours.append(simulated(world, lambda world=world: simulate(world, "training", 1500), count))
    if "driving" in options.worlds and options.kitti_poses is not None:
        for number, name in (("00", "driving, street"), ("01", "driving, motorway")):
            poses = options.kitti_poses / f"{number}.txt"
            ours.append(simulated(name, lambda poses=poses: simulate("driving", poses), count))
    real = [] if options.data is None else real_sets(options.data, count)
    return [naturalness.measure(pictures) for pictures in (*real, *ours)]


def _record(
    metric: str,
    value: float,
    unit: str,
    world: str,
    count: int,
    least: float | None = None,
    most: float | None = None,
    **note: object,
) -> Record:
    """Print a figure and make its record; `least` and `most` are targets, the latter of its size."""
    verdict = ""
    if least is not None or most is not None:
        note["target"] = f"at least {least:g}" if least is not None else f"at most {most:g}"
        note["met"] = value >= least if least is not None else abs(value) <= most
        verdict = f"{note['target']:<16} {'met' if note['met'] else 'MISSED'}"
    name = f"{metric}, {note['steps']} steps" if "steps" in note else metric
    print(f"{world:<13} {name:<36} {value:11.4g} {unit:<12} {verdict}", flush=True)
    return Record(metric, value, unit, dataset=world, count=count, seed=0, protocol=protocol(**note))


PARTS = {"speed": measure_speed, "exactness": measure_exactness, "consistency": measure_consistency}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, help="folder for metrics.json")
    parser.add_argument("--quick", action="store_true", help="fewer frames")
    parser.add_argument("--data", type=Path, default=DATA, help="real pictures and kitti_poses")
    parser.add_argument("--only", nargs="+", choices=[*PARTS, "naturalness"], help="some of the parts")
    parser.add_argument("--worlds", nargs="+", default=["planes", "grid", "forest", "driving", "traffic"])
    parser.add_argument("--figure", type=Path, help="where to draw the figure of naturalness (PNG)")
    parser.add_argument("--sheets", type=Path, help="write the contact sheets to this folder, and no more")
    arguments = parser.parse_args()
    data = arguments.data if arguments.data.is_dir() else None
    if data is None:
        print(f"no data at {arguments.data}: no real pictures, no driving")
    options = Options(arguments.quick, data, tuple(arguments.worlds))
    if arguments.sheets:
        write_sheets(arguments.sheets, options.kitti_poses, [w for w in options.worlds if w != "traffic"])
        return
    parts = arguments.only or [*PARTS, "naturalness"]
    records = [record for part, measure in PARTS.items() if part in parts for record in measure(options)]
    if "naturalness" in parts:
        statistics = measure_naturalness(options)
        print(naturalness.table(statistics))
        records += [record for row in statistics for record in naturalness.records(row)]
        if arguments.figure:
            naturalness.write_figure(arguments.figure, statistics)
    if arguments.out:
        write_records(arguments.out / "metrics.json", records)


if __name__ == "__main__":
    main()
