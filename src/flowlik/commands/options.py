"""Options of the commands, as objects: what a run records of itself is their `Options.asdict`.

Nothing heavy is imported here, so that the command line takes its defaults from these classes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from flowlik.commands._shared_options import Data, Execution, Options, StandardFlights

if TYPE_CHECKING:
    from flowlik.geometry.camera import Pinhole


BEST_FAMILY, BEST_SCHEDULE = "glc", "index"


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions(Execution, Data, StandardFlights):
    """Options of `flowlik.commands.calibrate`, of `Execution`, and of `Data` or `StandardFlights`.

    Attributes
    ----------
    family : str
        Family of the saved model; all are fitted, for comparison.
    schedule : str
        Schedule of the saved model, one of `flowlik.calibration.SCHEDULES`; the paper's is ``"texture"``.
    standard : bool
        Calibrate on the standard flights, as the shipped models were, instead of on data.
    seed : int
        Seed of pixels and reservoirs.
    """

    family: str = BEST_FAMILY
    schedule: str = BEST_SCHEDULE
    standard: bool = False
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class TruthlessOptions(Data):
    """Options of `flowlik.commands.calibrate_without_truth`, those of `Data` among them.

    Attributes
    ----------
    residual : {"depth", "epipolar"}, optional
        Which errors are learned; by default both components if the data has depth.
    model : Path, optional
        Model to begin with; by default the one that ships for the method, if one does.
    self_calibrate : bool
        Refine the camera from the images first, without depth.
    pairs : int
        Image pairs, evenly spread over the data.
    family : str
        Family of the model.
    seed : int
        Seed of pixels, samples and rows.
    """

    residual: str | None = None
    model: Path | None = None
    self_calibrate: bool = False
    pairs: int = 300
    family: str = BEST_FAMILY
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(Execution, Data):
    """Options of `flowlik.commands.evaluate`, those of `Execution` and `Data` among them.

    Attributes
    ----------
    method : str, optional
        May only confirm the model's flow method; must, where that is an object, a network or flow on disk.
    seed : int
        Seed of pixels and of the bootstrap.
    """

    method: str | None = None
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class OdometryOptions(Data):
    """Options of `flowlik.commands.odometry`, those of `Data` among them.

    Attributes
    ----------
    model : Path, optional
        Model file; needed for lcmsac and mle. It names the flow method.
    method : str, optional
        Flow method for RANSAC without a model; beside a model it may only confirm it, and must
        where that is an object, a network or flow on disk.
    estimator : {"lcmsac", "ransac", "mle"}
        Estimator.
    residual : {"depth", "epipolar"}, optional
        By default known depth if the data has it.
    scale : {"none", "truth-norm", "gps-norm", "camera-height", "stereo"}
        Where the length of each motion comes from without depth.
    camera_height_m : float, optional
        Height of the camera over the road [m]: the scale ``camera-height`` needs it.
    self_calibrate : bool
        Refine principal point and radial distortion from the images, without depth.
    adapt : bool
        Let the model follow the drive's own errors, by past frames alone.
    boresight : {"none", "causal"}
        Whether motions are turned into the frame of the true poses, by what past frames say.
    gate : float, optional
        Texture gate [intensity^2/px^2].
    truth : Path, optional
        File of true poses (TUM, KITTI, EuRoC's csv, TartanAir's), instead of the data set's own; images that
        it does not know are left out.
    frames : int, optional
        Only so many frames from the first.
    start : int
        First frame; what comes before is not looked at.
    stride : int
        Only every so many-th of these.
    parallax : float, optional
        Leave frames out until the median flow since the last one used exceeds so many pixels.
    frames_per_second : float, optional
        Frame rate [Hz], for images without times.
    topic, depth_topic : str, optional
        Topics of the images and of the depth of a ROS bag.
    bag : bool
        Also write the trajectory as a ROS 2 bag, ``odometry_bag``.
    bag_unscaled : bool
        Write positions there though nothing gives their scale: steps of length 1, not metres.
    view, record : bool
        Show the run live in the rerun viewer; record it as ``view.rrd``.
    seed : int
        Seed of pixels and samples.
    """

    model: Path | None = None
    method: str | None = None
    estimator: str = "lcmsac"
    residual: str | None = None
    scale: str = "none"
    camera_height_m: float | None = None
    self_calibrate: bool = False
    adapt: bool = False
    boresight: str = "none"
    gate: float | None = None
    truth: Path | None = None
    frames: int | None = None
    start: int = 0
    stride: int = 1
    parallax: float | None = None
    frames_per_second: float | None = None
    topic: str | None = None
    depth_topic: str | None = None
    bag: bool = False
    bag_unscaled: bool = False
    view: bool = False
    record: bool = False
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class DriftOptions(Options):
    """Options of `flowlik.commands.drift`.

    Attributes
    ----------
    align : {"none", "se3", "sim3"}
        How the estimate is laid onto the truth: first pose shared, or by least squares, rigidly or with a
        scale.
    max_difference_s : float
        Largest difference of times [s] of rows that match.
    times : Path, optional
        File with one time [s] a row, for files of poses without times.
    skip_bad_frames : bool
        Sort rows whose times or numbers go back, and leave double ones out.
    """

    align: str = "none"
    max_difference_s: float = 0.01
    times: Path | None = None
    skip_bad_frames: bool = False


@dataclass(frozen=True, kw_only=True)
class FlowOptions(Options):
    """Options of `flowlik.commands.flow`.

    Attributes
    ----------
    truth : Path, optional
        True flow, a file that `flowlik.datasets.flow_files.read_flow` reads, to report coverage.
    method : str, optional
        May only confirm the model's method; must, where that is an object, a network or flow on disk.
    flow_png : str, optional
        Coding of flow in PNG files that do not tell it themselves: a name in
        `flowlik.datasets.flow_png.PNG_CODINGS`.
    confidence : float
        Of the intervals drawn.
    camera : str, optional
        A camera file: both images are undistorted first. Without distortion a camera changes nothing.
    mask : Path, optional
        Image of the size of the images as they are, white where pixels are used.
    view, record : bool
        Show it live in the rerun viewer; record it as ``view.rrd``.
    """

    truth: Path | None = None
    method: str | None = None
    flow_png: str | None = None
    confidence: float = 0.9
    camera: str | None = None
    mask: Path | None = None
    view: bool = False
    record: bool = False


@dataclass(frozen=True, kw_only=True)
class KittiOptions(Options):
    """Options of `flowlik.commands.kitti_table`.

    Attributes
    ----------
    sequences : tuple of str
        Names, by default those of the paper's Table III; those that are not there are left out.
    frames : int, optional
        Only so many of each.
    start : int
        First frame of each: a cold start there.
    seed : int
        Seed of samples.
    """

    sequences: tuple[str, ...] = ("00", "01", "03")
    frames: int | None = None
    start: int = 0
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class SimulateOptions(Options):
    """Options of `flowlik.commands.simulate`; all but the last four as in `flowlik.simulation.simulate`.

    Attributes
    ----------
    trajectory : str
        Name, or a file of poses.
    frames : int, optional
        Number of images.
    speed_mps : float
        Speed [m/s] of a named trajectory.
    seed : int
        Seed of everything random.
    camera : Pinhole, optional
        By default the world's.
    frames_per_second : float, optional
        By default the world's, or a pose file's own times.
    start : int
        Frames left out at the beginning.
    baseline_m : float, optional
        Distance [m] of a second camera to the right.
    traffic : int
        Number of moving vehicles.
    sensor : bool
        Whether the sensor blurs, adds noise and changes its exposure.
    imu : str, optional
        IMU beside the camera, as `flowlik.simulation.imu_model` takes it.
    gps : str, optional
        GPS receiver, as `flowlik.simulation.gps_model` takes it.
    spoof : tuple of str
        Attacks on it, each as `flowlik.simulation.spoofing` takes it.
    """

    trajectory: str = "straight"
    frames: int | None = None
    speed_mps: float = 6.0
    seed: int = 0
    camera: Pinhole | None = None
    frames_per_second: float | None = None
    start: int = 0
    baseline_m: float | None = None
    traffic: int = 0
    sensor: bool = True
    imu: str | None = None
    gps: str | None = None
    spoof: tuple[str, ...] = ()
