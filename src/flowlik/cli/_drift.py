"""`flowlik drift`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli import _complete as complete
from flowlik.cli._options import Json
from flowlik.cli._printing import show_records
from flowlik.commands.options import DriftOptions


def run(
    estimated: Annotated[
        Path, typer.Argument(help="Estimated trajectory: TUM, KITTI, EuRoC's csv or TartanAir's poses.")
    ],
    truth: Annotated[Path, typer.Argument(help="True trajectory.")],
    align: Annotated[
        str,
        typer.Option(
            help="none: the first pose is shared; se3, sim3: moved, or moved and scaled, by least squares.",
            autocompletion=complete.one_of(complete.ALIGNMENTS),
        ),
    ] = DriftOptions.align,
    max_difference_s: Annotated[
        float, typer.Option("--max-difference", min=0, help="Rows further apart in time [s] do not match.")
    ] = DriftOptions.max_difference_s,
    times: Annotated[
        Path | None, typer.Option(help="File with a time [s] a row, for poses without times (KITTI).")
    ] = None,
    skip_bad_frames: Annotated[
        bool, typer.Option("--skip-bad-frames", help="Sort rows that go back in time, leave double ones out.")
    ] = False,
    json: Json = False,
) -> None:
    """Compare two trajectories: loop-closure drift, KITTI's metric, errors per frame.

    Rows are matched by time, or by frame number where the files have no times.

    Examples
    --------
    `flowlik drift k03/trajectory_kitti.txt poses/03.txt`

    `flowlik drift walk/trajectory_tum.txt groundtruth.txt --align sim3 --max-difference 0.02`
    """
    from flowlik.commands import drift

    options = DriftOptions(
        align=align, max_difference_s=max_difference_s, times=times, skip_bad_frames=skip_bad_frames
    )
    records, said = drift(estimated, truth, options)
    for line in said:
        typer.echo(line, err=True)
    show_records(records, json)
