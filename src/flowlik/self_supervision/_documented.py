"""What the file of a model that was learned without truth says of itself."""

from __future__ import annotations

from collections.abc import Sequence as Seq
from dataclasses import replace
from typing import Any

from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.self_supervision.cross_fit import MotionErrors
from flowlik.self_supervision.passes import Pass
from flowlik.self_supervision.readings import Reading


def documented(
    likelihood: FlowLikelihood,
    start: FlowLikelihood | None,
    found: Pass,
    training: Seq[MotionErrors],
    held_out: list[int],
    scores: list[float],
    amount: float,
    provenance: dict[str, Any] | None,
) -> FlowLikelihood:
    """Likelihood whose file says what it was learned from, and how well it fits in and out of fit."""
    in_fit, out_of_fit = (Reading.of(likelihood, found.of(held_out, own)) for own in (True, False))
    record = {
        **(provenance or {}),
        "truth": "none: own motions, each half of a chessboard against the other's",
        "start": "none" if start is None else start.provenance.get("name", "a model"),
        "pairs": len(training),
        "held_out_pairs": len(found.of(held_out)),
        "independent_pairs": round(amount, 1),
        "statuses": found.statuses,
        "components": int(sum(len(e.z) for e in training)),
        "shared_by_whole_images": "the start's" if start is not None else "unknown",
    }
    goodness = {
        "rounds": [round(score, 4) for score in scores],
        **{f"{name}_{key}": value for name, r in (("in_fit", in_fit), ("out_of_fit", out_of_fit))
           for key, value in r.values().items()},
    }  # fmt: skip
    return replace(
        likelihood,
        provenance={**likelihood.provenance, **record},
        goodness={**likelihood.goodness, **goodness},
    )
