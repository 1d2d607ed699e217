"""Every record and every figure of a model, or of several on one population of errors."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Seq
from typing import Any

from flowlik.calibration.sketch import ErrorSketch, merge_all
from flowlik.errors import CalibrationError
from flowlik.evaluation.likelihood import _evidence as evidence
from flowlik.evaluation.likelihood._bias import bias_arrays
from flowlik.evaluation.likelihood._eigenbasis import (
    eigenbasis_arrays,
    eigenbasis_cost,
    eigenbasis_records,
    tells_eigenbasis,
)
from flowlik.evaluation.likelihood._goodness import Counting, KolmogorovSmirnov
from flowlik.evaluation.likelihood._levels import levels, levels_arrays
from flowlik.evaluation.likelihood._pit import pit, pit_arrays
from flowlik.evaluation.likelihood._sparsification import (
    CAP_PX,
    STATISTICS,
    sparsification,
    sparsification_arrays,
)
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.results.records import Record, protocol

Kinds = Seq[Seq[ErrorSketch]]
"""One population of errors over several indices: for each index its blocks, as `gather` gives them."""


def blocks_over(kinds: Kinds, likelihood: FlowLikelihood) -> Seq[ErrorSketch]:
    """Blocks over a model's own index.

    Raises
    ------
    CalibrationError
        If there are none.
    """
    index = likelihood.schedule.index
    for blocks in kinds:
        if blocks and blocks[0].index == index:
            return blocks
    raise CalibrationError(f"no sketch over the {index.name} of the {likelihood.family.name} model")


def model_records(
    blocks: Seq[ErrorSketch],
    likelihood: FlowLikelihood,
    dataset: str,
    seed: int | None,
    counting: Counting = Counting(),
    **keys: object,
) -> list[Record]:
    """All records of a model: `evidence.goodness_records`, PIT, sparsification, coverage at the worst level.

    Parameters
    ----------
    blocks : sequence of ErrorSketch
        Sketches of runs of frames over the model's index.
    likelihood : FlowLikelihood
        Model.
    dataset : str
        Name of the data.
    seed : int or None
        Seed of the data and of the bootstrap.
    counting : Counting
        What a texture level needs to be counted.
    **keys
        Further keys of the protocol.
    """
    sketch = merge_all(blocks)
    record = evidence.Recorder(likelihood, dataset, seed, sketch.total)
    note = protocol(**keys, **evidence.what_was_kept(sketch))

    by_level = levels(blocks, likelihood, counting)
    worst = by_level.worst
    found = (
        {"texture": f"{by_level.texture[worst]:.3g}"} if worst is not None else {"reason": "no level counted"}
    )
    level_note = protocol(
        **keys, levels=counting,
        counted=int(by_level.counted.sum()), rows=by_level.rows, **found,
    )  # fmt: skip
    transform, ranked = pit(sketch, likelihood), sparsification(sketch, likelihood)
    capped = note + "; " + protocol(removed_by="90 % bound", cap_px=CAP_PX)
    return [
        *evidence.goodness_records(blocks, likelihood, dataset, seed, counting, **keys),
        record(
            "coverage_90_worst_level", None if worst is None else by_level.coverage[worst], "", level_note
        ),
        record("pit_deviation", transform.deviation, "", note),
        record("pit_ks", transform.ks, "", note),
        *(record(f"ause_{name}", ranked.ause(name), "", capped) for name in STATISTICS),
        record("ause_relative", ranked.ause_relative(), "", capped),
        record("rank_correlation", ranked.rank_correlation, "", note),
        *(
            eigenbasis_records(eigenbasis_cost(blocks, likelihood), record, note)
            if tells_eigenbasis(sketch, likelihood)
            else []
        ),
    ]


def floor_records(
    floor: KolmogorovSmirnov,
    dataset: str,
    flow: str | None,
    seed: int | None,
    counting: Counting = Counting(),
    **keys: object,
) -> list[Record]:
    """Median and largest K-S between two populations, of `held_out_floor`, beside which a model's stands."""
    note = protocol(**keys, **evidence.what_was_counted(floor, counting))
    return [
        Record(metric, value, "", dataset, flow, count=int(floor.counts.sum()), seed=seed, protocol=note)
        for metric, value in (("ks_floor_median", floor.median), ("ks_floor_max", floor.maximum))
    ]


def figures(
    kinds: Kinds,
    models: Mapping[str, FlowLikelihood],
    counting: Counting = Counting(),
    floor: KolmogorovSmirnov | None = None,
) -> dict[str, dict[str, Any]]:
    """Arrays of all figures of some models on one population, by kind; the first is drawn in detail.

    Parameters
    ----------
    kinds : sequence of sequence of ErrorSketch
        The population over each index that the models have.
    models : mapping of str to FlowLikelihood
        By the name that figures show.
    counting : Counting
        What a texture level needs to be counted.
    floor : KolmogorovSmirnov, optional
        Of `held_out_floor`.

    Raises
    ------
    CalibrationError
        If there is no sketch over a model's index.
    """
    blocks = {name: blocks_over(kinds, model) for name, model in models.items()}
    merged = {id(kind): merge_all(kind) for kind in blocks.values()}
    pairs = {name: (merged[id(blocks[name])], model) for name, model in models.items()}
    main, sketch = next(iter(blocks)), next(iter(pairs.values()))[0]
    by_level = {name: levels(blocks[name], model, counting) for name, model in models.items()}
    drawn = {
        "error-over-texture": evidence.error_over_texture(sketch, models[main]),
        "distributions": evidence.distributions(sketch, models[main]),
        "goodness": evidence.goodness(pairs, counting, floor),
        "coverage": evidence.reliability(pairs),
        "levels": levels_arrays(by_level),
        "pit": pit_arrays(pairs),
        "sparsification": sparsification_arrays(pairs),
        "bias": bias_arrays(sketch),
    }
    if not len(drawn["distributions"]["level_edges"]):
        del drawn["distributions"]
    if tells_eigenbasis(sketch, models[main]):
        drawn["eigenbasis"] = eigenbasis_arrays(eigenbasis_cost(blocks[main], models[main]))
    return drawn
