"""When the comparison of a method with its baseline is decided: after which world, and how.

Its intervals are confidence sequences (Darling & Robbins 1967), which cover at all looks together
with probability 1 - α. Who stops when a bootstrap interval excludes 0 is wrong far more often.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
import pandas as pd

from benchmarks.tables.frames import paired_worlds, scored, whole_runs
from benchmarks.tables.stats import ALPHA, NOT_KNOWN, Interval
from benchmarks.trials.scores import Score
from deqmcl_gym.numerics import Floats

FIRST, _BLOCK = 20, 10  # worlds before the first look, and between two looks

Relation = Literal["better", "worse", "equivalent", "open"]
RELATIONS: tuple[Relation, ...] = get_args(Relation)


class Look(NamedTuple):
    """What is known after so many worlds: the relative error, or the difference of shares."""

    worlds: int
    interval: Interval


@dataclass(frozen=True, kw_only=True)
class Rule:
    """When to stop; α = 0.05 is shared equally by all comparisons of a sweep, fixed before it runs.

    All intervals of a sweep (methods, settings, looks) hold together with a probability of 95 %.
    """

    margin: float  # difference that does not matter: as a share of the baseline's error, or of runs
    family: int  # comparisons of the sweep
    worlds: int  # most worlds of a setting

    @property
    def looks(self) -> Iterator[int]:
        """The numbers of worlds after which one looks."""
        yield from range(FIRST, self.worlds, _BLOCK)
        yield self.worlds


@dataclass(frozen=True, kw_only=True)
class Decision:
    """How a comparison stands."""

    # at each number of worlds that both have finished, up to the one that decided it
    looks: tuple[Look, ...]
    # better or worse by more than the margin, equivalent if within it on both sides, or open
    relation: Relation
    wanted: int  # worlds that it needs: those of its last look if it is decided, else of the next

    @property
    def last(self) -> Look:
        """The last look."""
        return self.looks[-1] if self.looks else Look(0, NOT_KNOWN)


def decide(ours: pd.DataFrame, baseline: pd.DataFrame, aim: Score | None, rule: Rule) -> Decision:
    """Look at a method beside its baseline after so many worlds, until that decides.

    At a look only the worlds up to it count, so the order in which trials were run does not matter.
    Rows are as of ``frames.cell``; ``aim`` is a share of runs; None compares errors at x_t.
    """
    interval = _intervals(ours, baseline, aim, ALPHA / rule.family)
    there = min(_ended(ours), _ended(baseline))
    looks: list[Look] = []
    relation: Relation = "open"
    for worlds in rule.looks:
        if worlds > there:
            break
        looks.append(Look(worlds, interval(worlds)))
        relation = _relation(looks[-1].interval, rule.margin, least=aim is None)
        if relation != "open" or math.isnan(looks[-1].interval.mean):
            break
    return Decision(looks=tuple(looks), relation=relation, wanted=worlds)


def _intervals(
    ours: pd.DataFrame, baseline: pd.DataFrame, aim: Score | None, alpha: float
) -> Callable[[int], Interval]:
    """Return a function from a number of worlds to what is known after these."""
    mine, theirs = (
        scored(rows)["error"] if aim is None else whole_runs(rows, aim) for rows in (ours, baseline)
    )
    found = paired_worlds(mine, theirs)
    worlds, (apart, reference) = found.index.to_numpy(), found.to_numpy().T
    if aim is not None:
        bets = [NOT_KNOWN, *shares(apart, alpha)]
        return lambda most: bets[int((worlds < most).sum())]
    return lambda most: ratio(apart[worlds < most], reference[worlds < most], alpha)


def _ended(rows: pd.DataFrame) -> int:
    """Count the worlds, from the first one, of which every run has ended."""
    runs = rows.index.unique().to_frame(index=False)
    if runs.empty:
        return 0
    seeds = runs.groupby("trial").size()
    whole = seeds.reindex(range(seeds.index.max() + 2)) == 1 + runs["filter_seed"].max()
    return int(whole.argmin())


def _relation(found: Interval, margin: float, *, least: bool) -> Relation:
    """Return where an interval lies; ``least``: whether the least is the best."""
    if found.high < -margin:
        return "better" if least else "worse"
    if found.low > margin:
        return "worse" if least else "better"
    return "equivalent" if -margin < found.low and found.high < margin else "open"


TIGHT = 20  # worlds at which the interval of a ratio is as short as it can be
_STEP = 1e-3  # between the means that are tried for an interval of shares
_MOST = 0.75  # of the capital that is bet at once


def ratio(apart: Floats, reference: Floats, alpha: float) -> Interval:
    """Mean difference over mean reference, E[d] / E[b], from paired values of the same worlds.

    The ratios r for which the mixture t-test of E[d - r b] = 0 is below 1 / α, as Fieller (1954)
    inverts a t-test: (d̄ - r b̄)² ≤ K (s_dd - 2 r s_db + r² s_bb) / n, K of ``_reach``. Its coverage
    is exact at all n together where d - r b is normal, and that of large samples elsewhere.

    d and b are (n,), the mean of b above 0. Ends are infinite where no ratio can be excluded;
    ``NOT_KNOWN`` if a value is NaN, or of fewer than two.
    """
    n = apart.size
    if n < 2 or np.isnan(apart).any() or np.isnan(reference).any() or not reference.mean() > 0:
        return NOT_KNOWN
    d, b = float(apart.mean()), float(reference.mean())
    if not (reach := _reach(n, alpha) / n) < math.inf:
        return Interval(d / b, -math.inf, math.inf)
    (dd, db), (_, bb) = np.cov(apart, reference)
    square, linear, constant = b * b - reach * bb, d * b - reach * db, d * d - reach * dd
    if square <= 0:
        return Interval(d / b, -math.inf, math.inf)
    half = math.sqrt(max(0.0, linear * linear - square * constant))  # d / b is one of the ratios
    return Interval(d / b, (linear - half) / square, (linear + half) / square)


def _reach(n: int, alpha: float) -> float:
    """Return K, the t² up to which the mixture t-test of n values stays below 1 / α.

    M_n = √k ((1 + t²/ν) / (1 + k t²/ν))^(n/2), k = c² / (n + c²), ν = n - 1: the likelihood ratio
    with a N(0, 1/c²) mixture over the mean in SDs (Lai 1976; Wang & Ramdas 2024, *Anytime-valid
    t-tests*), a martingale if the mean is 0. Infinite where n is too small for any t.
    """
    reach = -2 * math.log(alpha)
    c2 = TIGHT / (reach + math.log(reach + 1))
    k = c2 / (n + c2)
    bound = (alpha * math.sqrt(k)) ** (-2 / n)
    return (n - 1) * (bound - 1) / (1 - bound * k) if bound * k < 1 else math.inf


def shares(apart: Floats, alpha: float) -> list[Interval]:
    """Mean of differences of shares, from -1 to 1, after each of them: by betting.

    The means m at which nobody who bets against m, with a stake that depends on former values only,
    has ever multiplied his capital by 1 / α: hedged capital with the predictable plug-in
    (Waudby-Smith & Ramdas 2024, *Estimating means of bounded random variables by betting*). Its
    coverage is exact for every distribution.

    No interval is wider than the one before; ends are multiples of 0.001, rounded outwards.
    """
    n = apart.size
    if not n or np.isnan(apart).any():
        return [NOT_KNOWN] * n
    seen = (apart + 1) / 2
    count = np.arange(1, n + 1)
    guess = (0.5 + np.cumsum(seen)) / (count + 1)
    spread = (0.25 + np.cumsum((seen - guess) ** 2)) / (count + 1)
    before = np.concatenate([[0.25], spread[:-1]])
    stake = np.sqrt(2 * math.log(2 / alpha) / (before * count * np.log(count + 1)))[:, None]
    tried = np.arange(_STEP / 2, 1, _STEP / 2)
    gain = seen[:, None] - tried
    up = np.log1p(np.minimum(stake, _MOST / tried) * gain).cumsum(axis=0)
    down = np.log1p(-np.minimum(stake, _MOST / (1 - tried)) * gain).cumsum(axis=0)
    capital = np.maximum.accumulate(np.maximum(up, down), axis=0) - math.log(2)
    means, found = np.cumsum(apart) / count, []
    for mean, held in zip(means, capital < -math.log(alpha), strict=True):
        left = np.flatnonzero(held)
        ends = (left[0], left[-1] + 2) if left.size else (0, tried.size + 1)
        low, high = (round(float(end * _STEP - 1), 3) for end in ends)
        found.append(Interval(float(mean), low, high))
    return found
