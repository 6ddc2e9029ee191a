"""Which localizer is best on a log, and what its runs can confirm of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.replay.scoring import Row
from benchmarks.replay.tables import belief_table, results_table
from benchmarks.report.tables import Table
from benchmarks.report.words import interval, p_value, rounded, significant
from benchmarks.tables.stats import (
    ALPHA,
    Estimate,
    sample_sd,
    sign_estimate,
    sign_test,
    signed_rank_estimate,
    wilcoxon,
    worlds_to_see,
)
from benchmarks.trials.fixes import FOUND
from deqmcl_gym.numerics.types import Floats

_SUCCESS = f"success_{FOUND}"


@dataclass(frozen=True, kw_only=True)
class Difference:
    """What a localizer has beyond the first-named one, over runs of the same seeds.

    Attributes:
        value: with an interval that excludes 0 where ``p`` is below 0.05; all intervals of a table
            hold together with 95 %.
        p: of the test, times the number of tests; at most 1.
        runs: seeds with both.
        needed: runs that would show a difference of this size with 80 % power.
    """

    value: Estimate
    p: float
    runs: int
    needed: float

    @property
    def confirmed(self) -> bool:
        """Whether p, corrected, is below 0.05."""
        return self.p < ALPHA

    @property
    def doubt(self) -> str:
        """The corrected p; if it confirms nothing, how many runs would be needed."""
        if self.runs == 0:
            return "no run of both"
        if self.value.mean == 0:
            return "no difference"
        if self.confirmed:
            return f"p = {p_value(self.p)}"
        if math.isfinite(self.needed) and self.needed > self.runs:
            return f"not confirmed: would need about {rounded(int(self.needed))} runs"
        return f"not confirmed: p = {p_value(self.p)}"


def ranked(rows: Sequence[Row]) -> list[Row]:
    """Rows with a score: more runs localized to the end first, then the smaller median error."""
    known = [row for row in rows if row.played and not math.isnan(row.scores["position_median"])]
    return sorted(known, key=lambda row: (-_success(row), row.scores["position_median"]))


def verdict(rows: Sequence[Row]) -> str | None:
    """Return who is best; None without a reference, or if no run came to its end."""
    order = ranked(rows)
    if not order:
        return None
    best, *others = order
    if len(rows) == 1:
        return f"{best.localizer}: {_reached(best)}; nothing to compare it with."
    following = f" Next is {others[0].localizer}: {_reached(others[0])}." if others else ""
    return f"{best.localizer} is ahead: {_reached(best)}.{following}"


def comparison(rows: Sequence[Row]) -> str | None:
    """Return what the best localizer has beyond the first-named one, or the next if it is that.

    None if there are no two to compare.
    """
    order, base = ranked(rows), rows[0]
    other = next((row for row in order if row is not base), None)
    if other is None or base not in order:
        return None
    success, error = differences(other, base, family_of(rows))
    parts = [f"its error is {_metres(error.value)}, {error.doubt}"]
    if success.value.mean:
        points = success.value.percent
        parts.insert(0, f"{_points(points)} of runs localized to the end, {success.doubt}")
    return f"{other.localizer} against {base.localizer}: {'; '.join(parts)}."


def differences(row: Row, base: Row, family: int) -> tuple[Difference, Difference]:
    """Return the differences of runs localized to the end, and of their median errors in m.

    Args:
        row: a localizer.
        base: what it is compared with.
        family: number of tests, by which Bonferroni's correction divides 0.05.
    """
    ours, theirs = (_by_seed(one, _SUCCESS) for one in (row, base))
    won = np.array([ours[seed] - theirs[seed] for seed in ours if seed in theirs])
    ours, theirs = (_by_seed(one, "position_median") for one in (row, base))
    apart = np.array([ours[seed] - theirs[seed] for seed in ours if seed in theirs])
    alpha = ALPHA / family
    return (
        _difference(won, sign_estimate(won, alpha), sign_test(won), family),
        _difference(apart, signed_rank_estimate(apart, alpha), wilcoxon(apart), family),
    )


def family_of(rows: Sequence[Row]) -> int:
    """How many tests there are: two for each localizer beside the first."""
    return max(1, 2 * (len(rows) - 1))


def differences_table(rows: Sequence[Row]) -> Table | None:
    """Every localizer against the first-named one; None if there is nothing to compare."""
    base = rows[0]
    if len(rows) < 2 or not ranked(rows) or not base.played:
        return None
    lines = []
    for row in rows[1:]:
        success, error = differences(row, base, family_of(rows))
        cells = [
            _points(success.value.percent),
            success.doubt,
            _metres(error.value),
            error.doubt,
        ]
        lines.append([row.localizer, str(error.runs), *cells])
    caption = (
        f"Against {base.localizer}, over runs of the same seed. p and intervals are corrected for "
        f"{family_of(rows)} tests (Bonferroni), and agree: an interval excludes 0 where p is below "
        f"{ALPHA:g}. They tell what other seeds would give on this log, not what other logs would."
    )
    header = ["localizer", "pairs", "localized to the end", "confirmed?", "position error"]
    return Table(caption, [*header, "confirmed?"], lines)


def _difference(apart: Floats, value: Estimate, p: float, family: int) -> Difference:
    mean, sd = (abs(float(apart.mean())), sample_sd(apart)) if apart.size else (0.0, math.nan)
    known = mean > 0 and not math.isnan(sd)
    return Difference(
        value=value,
        p=min(1.0, family * p),
        runs=apart.size,
        needed=worlds_to_see(mean, sd, family) if known else math.nan,
    )


def _by_seed(row: Row, name: str) -> dict[int, float]:
    """Return a score of each run by seed; a run that failed is no success, its error unknown."""
    found = {one.run.seed: one.scores[name] for one in row.played}
    if name == _SUCCESS:
        found |= dict.fromkeys(row.failed_seeds, 0.0)
    return {seed: value for seed, value in found.items() if not math.isnan(value)}


def _success(row: Row) -> float:
    share = row.scores[_SUCCESS]
    return 0.0 if math.isnan(share) else share


def _reached(row: Row) -> str:
    scores = row.scores
    done = f"{round(_success(row) * row.seeds)} of {row.seeds} runs"
    within = f"{100 * scores[f'within_{FOUND}']:.0f} % of records within 1 m and 30°"
    return (
        f"localized to the end in {done}, {within}, position error "
        f"{scores['position_median']:.3f} m (median)"
    )


def _points(value: Estimate) -> str:
    return f"{value.mean:+.0f} points".replace("-", "−") + _ends(value, "+.0f")


def _metres(value: Estimate) -> str:
    if math.isnan(value.mean):
        return "n/a"
    size = f"{significant(abs(value.mean), 2)} m {'larger' if value.mean > 0 else 'smaller'}"
    return size + _ends(value, "+.3f", " m")


def _ends(value: Estimate, form: str, unit: str = "") -> str:
    return "" if math.isnan(value.low) else f" ({interval(value, form)}{unit})"


def tables_of(rows: Sequence[Row], referenced: bool) -> list[Table]:
    """Return the results, what they differ in, and the beliefs; without a reference the first."""
    if not referenced:
        return [results_table(rows, referenced)]
    found = results_table(rows, referenced), differences_table(rows), belief_table(rows)
    return [table for table in found if table is not None]
