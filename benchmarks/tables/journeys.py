"""The scores of whole runs over worlds: shares, metres until something happens, means.

Metres are censored where a run ends before it happens: such a run counts as infinite in medians and
curves, and in differences as the longest way that any method drove in its world (a restricted
mean). A run that failed counts as one in which nothing happened.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from benchmarks.tables import stats
from benchmarks.tables.pairing import Runs, differences, grouped, over_worlds
from benchmarks.tables.stats import UNKNOWN, Estimate
from benchmarks.trials.scores import JOURNEY_SCORES, Score
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Run
from deqmcl_gym.numerics.types import Floats


@dataclass(frozen=True, kw_only=True)
class JourneyScore:
    """A score of one method's runs; NaN is not available.

    Attributes:
        value: of metres the median over worlds with its interval by ranks; of shares and other
            numbers the mean over worlds, with Wilson's interval for as many cases as worlds, or
            a bootstrap interval.
        restricted: of metres the mean, each at most the longest way in its world.
        diff: mean over worlds of it (of metres: restricted) - the baseline's, 95 % bootstrap.
        p: of shares the sign test over worlds, with one run on each McNemar's exact test; of
            metres the signed-rank test of the restricted differences.
        p_holm: corrected for all tests of the panel at offset 0.
    """

    value: Estimate
    restricted: float = math.nan
    diff: Estimate = UNKNOWN
    p: float = math.nan
    p_holm: float = math.nan

    @property
    def significant(self) -> bool:
        """Whether the interval of the difference excludes 0, and ``p_holm`` is below 0.05."""
        return stats.confirmed(self.diff, self.p_holm)


class ShareCurve(NamedTuple):
    """Share of runs that are localized for good after so many metres, with a pointwise band."""

    metres: Floats
    share: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True, kw_only=True)
class Outcomes:
    """The whole runs of one method of a panel.

    Attributes:
        records: those that came to their end.
        failed: those that did not.
        longest: the longest way that any run of the panel drove in each world, m.
    """

    records: Sequence[Finished]
    failed: Sequence[Run]
    longest: Mapping[int, float]

    def runs(self, score: Score) -> Runs:
        """Return a score by run, left out where it is unknown; infinite if censored."""
        found = {record.trial.run: value_in(record, score) for record in self.records}
        found |= dict.fromkeys(self.failed, score.failed)
        return {run: value for run, value in found.items() if not math.isnan(value)}

    def restricted(self, score: Score) -> Runs:
        """Return metres by run, each at most the longest way in its world."""
        found = self.runs(score)
        return {run: min(value, self.longest.get(run[0], 0.0)) for run, value in found.items()}

    def curve(self, score: Score) -> ShareCurve:
        """Return the share of runs for which it happened within so many metres."""
        return curve_of(grouped(self.runs(score)))

    def summary(self, score: Score) -> JourneyScore:
        """Return a score over worlds."""
        runs = self.runs(score)
        if not runs:
            return JourneyScore(value=UNKNOWN)
        if score.censored:
            restricted = over_worlds(self.restricted(score))
            worlds = [median(own) for own in grouped(runs).values()]
            return JourneyScore(value=median_estimate(worlds), restricted=float(restricted.mean()))
        values = over_worlds(runs)
        if score.unit != "share":
            return JourneyScore(value=stats.estimate(values))
        share = float(values.mean())
        return JourneyScore(value=Estimate(share, *stats.wilson(share, values.size)))

    def beside(self, baseline: "Outcomes") -> dict[str, JourneyScore]:
        """Return all scores by name beside the baseline's, which may be its own."""
        scores = scores_in(self.records)
        if baseline is self:
            return {score.name: self.summary(score) for score in scores}
        return {score.name: self.against(baseline, score) for score in scores}

    def against(self, baseline: "Outcomes", score: Score) -> JourneyScore:
        """Return a score beside the baseline's."""
        own = self.summary(score)
        if not score.tested:
            return own
        read = Outcomes.restricted if score.censored else Outcomes.runs
        apart = differences(read(self, score), read(baseline, score))
        p = stats.sign_test(apart) if score.unit == "share" else stats.wilcoxon(apart)
        return replace(own, diff=stats.estimate(apart), p=p)


def longest_ways(records: Iterable[Finished]) -> dict[int, float]:
    """Return the longest way that any of these runs drove in each world, m."""
    longest: dict[int, float] = {}
    for record in records:
        if record.journey is not None:
            world, way = record.trial.trial, record.journey.curves["way"][-1]
            longest[world] = max(way, longest.get(world, 0.0))
    return longest


def scores_in(records: Iterable[Finished]) -> list[Score]:
    """Return the scores of whole runs that any of these records has, in their order."""
    names = {name for record in records if record.journey for name in record.journey.scores}
    return [score for name, score in JOURNEY_SCORES.items() if name in names]


def aim_of(records: Iterable[Finished]) -> Score | None:
    """Return the share of runs that these are about; None if they are about the error.

    Who was carried off is to be found again; who was lost, to be localized.
    """
    shares = [one for one in scores_in(records) if one.tested and one.unit == "share"]
    return shares[-1] if shares else None


def value_in(record: Finished, score: Score) -> float:
    """Return a score of a run; infinite if it is censored, NaN if it is unknown."""
    if record.journey is None or score.name not in record.journey.scores:
        return math.nan
    value = record.journey.scores[score.name]
    return float((math.inf if score.censored else math.nan) if value is None else value)


def curve_of(worlds: Mapping[int, Sequence[float]]) -> ShareCurve:
    """Return the share of runs with at most so many metres, runs on a world averaged first.

    The band is Wilson's 95 % interval, pointwise, for as many cases as worlds.

    Args:
        worlds: metres of each run by world; infinite where it did not happen.
    """
    finite = {m for own in worlds.values() for m in own if math.isfinite(m)}
    metres = np.array(sorted({0.0} | finite))
    found = np.array([[np.mean(np.array(own) <= m) for own in worlds.values()] for m in metres])
    share = found.mean(axis=1)
    low, high = np.array([stats.wilson(float(one), len(worlds)) for one in share]).T
    return ShareCurve(metres, share, low, high)


def median(values: Sequence[float]) -> float:
    """Return the median; the larger of the two in the middle if it is infinite."""
    ordered = sorted(values)
    low, high = ordered[(len(ordered) - 1) // 2], ordered[len(ordered) // 2]
    return low if low == high else (low + high) / 2


def median_estimate(values: Sequence[float]) -> Estimate:
    """Return the median with its 95 % interval between two of the values; NaN of fewer than six.

    The k-th smallest and k-th largest, k the largest with P(Binomial(n, ½) < k) ≤ 2.5 %: whatever
    the distribution (Conover 1999, section 3.2).
    """
    ordered, n = sorted(values), len(values)
    below = accumulate(math.comb(n, i) / 2**n for i in range(n))
    k = sum(1 for p in below if p <= 0.025)
    if k == 0:
        return Estimate(median(ordered))
    return Estimate(median(ordered), ordered[k - 1], ordered[n - k])
