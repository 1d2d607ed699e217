"""A textured room seen by a moving camera, in the layouts of data sets: images move as their truth says."""

import json
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets.flow_files import write_flo, write_kitti_flow
from flowlik.datasets.next_frame import true_flow
from flowlik.datasets.tartanair import encode_depth, encode_poses
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.trajectory import Trajectory, write_kitti

from .fakes import save

CAMERA = Pinhole(320, 240, 220.0, 220.0, 158.0, 121.0)
FRAMES = 14
PLANES = (([0.1, 0.05, 1.0], 6.0), ([0.0, 1.0, 0.1], 1.2))  # a wall and a floor: n . X = d [m]
TEXELS_PER_M = 60


def _texture(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    waves = sum(gaussian_filter(rng.normal(size=(1024, 1024)), s, mode="wrap") * s for s in (1.5, 3, 6))
    return np.clip(128 + 45 * waves / waves.std(), 0, 255).astype(np.float32)


TEXTURES = [_texture(seed) for seed in (1, 2)]


def walk(frames: int = FRAMES) -> RigidTransform:
    """Poses of steps and turns no two of which are alike."""
    rng = np.random.default_rng(5)
    steps = np.array([0.06, 0.01, 0.1]) * rng.uniform(0.2, 1.8, (frames, 3))
    turns = np.cumsum(rng.uniform(-1, 1, (frames, 3)) * [0.006, 0.012, 0.004], axis=0)
    return RigidTransform.from_components(np.cumsum(steps, axis=0) * [1, 0.2, 1], Rotation.from_rotvec(turns))


def straight(frames: int, advance: np.ndarray | None = None) -> RigidTransform:
    """Poses of a camera that flies straight, by default at one speed."""
    advance = np.arange(frames) / 10 if advance is None else advance
    return RigidTransform.from_translation(np.outer(advance, [0.4, 0.05, 0.8]))


def view(T_n_c: RigidTransform, camera: Pinhole = CAMERA) -> tuple[np.ndarray, np.ndarray]:
    """Grey image (H, W), with the noise of a sensor, and depth (H, W) [m]."""
    rays = camera.rays(camera.pixel_grid()) @ T_n_c.rotation.as_matrix().T
    depth, image = np.full(len(rays), np.inf), np.zeros(len(rays), np.float32)
    for (normal, distance), texture in zip(PLANES, TEXTURES):
        with np.errstate(divide="ignore"):
            z = (distance - T_n_c.translation @ normal) / (rays @ normal)
        nearer = (z > 0) & (z < depth)
        along = np.linalg.svd(np.array([normal]))[2][1:]  # two directions in the plane
        points = T_n_c.translation + z[nearer, None] * rays[nearer]
        depth[nearer] = z[nearer]
        image[nearer] = map_coordinates(texture, along @ points.T * TEXELS_PER_M, order=1, mode="grid-wrap")
    noise = np.random.default_rng(crc32(T_n_c.translation.tobytes())).normal(0, 1.5, len(rays))
    shape = camera.height, camera.width
    return np.clip(image + noise, 0, 255).astype(np.uint8).reshape(shape), depth.reshape(shape)


@dataclass
class Flight:
    """What a data set is made of; tests change it before it is written."""

    images: list[np.ndarray]
    depths: list[np.ndarray]
    poses: RigidTransform
    times_s: np.ndarray
    camera: Pinhole = CAMERA
    flow_factor: float = 1.0

    def flow(self, k: int) -> np.ndarray:
        motion = self.poses[k + 1].inv() * self.poses[k]
        return self.flow_factor * true_flow(self.camera, self.depths[k], motion)

    def __len__(self) -> int:
        return len(self.images)


def flight(poses: RigidTransform | None = None) -> Flight:
    """A flight whose truth is right."""
    poses = walk() if poses is None else poses
    images, depths = zip(*(view(T) for T in poses))
    return Flight(list(images), list(depths), poses, 100 + 0.1 * np.arange(len(poses)))


def write_tartanair(folder: Path, made: Flight) -> Path:
    for k in range(len(made)):
        save(folder / f"image_lcam_front/{k:06d}_lcam_front.png", made.images[k])
        save(folder / f"depth_lcam_front/{k:06d}_lcam_front_depth.png", encode_depth(made.depths[k]))
    np.savetxt(folder / "pose_lcam_front.txt", encode_poses(made.poses))
    np.savetxt(folder / "times.txt", made.times_s)
    c = made.camera
    values = {"width": c.width, "height": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy}
    (folder / "camera.json").write_text(json.dumps({**values, "frames_per_second": 10}))
    return folder


def write_tum(folder: Path, made: Flight) -> Path:
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
    for k, t in enumerate(made.times_s):
        save(folder / f"rgb/{k}.png", made.images[k])
        save(folder / f"depth/{k}.png", np.rint(made.depths[k] * 5000).astype(np.uint16))
        T = made.poses[k]
        pose = " ".join(f"{v:.9f}" for v in (*T.translation, *T.rotation.as_quat()))
        for name, what in (("rgb", f"rgb/{k}.png"), ("depth", f"depth/{k}.png"), ("groundtruth", pose)):
            lists[name].append(f"{t:.6f} {what}")
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    c = made.camera
    (folder / "calibration.txt").write_text(f"{c.fx} {c.fy} {c.cx} {c.cy}\n")
    return folder


def write_seven_scenes(folder: Path, made: Flight) -> Path:
    for k in range(len(made)):
        save(folder / f"frame-{k:06d}.color.png", made.images[k])
        save(folder / f"frame-{k:06d}.depth.png", np.rint(made.depths[k] * 1000).astype(np.uint16))
        np.savetxt(folder / f"frame-{k:06d}.pose.txt", made.poses[k].as_matrix())
    np.savetxt(folder / "camera-intrinsics.txt", made.camera.K)
    return folder


def write_kitti_odometry(folder: Path, made: Flight) -> Path:
    for k in range(len(made)):
        save(folder / f"image_0/{k:06d}.png", made.images[k])
    row = " ".join(map(str, np.column_stack([made.camera.K, np.zeros(3)]).ravel()))
    (folder / "calib.txt").write_text(f"P0: {row}\n")
    write_kitti(folder / "poses.txt", Trajectory(made.times_s, made.poses))
    np.savetxt(folder / "times.txt", made.times_s)
    return folder


def write_euroc(folder: Path, made: Flight) -> Path:
    c, stamps = made.camera, np.rint(made.times_s * 1e9).astype(np.int64)
    for k, stamp in enumerate(stamps):
        save(folder / f"mav0/cam0/data/{stamp}.png", made.images[k])
    rows = [f"{t},{t}.png" for t in stamps]
    (folder / "mav0/cam0/data.csv").write_text("#timestamp [ns],filename\n" + "\n".join(rows) + "\n")
    sensor = f"""T_BS:
  data: {np.eye(4).ravel().tolist()}
resolution: [{c.width}, {c.height}]
camera_model: pinhole
intrinsics: [{c.fx}, {c.fy}, {c.cx}, {c.cy}]
distortion_model: radial-tangential
distortion_coefficients: [0, 0, 0, 0]
"""
    (folder / "mav0/cam0/sensor.yaml").write_text(sensor)
    truth = folder / "mav0/state_groundtruth_estimate0"
    truth.mkdir()
    poses = [(*T.translation, *T.rotation.as_quat(scalar_first=True)) for T in made.poses]
    rows = [f"{t},{','.join(map(str, pose))}" for t, pose in zip(stamps, poses)]
    (truth / "data.csv").write_text("#timestamp, p, q\n" + "\n".join(rows) + "\n")
    return folder


def write_sintel(folder: Path, made: Flight) -> Path:
    training = folder / "training"
    (training / "flow/alley_9").mkdir(parents=True)
    for k in range(len(made)):
        save(training / f"clean/alley_9/frame_{k + 1:04d}.png", made.images[k])
        if k + 1 < len(made):
            write_flo(training / f"flow/alley_9/frame_{k + 1:04d}.flo", made.flow(k))
            save(training / f"invalid/alley_9/frame_{k + 1:04d}.png", np.zeros_like(made.images[k]))
    return training / "clean/alley_9"


def write_kitti_flow_pairs(folder: Path, made: Flight) -> Path:
    (folder / "flow_occ").mkdir(parents=True)
    for k in range(0, len(made) - 1, 2):
        save(folder / f"image_2/{k:06d}_10.png", made.images[k])
        save(folder / f"image_2/{k:06d}_11.png", made.images[k + 1])
        write_kitti_flow(folder / f"flow_occ/{k:06d}_10.png", made.flow(k))
    return folder


def write_chairs(folder: Path, made: Flight) -> Path:
    for k in range(0, len(made) - 1, 2):
        save(folder / f"{k:05d}_img1.ppm", cv2.cvtColor(made.images[k], cv2.COLOR_GRAY2BGR))
        save(folder / f"{k:05d}_img2.ppm", cv2.cvtColor(made.images[k + 1], cv2.COLOR_GRAY2BGR))
        write_flo(folder / f"{k:05d}_flow.flo", made.flow(k))
    return folder


def write_middlebury(folder: Path, made: Flight) -> Path:
    save(folder / "frame10.png", made.images[0])
    save(folder / "frame11.png", made.images[1])
    write_flo(folder / "flow10.flo", made.flow(0))
    return folder
