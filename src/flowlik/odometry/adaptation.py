"""A likelihood that follows a drive's own errors: slowly, and by past frames alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from flowlik.egomotion import EgoMotion, Status
from flowlik.errors import ModelError
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.tables import look_up
from flowlik.odometry.odometry import Odometry, Step
from flowlik.support.arrays import Array

# fewer components tell nothing
LEAST_COMPONENTS = 100
# coordinates [ln px] by which the density's slope is taken
STEP = 0.1
# information of a component about the logarithm of its error's size, about
EACH = 0.5
# coordinate that a slope leaves where it is: errors of a tenth of a pixel
CENTRE = float(np.log(0.1))


@dataclass(frozen=True)
class Adaptation:
    """How fast a likelihood follows a drive, and how far.

    Attributes
    ----------
    memory_frames : float
        A frame counts by a factor of e less after so many more.
    prior_frames : float
        So many frames' worth the model itself counts, for good.
    most : float
        Errors are never said to be more than so many times smaller or larger than the model has them.
    """

    memory_frames: float = 200.0
    prior_frames: float = 30.0
    most: float = 3.0


@dataclass(frozen=True, eq=False)
class Adapted:
    """A likelihood whose index is moved, ``x' = x + a + b (x - c)``, as past frames' errors say.

    The coordinate of a learned index is about the logarithm of the error: a shift a makes all errors larger
    or smaller, a slope b those far from a tenth of a pixel (c). Table, tails and confidences stay. Each
    frame's log-density, a mean over all components, outliers too, enters as a quadratic form about the shift
    at its time. A motion's own errors are a little too small, by what it bends to them: five freedoms of
    hundreds of vectors.

    Attributes
    ----------
    model : FlowLikelihood
        As it was calibrated.
    settings : Adaptation
        How.
    information, pull : array (2, 2), array (2,)
        Quadratic form of past frames: ``pull - information (a, b)`` is the slope of their log-density.

    Raises
    ------
    ModelError
        If the model's index is not learned.
    """

    model: FlowLikelihood
    settings: Adaptation = Adaptation()
    information: Array = field(default_factory=lambda: np.zeros((2, 2)))
    pull: Array = field(default_factory=lambda: np.zeros(2))

    def __post_init__(self) -> None:
        if self.model.schedule.name != "index":
            raise ModelError(
                "only a model over a learned index, whose coordinate is the error's size, can follow a "
                f"drive; this one is over {self.model.schedule.name}"
            )

    @cached_property
    def moved(self) -> Array:
        """The shift a [ln px] and the slope b."""
        prior = EACH * self.settings.prior_frames * np.eye(2)
        a, b = np.linalg.solve(self.information + prior, self.pull)
        most = np.log(self.settings.most)
        return np.array([np.clip(a, -most, most), np.clip(b, -0.5, 0.5)])

    @cached_property
    def likelihood(self) -> FlowLikelihood:
        """The likelihood as past frames have it."""
        a, b = self.moved
        return self.model.with_index(self.model.schedule.index.moved(a - b * CENTRE, 1.0 + b))

    def updated(self, step: Step) -> Adapted:
        """Take what a frame's vectors leave over of its motion; a frame without one tells nothing."""
        if step.motion.status is not Status.SOLVED:
            return self
        T = step.residual.retract(step.motion.T_k_prev.as_matrix()[:3], np.zeros(6))
        errors = step.residual.at(T, self.likelihood.schedule.index)
        seen = np.isfinite(errors.z)
        if seen.sum() < LEAST_COMPONENTS:
            return self
        (a, b), tables = self.moved, self.model.compiled
        z, x = errors.z[seen], errors.x[seen]
        up, down = (look_up(tables.log_prob, tables.rows(x + s), z) for s in (STEP, -STEP))
        slope = (up - down) / (2 * STEP)
        features = np.stack([np.ones_like(x), (x - CENTRE - a) / (1 + b)])
        gradient = features @ slope / len(x)
        information = (features * slope**2) @ features.T / len(x)
        kept = np.exp(-1 / self.settings.memory_frames)
        return replace(
            self,
            information=kept * self.information + information,
            pull=kept * self.pull + gradient + information @ self.moved,
        )


def adapting(
    motions: Iterable[EgoMotion], robot: Odometry, settings: Adaptation = Adaptation()
) -> Iterator[EgoMotion]:
    """Motions of an odometry whose likelihood follows the frames before each.

    Parameters
    ----------
    motions : iterable of EgoMotion
        As `flowlik.odometry.run_odometry` yields them, one each time it is asked.
    robot : Odometry
        The odometry; its estimator's likelihood changes after every frame.
    settings : Adaptation
        How fast and how far.

    Raises
    ------
    ModelError
        If the likelihood's index is not learned.
    """
    adapted = Adapted(robot.estimator.likelihood, settings)
    for motion in motions:
        if robot.last is not None:
            adapted = adapted.updated(robot.last)
            robot.estimator = replace(robot.estimator, likelihood=adapted.likelihood)
        yield motion
