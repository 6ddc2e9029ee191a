"""Every method of a panel against the panel's baseline, over paired worlds."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from benchmarks.tables import pairing, stats
from benchmarks.tables.auroc import Auroc, auroc_of
from benchmarks.tables.deciding import Decision, Rule, decide
from benchmarks.tables.journeys import JourneyScore, Outcomes, aim_of
from benchmarks.tables.pairing import Runs
from benchmarks.tables.stats import UNKNOWN, Estimate
from benchmarks.trials.scores import Score
from benchmarks.trials.scoring import SCORE_NAMES, Finished
from benchmarks.trials.spec import Method

AVERAGED = tuple(name for name in SCORE_NAMES if name not in ("error", "lost"))
RANGED = ("coverage_50", "coverage_80", "coverage_95", "nees")  # scores with an interval


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One method of a panel at one offset; NaN is not available.

    Attributes:
        method, offset: of what.
        worlds, runs: on how much; the runs on a world are averaged first.
        errors: e of each world.
        error, error_sd: mean over worlds of e with its 95 % bootstrap interval, and its SD.
        scores: the other scores by name; those of ``RANGED`` with an interval.
        lost: share of lost runs, with Wilson's 95 % interval for as many cases as worlds.
        detection: how well its quality tells that it is far off; only at offset 0.
        milliseconds: median of its own time per step.
        baseline: what it is compared with, at offset 0.
        cost: its time per step over the baseline's.
        paired_worlds: worlds that both have run.
        diff, diff_sd: mean over worlds of error - the baseline's, 95 % bootstrap, and its SD.
        relative: the same mean as a share of the baseline's, both on the shared worlds.
        win_rate: share of worlds where its error is the smaller one.
        p, p_holm: Wilcoxon's signed-rank test of the differences, alone and corrected for all
            tests of the panel at this offset.
        journey: scores of whole runs by name, if the panel's are about such; only at offset 0.
        aim: the share of whole runs that the panel is about; None if it is about the error.
        decision: how it stands, if the sweep stops when that is decided; its interval is the only
            one of the comparison then, and there are no tests.
        expected: then the error (or share) to be expected on all worlds of the baseline, by which
            it is ranked, as methods have run on different worlds; NaN elsewhere.
    """

    method: Method
    offset: int
    worlds: int
    runs: int
    errors: dict[int, float]
    error: Estimate
    error_sd: float
    scores: dict[str, Estimate]
    lost: Estimate
    detection: Auroc
    milliseconds: float
    baseline: Method
    cost: float
    paired_worlds: int = 0
    diff: Estimate = UNKNOWN
    diff_sd: float = math.nan
    relative: Estimate = UNKNOWN
    win_rate: float = math.nan
    p: float = math.nan
    p_holm: float = math.nan
    journey: dict[str, JourneyScore] = field(default_factory=dict)
    aim: Score | None = None
    decision: Decision | None = None
    expected: float = math.nan

    @property
    def is_baseline(self) -> bool:
        """Whether it is the baseline at x_t, which is compared with nothing."""
        return self.method == self.baseline and self.offset == 0

    @property
    def wins(self) -> float:
        """Worlds where its error is the smaller one, ties counted half."""
        return self.win_rate * self.paired_worlds

    @cached_property
    def standing(self) -> JourneyScore:
        """What it is ranked by, the error or the aim, beside its baseline's."""
        if self.aim is None:
            return JourneyScore(value=self.error, diff=self.diff, p=self.p, p_holm=self.p_holm)
        return self.journey.get(self.aim.name, JourneyScore(value=UNKNOWN))

    @property
    def worse(self) -> float:
        """The error, or 1 less the share that is the aim; infinite if it is unknown."""
        mean = self.standing.value.mean if math.isnan(self.expected) else self.expected
        if math.isnan(mean):
            return math.inf
        return mean if self.aim is None else 1 - mean

    @property
    def differs(self) -> bool:
        """Whether it is better or worse than its baseline: by the interval and the corrected test.

        Where a sweep stops when that is decided: by the decision.
        """
        if self.decision is not None:
            return self.decision.relation in ("better", "worse")
        return self.standing.significant

    @property
    def confirmed(self) -> bool:
        """Whether it is better than its baseline, and that differs."""
        return self.differs and (self.standing.diff.mean < 0) == (self.aim is None)


