"""The related systems' error models, each calibrated on the same flow vectors: the rows of `rivals.py`.

A model gives a vector's log-density, and for its two components in its own axes the error, the distribution
of its magnitude, and a spread by which vectors are ranked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize
from scipy.special import erf, logsumexp

from flowlik.calibration import FLOW_INDEX, ErrorSketch, fit_likelihood, index_form, schedule_index
from flowlik.flow import DIS, PRESETS
from flowlik.likelihood.covariates import covariate, of_components
from flowlik.likelihood.families import error_family
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index, Input, Schedule, Term
from flowlik.support.arrays import Array
from rivals_rows import Rows

RESIDUAL_INDEX = Index((Input("residual", 0.3),), (Term(("residual",)),), low=np.log(0.3), high=np.log(300.0))
COMPONENTS = 4
EM_ERRORS, EM_STEPS = 30_000, 100
SMOOTHING_NAT = 1e-5
NAMED = DIS()
"""What the models' files would name, and a dense method's index; fits do not depend on it."""
WIDE = 0.68
VOLDOR_RANGE_PX = (2.0, 100.0)
"""Lengths of flow, at half the resolution, to which its published table is clamped."""
NODES, WEIGHTS = np.polynomial.hermite.hermgauss(15)

Learned = Mapping[str, Rows]


@dataclass(frozen=True)
class Predicted:
    """Log-density (N,) of vectors; errors, texture and spread in the model's axes; cdf of magnitudes."""

    log_prob: Array
    errors: Array
    texture: Array
    spread: Array
    cdf: Callable[[Array], Array]


@dataclass(frozen=True)
class Rival:
    """A calibrated error model: its family and schedule, as records name them."""

    family: str
    schedule: str
    predict: Callable[[Rows], Predicted]


def _errors(rows: Rows) -> Array:
    return rows.measurements.errors(rows.truth)


def _sketch(rows: Rows, index: Index, columns: tuple[str, ...]) -> ErrorSketch:
    m = rows.measurements
    names = tuple(dict.fromkeys(("texture", *index.covariates, *columns)))
    along = np.einsum("nij,ni->nj", m.R_i_e, m.flow)
    values = {name: of_components(name, m) for name in names}
    sign = np.where(along < 0, -1.0, 1.0)
    return ErrorSketch.of(index, values, _errors(rows), sign, np.random.default_rng(0), {})


def _in_eigenbasis(model: FlowLikelihood) -> Rival:
    """Independent components along the eigenvectors, of a family over a schedule."""

    def predict(rows: Rows) -> Predicted:
        z, x = _errors(rows), model.schedule.index.of(rows.measurements)
        theta = model.schedule.theta(x)
        return Predicted(
            model.log_prob(z, x).sum(axis=1), z, rows.t, model.bound(x, WIDE),
            lambda magnitude: model.family.magnitude_cdf(magnitude, theta),
        )  # fmt: skip

    return Rival(model.family.name, model.schedule.name, predict)


def scheduled(family: str, schedule: str) -> Callable[[Learned, str], Rival]:
    """Family over a schedule of `flowlik calibrate`, or over the residual."""

    def make(learned: Learned, method: str) -> Rival:
        form = index_form(PRESETS.get(method, NAMED))
        sketches = {name: _sketch(rows, Index(), form.covariates) for name, rows in learned.items()}
        index = {"flow": FLOW_INDEX, "residual": RESIDUAL_INDEX}.get(schedule) or schedule_index(
            schedule, [[s] for s in sketches.values()], form
        )
        blocks = list(sketches.values()) if index == Index() else [
            _sketch(rows, index, form.covariates) for rows in learned.values()
        ]  # fmt: skip
        constant = schedule == "constant"
        return _in_eigenbasis(
            fit_likelihood(blocks, error_family(family), NAMED, smoothing=SMOOTHING_NAT, constant=constant)
        )

    return make


