"""Who is best, and how methods compare with the paper's, run by run."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmarks.tables.comparison import Comparison
from benchmarks.tables.journeys import Outcomes
from benchmarks.tables.pairing import differences, runs_of
from benchmarks.tables.stats import UNKNOWN, Estimate, estimate
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Method

BLIND = "dead-reckoning"  # uses no scan, so that it localizes nothing


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the errors at x_t, or the shares of runs that succeed, say of methods of a panel.

    Attributes:
        first: the smallest error, or the largest share.
        best: the first of those that are confirmed to be better than their baseline; None if none
            is.
        following: the next after the winner; None if there is no other.
        lead: how much better than it the winner is, mean over the shared worlds.
    """

    first: Comparison
    best: Comparison | None
    following: Comparison | None
    lead: Estimate

    @property
    def winner(self) -> Comparison:
        """The best method; where none is confirmed, the first."""
        return self.best or self.first


def verdict(
    ranked: Sequence[Comparison],
    methods: Mapping[Method, Sequence[Finished]],
    whole: Mapping[Method, Outcomes],
    *,
    lead: bool = True,
) -> Verdict | None:
    """Return the verdict on methods; None if nothing is known of the first.

    Args:
        ranked: rows at x_t, the best first.
        methods: their trials.
        whole: their whole runs.
        lead: whether to tell it; not where the results say how many worlds there are.
    """
    if not ranked or math.isinf(ranked[0].worse):
        return None
    best = next((row for row in ranked if row.confirmed), None)
    winner = best or ranked[0]
    others = [row for row in ranked if row.errors != winner.errors and row is not ranked[0]]
    behind = (row for row in others if winner.worse <= row.worse < math.inf)
    following = next(behind, None)
    found = UNKNOWN
    if lead and following and winner.aim is None:
        ours, theirs = (runs_of(methods[row.method], "error") for row in (winner, following))
        found = estimate(differences(theirs, ours))
    elif lead and following and winner.aim:
        ours, theirs = (whole[row.method].runs(winner.aim) for row in (winner, following))
        found = estimate(differences(ours, theirs))
    return Verdict(first=ranked[0], best=best, following=following, lead=found)


_NOW = ("mcl", "mcl-map", "deq-mcl")
_PAST = ("mcl-smoother", "mcl-map-smoother", "deq-mcl")

Rivals = dict[Method, dict[Method, Estimate]]


def rivals(methods: Mapping[Method, Sequence[Finished]], lag: int) -> dict[int, Rivals]:
    """Return differences of errors at x_t and x_{t-L}, by offset, method and rival.

    Each is the mean over worlds of error - the rival's at the same offset, with its interval.
    Offsets without a rival are left out.
    """
    if len({method.agent for method in methods}) > 1:  # they differ by who drives
        return {}
    offsets = {0: _NOW} | ({-lag: _PAST} if lag else {})
    found = {}
    for offset, names in offsets.items():
        runs = {method: runs_of(records, "error", offset) for method, records in methods.items()}
        errors = {method: own for method, own in runs.items() if own}
        against = [method for name in names for method in errors if method.name == name]
        if against and len(errors) > 1:
            found[offset] = {
                method: {one: estimate(differences(own, errors[one])) for one in against}
                for method, own in errors.items()
            }
    return found
