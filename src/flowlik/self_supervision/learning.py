"""A likelihood learned from a sequence's own vectors and motions, without true flow."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from collections.abc import Sequence as Seq
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flowlik.calibration import (
    ErrorSketch,
    IndexForm,
    Rows,
    fit_likelihood,
    index_form,
    learn_index,
    with_shared_errors,
)
from flowlik.egomotion import lcmsac, ransac
from flowlik.errors import CalibrationError
from flowlik.flow.base import FlowMethod
from flowlik.likelihood.covariates import covariate
from flowlik.likelihood.families import error_family
from flowlik.likelihood.likelihood import Errors, FlowLikelihood
from flowlik.likelihood.shared_errors import SharedErrors
from flowlik.self_supervision._correlation import scalar_correlation
from flowlik.self_supervision._documented import documented
from flowlik.self_supervision.cross_fit import MotionErrors, SeenPair
from flowlik.self_supervision.passes import Pass, check_enough, pass_over
from flowlik.self_supervision.readings import Reading, independent_pairs

ROUNDS = 4
SETTLED_NAT = 0.005
INDEX_ROWS = 40_000
SHARED_PAIRS = 60
BLOCK, HOLD_EVERY = 10, 5
"""Image pairs of a block at most, and every how many-th block is held out."""

# of the table: chosen by held-out score it takes nine fits
SMOOTHING_NAT = 1e-4
LEAST_SPREAD = np.log(2.0)
FEW_INDEPENDENT = 10
EXTRA_COVARIATES = ("flow-along", "discrepancy-across")
"""What the index of errors across epipolar lines has besides that of both components."""


def truthless_form(method: FlowMethod, residual: Errors) -> IndexForm:
    """Form of the index that is learned of a method's errors of one residual."""
    form = index_form(method)
    if residual == "depth":
        return form
    # the discrepancy across costs nothing where flow back is measured anyway
    extra = [
        name for name in EXTRA_COVARIATES if name != "discrepancy-across" or "discrepancy" in form.covariates
    ]
    return replace(form, covariates=(*form.covariates, *extra))


