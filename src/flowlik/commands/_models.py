"""`flowlik models`: the likelihoods that ship, and what a model file says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flowlik.likelihood.covariates import covariate
from flowlik.likelihood.model_file import find_model, load_likelihood
from flowlik.likelihood.shipped import shipped


@dataclass(frozen=True)
class ModelSummary:
    """What a model is, where it comes from, and how well it fits its own data."""

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
    )
