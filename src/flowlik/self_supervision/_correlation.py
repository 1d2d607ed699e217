"""How the scores of neighbouring errors across epipolar lines go together, without truth."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.optimize import nnls

from flowlik.calibration.distances import EDGES_PX, PER_OCTAVE, distances_px
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.shared_errors import SCALES_PX, ScoreCorrelation, flow_directions, shapes
from flowlik.self_supervision._kernels import scalar_products
from flowlik.self_supervision.cross_fit import MotionErrors
from flowlik.support.arrays import Array

VECTORS = 1200


def scalar_correlation(
    likelihood: FlowLikelihood, errors: Iterable[MotionErrors], image: Array, seed: int
) -> ScoreCorrelation:
    """Correlation of scores from scalar errors: of each pair of vectors only the components across lines.

    What a whole image shares moves the motions of both halves alike, and errors against them do not hold it:
    its weights ``image`` (isotropic, along the flow, vertical) are given.

    Parameters
    ----------
    likelihood : FlowLikelihood
        Of errors across lines.
    errors : iterable of MotionErrors
        Of image pairs, one component a vector.
    image : array (3,)
        Weights of the whole image.
    seed : int
        Draws at most 1200 vectors a pair.
    """
    normal, right = np.zeros((len(EDGES_PX), 3, 3)), np.zeros((len(EDGES_PX), 3))
    for number, e in enumerate(errors):
        chosen = np.random.default_rng([seed, number]).permutation(len(e.z))[:VECTORS]
        x = e.coordinates(likelihood.schedule.index)[chosen]
        fisher = likelihood.fisher(x)
        scores = likelihood.score(e.z[chosen], x) / np.sqrt(fisher)
        # every image pair counts alike: where errors are small, information is a hundredfold
        size = np.sqrt(fisher) / np.linalg.norm(np.sqrt(fisher))
        n = np.ascontiguousarray(e.directions[chosen])
        flow = flow_directions(e.measurements.flow[chosen])
        pixels = np.ascontiguousarray(e.measurements.pixels[chosen])
        scalar_products(
            pixels, scores, n, (n * flow).sum(axis=1), size, EDGES_PX[1], PER_OCTAVE, normal, right
        )
    return _fitted(normal, right, image)


def _fitted(normal: Array, right: Array, image: Array) -> ScoreCorrelation:
    """Least squares over all distances with weights of at least 0, those of the whole image given."""
    scales = np.array(SCALES_PX)
    near = shapes(distances_px()[1:], scales)[:, 1:-1]
    count = len(scales)
    # unknowns: kinds (3) times scales (S)
    gram = np.einsum("bpq,bs,bt->psqt", normal[1:], near, near).reshape(3 * count, 3 * count)
    target = np.einsum("bp,bs->ps", right[1:], near).ravel()
    # non-negative least squares of a quadratic form, by its root
    values, vectors = np.linalg.eigh(gram)
    root = np.sqrt(np.maximum(values, 1e-12 * values[-1]))
    fitted, _ = nnls(root[:, None] * vectors.T, (vectors.T @ target) / root)
    isotropic, along, vertical = np.round(fitted, 9).reshape(3, count)
    # the rest of the scores' variance is each vector's own
    shared = np.array([isotropic.sum(), along.sum(), vertical.sum()]) + image
    own = (right[0, 0] - normal[0, 0] @ shared) / normal[0, 0, 0]
    return ScoreCorrelation(
        scales,
        np.concatenate([[max(round(own, 9), 0.0)], isotropic, image[:1]]),
        np.concatenate([[0.0], along, image[1:2]]),
        np.concatenate([[0.0], vertical, image[2:]]),
    )
