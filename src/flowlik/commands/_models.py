"""`flowlik models`: the likelihoods that ship, and what a model file says."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from flowlik.likelihood.covariates import covariate
from flowlik.likelihood.model_file import find_model, load_likelihood
from flowlik.likelihood.shipped import shipped


@dataclass(frozen=True)
class ModelSummary:
    """What a model is, where it comes from, and how well it does.

    ``goodness`` is on the calibration data itself; ``held_out`` on images of others, of a shipped model:
    ``coverage_90`` (least, largest) of nine pairs and clips, and ``frames_per_second``. ``residual`` says
    which errors it knows: those along and across epipolar lines (``both``), or one kind.
    """

    name: str
    path: Path
    flow: dict[str, Any]
    family: str
    schedule: str
    covariates: tuple[str, ...]
    signals: tuple[str, ...]
    knots: int
    provenance: dict[str, Any]
    goodness: dict[str, Any]
    residual: str
    held_out: dict[str, Any]


def models() -> list[ModelSummary]:
    """Summaries of the shipped models."""
    return [summary(name) for name in shipped()]


def summary(name: str | Path) -> ModelSummary:
    """Summary of a shipped model's name or a model file.

    Raises
    ------
    ModelError
        If there is no such model.
    """
    path = find_model(name)
    likelihood = load_likelihood(path)
    schedule = likelihood.schedule
    return ModelSummary(
        path.stem,
        path,
        likelihood.method or {},
        likelihood.family.name,
        schedule.name,
        tuple(f"{i.covariate} [{covariate(i.covariate).unit}]" for i in schedule.index.inputs),
        schedule.index.signals,
        len(schedule.knots),
        likelihood.provenance,
        likelihood.goodness,
        "both" if likelihood.residual == "depth" else likelihood.residual,
        _held_out(path),
    )


def _held_out(path: Path) -> dict[str, Any]:
    """Figures of a shipped model on images that it was not calibrated on; empty of another file."""
    if shipped().get(path.stem) != path:
        return {}
    content = json.loads(files("flowlik.likelihood").joinpath("held_out.json").read_text(encoding="utf-8"))
    found = dict(content["models"].get(path.stem, {}))
    return found if found.pop("digest", None) == digest_of(path) else {}


def digest_of(path: Path) -> str:
    """Digest of what decides a model's intervals: figures of an earlier model are not this one's."""
    content = json.loads(path.read_text(encoding="utf-8"))
    decides = {key: content[key] for key in ("family", "index", "knots", "table", "flow")}
    return hashlib.sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest()[:16]
