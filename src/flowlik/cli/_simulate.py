"""`flowlik simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli import _complete as complete
from flowlik.cli._options import Json, Seed
from flowlik.commands.options import SimulateOptions


def run(
    world: Annotated[
        str,
        typer.Argument(
            help="planes, grid, forest, forest-small or driving.",
            autocompletion=complete.one_of(complete.WORLDS),
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the data set.")],
    trajectory: Annotated[
        str,
        typer.Option(
            help="straight, curve, training, forest-fig8, hover, or a pose file in KITTI's or TUM's format."
        ),
    ] = SimulateOptions.trajectory,
    frames: Annotated[
        int | None, typer.Option(min=2, help="Number of images; default: 300, or all of a pose file.")
    ] = None,
    speed: Annotated[
        float, typer.Option(help="Speed [m/s] of a named trajectory.")
    ] = SimulateOptions.speed_mps,
    fps: Annotated[
        float | None,
        typer.Option(help="Frames a second; default: 10 in driving, else 60; a pose file's own times."),
    ] = None,
    start: Annotated[int, typer.Option(min=0, help="Frames left out at the beginning.")] = 0,
    width: Annotated[int | None, typer.Option(help="Image width [px].")] = None,
    height: Annotated[int | None, typer.Option(help="Image height [px].")] = None,
    fov: Annotated[float | None, typer.Option(help="Horizontal field of view [deg].")] = None,
    sensor: Annotated[bool, typer.Option(help="Blur, noise and exposure steps of the sensor.")] = True,
    stereo_baseline: Annotated[
        float | None, typer.Option(help="Distance [m] of a second camera to the right.")
    ] = None,
    traffic: Annotated[int, typer.Option(min=0, help="Number of moving vehicles in driving.")] = 0,
    imu: Annotated[
        str | None,
        typer.Option(
            help="IMU beside the camera: adis16448, mpu6050 or ideal, with changes as in "
            "adis16448:rate_hz=240,position_c_m=0.1/0/0.",
        ),
    ] = None,
    gps: Annotated[
        str | None,
        typer.Option(help="GPS receiver: white, coloured or rtk, with changes as in white:outages_s=20/40."),
    ] = None,
    spoof: Annotated[
        list[str] | None,
        typer.Option(
            help="Attack on the GPS: jump:onset_s=20,distance_m=30, ramp:onset_s=20,rate_mps=0.5 or "
            "replay:onset_s=20,delay_s=5; may be given again.",
        ),
    ] = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Render a flight with exact depth, poses and flow, in TartanAir V2's layout.

    The camera is the paper's (640x360, 120 deg), in driving KITTI's (1242x375, 81 deg), unless width, height
    or field of view are given. An interrupted run goes on where it stopped.

    Example: `flowlik simulate forest --trajectory forest-fig8 --frames 600 --out flight`

    With IMU and GPS: `flowlik simulate forest --frames 1800 --imu adis16448 --gps white --out flight`

    Along real poses: `flowlik simulate driving --trajectory poses/00.txt --traffic 20 --out drive`
    """
    from flowlik.commands import simulate
    from flowlik.simulation import camera_of
    from flowlik.support.progress import terminal_progress

    options = SimulateOptions(
        trajectory=trajectory,
        frames=frames,
        speed_mps=speed,
        seed=seed,
        camera=camera_of(world, width, height, fov),
        frames_per_second=fps,
        start=start,
        baseline_m=stereo_baseline,
        traffic=traffic,
        sensor=sensor,
        imu=imu,
        gps=gps,
        spoof=tuple(spoof or ()),
    )
    folder = simulate(world, out, options, progress=terminal_progress)
    if json:
        import json as json_module

        typer.echo(json_module.dumps({"data_set": str(folder)}))
    typer.echo(f"data set: {folder}", err=True)
