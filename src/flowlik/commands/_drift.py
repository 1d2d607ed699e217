"""`flowlik drift`: how far one trajectory strays from another."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, cast

from flowlik.commands.options import DriftOptions
from flowlik.errors import DataError
from flowlik.evaluation.motion import Align, absolute_trajectory_error, match, trajectory_records
from flowlik.geometry.pose_table import PoseTable, read_pose_table
from flowlik.geometry.times import read_times
from flowlik.results.records import Record
from flowlik.support.files import printable


class Drift(NamedTuple):
    """What `drift` found.

    Attributes
    ----------
    records : list of Record
        Its figures.
    said : list of str
        How rows were matched, and what else is worth knowing, a sentence each.
    """

    records: list[Record]
    said: list[str]


def drift(estimated: Path, truth: Path, options: DriftOptions = DriftOptions()) -> Drift:  # noqa: B008
    """Drift, position error, KITTI errors and per-frame errors of a trajectory file against the true one.

    Rows are matched by time where the files have times, else by frame number, see
    `flowlik.evaluation.motion._matching`.

    Parameters
    ----------
    estimated, truth : Path
        Files of poses: TUM, KITTI (12, 13 or 16 columns), EuRoC's csv or TartanAir's.
    options : DriftOptions
        How they are matched and aligned.

    Raises
    ------
    DataError
        If a file cannot be read, or the two cannot be matched.
    """
    first, second = (_read(path, options) for path in (estimated, truth))
    for path, table in ((estimated, first), (truth, second)):
        if len(table) < 2:
            raise DataError(f"{path}: one pose is no trajectory")
    try:
        found = match(first, second, options.max_difference_s)
    except DataError as error:
        raise DataError(f"{estimated}, {truth}: {error}") from error
    n = len(found.truth)
    keys: dict[str, Any] = {
        "scale": "as given", "source": printable(estimated.name), "matched_by": found.by,
        "matched": f"{n} of {len(first)} estimated and {len(second)} true rows",
    }  # fmt: skip
    if found.by == "time":
        keys |= {"max_difference_s": f"{options.max_difference_s:g}", "largest_s": f"{found.apart_s:.3g}"}
    align = cast(Align, options.align)
    records = trajectory_records(found.estimated, found.truth, printable(truth.stem), **keys, align=align)
    ate_m = absolute_trajectory_error(found.estimated, found.truth, align)
    records.append(replace(records[0], metric="ate_rmse_m", value=ate_m, unit="m"))
    apart = f", at most {found.apart_s:.3g} s apart" if found.by == "time" else ""
    said = [f"matched by {found.by}: {keys['matched']}{apart}"]
    for path, table in ((estimated, first), (truth, second)):
        if table.left_out:
            said.append(f"{path}: {table.left_out} rows left out, whose time or number another row has")
        if table.of_body:
            said.append(f"{path}: poses of the robot's body, not of a camera")
    return Drift(records, said)


def _read(path: Path, options: DriftOptions) -> PoseTable:
    table = read_pose_table(path, options.skip_bad_frames)
    if options.times is None or table.times_s is not None:
        return table
    times_s = read_times(options.times)
    if table.frames is not None:
        if table.frames[0] < 0 or table.frames[-1] >= len(times_s):
            raise DataError(f"{options.times}: {len(times_s)} times for frames up to {table.frames[-1]}")
        return replace(table, times_s=times_s[table.frames])
    if len(times_s) != len(table):
        raise DataError(f"{options.times}: {len(times_s)} times for the {len(table)} poses of {path}")
    return replace(table, times_s=times_s)
