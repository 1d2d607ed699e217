"""Data sets: one file a format, found by name in a registry or by the layout of their folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flowlik.datasets import _layouts as layouts
from flowlik.datasets._camera_file import read_camera
from flowlik.datasets._images import read_grey
from flowlik.datasets._lens import Lens
from flowlik.datasets._mask_file import read_mask
from flowlik.datasets._masked import masked
from flowlik.datasets._resized import resized
from flowlik.datasets.agreement import truth_doubts
from flowlik.datasets.base import ImageSequence, frame_pairs, mask_of
from flowlik.datasets.gps import GpsFixes, check_geodetic, read_gps
from flowlik.datasets.imu import read_imu
from flowlik.datasets.inertial import (
    ImuNoise,
    ImuSamples,
    check_imu,
    read_euroc_imu,
    read_imu_noise,
    read_tartanair_imu,
)
from flowlik.datasets.selection import select_frames
from flowlik.datasets.uncertainty_file import read_uncertainty
from flowlik.datasets.velodyne import read_kitti_lidar_place, read_velodyne
from flowlik.errors import DataError

if TYPE_CHECKING:
    from flowlik.datasets.intrinsics import CameraLike


__all__ = [
    "FORMATS",
    "GpsFixes",
    "ImageSequence",
    "ImuNoise",
    "ImuSamples",
    "Lens",
    "check_geodetic",
    "check_imu",
    "frame_pairs",
    "guess_format",
    "mask_of",
    "masked",
    "open_sequence",
    "read_camera",
    "read_euroc_imu",
    "read_gps",
    "read_grey",
    "read_imu",
    "read_imu_noise",
    "read_kitti_lidar_place",
    "read_mask",
    "read_tartanair_imu",
    "read_uncertainty",
    "read_velodyne",
    "resized",
    "select_frames",
    "truth_doubts",
]


@dataclass(frozen=True)
class Format:
    """How a format is opened and recognised.

    Attributes
    ----------
    open : callable
        Opens a path, with those of ``options`` that are given; imports its reader when called.
    fits : callable
        Whether a path unmistakably has the format's layout.
    layout : str
        What is expected there, in words.
    options : tuple of str
        Of ``camera``, ``frames_per_second``, ``lenient``, ``topic`` and ``depth_topic``, those that it takes.
    """

    open: Callable[..., ImageSequence]
    fits: Callable[[Path], bool]
    layout: str
    options: tuple[str, ...] = ()


def _open_kitti(path: Path, **options: Any) -> ImageSequence:
    from flowlik.datasets.kitti import KittiOdometry

    return KittiOdometry(path, **options)


def _open_kitti_raw(path: Path, **options: Any) -> ImageSequence:
    from flowlik.datasets.kitti_raw import KittiRaw

    return KittiRaw(path, **options)


def _open_tartanair(path: Path, **options: Any) -> ImageSequence:
    from flowlik.datasets.tartanair import TartanAir

    return TartanAir(path, **options)


def _open_sintel(path: Path, **options: Any) -> ImageSequence:
    from flowlik.datasets._sintel import Sintel

    return Sintel(path, **options)


def _open_kitti_flow(path: Path) -> ImageSequence:
    from flowlik.datasets._kitti_flow import KittiFlow

    return KittiFlow(path)


def _open_middlebury_flow(path: Path) -> ImageSequence:
    from flowlik.datasets._middlebury import MiddleburyFlow

    return MiddleburyFlow(path)


def _open_middlebury_stereo(path: Path) -> ImageSequence:
    from flowlik.datasets._middlebury import MiddleburyStereo

    return MiddleburyStereo(path)


def _open_flying_chairs(path: Path) -> ImageSequence:
    from flowlik.datasets._flying_chairs import FlyingChairs

    return FlyingChairs(path)


def _open_seven_scenes(path: Path, **options: Any) -> ImageSequence:
    from flowlik.datasets._seven_scenes import SevenScenes

    return SevenScenes(path, **options)


def _open_tum_rgbd(path: Path, **options: Any) -> ImageSequence:
    from flowlik.datasets._tum_rgbd import TumRgbd

    return TumRgbd(path, **options)


def _open_euroc(path: Path, **options: Any) -> ImageSequence:
    from flowlik.datasets._euroc import Euroc

    return Euroc(path, **options)


def _open_image_folder(path: Path, **options: Any) -> ImageSequence:
    from flowlik.datasets._image_folder import ImageFolder

    return ImageFolder(path, **options)


def _open_video(path: Path, **options: Any) -> ImageSequence:
    from flowlik.datasets._video import Video

    return Video(path, **options)


def _open_ros(path: Path, **options: Any) -> ImageSequence:
    from flowlik.datasets._ros_bag import RosBag

    return RosBag(path, **options)


_BOTH = ("camera", "frames_per_second")

FORMATS: dict[str, Format] = {
    "kitti-flow": Format(_open_kitti_flow, layouts.kitti_flow, "image_2, image_0 or colored_0 with flow_occ"),
    "kitti": Format(_open_kitti, layouts.kitti, "image_0 or image_2", ("lenient",)),
    "kitti-raw": Format(_open_kitti_raw, layouts.kitti_raw, "image_00 or image_02", ("lenient",)),
    "tartanair": Format(_open_tartanair, layouts.tartanair, "image_lcam_front or image_left", ("lenient",)),
    "sintel": Format(
        _open_sintel, layouts.sintel, "frame_NNNN.png, the folder being training/clean/SCENE", ("lenient",)
    ),
    "middlebury-flow": Format(_open_middlebury_flow, layouts.middlebury_flow, "frame10.png"),
    "middlebury-stereo": Format(_open_middlebury_stereo, layouts.middlebury_stereo, "im0.png with disp0.pfm"),
    "flying-chairs": Format(_open_flying_chairs, layouts.flying_chairs, "NNNNN_flow.flo"),
    "seven-scenes": Format(
        _open_seven_scenes, layouts.seven_scenes, "frame-NNNNNN.color.png", ("camera", "lenient")
    ),
    "tum-rgbd": Format(_open_tum_rgbd, layouts.tum_rgbd, "rgb.txt with depth.txt", ("camera", "lenient")),
    "euroc": Format(_open_euroc, layouts.euroc, "mav0/cam0", ("lenient",)),
    "ros": Format(
        _open_ros, layouts.ros, "a ROS bag or .mcap", ("camera", "topic", "depth_topic", "lenient")
    ),
    "video": Format(_open_video, layouts.video, "a file such as .mp4", (*_BOTH, "lenient")),
    "image-folder": Format(_open_image_folder, layouts.image_folder, "images", (*_BOTH, "lenient")),
}
"""Formats by name, in the order in which they are tried on a folder: the more particular layout first."""


def guess_format(path: Path | str) -> str:
    """Name of the format whose layout a folder (or video file) has.

    Raises
    ------
    DataError
        If it is missing, or has the layout of no known format.
    """
    path = Path(path)
    if not path.exists():
        raise DataError(f"{path}: no such file or folder")
    for name, format in FORMATS.items():
        if format.fits(path):
            return name
    if path.is_dir() and (inside := _sequences_in(path)):
        raise DataError(f"{path}: holds data sets and is none; give one of them: {', '.join(inside)}")
    expected = "; ".join(f"{name}: {format.layout}" for name, format in FORMATS.items())
    raise DataError(f"{path}: not the folder of a known data set (expected {expected})")


def _sequences_in(path: Path, most: int = 4) -> list[str]:
    """First folders of a folder that have the layout of a known format."""
    folders = (child for child in sorted(path.iterdir()) if child.is_dir())
    found = [str(child) for child in folders if any(format.fits(child) for format in FORMATS.values())]
    return [*found[:most], *(["..."] if len(found) > most else [])]


def open_sequence(
    path: Path | str,
    format: str | None = None,
    camera: CameraLike | None = None,
    frames_per_second: float | None = None,
    lenient: bool = False,
    topic: str | None = None,
    depth_topic: str | None = None,
) -> ImageSequence:
    """Open the folder of a sequence, or a video file.

    Parameters
    ----------
    path : Path or str
        Folder or file.
    format : str, optional
        A name in `FORMATS`; by default guessed from the layout.
    camera : Pinhole, Lens, str, Path or sequence of float, optional
        Camera for a format without one of its own, or instead of its default: ``f,cx,cy`` or ``fx,fy,cx,cy``
        [px], or a camera file (`read_camera`). Where its lens distorts, images and depth are
        undistorted as they are read.
    frames_per_second : float, optional
        Frame rate [Hz] for a format without times.
    lenient : bool
        Open it though images are missing between others or times go back; `select_frames` then leaves out
        what cannot be used.
    topic : str, optional
        Topic of the images of a ROS bag; needed where there are several.
    depth_topic : str, optional
        Topic of depth images of a ROS bag, registered to the images.

    Raises
    ------
    DataError
        If the format is unknown, does not take what is given, or the folder is not a sequence of it.
    """
    if format is not None and format not in FORMATS:
        raise DataError(f"unknown data set format {format!r}, known are {', '.join(FORMATS)}")
    name = format or guess_format(path)
    options: dict[str, Any] = {
        "camera": camera, "frames_per_second": frames_per_second, "topic": topic, "depth_topic": depth_topic,
    }  # fmt: skip
    given = {option: value for option, value in options.items() if value is not None}
    for option in given:
        if option not in FORMATS[name].options:
            takers = ", ".join(n for n, f in FORMATS.items() if option in f.options)
            raise DataError(f"{path}: format {name} has its own {option}, only {takers} take one")
    if lenient and "lenient" in FORMATS[name].options:
        given["lenient"] = True
    return without_distortion(FORMATS[name].open(Path(path), **given))


def without_distortion(sequence: ImageSequence) -> ImageSequence:
    """Sequence whose images are undistorted as they are read, if its lens distorts."""
    lens = getattr(sequence, "lens", None)
    if lens is None or not lens.distorts:
        return sequence
    from flowlik.datasets.undistorted import Undistorted

    return Undistorted(sequence, lens)
