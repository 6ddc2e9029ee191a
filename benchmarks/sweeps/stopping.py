"""Which trials a sweep needs that stops a method when its comparison is decided."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TypeVar

from benchmarks.sweeps.design import Sweep
from benchmarks.tables.deciding import FIRST, Rule, decide
from benchmarks.tables.frames import by_method, cell, scores_of_rows, trials_frame
from benchmarks.tables.panels import MethodGroup, aim_of, groups
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Method, Setting, Trial
from deqmcl_gym.validation import InputError

K = TypeVar("K")


def rule_of(sweep: Sweep) -> Rule | None:
    """Return when comparisons of a sweep are decided; None if it runs all its worlds."""
    if sweep.until_decided is None:
        return None
    family = sum(len(group.pairs(sweep.baseline)) for group in _groups(sweep))
    if family == 0:
        raise InputError(
            "--until-decided has nothing to decide, as no method has a baseline to be compared "
            "with: name a second localizer, or leave it out."
        )
    if sweep.trials < FIRST:
        raise InputError(
            f"--max-worlds is {sweep.trials}, but nothing is decided before {FIRST} worlds: give "
            f"{FIRST} or more."
        )
    return Rule(margin=sweep.until_decided.margin, family=family, worlds=sweep.trials)


def due(
    sweep: Sweep, trials: Mapping[K, Trial], records: Iterable[Finished], failures: Iterable[Trial]
) -> dict[K, Trial]:
    """Return those of a sweep's trials that it needs, as far as its results tell; all without rule.

    A method needs the worlds up to its decision, or to its next look; a baseline those of all that
    are compared with it; a limit all of its own. It depends on nothing but the results.
    """
    rule = rule_of(sweep)
    if rule is None:
        return dict(trials)
    cells = by_method(trials_frame(records, failures))
    worlds: dict[tuple[Setting, Method], int] = {}
    for group in _groups(sweep):
        rows = {method: cell(cells, group.setting, method) for method in group.methods}
        aim = aim_of(score for own in rows.values() for score in scores_of_rows(own))
        wanted = dict.fromkeys(group.methods, FIRST)
        for pair in group.pairs(sweep.baseline):
            ours, baseline = (rows[method] for method in pair)
            needed = decide(ours, baseline, aim, rule).wanted
            wanted |= {method: max(needed, wanted[method]) for method in pair}
        for method, needed in wanted.items():
            own = group.setting, method
            worlds[own] = max(needed, worlds.get(own, 0))
    limits = {trial for limit in sweep.limits for trial in sweep.limiting(limit)}
    return {
        key: trial
        for key, trial in trials.items()
        if trial.trial < worlds.get((trial.setting, trial.method), 0) or trial in limits
    }


def _groups(sweep: Sweep) -> list[MethodGroup]:
    cells = replace(sweep, limits=()).cells()
    return groups((first.setting, first.method) for first in cells)