def _isotropic(schedule: Schedule, px: float) -> Rival:
    """Log-logistic end-point error over the flow's length, all directions alike, of images px as large."""
    family = error_family("log-logistic")

    def predict(rows: Rows) -> Predicted:
        error = px * np.linalg.norm(rows.flow - rows.truth, axis=1).clip(1e-4)
        x = np.log((px * np.linalg.norm(rows.flow, axis=1)).clip(0.05))
        theta = schedule.theta(x)
        # the family halves the density of a magnitude; a ring has the length 2 pi r
        log = np.log(2) + family.logpdf(error, theta) - np.log(2 * np.pi * error) + 2 * np.log(px)
        scale, shape = theta
        spread = scale * (WIDE / (1 - WIDE)) ** (1 / shape)
        return Predicted(
            log, error[:, None], rows.t.mean(axis=1, keepdims=True), spread[:, None],
            lambda magnitude: family.magnitude_cdf(magnitude[:, 0], theta)[:, None],
        )  # fmt: skip

    return Rival("log-logistic, isotropic", "flow", predict)


def voldor_published(learned: Learned, method: str) -> Rival:
    """VOLDOR's constants, of PWC-Net at half the size: shape 1 - 0.0022 m, scale 0.01 exp(0.09 m) px."""
    lengths = np.linspace(*VOLDOR_RANGE_PX, 50)
    values = np.stack([0.01 * np.exp(0.09 * lengths), 1 - 0.0022 * lengths])
    return _isotropic(Schedule(FLOW_INDEX, np.log(lengths), values), 0.5)


def voldor(learned: Learned, method: str) -> Rival:
    """VOLDOR's form: log-logistic end-point error over the flow's length, calibrated."""
    blocks = []
    for rows in learned.values():
        error = np.tile(np.linalg.norm(rows.flow - rows.truth, axis=1)[:, None], 2)
        values = {name: of_components(name, rows.measurements) for name in ("texture", "flow")}
        rng = np.random.default_rng(0)
        blocks.append(ErrorSketch.of(FLOW_INDEX, values, error, np.ones_like(error), rng, {}))
    return _isotropic(
        fit_likelihood(blocks, error_family("log-logistic"), NAMED, smoothing=SMOOTHING_NAT).schedule, 1.0
    )


def _gaussian_mixture(z: Array) -> tuple[Array, Array]:
    """Weights and standard deviations (K,) of a mixture of Gaussians around 0, by EM."""
    z = z[np.isfinite(z)]
    z = z[np.random.default_rng(0).permutation(len(z))[:EM_ERRORS]]
    sigma = np.quantile(np.abs(z), np.linspace(0.3, 0.99, COMPONENTS))
    weight = np.full(COMPONENTS, 1 / COMPONENTS)
    for _ in range(EM_STEPS):
        log = np.log(weight) - np.log(sigma) - 0.5 * (z[:, None] / sigma) ** 2
        share = np.exp(log - logsumexp(log, axis=1, keepdims=True))
        weight = share.mean(axis=0)
        sigma = np.sqrt((share * z[:, None] ** 2).sum(axis=0) / share.sum(axis=0)).clip(1e-4)
    return weight, sigma


def probflow(learned: Learned, method: str) -> Rival:
    """Mixture of Gaussians, independent in the image's axes, the same for all vectors."""
    z = np.concatenate([rows.flow - rows.truth for rows in learned.values()])
    mixtures = [_gaussian_mixture(z[:, axis]) for axis in (0, 1)]

    def predict(rows: Rows) -> Predicted:
        errors = rows.flow - rows.truth
        log = sum(
            logsumexp(-0.5 * (errors[:, [a]] / s) ** 2 - np.log(s * np.sqrt(2 * np.pi)), axis=1, b=w)
            for a, (w, s) in enumerate(mixtures)
        )

        def cdf(magnitude: Array) -> Array:
            return np.stack(
                [erf(magnitude[:, [a]] / s / np.sqrt(2)) @ w for a, (w, s) in enumerate(mixtures)], axis=1
            )

        return Predicted(log, errors, _image_texture(rows), np.ones_like(errors), cdf)

    return Rival("gaussian-mixture", "constant", predict)


def _image_texture(rows: Rows) -> Array:
    m = rows.measurements
    axes = [np.tile(axis, (len(m), 1)) for axis in ([1.0, 0.0], [0.0, 1.0])]
    return np.stack([covariate("texture").along(m, axis) for axis in axes], axis=1)


