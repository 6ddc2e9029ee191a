"""Is the plan still about this robot? AUROC of what the filter sees against what is true.

A plan conflicts if, laid from the true pose, it would collide. Steps of all the scenarios of one
setting are taken together: the filter does not know who made the plan.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.tables.auroc import Auroc, Steps, auroc_of_steps
from benchmarks.tables.pairing import worlds_of
from benchmarks.tables.panels import Panel
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Method
from deqmcl_gym.numerics.types import Floats

RECENT = 20  # steps over which log-evidence is averaged, too


@dataclass(frozen=True, kw_only=True)
class Validity:
    """How well each signal tells conflicting plans from others, of one method on one setting.

    Attributes:
        panels: whose steps are taken together; they differ in nothing but the scenario.
        label, method: what the method is called there, and what it is.
        signals: AUROC by signal; a conflicting step has the smaller value.
    """

    panels: Sequence[Panel]
    label: str
    method: Method
    signals: Mapping[str, Auroc]


def validities(panels: Iterable[Panel]) -> list[Validity]:
    """Return a row for each group of panels and method that reads plans."""
    groups: dict[object, list[Panel]] = {}
    for panel in panels:
        groups.setdefault((replace(panel.setting, scenario=""), panel.swept), []).append(panel)
    rows = []
    for group in groups.values():
        for method in dict.fromkeys(method for panel in group for method in panel.records):
            own = [r for panel in group for r in panel.records.get(method, []) if r.plan]
            if own:
                label = next(p.labels[method] for p in group if method in p.labels)
                rows.append(_validity(group, label, method, own))
    return rows


def _validity(
    group: Sequence[Panel], label: str, method: Method, records: Sequence[Finished]
) -> Validity:
    worlds = [[_columns(record) for record in own] for own in worlds_of(records)]
    names = [name for name in worlds[0][0] if name != "conflict"]
    signals = {name: auroc_of_steps([_steps(own, name) for own in worlds]) for name in names}
    told = signals.pop("trusted", None)
    if told is not None and told.far_worlds is not None:  # else of a method that doubts no plan
        laps = auroc_of_steps([_laps(own) for own in worlds])
        signals |= {"trusted": told, "trusted_lap": laps}
    return Validity(panels=group, label=label, method=method, signals=signals)


def _columns(record: Finished) -> dict[str, Floats]:
    """The signals of a trial by name, (T,) each; NaN where there is none."""
    plan = record.plan or {}
    columns = {name: np.array(values, np.float64) for name, values in plan.items()}
    evidence = np.nan_to_num(columns["log_evidence"])
    total = np.concatenate(([0.0], np.cumsum(evidence)))
    last = np.arange(1, evidence.size + 1)
    first = np.maximum(last - RECENT, 0)
    columns[f"log_evidence_{RECENT}"] = (total[last] - total[first]) / (last - first)
    if record.quality is not None:
        columns["quality"] = np.array(record.quality, np.float64)
    return columns


def _steps(runs: Sequence[Mapping[str, Floats]], name: str) -> Steps:
    """A signal and whether the plan conflicts, of the steps of a world that have both."""
    values, conflicts = (np.concatenate([run[key] for run in runs]) for key in (name, "conflict"))
    known = ~np.isnan(values) & ~np.isnan(conflicts)
    return values[known], conflicts[known] > 0


def _laps(runs: Sequence[Mapping[str, Floats]]) -> Steps:
    """The lowest trust of each lap of a world, and whether its plan ever conflicts."""
    laps = [_steps([run], "trusted") for run in runs]
    ends = [(trusted.min(), conflict.any()) for trusted, conflict in laps if trusted.size]
    trusted, conflict = zip(*ends, strict=True) if ends else ((), ())
    return np.array(trusted), np.array(conflict, bool)
