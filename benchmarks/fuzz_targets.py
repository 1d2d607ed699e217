"""What is fuzzed: every reader and every file that is loaded, with a small whole example of each."""

from __future__ import annotations

import contextlib
import itertools
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.datasets import camera_files, fakes, test_kitti_raw, test_numbering
from tests.datasets.ros_bags import Message, make_bag
from tests.datasets.test_open_sequence import MAKERS
from tests.odometry.test_ros_odometry import write_bag
from tests.odometry.test_trajectory_covariance import steps

import fuzz_examples as examples
from flowlik.calibration import load_sketch
from flowlik.datasets import ImageSequence, open_sequence, read_camera, read_grey
from flowlik.datasets._mask_file import read_mask
from flowlik.datasets.flow_files import read_flow
from flowlik.datasets.truth import with_truth
from flowlik.datasets.uncertainty_file import read_uncertainty
from flowlik.errors import DataError
from flowlik.geometry.pose_table import read_pose_table
from flowlik.geometry.trajectory import chain, read_trajectory, write_kitti, write_tum
from flowlik.likelihood.model_file import load_likelihood
from flowlik.likelihood.shipped import shipped
from flowlik.odometry.ros_odometry import read_odometry_bag, write_odometry_bag
from flowlik.odometry.trajectory_covariance import (
    read_covariance_csv,
)
from flowlik.report._figures import render
from flowlik.report._page import read_arrays, read_run
from flowlik.results.records import read_records
from flowlik.support.extras import missing
from fuzz_examples import file_of, trajectory
from fuzz_sensors import sensors

FIELDS = ("image", "flow", "visible", "depth", "T_n_c", "timestamp")
MOST_FRAMES = 6


class Target(NamedTuple):
    """How an example is made below a folder, and how it is used; ``use`` gets what ``make`` returned."""

    make: Callable[[Path], Path]
    use: Callable[[Path], object]


def everything(path: Path, format: str | None, **options: Any) -> None:
    """Ask a sequence for all it has."""
    ask(open_sequence(path, format, **options))


def ask(sequence: ImageSequence) -> None:
    """Ask a sequence for all that its first frames have."""
    fields = [getattr(sequence, name) for name in FIELDS if hasattr(sequence, name)]
    for k in range(min(len(sequence), MOST_FRAMES)):
        for field in fields:
            try:
                field(k)
            except DataError as error:
                assert "\n" not in str(error), "a message of several lines"
    with contextlib.suppress(DataError):
        _ = sequence.camera


def _images() -> dict[str, Target]:
    grey = fakes.picture(0)
    colour = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)

    def write(path: Path) -> None:
        fakes.save(path, grey if path.suffix == ".pgm" else colour)

    return {
        f"image {suffix}": Target(file_of(f"a.{suffix}", write), read_grey)
        for suffix in ("png", "jpg", "bmp", "pgm", "ppm", "tif", "webp")
    }


def _flow(suffix: str) -> Target:
    writers = {
        "flo": lambda p: fakes.write_flo(p, fakes.some_flow()),
        "png": lambda p: fakes.write_kitti_flow(p, fakes.some_flow()),
        "npy": lambda p: np.save(p, fakes.some_flow().transpose(2, 0, 1)),
        "npz": lambda p: np.savez_compressed(p, flow=fakes.some_flow(), valid=np.ones((30, 40))),
        "pfm": lambda p: fakes.write_pfm(p, np.dstack([fakes.some_flow(), np.zeros((30, 40))])),
    }
    return Target(file_of(f"a.{suffix}", writers[suffix]), read_flow)


