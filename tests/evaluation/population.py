"""Errors drawn from a known model, and their sketches, over texture or over a learned index."""

import numpy as np

from flowlik.calibration import ErrorSketch
from flowlik.likelihood.families import LaplaceCauchy
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index, Input, Schedule, Term
from tests.helpers import KNOTS, LCM_VALUES, lcm_likelihood

MODEL = lcm_likelihood(method={"name": "synthetic"})
INDEX = Index(
    (Input("texture", 1e-2, 1e5), Input("discrepancy", 1e-3, 1e2)),
    (Term(("texture",), -0.25), Term(("discrepancy",), 0.5)),
    0.5, -7.0, 5.0,
)  # fmt: skip
OVER_INDEX = FlowLikelihood(
    LaplaceCauchy(), Schedule(INDEX, np.linspace(-3, 3, 4), LCM_VALUES[:, ::-1].copy())
)


def draw(model=MODEL, n=60_000, seed=0):
    """Covariates and errors of the model itself."""
    rng = np.random.default_rng(seed)
    texture, across = np.exp(rng.uniform(KNOTS[0], KNOTS[-1], (2, n)))
    discrepancy, other = np.exp(rng.normal(-2, 1.5, (2, n)))
    values = {
        "texture": texture, "texture-across": across,
        "discrepancy": discrepancy, "discrepancy-across": other,
    }  # fmt: skip
    return values, model.sample(model.schedule.index.combine(values), rng)


def sketch_of(values, z, index=None, seed=99):
    """Sketch whose signs are all positive; its seed is not that of the errors, which would order the rows."""
    return ErrorSketch.of(index or Index(), values, z, np.ones(len(z)), np.random.default_rng(seed))