def compared(
    methods: Mapping[Method, Sequence[Finished]],
    baseline: str,
    whole: Mapping[Method, Outcomes],
    rule: Rule | None = None,
) -> list[Comparison]:
    """Compare the methods of a panel: by method, then offset, in the order of their trials.

    Holm's family is what the panel tests at one offset.

    Args:
        methods: their finished trials.
        baseline: localizer or agent that the others are compared with.
        whole: their whole runs, with those that failed.
        rule: when comparisons are decided; None: all worlds are run, whatever they show.
    """
    times = {method: pairing.milliseconds_per_step(records) for method, records in methods.items()}
    rows = []
    for method, records in methods.items():
        reference = baseline_of(method, methods, baseline)
        present = pairing.runs_of(methods[reference], "error")
        for offset in dict.fromkeys(k for record in records for k in record.offsets):
            errors = pairing.runs_of(records, "error", offset)
            lost = float(pairing.over_worlds(pairing.runs_of(records, "lost", offset)).mean())
            worlds = pairing.by_world(errors)
            row = Comparison(
                method=method,
                offset=offset,
                worlds=len(worlds),
                runs=len(errors),
                errors=worlds,
                error=stats.estimate(pairing.over_worlds(errors)),
                error_sd=stats.sample_sd(pairing.over_worlds(errors)),
                scores={name: _score(records, name, offset) for name in AVERAGED},
                lost=Estimate(lost, *stats.wilson(lost, len(worlds))),
                detection=Auroc() if offset else auroc_of(records),
                milliseconds=times[method],
                baseline=reference,
                cost=times[method] / times[reference] if times[reference] > 0 else math.nan,
                journey={} if offset else whole[method].beside(whole[reference]),
            )
            rows.append(row if row.is_baseline else _against(row, errors, present))
    rows = _corrected(rows, aim_of(record for own in methods.values() for record in own))
    if rule is None:
        return rows
    bases = {row.method: row for row in rows if row.is_baseline}
    return [
        row if row.is_baseline else _decided(row, bases[row.baseline], whole, rule) for row in rows
    ]


def baseline_of(method: Method, methods: Iterable[Method], name: str) -> Method:
    """Return what a method is compared with: the localizer or the agent of that name.

    A localizer with the same agent, an agent with the same localizer; else the first method. Of
    several variants it is the one whose parameters agree with the method's, else the first.
    """
    listed = list(methods)
    variants = [other for other in listed if other.is_named(name)] or listed[:1]
    if variants[0].name == name:
        same = [one for one in variants if one.agent == method.agent]
    else:
        same = [one for one in variants if one.name == method.name]
    variants = same or variants
    return next((one for one in variants if pairing.agree(one.values, method.values)), variants[0])


def _score(records: Sequence[Finished], name: str, offset: int) -> Estimate:
    values = pairing.over_worlds(pairing.runs_of(records, name, offset))
    return stats.estimate(values) if name in RANGED else Estimate(float(values.mean()))


def _against(row: Comparison, errors: Runs, baseline: Runs) -> Comparison:
    apart = pairing.differences(errors, baseline)
    return replace(
        row,
        paired_worlds=apart.size,
        diff=stats.estimate(apart),
        diff_sd=stats.sample_sd(apart),
        relative=stats.relative_change(apart, pairing.shared(errors, baseline)),
        win_rate=stats.win_rate(apart),
        p=_six_digits(stats.wilcoxon(apart)),
    )


def _corrected(rows: list[Comparison], aim: Score | None) -> list[Comparison]:
    """Correct all tests of the panel at one offset together, by Holm's method; set their aim."""
    corrected = list(rows)
    for offset in {row.offset for row in rows}:
        places = [i for i, row in enumerate(rows) if row.offset == offset]
        tests = {(i, ""): rows[i].p for i in places}
        tests |= {(i, name): own.p for i in places for name, own in rows[i].journey.items()}
        adjusted = dict(zip(tests, map(_six_digits, stats.holm([*tests.values()])), strict=True))
        for i in places:
            journey = {
                name: replace(own, p=_six_digits(own.p), p_holm=adjusted[i, name])
                for name, own in rows[i].journey.items()
            }
            corrected[i] = replace(rows[i], p_holm=adjusted[i, ""], journey=journey, aim=aim)
    return corrected


def _decided(
    row: Comparison, base: Comparison, whole: Mapping[Method, Outcomes], rule: Rule
) -> Comparison:
    """Return a row with its decision, and without what only a fixed number of worlds allows."""
    journey = {
        name: replace(own, diff=Estimate(own.diff.mean), p=math.nan, p_holm=math.nan)
        for name, own in row.journey.items()
    }
    row = replace(
        row,
        diff=Estimate(row.diff.mean),
        relative=Estimate(row.relative.mean),
        p=math.nan,
        p_holm=math.nan,
        journey=journey,
    )
    if row.offset != 0:
        return row
    found = decide(whole[row.method], whole[row.baseline], row.aim, rule)
    reference, apart = base.standing.value.mean, found.interval.mean
    expected = reference * (1 + apart) if row.aim is None else reference + apart
    return replace(row, decision=found, expected=expected)


def _six_digits(p: float) -> float:
    """As many as do not depend on how the system computes erfc."""
    return p if math.isnan(p) else float(f"{p:.6g}")
