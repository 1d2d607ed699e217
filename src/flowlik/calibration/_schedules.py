"""Schedules that a calibration offers: constant, texture (the paper's), flow (VOLDOR's), a learned index."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flowlik.calibration._learn import Rows, learn_index
from flowlik.calibration.sketch import ErrorSketch, merge_all
from flowlik.errors import CalibrationError
from flowlik.flow.base import DenseFlow, DensePairs, FlowMethod, TwoWay
from flowlik.likelihood.families import error_family
from flowlik.likelihood.schedule import Index, Input, Term

SCHEDULES = ("constant", "texture", "flow", "index")

FLOW_INDEX = Index(
    (Input("flow", 0.05),), (Term(("flow",)),), low=float(np.log(0.05)), high=float(np.log(500.0))
)
"""VOLDOR's choice: the flow's magnitude alone."""


@dataclass(frozen=True)
class IndexForm:
    """What a learned index is made of: covariates, and whether products of their logarithms enter."""

    covariates: tuple[str, ...]
    products: bool = True


# each covariate, and the products, earn 0.015 nat or more on worlds neither calibrated nor reported on
TWO_WAY = IndexForm(("texture", "flow", "discrepancy", "residual", "standard-error"))
ONE_WAY = IndexForm(("texture", "flow", "patch-discrepancy", "residual", "standard-error"))
DENSE = IndexForm((*ONE_WAY.covariates, "spread"))


def check_schedule(schedule: str) -> None:
    """Check that a schedule of that name is offered.

    Raises
    ------
    CalibrationError
        If it is not.
    """
    if schedule not in SCHEDULES:
        raise CalibrationError(f"unknown schedule {schedule!r}: known are {', '.join(SCHEDULES)}")


def index_form(method: FlowMethod) -> IndexForm:
    """Form of a method's learned index.

    Flow back is for methods that find it along with the flow there. A dense one also has neighbours to
    compare its flow with. What the flow says of its own uncertainty enters too: the index learns its worth.
    """
    if isinstance(method, DensePairs) and method.tells_uncertainty:
        return IndexForm((*DENSE.covariates, "own-uncertainty"))
    if isinstance(method, DenseFlow):
        return DENSE
    return TWO_WAY if isinstance(method, TwoWay) else ONE_WAY


def schedule_index(schedule: str, populations: Sequence[Sequence[ErrorSketch]], form: IndexForm) -> Index:
    """Index of a schedule's name; that of ``"index"`` is learned from the populations' reservoirs.

    Parameters
    ----------
    schedule : str
        One of `SCHEDULES`.
    populations : sequence of sequence of ErrorSketch
        Blocks of each flight or data set, which all count alike, with the covariates kept.
    form : IndexForm
        Of a learned index.

    Raises
    ------
    CalibrationError
        If the name is unknown or there is too little data.
    ModelError
        If the form's family is unknown.
    """
    check_schedule(schedule)
    if schedule == "flow":
        return FLOW_INDEX
    if schedule != "index":
        return Index()
    merged = [merge_all(blocks) for blocks in populations if blocks]
    # the weights hardly depend on the family; the paper's is the fastest to fit
    rows = Rows.of([m for m in merged if m.total])
    return learn_index(rows, error_family("lcm"), form.covariates, form.products)
