"""`flowlik drift`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli.options import Json, show_records


def run(
    estimated: Annotated[Path, typer.Argument(help="Estimated trajectory, KITTI or TUM format.")],
    truth: Annotated[Path, typer.Argument(help="True trajectory of the same frames.")],
    json: Json = False,
) -> None:
    """Compare two trajectories: loop-closure drift, KITTI's metric, errors per frame. Nothing is aligned.

    Example: `flowlik drift k03/trajectory_kitti.txt poses/03.txt`
    """
    from flowlik.commands.drift import drift

    show_records(drift(estimated, truth), json)
