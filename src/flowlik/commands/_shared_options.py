"""Options that several commands share, and how options are recorded.

Nothing heavy is imported here, so that the command line takes its defaults from these classes.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any


@dataclass(frozen=True)
class Options:
    """What a command may be told; every option has a default."""

    def asdict(self) -> dict[str, Any]:
        """All options by name, as JSON takes them: the configuration in ``run.json``."""
        return dataclasses.asdict(self, dict_factory=_plain)


def _plain(items: list[tuple[str, Any]]) -> dict[str, Any]:
    return {name: str(value) if isinstance(value, PurePath) else value for name, value in items}


@dataclass(frozen=True, kw_only=True)
class Execution(Options):
    """Where a command measures, and whether it keeps the sketches.

    Attributes
    ----------
    executor : {"serial", "processes", "dask"}
        Where to measure, see `flowlik.calibration.executor`.
    workers : int, optional
        Processes on this machine; by default one a core.
    scheduler : str, optional
        Address of a Dask scheduler; by default a cluster of local processes.
    keep_sketches : bool
        Leave the sketches in the run's folder, for a repeated run.
    """

    executor: str = "serial"
    workers: int | None = None
    scheduler: str | None = None
    keep_sketches: bool = False


@dataclass(frozen=True, kw_only=True)
class Data(Options):
    """How data sets are opened, and how their images are looked at.

    Attributes
    ----------
    format : str, optional
        Data format; guessed by default.
    camera : str, optional
        As `flowlik.open_sequence` takes it, for data without a camera of its own.
    mask : Path, optional
        Image of the size of the images as they are, white where pixels are used; `flowlik.datasets.masked`.
    resize : str, optional
        ``WIDTHxHEIGHT`` [px] or a factor of the images' size; `flowlik.datasets.resized`.
    flow_png : str, optional
        Coding of flow in PNG files that do not tell it themselves: a name in
        `flowlik.datasets.flow_png.PNG_CODINGS`.
    skip_bad_frames : bool
        Go on over frames that are missing or unreadable, or whose time does not advance; the report tells
        which.
    """

    format: str | None = None
    camera: str | None = None
    mask: Path | None = None
    resize: str | None = None
    flow_png: str | None = None
    skip_bad_frames: bool = False

    @property
    def images(self) -> dict[str, Any]:
        """What is done to the images, if anything, for the protocol of results."""
        done = {"mask": None if self.mask is None else "given", "resize": self.resize}
        return {key: value for key, value in done.items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class StandardFlights(Options):
    """Which standard flights are calibrated on, and where they are kept.

    Attributes
    ----------
    share : float
        Share of each standard flight's places, at least one of each.
    cache : Path, optional
        Folder of the standard flights, rendered once; by default the user's cache folder.
    kitti_poses : Path, optional
        Folder of KITTI odometry's true poses, ``00.txt`` to ``10.txt``, whose routes the standard flights
        along roads follow; without it these are left out.
    """

    share: float = 1.0
    cache: Path | None = None
    kitti_poses: Path | None = None
