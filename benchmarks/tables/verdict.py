"""Who is best: the methods of a panel by what it is about, and what is known of the first."""

import math
from dataclasses import dataclass

from benchmarks.tables.comparison import Comparison, outcomes_of
from benchmarks.tables.journeys import JourneyScore
from benchmarks.tables.pairing import differences, runs_of
from benchmarks.tables.panels import Panel
from benchmarks.tables.series import milliseconds_per_step
from benchmarks.tables.stats import UNKNOWN, Estimate, estimate
from benchmarks.trials.journeys import JOURNEY_SCORES, Score

BLIND = "dead-reckoning"  # uses no scan, so that it localizes nothing


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the errors at x_t, or the shares of runs that succeed, say of methods of a panel.

    Attributes:
        aim: the share that they are ranked by; None is the error.
        first: the smallest error, or the largest share.
        best: the first of those that are confirmed to be better than their baseline; None if none
            is.
        following: the next after the winner; None if there is no other.
        lead: how much better than it the winner is, mean over the shared worlds.
        tests: members of Holm's family.
    """

    aim: Score | None
    first: Comparison
    best: Comparison | None
    following: Comparison | None
    lead: Estimate
    tests: int

    @property
    def winner(self) -> Comparison:
        """The best method; where none is confirmed, the first."""
        return self.best or self.first


def aim_of(panel: Panel) -> Score | None:
    """Return the share of whole runs that a panel is about; None if it is about the error.

    Who was carried off is to be found again; who was lost, to be localized.
    """
    held = {name for row in panel.present for name in row.journey}
    shares = [s for s in JOURNEY_SCORES.values() if s.tested and s.unit == "share"]
    return next((score for score in reversed(shares) if score.name in held), None)


def standing(row: Comparison, aim: Score | None) -> JourneyScore:
    """Return what a method is ranked by, beside its baseline's."""
    if aim is None:
        return JourneyScore(value=row.error, diff=row.diff, p=row.p, p_holm=row.p_holm)
    return row.journey.get(aim.name, JourneyScore(value=UNKNOWN))


def ranked(panel: Panel) -> list[Comparison]:
    """Rows, the best first, an unknown one last; equal ones as they are, but the baseline first."""
    aim = aim_of(panel)
    return sorted(panel.present, key=lambda row: (worse(row, aim), not row.is_baseline))


def verdict(panel: Panel, *, filters: bool = False) -> Verdict | None:
    """Return the verdict on a panel, or on its methods that use scans; None if it has none."""
    aim, rows = aim_of(panel), ranked(panel)
    listed = [row for row in rows if not (filters and row.method.name == BLIND)]
    if not listed or math.isinf(worse(listed[0], aim)):
        return None
    best = next((row for row in listed if _confirmed(row, aim)), None)
    winner = best or listed[0]
    others = [row for row in listed if row.errors != winner.errors and row is not listed[0]]
    behind = (row for row in others if worse(winner, aim) <= worse(row, aim) < math.inf)
    following = next(behind, None)
    return Verdict(
        aim=aim,
        first=listed[0],
        best=best,
        following=following,
        lead=_lead(panel, aim, winner, following) if following else Estimate(),
        tests=tests_in(panel),
    )


def tests_in(panel: Panel) -> int:
    """How many tests Holm's correction at x_t is for."""
    own = (p for row in panel.present for p in (row.p, *(s.p for s in row.journey.values())))
    return sum(not math.isnan(p) for p in own)


def baseline_row(panel: Panel, row: Comparison) -> Comparison:
    """The row of a method's baseline at x_t."""
    return next(one for one in panel.present if one.method == row.baseline)


def cost(panel: Panel, row: Comparison) -> float:
    """Its median time per step over the baseline's; NaN if one of them was not timed."""
    own, theirs = (milliseconds_per_step(panel.records[m]) for m in (row.method, row.baseline))
    return own / theirs if theirs > 0 else math.nan


def worse(row: Comparison, aim: Score | None) -> float:
    """What methods are ranked by, the least first: the error, or 1 less the share.

    Infinite if it is unknown.
    """
    mean = standing(row, aim).value.mean
    if math.isnan(mean):
        return math.inf
    return mean if aim is None else 1 - mean


def _confirmed(row: Comparison, aim: Score | None) -> bool:
    own = standing(row, aim)
    return own.significant and (own.diff.mean < 0) == (aim is None)


def _lead(panel: Panel, aim: Score | None, winner: Comparison, other: Comparison) -> Estimate:
    if aim is None:
        ours, theirs = (runs_of(panel.records[row.method], "error") for row in (winner, other))
        return estimate(differences(theirs, ours))
    outcomes = outcomes_of(panel.records, panel.failed)
    ours, theirs = (outcomes[row.method].runs(aim) for row in (winner, other))
    return estimate(differences(ours, theirs))
