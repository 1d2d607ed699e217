"""`flowlik flow`: two images to a picture of how far each flow vector can be trusted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flowlik.commands._pictures import uncertainty_picture
from flowlik.commands.options import FlowOptions
from flowlik.datasets import read_grey, read_mask
from flowlik.datasets.agreement import pair_doubt
from flowlik.datasets.flow_files import read_flow, write_flo, write_kitti_flow
from flowlik.datasets.flow_png import MOST_PX
from flowlik.datasets.intrinsics import given_lens
from flowlik.datasets.uncertainty_file import write_uncertainty
from flowlik.errors import DataError
from flowlik.evaluation.likelihood import outside_warning
from flowlik.flow import FlowFiles, coded, confirmed_method, describe, method_label
from flowlik.flow.base import FlowMethod, Image
from flowlik.image.sampling import sample_flow
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood
from flowlik.measurement.masking import measure_clear
from flowlik.measurement.measurements import Measurements
from flowlik.report import finish
from flowlik.report.viewer import viewer
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder
from flowlik.support.arrays import Array
from flowlik.support.files import write_npz

COVERAGES = (0.5, 0.68, 0.9, 0.95)


def flow(
    previous: Path,
    current: Path,
    model: Path,
    out: Path,
    options: FlowOptions = FlowOptions(),
    *,
    command: str = "flowlik flow",
) -> RunFolder:
    """Measure the flow between two images and draw its uncertainty.

    Parameters
    ----------
    previous, current : Path
        Image files of one size.
    model : Path
        Model file; it names the flow method.
    out : Path
        Run folder: report, figure, ``flow.npz`` with pixels, flow, half-widths and eigenbasis, and as images
        ``flow.flo``, ``flow.png`` (KITTI's) and ``uncertainty.png`` (`flowlik.datasets.uncertainty_file`).
    options : FlowOptions
        How; the run records them.
    command : str
        Command line that repeats the run.

    Raises
    ------
    DataError
        If an image or flow cannot be read or sizes differ.
    ModelError
        If the model is for another method than the one given.
    """
    likelihood = load_likelihood(model)
    likelihood.check_components()
    chosen = coded(confirmed_method(likelihood.method or {}, options.method), options.flow_png)
    image, following = read_grey(previous), read_grey(current)
    usable = None if options.mask is None else read_mask(options.mask, image.shape)
    lens = None if options.camera is None else given_lens(options.camera, image.shape)
    if lens is not None and lens.distorts:
        usable = lens.valid(image.shape) if usable is None else lens.straighten_mask(usable)
        image, following = lens.undistort(image), lens.undistort(following)
        chosen = replace(chosen, lens=lens) if isinstance(chosen, FlowFiles) else chosen
    images = image, following
    m = measure_clear(images, chosen, likelihood.texture, usable, signals=likelihood.signals)
    if not len(m):
        raise DataError(f"{previous}: no flow vector could be measured (no texture?)")
    true_flow = None
    if options.truth is not None:
        true_flow = _read_truth(options.truth, options.flow_png, image.shape)
        true_flow = true_flow if lens is None else lens.straighten_flow(true_flow)
    config = {"images": [str(previous), str(current)], "model": str(model), **options.asdict()}
    run = RunFolder(out, command, {**config, "flow": describe(chosen)})
    _warn_of_doubts(run, images, true_flow, chosen, usable)
    shown = viewer(options.view, run.begin() / "view.rrd" if options.record else None)
    x, confidence = likelihood.coordinate(m), options.confidence
    half_width = likelihood.bound(x, confidence)
    told = {"confidence": confidence, "mask": None if options.mask is None else "given"}
    run.records = _records(m, likelihood, half_width, told, true_flow, f"{previous.name} to {current.name}")
    if message := outside_warning(likelihood.schedule.outside(x), "this image"):
        run.warn(message)
    picture = uncertainty_picture(image, m, half_width, confidence)
    run.save("uncertainty", method_label(m.method), picture)
    _write(run, picture, m, half_width, likelihood.covariance(m, confidence), confidence)
    shown.pair(0.0, image, m, likelihood, confidence)
    shown.close()
    finish(run)
    return run


def _warn_of_doubts(
    run: RunFolder,
    images: tuple[Image, Image],
    true_flow: Array | None,
    method: FlowMethod,
    usable: NDArray[np.bool_] | None,
) -> None:
    """Let a run warn of true flow, or of flow on disk, that is not that of the images."""
    doubts = []
    if true_flow is not None:
        doubts.append(pair_doubt("true flow", images, true_flow, usable=usable))
    if isinstance(method, FlowFiles):
        doubts.append(pair_doubt(f"flow {method.label}", images, method.dense(*images), False, usable))
    for doubt in filter(None, doubts):
        run.warn(doubt)


def _write(
    run: RunFolder,
    picture: dict[str, NDArray[Any]],
    m: Measurements,
    half_width: Array,
    covariance: Array,
    confidence: float,
) -> None:
    """Write flow and uncertainty: vectors as npz, maps as .flo and as 16-bit PNG."""
    arrays: dict[str, ArrayLike] = {
        "pixels": m.pixels, "flow_px": m.flow, "half_width_px": half_width, "R_i_e": m.R_i_e,
        "texture": m.t, "confidence": confidence, "covariance_px2": covariance,
    }  # fmt: skip
    write_npz(run.path / "flow.npz", arrays)
    flow = picture["flow"].astype(np.float64)
    write_flo(run.path / "flow.flo", flow)
    write_uncertainty(run.path / "uncertainty.png", picture["half_width"], picture["angle"])
    with np.errstate(invalid="ignore"):
        beyond = np.abs(flow).max(axis=-1) > MOST_PX
    if beyond.any():
        run.warn(f"flow.png holds up to {MOST_PX} px: {int(beyond.sum())} vectors beyond are left out of it")
    write_kitti_flow(run.path / "flow.png", np.where(np.expand_dims(beyond, -1), np.nan, flow))


def _read_truth(path: Path, png: str | None, shape: tuple[int, ...]) -> Array:
    truth = read_flow(path, png)
    if truth.shape[:2] != shape:
        sizes = f"{truth.shape[1]}x{truth.shape[0]}, the images {shape[1]}x{shape[0]}"
        raise DataError(f"{path}: true flow of {sizes}")
    if not np.isfinite(truth).any():
        raise DataError(f"{path}: no true flow is known")
    return truth


def _records(
    m: Measurements,
    likelihood: FlowLikelihood,
    half_width: Array,
    told: dict[str, Any],
    true_flow: Array | None,
    dataset: str,
) -> list[Record]:
    x = likelihood.coordinate(m)

    def record(metric: str, value: float, unit: str, count: int, **keys: object) -> Record:
        note = protocol(**told, vectors=len(m), lost=m.lost, **keys)
        return Record(
            metric,
            value,
            unit,
            dataset,
            method_label(m.method),
            likelihood.family.name,
            likelihood.schedule.name,
            None,
            count,
            None,
            note,
        )

    records = [
        record("half_width_e1_median_px", float(np.median(half_width[:, 0])), "px", len(m)),
        record("half_width_e2_median_px", float(np.median(half_width[:, 1])), "px", len(m)),
        record("within_half_px_fraction", float(np.mean(half_width <= 0.5)), "", half_width.size),
        record("outside_fraction", likelihood.schedule.outside(x), "", x.size),
    ]
    if true_flow is None:
        return records
    given = {"truth": "given flow", "pixels": "known truth"}
    truth = sample_flow(true_flow, m.pixels)
    known = np.asarray(np.isfinite(truth).all(axis=1))
    z = m.select(known).errors(truth[known])
    for level in COVERAGES:
        inside = np.abs(z) <= likelihood.bound(x[known], level)
        name = f"coverage_{level * 100:.0f}"
        records.append(record(name, float(inside.mean()), "", z.size, **given))
    held = float(_in_ellipse(m.select(known), truth[known], likelihood, 0.9).mean())
    nll = float(-likelihood.log_prob(z, x[known]).mean())
    return [
        *records,
        record("coverage_ellipse_90", held, "", len(z), **given),
        record("nll", nll, "nat", z.size, **given),
    ]


def _in_ellipse(m: Measurements, truth: Array, likelihood: FlowLikelihood, level: float) -> NDArray[np.bool_]:
    """Which errors (N,) lie in the ellipse of the level that `FlowLikelihood.covariance` gives."""
    error = m.flow - truth
    whitened = np.linalg.solve(likelihood.covariance(m, level), error[..., None])[..., 0]
    return np.asarray((error * whitened).sum(axis=-1) <= -2.0 * np.log1p(-level))