def ilg(learned: Learned, method: str) -> Rival | None:
    """Gaussian with the sample covariance of an ensemble, times one factor, plus one constant."""
    joined = Rows.join(list(learned.values()))
    if not joined.ensemble.shape[1]:
        return None

    def covariances(rows: Rows, factor: float, floor: float) -> tuple[Array, Array]:
        away = rows.ensemble - rows.ensemble.mean(axis=1, keepdims=True)
        sample = np.einsum("nki,nkj->nij", away, away) / (away.shape[1] - 1)
        return rows.ensemble.mean(axis=1), factor * sample + floor * np.eye(2)

    def log_prob(rows: Rows, factor: float, floor: float) -> Array:
        mean, covariance = covariances(rows, factor, floor)
        error = mean - rows.truth
        square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
        return -0.5 * square - 0.5 * np.log(np.linalg.det(2 * np.pi * covariance))

    best = minimize(lambda p: -float(log_prob(joined, *np.exp(p)).mean()), [0.0, -4.0], method="Nelder-Mead")
    calibrated = np.exp(best.x)

    def predict(rows: Rows) -> Predicted:
        mean, covariance = covariances(rows, *calibrated)
        sigma = np.sqrt(np.einsum("nii->ni", covariance))
        return Predicted(
            log_prob(rows, *calibrated), mean - rows.truth, _image_texture(rows), sigma,
            lambda magnitude: erf(magnitude / sigma / np.sqrt(2)),
        )  # fmt: skip

    return Rival("gaussian", "ensemble", predict)


def uncertain_eigenbasis(learned: Learned, method: str) -> Rival:
    """The paper's model, its two-dimensional density averaged over the eigenbasis' angle.

    The angle's standard deviation is that of the tensor's off-diagonal element over t1 - t2; the former is
    in proportion to sqrt(t1), with one constant for the noise, calibrated on the joint score.
    """
    joined = Rows.join(list(learned.values()))
    some = joined.select(np.random.default_rng(0).permutation(len(joined.flow))[:10_000])
    paper = fit_texture(learned)
    base = _in_eigenbasis(paper)

    def log_prob(rows: Rows, noise: float) -> Array:
        m = rows.measurements
        x = paper.schedule.index.of(m)
        gap = np.maximum(m.t[:, 0] - m.t[:, 1], 1e-9)
        sigma = np.minimum(noise * np.sqrt(np.maximum(m.t[:, 0], 1e-6)) / gap, np.pi / 4)
        z = _errors(rows)
        terms = []
        for node, weight in zip(NODES, WEIGHTS):
            c, s = np.cos(np.sqrt(2) * sigma * node), np.sin(np.sqrt(2) * sigma * node)
            turned = np.stack([c * z[:, 0] + s * z[:, 1], c * z[:, 1] - s * z[:, 0]], axis=1)
            terms.append(paper.log_prob(turned, x).sum(axis=1) + np.log(weight / np.sqrt(np.pi)))
        return logsumexp(np.stack(terms), axis=0)

    steps = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
    noise = max(steps, key=lambda step: float(log_prob(some, step).mean()))

    def predict(rows: Rows) -> Predicted:
        return replace(base.predict(rows), log_prob=log_prob(rows, noise))

    return Rival("lcm, uncertain angle", "texture", predict)


def fit_texture(learned: Learned) -> FlowLikelihood:
    """The paper's model: a Laplace-Cauchy mixture over texture."""
    blocks = [_sketch(rows, Index(), ()) for rows in learned.values()]
    return fit_likelihood(blocks, error_family("lcm"), NAMED, smoothing=SMOOTHING_NAT)


RIVALS: dict[str, Callable[[Learned, str], Rival | None]] = {
    "RANSAC: constant Gaussian": scheduled("gaussian", "constant"),
    "ProbFlow: image axes": probflow,
    "Ilg: ensemble": ilg,
    "D3VO: Laplace over residual": scheduled("laplace", "residual"),
    "VOLDOR: calibrated": voldor,
    "VOLDOR: published": voldor_published,
    "the paper": scheduled("lcm", "texture"),
    "the paper, uncertain eigenbasis": uncertain_eigenbasis,
    "flowlik": scheduled("glc", "index"),
}
"""Rows of the table by name; None where a flow lacks what a row needs."""