def _ros() -> dict[str, Target]:
    if missing("ros"):
        return {}

    def odometry(root: Path) -> Path:
        root.mkdir(parents=True)
        return write_odometry_bag(root / "odometry", *trajectory())

    def bag(root: Path, **options) -> Path:
        root.mkdir(parents=True)
        return write_bag(root / "bag", **options)

    def driver(encoding: str, depth: str | None = None) -> Callable[[Path], Path]:
        def make(root: Path) -> Path:
            root.mkdir(parents=True)
            grey = [
                fakes.picture(k).astype(np.uint16 if encoding == "mono16" else np.uint8) for k in range(3)
            ]
            images = [Message(k, 100 + k, encoding, values) for k, values in enumerate(grey)]
            if depth is not None:
                kind = np.uint16 if depth == "16UC1" else np.float32
                images += [
                    Message(k, 100 + k, depth, (9 + values).astype(kind), topic="/depth")
                    for k, values in enumerate(grey)
                ]
            return make_bag(root / "bag", images)

        return make

    return {
        "ros mono16": Target(driver("mono16"), lambda path: everything(path, "ros")),
        "ros nv12": Target(driver("nv12"), lambda path: everything(path, "ros")),
        **{
            f"ros depth {kind}": Target(
                driver("mono8", kind), lambda path: everything(path, "ros", depth_topic="/depth")
            )
            for kind in ("16UC1", "32FC1")
        },
        "ros mcap": Target(bag, lambda path: everything(path, "ros")),
        "ros sqlite": Target(
            lambda root: bag(root, plugin="SQLITE3", encoding="jpeg"), lambda path: everything(path, "ros")
        ),
        "ros odometry": Target(odometry, read_odometry_bag),
    }


def _cameras() -> dict[str, Target]:
    """Camera files of each kind, read as a lens that is then used."""
    texts = {
        "ros": camera_files.ROS,
        "ros echo": camera_files.ROS_ECHO,
        "kalibr": camera_files.KALIBR,
        "kalibr ds": camera_files.KALIBR_DS,
        "euroc": camera_files.EUROC,
        "orb-slam 2": camera_files.ORB_SLAM_2,
        "orb-slam 3": camera_files.ORB_SLAM_3,
        "colmap": camera_files.COLMAP,
        "kitti": camera_files.KITTI,
        "kitti raw": camera_files.KITTI_RAW,
        "transforms": camera_files.transforms(),
        "basalt": camera_files.basalt("ds", xi=camera_files.XI, alpha=camera_files.ALPHA),
        "row": "458.5 457.25 367.0 248.5\n",
    }
    found = {
        f"camera {name}": Target(file_of("camera", lambda p, text=text: p.write_text(text)), use_camera)
        for name, text in texts.items()
    }
    opencv = {
        f"camera opencv {suffix}": Target(
            file_of(f"camera.{suffix}", camera_files.written_by_opencv), use_camera
        )
        for suffix in ("yml", "xml", "json")
    }

    def fisheye(path: Path) -> None:
        camera_files.written_by_opencv(path, fisheye=True)

    opencv["camera opencv fisheye"] = Target(file_of("camera.yml", fisheye), use_camera)
    stereo = file_of("camera", lambda p: p.write_text(camera_files.ORB_SLAM_STEREO))
    return found | opencv | {"camera orb-slam stereo": Target(stereo, lambda p: use_camera(p, "LEFT"))}


def use_camera(path: Path, name: str | None = None) -> None:
    """Read a camera file and use it; maps of every hundredth, they are slow."""
    lens = read_camera(path, name)
    for shape in ((480, 752), (375, 1242)):
        with contextlib.suppress(DataError):
            lens.straighten(np.array([[367.0, 248.0], [0.0, 0.0], [1e3, -1e3]]), shape)
            if next(_counter) % 100 == 0:
                lens.valid(shape)


