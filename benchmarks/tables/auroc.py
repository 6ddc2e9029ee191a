"""Does the quality of a belief detect that it is far off? The area under the ROC curve (AUROC).

Fawcett 2006, section 7; the area is the statistic of Mann & Whitney 1947. Steps of a lap depend on
each other, so intervals come from resampled worlds.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.tables.pairing import worlds_of
from benchmarks.tables.stats import QUANTILES, UNKNOWN, Estimate, multiplicities
from benchmarks.trials.scoring import Finished
from deqmcl_gym.numerics.types import Bools, Floats

Steps = tuple[Floats, Bools]


@dataclass(frozen=True, kw_only=True)
class Auroc:
    """AUROC of the quality at x_t against whether e is far off; NaN is not available.

    Attributes:
        auroc: P(q of a far step < q of another) + ½ P(equal), over all steps of all worlds, with
            its interval over worlds; see ``auroc_interval``.
        far_steps: share of far steps, of those that have a quality.
        far_worlds: worlds with such a step; None if no step has a quality.
    """

    auroc: Estimate = UNKNOWN
    far_steps: float = math.nan
    far_worlds: int | None = None


def auroc_of(records: Sequence[Finished]) -> Auroc:
    """Return how well the quality ranks the steps t ≥ 1 of one method's trials on one setting."""
    runs = [[rated_steps(record) for record in own] for own in worlds_of(records)]
    worlds = [
        (np.concatenate([q for q, _ in own]), np.concatenate([far for _, far in own]))
        for own in runs
    ]
    return auroc_of_steps(worlds)


def auroc_of_steps(worlds: Sequence[Steps]) -> Auroc:
    """Return how well a number ranks steps, given by world; far steps should have smaller ones."""
    every = np.concatenate([far for _, far in worlds]) if worlds else np.empty(0, bool)
    if not every.size:
        return Auroc()
    wins = in_order(worlds)
    pairs = every.sum() * (~every).sum()
    return Auroc(
        auroc=Estimate(
            float(wins.sum() / pairs) if pairs else math.nan, *auroc_interval(wins, worlds)
        ),
        far_steps=float(every.mean()),
        far_worlds=sum(bool(far.any()) for _, far in worlds),
    )


def rated_steps(record: Finished) -> Steps:
    """Return the qualities of a trial's steps t ≥ 1 that have one, and which are far off."""
    if record.quality is None:
        return np.empty(0), np.empty(0, dtype=bool)
    present, quality = record.curves[0], np.array(record.quality, np.float64)  # None is NaN
    errors = np.full(quality.size + 1, math.nan)  # of the states 0 … T
    listed = np.array(present.error, np.float64)[: max(0, errors.size - present.first_state)]
    errors[present.first_state : present.first_state + listed.size] = listed
    rated = np.isfinite(quality) & np.isfinite(errors[1:])
    return quality[rated], errors[1:][rated] > record.thresholds.far


def in_order(worlds: Sequence[Steps]) -> Floats:
    """Count pairs of a far step of world i and another step of world j that are in order, (W, W).

    In order: the far step has the smaller quality. Pairs of equal quality count half.
    """
    far = np.concatenate([quality[is_far] for quality, is_far in worlds])
    world = np.repeat(np.arange(len(worlds)), [is_far.sum() for _, is_far in worlds])
    wins = np.zeros((len(worlds), len(worlds)))
    for j, (quality, is_far) in enumerate(worlds):
        others = np.sort(quality[~is_far])
        below = np.searchsorted(others, far, "left") + np.searchsorted(others, far, "right")
        wins[:, j] = np.bincount(world, others.size - below / 2, len(worlds))
    return wins


def auroc_interval(wins: Floats, worlds: Sequence[Steps]) -> tuple[float, float]:
    """95 % percentile bootstrap interval of the AUROC, over worlds.

    10,000 resamples with a fixed seed; one without a far step, or with nothing else, has no AUROC
    and is left out. NaN unless two worlds or more have far steps, and two or more have others.
    """
    far = np.array([is_far.sum() for _, is_far in worlds])
    others = np.array([(~is_far).sum() for _, is_far in worlds])
    if min((far > 0).sum(), (others > 0).sum()) < 2:
        return math.nan, math.nan
    drawn = multiplicities(len(worlds))
    pairs = (drawn @ far) * (drawn @ others)
    # sums of halves below 2⁵³: exact, in whatever order they are added
    values = ((drawn @ wins) * drawn).sum(axis=1)[pairs > 0] / pairs[pairs > 0]
    low, high = np.quantile(values, QUANTILES)
    return float(low), float(high)
