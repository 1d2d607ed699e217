"""What the shell offers on the tab key; nothing heavy is imported here."""

from __future__ import annotations

from collections.abc import Callable

METHODS = (
    "dis",
    "farneback",
    "farneback-wide",
    "horn-schunck",
    "lucas-kanade",
    "lucas-kanade-11",
    "lucas-kanade-11-opencv",
    "lucas-kanade-opencv",
)
FAMILIES = ("gaussian", "glc", "laplace", "lcm", "log-logistic", "student-t")
SCHEDULES = ("constant", "flow", "index", "texture")
ESTIMATORS = ("lcmsac", "mle", "ransac")
RESIDUALS = ("depth", "epipolar")
SCALES = ("camera-height", "gps-norm", "none", "stereo", "truth-norm")
EXECUTORS = ("dask", "processes", "serial")
WORLDS = ("driving", "forest", "forest-small", "grid", "planes")
TRAJECTORIES = ("curve", "forest-fig8", "hover", "straight", "training")
FORMATS = (
    "euroc", "flying-chairs", "image-folder", "kitti", "kitti-flow", "kitti-raw", "middlebury-flow",
    "middlebury-stereo", "ros", "seven-scenes", "sintel", "tartanair", "tum-rgbd", "video",
)  # fmt: skip
FLOW_PNGS = ("dsec", "kitti", "tartanair", "virtual-kitti")
BORESIGHTS = ("causal", "none")
ALIGNMENTS = ("none", "se3", "sim3")


def one_of(names: tuple[str, ...]) -> Callable[[str], list[str]]:
    """Completion that offers the names that begin with what was typed."""

    def complete(incomplete: str) -> list[str]:
        return [name for name in names if name.startswith(incomplete)]

    return complete


def models(incomplete: str) -> list[str]:
    """Shipped models whose names begin with what was typed; files are the shell's own."""
    from flowlik.likelihood.shipped import shipped

    return [name for name in shipped() if name.startswith(incomplete)]