def truthless_signals(
    method: FlowMethod, residual: Errors, start: FlowLikelihood | None = None
) -> tuple[str, ...]:
    """Signals that must be measured of every pair.

    Raises
    ------
    ModelError
        If a covariate is unknown.
    """
    names = (*truthless_form(method, residual).covariates, *_covariates(start))
    return tuple(sorted({signal for name in names for signal in covariate(name).signals}))


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A model learned without truth, and what is known of how well it holds.

    Attributes
    ----------
    likelihood : FlowLikelihood
        The model; its provenance and goodness tell the rest in short.
    start : FlowLikelihood or None
        The model before.
    first, last : Pass
        By the start, and by the model.
    held_out : list of int
        Pairs that the model was not learned from.
    scores : list of float
        Held-out nll [nat] after every round.
    independent_pairs : float
        What the pairs that it was learned from amount to.
    warnings : list of str
        What a user must know.
    """

    likelihood: FlowLikelihood
    start: FlowLikelihood | None
    first: Pass
    last: Pass
    held_out: list[int]
    scores: list[float]
    independent_pairs: float
    warnings: list[str]


def learn_without_truth(
    pairs: Seq[SeenPair],
    method: FlowMethod,
    start: FlowLikelihood | None = None,
    *,
    family: str = "glc",
    seed: int = 0,
    provenance: dict[str, Any] | None = None,
    map: Callable[..., Iterable[Any]] = map,
) -> Calibrated:
    """Learn a method's error model from image pairs of unknown true flow.

    Motions of both halves of each pair are estimated, each half's errors taken against the other's motion,
    index, table and correlation learned from these, and all of it repeated with the new model until its
    score on held-out blocks of pairs settles. All vectors enter, not the estimator's inliers.

    Parameters
    ----------
    pairs : sequence of SeenPair
        In order of time, with the signals of `truthless_signals`. With depth both components are learned,
        without it the errors across epipolar lines.
    method : FlowMethod
        What measured them.
    start : FlowLikelihood, optional
        Model to begin with, as the shipped one; without it the first motions are RANSAC's.
    family : str
        Error family.
    seed : int
        Of the samples of motions and of the choice of rows.
    provenance : dict, optional
        What the model file should tell besides, as the camera.
    map : callable
        Like the built-in one; runs the pairs' estimates.

    Raises
    ------
    CalibrationError
        If too few pairs have a motion in both halves, or their vectors are all alike.
    ModelError
        If the start or a covariate does not fit the measurements, or the family is unknown.
    """
    residual: Errors = "epipolar" if not pairs or pairs[0].depth is None else "depth"
    form = truthless_form(method, residual)
    names = tuple(dict.fromkeys(["texture", *form.covariates, *_covariates(start)]))
    found = first = pass_over(pairs, ransac() if start is None else lcmsac(start), names, seed, None, map)
    warnings = check_enough(first)
    block = int(np.clip(len(pairs) // 10, 1, BLOCK))
    held_out = [k for k in range(len(pairs)) if k // block % HOLD_EVERY == HOLD_EVERY - 1]
    learned_from = sorted(set(range(len(pairs))) - set(held_out))
    scores: list[float] = []
    while True:
        training = found.of(learned_from)
        blocks = [k // block for k in found.solved if k not in set(held_out)]
        likelihood = model_of_errors(training, blocks, method, family, seed)
        likelihood = replace(likelihood, shared_errors=shared_by(likelihood, training, start, seed))
        scores.append(Reading.of(likelihood, found.of(held_out)).nll)
        found = pass_over(pairs, lcmsac(likelihood), names, seed, found, map)
        warnings = check_enough(found)
        if len(scores) == ROUNDS or (len(scores) > 1 and scores[-2] - scores[-1] < SETTLED_NAT):
            break
    amount = independent_pairs(likelihood, found.of(learned_from))
    if amount < FEW_INDEPENDENT:
        warnings.append(
            f"neighbouring pairs show the same things: {len(learned_from)} amount to {amount:.1f} "
            "independent ones, and the model is of these scenes alone"
        )
    likelihood = documented(likelihood, start, found, training, held_out, scores, amount, provenance)
    return Calibrated(likelihood, start, first, found, held_out, scores, amount, warnings)


def _covariates(start: FlowLikelihood | None) -> tuple[str, ...]:
    return () if start is None else start.schedule.index.covariates


def model_of_errors(
    errors: Seq[MotionErrors], blocks: Seq[int], method: FlowMethod, family: str = "glc", seed: int = 0
) -> FlowLikelihood:
    """Index and table of errors, with nothing of what they share.

    Parameters
    ----------
    errors : sequence of MotionErrors
        Of image pairs, with texture and the covariates of the method's form.
    blocks : sequence of int
        To which block of pairs each belongs.
    method : FlowMethod
        What measured them.
    family : str
        Error family.
    seed : int
        Of the choice of rows.

    Raises
    ------
    CalibrationError
        If there is too little data, or all of it is alike.
    ModelError
        If the family is unknown.
    """
    residual: Errors = "depth" if len(errors[0].z) == 2 * len(errors[0].measurements) else "epipolar"
    form = truthless_form(method, residual)
    z = np.concatenate([e.z for e in errors])
    chosen = np.random.default_rng(seed).permutation(len(z))[:INDEX_ROWS]
    values = {name: np.concatenate([e.values[name] for e in errors])[chosen] for name in form.covariates}
    # the weights hardly depend on the family; the paper's is the fastest to fit
    index = learn_index(Rows(values, z[chosen]), error_family("lcm"), form.covariates, form.products)
    x = index.combine(values)
    low, high = np.quantile(x, [0.05, 0.95])
    if high - low < LEAST_SPREAD:
        raise CalibrationError(
            f"the vectors are too much alike: the errors expected of 90 % of them differ by a factor of "
            f"{np.exp(high - low):.2f}, and 2 is the least to learn from"
        )
    sketches: dict[int, ErrorSketch] = {}
    for block, e in zip(blocks, errors):
        rng = np.random.default_rng([seed, block])
        sketch = ErrorSketch.of(
            index, {n: e.values[n] for n in ("texture", *form.covariates)}, e.z, e.sign, rng
        )
        sketches[block] = sketches[block].merge(sketch) if block in sketches else sketch
    texture = errors[0].measurements.texture
    likelihood = fit_likelihood(
        list(sketches.values()), error_family(family), method, texture, smoothing=SMOOTHING_NAT
    )
    return replace(likelihood, residual=residual)


def shared_by(
    likelihood: FlowLikelihood, errors: Seq[MotionErrors], start: FlowLikelihood | None, seed: int = 0
) -> SharedErrors:
    """What errors of an image share, by at most 60 pairs.

    What whole images share, and how long that stays, is the start's: two halves of one image do not tell.

    Parameters
    ----------
    likelihood : FlowLikelihood
        Of these errors.
    errors : sequence of MotionErrors
        Of image pairs.
    start : FlowLikelihood, optional
        Model of the same flow that knows what whole images share; without it these weights are 0.
    seed : int
        Of the choice of vectors.

    Raises
    ------
    CalibrationError
        If there are no pairs of vectors.
    ModelError
        If the vectors are not of the model's flow.
    """
    known = None if start is None else start.shared_errors.correlation
    image = np.zeros(3)
    if known is not None:
        image = np.array([known.isotropic[-1], known.along[-1], known.vertical[-1]])
    chosen = [errors[i] for i in np.unique(np.linspace(0, len(errors) - 1, SHARED_PAIRS).astype(int))]
    if likelihood.residual == "epipolar":
        return SharedErrors(scalar_correlation(likelihood, chosen, image, seed))
    pairs = []
    for number, e in enumerate(chosen):
        some = np.random.default_rng([seed, number]).permutation(len(e.measurements))[:1200]
        pairs.append((e.measurements.select(some), e.z.reshape(-1, 2)[some]))
    found = with_shared_errors(likelihood, pairs).shared_errors
    assert found.correlation is not None
    kinds = ("isotropic", "along", "vertical")
    weights = {
        kind: np.append(getattr(found.correlation, kind)[:-1], whole) for kind, whole in zip(kinds, image)
    }
    over_time = None if start is None else start.shared_errors.over_time
    return replace(found, correlation=replace(found.correlation, **weights), over_time=over_time)
