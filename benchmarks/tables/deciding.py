"""When the comparison of a method with its baseline is decided: after which world, and how."""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from benchmarks.tables import sequential
from benchmarks.tables.journeys import Outcomes
from benchmarks.tables.pairing import Runs, by_world, runs_of
from benchmarks.tables.stats import ALPHA, UNKNOWN, Estimate
from benchmarks.trials.scores import Score

FIRST, BLOCK = 20, 10  # worlds before the first look, and between two looks

Relation = Literal["better", "worse", "equivalent", "open"]
RELATIONS: tuple[Relation, ...] = get_args(Relation)


class Interim(NamedTuple):
    """What is known after so many worlds: the relative error, or the difference of shares."""

    worlds: int
    interval: Estimate


@dataclass(frozen=True, kw_only=True)
class Rule:
    """When to stop; α = 0.05 is shared equally by all comparisons of a sweep, fixed before it runs.

    So all intervals that a sweep shows, of all methods, settings and looks, hold together with a
    probability of 95 %.

    Attributes:
        margin: difference that does not matter: as a share of the baseline's error, or of runs.
        family: comparisons of the sweep.
        worlds: most worlds of a setting.
    """

    margin: float
    family: int
    worlds: int

    @property
    def looks(self) -> Iterator[int]:
        """The numbers of worlds after which one looks."""
        yield from range(FIRST, self.worlds, BLOCK)
        yield self.worlds


@dataclass(frozen=True, kw_only=True)
class Decision:
    """How a comparison stands.

    Attributes:
        interims: at each number of worlds that both have finished, up to the one that decided it.
        relation: better or worse than the baseline by more than the margin, equivalent if within
            the margin on both sides, or open.
        margin: of the rule.
        wanted: worlds that it needs: those of its last look if it is decided, else of the next.
    """

    interims: tuple[Interim, ...]
    relation: Relation
    margin: float
    wanted: int

    @property
    def interval(self) -> Estimate:
        """The interval of the last look."""
        return self.interims[-1].interval if self.interims else UNKNOWN

    @property
    def worlds(self) -> int:
        """The worlds of the last look."""
        return self.interims[-1].worlds if self.interims else 0


def decide(ours: Outcomes, baseline: Outcomes, aim: Score | None, rule: Rule) -> Decision:
    """Look at a method beside its baseline after so many worlds, until that decides.

    Nothing but the worlds up to a look counts at it, so that the order in which trials were run
    does not matter. Where nothing can be compared, one looks no further.

    Args:
        ours, baseline: what has run of both.
        aim: share of runs that succeed; None compares errors at x_t.
        rule: when to stop.
    """
    interval = _intervals(ours, baseline, aim, ALPHA / rule.family)
    there = min(_finished(ours), _finished(baseline))
    seen: list[Interim] = []
    relation: Relation = "open"
    for worlds in rule.looks:
        if worlds > there:
            break
        seen.append(Interim(worlds, interval(worlds)))
        relation = _relation(seen[-1].interval, rule.margin, least=aim is None)
        if relation != "open" or math.isnan(seen[-1].interval.mean):
            break
    return Decision(interims=tuple(seen), relation=relation, margin=rule.margin, wanted=worlds)


def _intervals(
    ours: Outcomes, baseline: Outcomes, aim: Score | None, alpha: float
) -> Callable[[int], Estimate]:
    """Return a function from a number of worlds to what is known after these."""
    mine, theirs = (_values(one, aim) for one in (ours, baseline))
    apart = by_world({run: mine[run] - theirs[run] for run in mine if run in theirs})
    worlds, values = np.array(list(apart)), np.array(list(apart.values()))
    if aim is not None:
        bets = [UNKNOWN, *sequential.shares(values, alpha)]
        return lambda most: bets[int((worlds < most).sum())]
    levels = by_world({run: theirs[run] for run in mine if run in theirs})
    reference = np.array(list(levels.values()))
    return lambda most: sequential.ratio(values[worlds < most], reference[worlds < most], alpha)


def _values(outcomes: Outcomes, aim: Score | None) -> Runs:
    return runs_of(outcomes.records, "error") if aim is None else outcomes.runs(aim)


def _finished(outcomes: Outcomes) -> int:
    """Count the worlds, from the first one, of which every run has ended."""
    runs = {*(record.trial.run for record in outcomes.records), *outcomes.failed}
    seeds = 1 + max((seed for _, seed in runs), default=0)
    whole = (all((world, seed) in runs for seed in range(seeds)) for world in itertools.count())
    return sum(1 for _ in itertools.takewhile(bool, whole))


def _relation(found: Estimate, margin: float, *, least: bool) -> Relation:
    """Return where an interval lies; ``least``: whether the least is the best."""
    if found.high < -margin:
        return "better" if least else "worse"
    if found.low > margin:
        return "worse" if least else "better"
    return "equivalent" if -margin < found.low and found.high < margin else "open"
