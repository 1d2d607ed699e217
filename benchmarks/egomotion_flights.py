"""Long simulated flights for ego-motion: rendered once, exposed to as many sensors as wanted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.lib.format import open_memmap
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.next_frame import true_flow
from flowlik.flow import Farneback
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import relative_motion
from flowlik.likelihood.covariates import of_components
from flowlik.measurement.measurements import attach_texture, stratified_pixels
from flowlik.results.records import Record, protocol
from flowlik.simulation import Sensor, SimulatedSequence, lap_frames, simulate
from flowlik.support.files import read_json, write_json
from flowlik.support.progress import Progress

SPEED_MPS = 6.0
# 100 m, and a lap of 198 m
FRAMES = {"straight": 1001, "forest-fig8": lap_frames(SPEED_MPS)}
WORLD_SEEDS = (200, 201, 202)
"""Seeds of the table's forests; nothing was calibrated or tried on them."""

SAVED_EVERY = 20
EDGE_RATIO = 1.1
EDGE_REACH_PX = 10


@dataclass(frozen=True)
class TableFlight:
    """A trajectory through the default forest at 6 m/s and 60 frames/s."""

    trajectory: str
    seed: int
    frames: int

    @property
    def name(self) -> str:
        return f"forest-{self.trajectory}-seed{self.seed}"

    def sequence(self) -> SimulatedSequence:
        return simulate("forest", self.trajectory, self.frames, SPEED_MPS, self.seed)


class Exposed:
    """A rendered flight as one sensor sees it; implements `flowlik.datasets.ImageSequence`.

    Light is kept in half precision, whose rounding is a twentieth of the sensor's own noise.
    """

    def __init__(self, flight: TableFlight, folder: Path, sensor_seed: int) -> None:
        self.flight, self.seed, self.sensor = flight, sensor_seed, Sensor()
        self._sequence = flight.sequence()
        self._light = np.load(folder / "light.npy", mmap_mode="r")
        self._depth = np.load(folder / "depth.npy", mmap_mode="r")
        self.name = flight.name

    @property
    def camera(self) -> Pinhole:
        return self._sequence.camera

    def __len__(self) -> int:
        return self.flight.frames

    def image(self, k: int) -> np.ndarray:
        light = self._light[k].astype(np.float32)
        return self.sensor.expose(light, self.camera, self.seed, k, self.timestamp(k))

    def depth(self, k: int) -> np.ndarray:
        return self._depth[k].astype(np.float64)

    def T_n_c(self, k: int) -> RigidTransform:
        return self._sequence.T_n_c(k)

    def timestamp(self, k: int) -> float:
        return self._sequence.timestamp(k)

    def flow(self, k: int) -> np.ndarray:
        return true_flow(self.camera, self.depth(k), relative_motion(self.T_n_c(k), self.T_n_c(k + 1)))


def rendered(flight: TableFlight, cache: Path, progress: Progress) -> Path:
    """Folder of a flight's light and depth; what is missing is rendered, and an interrupted run goes on."""
    folder = cache / flight.name
    folder.mkdir(parents=True, exist_ok=True)
    sequence = flight.sequence()
    wanted = sequence.configuration_hash
    state = read_json(folder / "done.json") if (folder / "done.json").is_file() else {}
    assert isinstance(state, dict)
    done = int(state.get("frames", 0)) if state.get("configuration") == wanted else 0
    shape = (FRAMES[flight.trajectory], sequence.camera.height, sequence.camera.width)
    mode = "r+" if done else "w+"
    if done >= flight.frames:
        return folder
    light = open_memmap(folder / "light.npy", mode, np.float16, shape)
    depth = open_memmap(folder / "depth.npy", mode, np.float32, shape)
    for k in progress(iter(range(done, flight.frames)), f"rendering {flight.name}", flight.frames - done):
        light[k], depth[k] = sequence.light(k), sequence.depth(k)
        if (k + 1) % SAVED_EVERY == 0 or k + 1 == flight.frames:
            light.flush()
            depth.flush()
            write_json(folder / "done.json", {"configuration": wanted, "frames": k + 1})
    return folder


def description(sequence: Exposed, pairs: int = 30) -> list[Record]:
    """What a flight looks like: true flow, texture and depth edges, over some of its pairs."""
    flows, textures, edges = [], [], []
    for k in np.linspace(0, len(sequence) - 2, min(pairs, len(sequence) - 1)).astype(int):
        flow = np.linalg.norm(sequence.flow(k), axis=-1)
        flows.append(flow[np.isfinite(flow)])
        image = sequence.image(k)
        pixels = stratified_pixels(image.shape, 4000, np.random.default_rng(int(k)))
        m = attach_texture(image, pixels, np.zeros_like(pixels), Farneback())
        textures.append(of_components("texture", m).ravel())
        edges.append(_near_depth_edge(sequence.depth(k)))
    found = {
        "true_flow_median_px": (np.median(np.concatenate(flows)), "px"),
        **{
            f"texture_quantile_{q}": (np.percentile(np.concatenate(textures), q), "intensity^2/px^2")
            for q in (10, 50, 90)
        },
        "near_depth_edge_share": (np.mean(edges), ""),
    }
    note = protocol(
        frames=len(sequence), pixels="all of known depth", edge=f"depth ratio >{EDGE_RATIO} in 3x3",
        near=f"within {EDGE_REACH_PX} px",
    )  # fmt: skip
    return [
        Record(name, float(value), unit, sequence.name, count=len(edges), seed=sequence.seed, protocol=note)
        for name, (value, unit) in found.items()
    ]


def _near_depth_edge(depth: np.ndarray) -> float:
    """Share of pixels of known depth within 10 px of a depth edge."""
    import cv2

    known = np.isfinite(depth)
    # the sky is as far as anything can be
    filled = np.where(known, depth, 1e6).astype(np.float32)
    box = np.ones((3, 3), np.uint8)
    edge = cv2.dilate(filled, box) / cv2.erode(filled, box) > EDGE_RATIO
    reach = np.ones((2 * EDGE_REACH_PX + 1,) * 2, np.uint8)
    return float(np.mean(cv2.dilate(edge.astype(np.uint8), reach)[known]))
