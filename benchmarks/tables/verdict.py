"""Who is best: the rows of a panel by error, and what is known of the first of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.tables.comparison import Comparison
from benchmarks.tables.pairing import differences, runs_of
from benchmarks.tables.panels import Panel
from benchmarks.tables.series import milliseconds_per_step
from benchmarks.tables.stats import Estimate, estimate

BLIND = "dead-reckoning"  # uses no scan, so that it localizes nothing


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the errors at x_t say of some methods of a panel.

    Attributes:
        first: the smallest error.
        best: the smallest error of those that are confirmed to be better than their baseline; None
            if none is.
        following: the next smallest error after the winner's; None if there is no other.
        lead: mean over the shared worlds of its error - the winner's.
        tests: members of Holm's family.
    """

    first: Comparison
    best: Comparison | None
    following: Comparison | None
    lead: Estimate
    tests: int

    @property
    def winner(self) -> Comparison:
        """The best method; where none is confirmed, the one with the smallest error."""
        return self.best or self.first


def ranked(rows: Sequence[Comparison]) -> list[Comparison]:
    """Rows by error, an unknown one last; equal ones as they are, but the baseline first."""
    return sorted(
        rows,
        key=lambda row: (
            math.isnan(row.error.mean),
            0.0 if math.isnan(row.error.mean) else row.error.mean,
            not row.is_baseline,
        ),
    )


def verdict(panel: Panel, *, filters: bool = False) -> Verdict | None:
    """Return the verdict on a panel, or on its methods that use scans; None if it has none."""
    rows = ranked(panel.present)
    listed = [row for row in rows if not (filters and row.method.localizer == BLIND)]
    if not listed or math.isnan(listed[0].error.mean):
        return None
    better = (row for row in listed if row.significant and row.diff.mean < 0)
    best = next(better, None)
    winner = best or listed[0]
    others = [row for row in listed if row.errors != winner.errors and row is not listed[0]]
    following = next((row for row in others if row.error.mean >= winner.error.mean), None)
    return Verdict(
        first=listed[0],
        best=best,
        following=following,
        lead=lead(panel, winner, following) if following else Estimate(),
        tests=sum(not math.isnan(row.p) for row in rows),
    )


def lead(panel: Panel, winner: Comparison, other: Comparison) -> Estimate:
    """Mean over the shared worlds of the other's error - the winner's."""
    ours, theirs = (runs_of(panel.records[row.method], "error") for row in (winner, other))
    return estimate(differences(theirs, ours))


def baseline_row(panel: Panel, row: Comparison) -> Comparison:
    """The row of a method's baseline at x_t."""
    return next(one for one in panel.present if one.method == row.baseline)


def cost(panel: Panel, row: Comparison) -> float:
    """Its median time per step over the baseline's; NaN if one of them was not timed."""
    own, theirs = (milliseconds_per_step(panel.records[m]) for m in (row.method, row.baseline))
    return own / theirs if theirs > 0 else math.nan
