"""Small whole examples of what is fuzzed, each made below a folder."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.datasets import fakes, test_kitti, test_truth
from tests.odometry.test_trajectory_covariance import steps

from flowlik.calibration import save_sketch
from flowlik.calibration.sketch import ErrorSketch
from flowlik.datasets.tartanair import encode_depth, encode_flow
from flowlik.datasets.uncertainty_file import write_uncertainty
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.trajectory import Trajectory, chain
from flowlik.likelihood.schedule import Index
from flowlik.odometry.trajectory_covariance import _write_covariance_csv, trajectory_covariance
from flowlik.results.records import Record, write_records


def file_of(name: str, write: Callable[[Path], object]) -> Callable[[Path], Path]:
    """Maker of one file."""

    def make(root: Path) -> Path:
        root.mkdir(parents=True, exist_ok=True)
        write(root / name)
        return root / name

    return make


def kitti(root: Path) -> Path:
    folder = test_kitti.make_sequence(root / "03")
    test_kitti.write_poses(folder / "poses.txt", 4)
    (folder / "times.txt").write_text("0\n0.1\n0.2\n0.3\n")
    return folder


def tartanair(root: Path) -> Path:
    for kind in ("image", "depth"):
        (root / f"{kind}_lcam_front").mkdir(parents=True)
    for k in range(3):
        cv2.imwrite(str(root / f"image_lcam_front/{k:06d}_lcam_front.png"), fakes.picture(k))
        depth = encode_depth(np.full((fakes.HEIGHT, fakes.WIDTH), 9.0))
        cv2.imwrite(str(root / f"depth_lcam_front/{k:06d}_lcam_front_depth.png"), depth)
    np.savetxt(root / "pose_lcam_front.txt", [[0.1 * k, 0, 0, 0, 0, 0, 1] for k in range(3)])
    camera = {"width": fakes.WIDTH, "height": fakes.HEIGHT, "fx": 40, "fy": 40, "cx": 19.5, "cy": 14.5}
    (root / "camera.json").write_text(json.dumps({**camera, "frames_per_second": 20}))
    return root


def video(root: Path) -> Path:
    root.mkdir(parents=True)
    writer = cv2.VideoWriter(str(root / "a.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 20, (64, 48))
    for k in range(4):
        writer.write(cv2.cvtColor(fakes.picture(k, 64, 48), cv2.COLOR_GRAY2BGR))
    writer.release()
    return root / "a.avi"


def trajectory() -> tuple[Trajectory, list]:
    motions = steps(4)
    return Trajectory(np.arange(5) / 10, chain(m.T_k_prev for m in motions)), motions


def covariance(path: Path) -> None:
    flown, motions = trajectory()
    _write_covariance_csv(path, trajectory_covariance(flown.timestamps, motions))


def sketch(path: Path) -> None:
    save_sketch(ErrorSketch.empty(Index()), path)


def run(root: Path) -> Path:
    root.mkdir(parents=True)
    (root / "run.json").write_text(
        json.dumps({"name": "flowlik flow", "command": "flowlik flow", "config": {}})
    )
    write_records(root / "metrics.json", [Record("nll", 1.0, "nat", "a", "dis", count=3, seed=1)])
    return root


def figure(path: Path) -> None:
    flow = fakes.some_flow().astype(np.float32)
    half_width = np.abs(flow) + 0.1
    np.savez_compressed(
        path, image=fakes.picture(0), flow=flow, half_width=half_width, angle=flow[..., 0], confidence=0.9
    )


def uncertainty(path: Path) -> None:
    write_uncertainty(path, np.abs(fakes.some_flow()), fakes.some_flow()[..., 0])


def tartanair_flow(path: Path) -> None:
    flow = fakes.some_flow()
    cv2.imwrite(str(path), encode_flow(flow, np.ones((30, 40), bool), Pinhole(40, 30, 20, 20, 19.5, 14.5)))


def mask(path: Path) -> None:
    usable = np.full((fakes.HEIGHT, fakes.WIDTH), 255, np.uint8)
    usable[20:, :15] = 0
    fakes.save(path, usable)


def truth(root: Path) -> Path:
    test_truth.make_images(root)
    return test_truth.write_tum(root / "truth.txt", range(test_truth.COUNT)).parent
