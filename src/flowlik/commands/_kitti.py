"""`flowlik reproduce --kitti`: the paper's Table III on KITTI odometry, beside other estimators."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from flowlik.commands.options import KittiOptions
from flowlik.comparison import drive_figures, drive_records, run_drive
from flowlik.datasets.base import ImageSequence
from flowlik.datasets.kitti import KittiOdometry, find_sequences
from flowlik.datasets.kitti_raw import ODOMETRY_DRIVES, KittiRaw
from flowlik.datasets.selection import Selection, select_frames
from flowlik.errors import DataError
from flowlik.likelihood.model_file import load_likelihood
from flowlik.report import finish
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder
from flowlik.support.progress import Progress, no_progress

PUBLISHED = {
    "lcmsac-paper": {"00": 0.655, "01": 0.942, "03": 0.536},
    "voldor": {"00": 1.09, "01": 2.31, "03": 1.46},
}
"""t_err [%] as published: the paper's Table III; VOLDOR's scale is from the camera's height."""


def kitti_table(
    data: Path,
    model: Path,
    out: Path,
    options: KittiOptions = KittiOptions(),
    *,
    command: str = "flowlik reproduce --kitti",
    progress: Progress = no_progress,
) -> RunFolder:
    """Run KITTI odometry sequences with one camera and the true steps' lengths.

    Rows are ours with nominal intrinsics, self-calibrated from images, and with a causal boresight; OpenCV
    (RANSAC, USAC_MAGSAC) and PoseLib on the same tracks.

    Parameters
    ----------
    data : Path
        Root of KITTI odometry (``sequences/NN`` and ``poses/NN.txt``, or folders ``NN`` of clips), or of
        KITTI raw (the drives that the sequences were cut from, with OXTS).
    model : Path
        Model file, calibrated in simulation.
    out : Path
        Run folder.
    options : KittiOptions
        Which sequences, and how much of them; the run records them, with the sequences that are there.
    command : str
        Command line that repeats the run.
    progress : Progress
        Told how far it is.

    Raises
    ------
    DataError
        If none of the sequences is there.
    ModelError
        If there is no such model.
    """
    likelihood = load_likelihood(model)
    found = find_table_sequences(data)
    there = tuple(name for name in options.sequences if name in found)
    if not there:
        asked = ", ".join(options.sequences)
        raise DataError(f"{data}: none of the sequences {asked} (there are {', '.join(found)})")
    config = {"model": model.name, **replace(options, sequences=there).asdict()}
    run = RunFolder(out, command, config, options.seed)
    for name in there:
        sequence, _ = select_frames(found[name](), options.start, options.frames)
        drive = run_drive(sequence, likelihood, None, options.seed, progress=progress)
        run.records += drive_records(drive)
        for kind, arrays in drive_figures(drive).items():
            run.save(kind, drive.sequence.replace("/", "-"), arrays)
        for label, values in PUBLISHED.items():
            if name in values:
                note = protocol(align="none", source="published", frames="all")
                run.records.append(
                    Record("t_err_percent", values[name], "%", sequence.name, estimator=label, protocol=note)
                )
    finish(run)
    return run


def find_table_sequences(root: Path) -> dict[str, Callable[[], ImageSequence]]:
    """What opens the sequences below a root, by name: from KITTI raw where its drives are there.

    Raises
    ------
    DataError
        If there are neither sequences nor raw drives.
    """
    drives = {
        name: next(iter(sorted(root.glob(f"**/{drive}_sync"))), None)
        for name, (drive, _) in ODOMETRY_DRIVES.items()
    }
    raw = {name: folder for name, folder in drives.items() if folder is not None}
    if raw:
        return {name: partial(_of_raw, folder, ODOMETRY_DRIVES[name][1]) for name, folder in raw.items()}
    return {name: partial(KittiOdometry, folder) for name, folder in find_sequences(root).items()}


def _of_raw(folder: Path, frames: int) -> ImageSequence:
    drive = KittiRaw(folder)
    return Selection(drive, range(min(frames, len(drive))))
