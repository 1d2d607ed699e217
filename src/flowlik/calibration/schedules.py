"""Schedules that a calibration offers: constant, texture (the paper's), flow (VOLDOR's), a learned index."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flowlik.calibration.learn import Rows, learn_index
from flowlik.calibration.sketch import ErrorSketch, merge_all
from flowlik.errors import CalibrationError
from flowlik.families import error_family
from flowlik.flow.base import DenseFlow, FlowMethod
from flowlik.schedule import Index, Input, Term

SCHEDULES = ("constant", "texture", "flow", "index")

FLOW_INDEX = Index(
    (Input("flow", 0.05),), (Term(("flow",)),), low=float(np.log(0.05)), high=float(np.log(500.0))
)
"""VOLDOR's choice: the flow's magnitude alone."""

INDEX_COVARIATES = (
    "texture",
    "texture-across",
    "flow",
    "discrepancy",
    "residual",
    "residual-wide",
)
"""What a learned index takes; chosen by held-out score on worlds neither calibrated nor reported on."""


def check_schedule(schedule: str) -> None:
    """Raise CalibrationError unless a schedule of that name is offered."""
    if schedule not in SCHEDULES:
        raise CalibrationError(f"unknown schedule {schedule!r}: known are {', '.join(SCHEDULES)}")


def index_covariates(method: FlowMethod) -> tuple[str, ...]:
    """Covariates of a learned index of a method: a dense one also has neighbours to compare its flow with."""
    return (*INDEX_COVARIATES, "spread") if isinstance(method, DenseFlow) else INDEX_COVARIATES


def schedule_index(
    schedule: str, populations: Sequence[Sequence[ErrorSketch]], names: Sequence[str] = INDEX_COVARIATES
) -> Index:
    """Index of a schedule's name; that of ``"index"`` is learned from the populations' reservoirs.

    Parameters
    ----------
    schedule : str
        One of `SCHEDULES`.
    populations : sequence of sequence of ErrorSketch
        Blocks of each flight or data set, which all count alike, with the covariates kept.
    names : sequence of str
        Covariates of a learned index.

    Raises
    ------
    CalibrationError
        If the name is unknown or there is too little data.
    """
    check_schedule(schedule)
    if schedule == "flow":
        return FLOW_INDEX
    if schedule != "index":
        return Index()
    merged = [merge_all(blocks) for blocks in populations if blocks]
    # the weights hardly depend on the family; the paper's is the fastest to fit
    return learn_index(Rows.of([m for m in merged if m.total]), error_family("lcm"), names, products=True)
