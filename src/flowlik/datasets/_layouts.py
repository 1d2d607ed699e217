"""What the folder of each format looks like: enough to guess the format, and no more."""

from __future__ import annotations

from pathlib import Path

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff", ".webp"})
BAG_SUFFIXES = frozenset({".bag", ".mcap", ".db3"})
VIDEO_SUFFIXES = frozenset({".mp4", ".m4v", ".avi", ".mov", ".mkv", ".webm", ".mpg", ".mpeg"})

KITTI_IMAGES = ("image_0", "image_2", "colored_0")
STEREO_FILES = (("im0.png", "im1.png", "disp0.pfm"), ("*_left.png", "*_right.png", "*_disp.npz"))
"""Names of left image, right image and disparity: Middlebury's own, and those of scikit-image's copy."""


def kitti_flow(path: Path) -> bool:
    """Whether there are images with true flow beside them."""
    return _has_folder(path, "flow_occ", "flow_noc") and _has_folder(path, *KITTI_IMAGES)


def kitti(path: Path) -> bool:
    """Whether there are images of camera 0 or 2."""
    return _has_folder(path, "image_0", "image_2")


def kitti_raw(path: Path) -> bool:
    """Whether there are images of a raw drive's camera 0 or 2."""
    return _has_folder(path, "image_00", "image_02")


def tartanair(path: Path) -> bool:
    """Whether there are images of the left camera, by the names of V2 or V1."""
    return _has_folder(path, "image_lcam_front", "image_left")


def sintel(path: Path) -> bool:
    """Whether this is a scene of a pass, with true flow beside the pass."""
    apart = path.resolve().parent.parent / "flow" / path.resolve().name
    return apart.is_dir() and _has_file(path, "frame_*.png")


def middlebury_flow(path: Path) -> bool:
    """Whether this is a scene, or a folder of scenes."""
    return _has_file(path, "frame10.png", "*/frame10.png")


def middlebury_stereo(path: Path) -> bool:
    """Whether this is a scene with disparity, or a folder of scenes."""
    return any(
        _has_file(path, start + left) and _has_file(path, start + truth)
        for left, _, truth in STEREO_FILES
        for start in ("", "*/")
    )


def flying_chairs(path: Path) -> bool:
    """Whether there are flows named as those of FlyingChairs, here or in ``data``."""
    return _has_file(path, "*[0-9]flow.flo", "*[0-9]_flow.flo", "data/*[0-9]_flow.flo")


def seven_scenes(path: Path) -> bool:
    """Whether there are colour frames."""
    return _has_file(path, "frame-*.color.png", "frame-*.color.jpg")


def tum_rgbd(path: Path) -> bool:
    """Whether there is a list of colour images, and one of depth images or poses."""
    others = ("depth.txt", "groundtruth.txt")
    return (path / "rgb.txt").is_file() and any((path / name).is_file() for name in others)


def euroc(path: Path) -> bool:
    """Whether there is a first camera."""
    return any((path / start / "cam0" / "data.csv").is_file() for start in ("mav0", ""))


def image_folder(path: Path) -> bool:
    """Whether there is an image."""
    return path.is_dir() and any(file.suffix.lower() in IMAGE_SUFFIXES for file in path.iterdir())


def video(path: Path) -> bool:
    """Whether the file is named as a video."""
    return path.suffix.lower() in VIDEO_SUFFIXES and path.is_file()


def ros(path: Path) -> bool:
    """Whether this is a ROS bag: a folder with metadata, or a file named as one."""
    return (path / "metadata.yaml").is_file() or (path.suffix.lower() in BAG_SUFFIXES and path.is_file())


def _has_folder(path: Path, *names: str) -> bool:
    return any((path / name).is_dir() for name in names)


def _has_file(path: Path, *patterns: str) -> bool:
    return any(next(path.glob(pattern), None) is not None for pattern in patterns)
