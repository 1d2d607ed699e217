"""`flowlik simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli.options import Seed


def run(
    world: Annotated[str, typer.Argument(help="World: planes.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the data set.")],
    trajectory: Annotated[str, typer.Option(help="straight, curve or training.")] = "straight",
    frames: Annotated[int, typer.Option(min=2, help="Number of images.")] = 300,
    speed: Annotated[float, typer.Option(help="Speed [m/s], at 60 frames/s.")] = 6.0,
    width: Annotated[int, typer.Option(help="Image width [px].")] = 640,
    height: Annotated[int, typer.Option(help="Image height [px].")] = 360,
    fov: Annotated[float, typer.Option(help="Horizontal field of view [deg].")] = 120.0,
    noise: Annotated[bool, typer.Option(help="Sensor blur and noise.")] = True,
    seed: Seed = 0,
) -> None:
    """Render a flight with exact depth, poses and flow, in TartanAir V2's layout.

    Example: `flowlik simulate planes --trajectory curve --frames 120 --out data`
    """
    from flowlik.commands.simulate import simulate
    from flowlik.progress import terminal_progress

    folder = simulate(
        world, trajectory, frames, out, speed, seed, width, height, fov, noise, terminal_progress
    )
    typer.echo(f"data set: {folder}", err=True)