def _poses() -> dict[str, Target]:
    """Files of poses in each layout."""
    matrices = chain(m.T_k_prev for m in steps(4)).as_matrix()
    last = np.tile([0.0, 0, 0, 1], (5, 1))
    rows = matrices[:, :3].reshape(5, 12)
    numbers = np.arange(5.0)[:, None]
    quaternions = np.tile([1.0, 2, 3, 0, 0, 0.6, 0.8], (5, 1))
    tables = {
        "7": quaternions,
        "13": np.hstack([numbers, rows]),
        "13 times": np.hstack([numbers + 0.5, rows]),
        "16": np.hstack([rows, last]),
        "17": np.hstack([numbers, rows, last]),
    }

    def euroc(path: Path) -> None:
        text = "".join(f"{10**9 + k},{','.join(map(str, row))},0,0,0\n" for k, row in enumerate(quaternions))
        path.write_text(f"#timestamp,x,y,z\n{text}")

    def use(path: Path) -> None:
        with contextlib.suppress(DataError):
            read_pose_table(path, lenient=True)
        read_pose_table(path)

    return {
        **{
            f"poses {name}": Target(file_of("p.txt", lambda p, table=table: np.savetxt(p, table)), use)
            for name, table in tables.items()
        },
        "poses euroc": Target(file_of("p.csv", euroc), use),
        "poses tum": Target(file_of("p.txt", lambda p: write_tum(p, trajectory()[0])), use),
    }


def _lenient() -> dict[str, Target]:
    """Readers that go on over what is missing or double."""
    makers = {
        "kitti": examples.kitti,
        "tartanair": examples.tartanair,
        **{n: MAKERS[n] for n in ("euroc", "tum-rgbd")},
    }
    return {
        f"lenient {name}": Target(make, lambda path, name=name: everything(path, name, lenient=True))
        for name, make in makers.items()
    }


def targets() -> dict[str, Target]:
    """All targets by name."""
    makers = {
        **MAKERS,
        "kitti": examples.kitti,
        "kitti-raw": test_kitti_raw.make_drive,
        "tartanair": examples.tartanair,
    }
    found = {
        f"reader {name}": Target(make, lambda path, name=name: everything(path, name))
        for name, make in {**makers, "video": examples.video}.items()
    }
    model = shipped()["lucas-kanade-lcm"], shipped()["dis"]
    return {
        **found,
        "reader tartanair v1": Target(
            test_numbering.make_tartanair_v1, lambda path: everything(path, "tartanair")
        ),
        **_lenient(),
        **_poses(),
        "truth": Target(
            examples.truth, lambda root: ask(with_truth(open_sequence(root / "walk"), root / "truth.txt"))
        ),
        **_ros(),
        **{name: Target(*used) for name, used in sensors().items()},
        **_images(),
        **{f"flow {suffix}": _flow(suffix) for suffix in ("flo", "png", "npy", "npz", "pfm")},
        "flow tartanair": Target(file_of("a.png", examples.tartanair_flow), read_flow),
        **_cameras(),
        "mask": Target(
            file_of("m.png", examples.mask),
            lambda path: read_mask(path, (fakes.HEIGHT, fakes.WIDTH)),
        ),
        **{
            f"model {path.stem}": Target(
                file_of("m.json", lambda p, path=path: shutil.copy(path, p)), load_likelihood
            )
            for path in model
        },
        "trajectory kitti": Target(
            file_of("t.txt", lambda p: write_kitti(p, trajectory()[0])), read_trajectory
        ),
        "trajectory tum": Target(file_of("t.txt", lambda p: write_tum(p, trajectory()[0])), read_trajectory),
        "covariance": Target(file_of("c.csv", examples.covariance), read_covariance_csv),
        "uncertainty": Target(file_of("u.png", examples.uncertainty), read_uncertainty),
        "sketch": Target(file_of("s.npz", examples.sketch), load_sketch),
        "run": Target(examples.run, read_run),
        "records": Target(
            lambda root: examples.run(root) / "metrics.json",
            lambda path: (read_records(path), read_run(path.parent)),
        ),
        "figure": Target(file_of("uncertainty--a.npz", examples.figure), lambda p: _draw(p)),
    }


def _draw(path: Path) -> None:
    """Read the arrays of a figure, and draw every hundredth: drawing is slow."""
    arrays = read_arrays(path)
    if next(_counter) % 100 == 0:
        render("uncertainty", arrays)


_counter = itertools.count()
