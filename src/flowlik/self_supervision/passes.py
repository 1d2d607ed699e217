"""One pass over a sequence's pairs: motions of both halves, errors against them, and whether it is enough."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from collections.abc import Sequence as Seq
from dataclasses import dataclass
from typing import Any

from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import EgoMotion, Estimator, Status
from flowlik.errors import CalibrationError
from flowlik.self_supervision.cross_fit import MotionErrors, SeenPair, errors_against, half_motions

LEAST_PAIRS = 20
WARN_SOLVED = 0.8


@dataclass(frozen=True, eq=False)
class Pass:
    """Motions of both halves of every pair by one model, and errors against them.

    Attributes
    ----------
    motions : list of pair of EgoMotion
        Of the halves of every pair.
    solved : list of int
        The pairs both of whose halves are solved.
    crossed, own : list of MotionErrors
        Of these pairs, against the motion of the other half, and against their own.
    """

    motions: list[tuple[EgoMotion, EgoMotion]]
    solved: list[int]
    crossed: list[MotionErrors]
    own: list[MotionErrors]

    @property
    def statuses(self) -> dict[str, int]:
        """How many pairs ended how: as the first of its halves that is not solved, or solved."""
        counts: dict[str, int] = {}
        for halves in self.motions:
            status = next((m.status for m in halves if m.status is not Status.SOLVED), Status.SOLVED)
            counts[status.value] = counts.get(status.value, 0) + 1
        return counts

    @property
    def told(self) -> str:
        """One phrase of how many pairs ended how."""
        ends = ", ".join(f"{count} {name}" for name, count in sorted(self.statuses.items()))
        return f"of {len(self.motions)} image pairs {ends}"

    def of(self, pairs: Iterable[int], own: bool = False) -> list[MotionErrors]:
        """Errors of some of the pairs, out of fit or in fit."""
        wanted = set(pairs)
        return [e for k, e in zip(self.solved, self.own if own else self.crossed) if k in wanted]


def pass_over(
    pairs: Seq[SeenPair],
    estimator: Estimator,
    names: tuple[str, ...],
    seed: int,
    before: Pass | None = None,
    map: Callable[..., Iterable[Any]] = map,
) -> Pass:
    """Estimate both halves' motions of all pairs, each begun from its own half's before, and take errors.

    Raises
    ------
    ModelError
        If the model or a covariate does not fit the measurements.
    """

    def work(number: int) -> tuple[tuple[EgoMotion, EgoMotion], tuple[MotionErrors, MotionErrors] | None]:
        residuals = pairs[number].residuals()
        starts: tuple[RigidTransform | None, RigidTransform | None] = (None, None)
        if before is not None and _both(before.motions[number]):
            starts = before.motions[number][0].T_k_prev, before.motions[number][1].T_k_prev
        motions = half_motions(estimator, residuals, (seed, number), starts)
        if not _both(motions):
            return motions, None
        first, second = (motion.T_k_prev for motion in motions)
        crossed = errors_against(residuals, (second, first), names)
        return motions, (crossed, errors_against(residuals, (first, second), names))

    found = list(map(work, range(len(pairs))))
    solved = [number for number, (_, errors) in enumerate(found) if errors is not None]
    kept = [errors for _, errors in found if errors is not None]
    return Pass([motions for motions, _ in found], solved, [a for a, _ in kept], [b for _, b in kept])


def _both(motions: tuple[EgoMotion, EgoMotion]) -> bool:
    return all(motion.status is Status.SOLVED for motion in motions)


def check_enough(found: Pass) -> list[str]:
    """Warnings about a pass whose pairs are few of those given.

    Raises
    ------
    CalibrationError
        If fewer than 20 pairs have a motion in both halves.
    """
    solved, asked = len(found.solved), len(found.motions)
    if solved < LEAST_PAIRS:
        raise CalibrationError(
            f"too little to calibrate on without truth: {found.told}; {LEAST_PAIRS} solved ones are needed, "
            "whose motions have parallax"
        )
    if solved < WARN_SOLVED * asked:
        return [f"{found.told}: only the solved ones tell of errors, and the others may have larger ones"]
    return []
