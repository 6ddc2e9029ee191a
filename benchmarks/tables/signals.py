"""Does a number that a localizer has detect trouble? The area under the ROC curve (AUROC).

That is P(value of a step in trouble < value of another) + ½ P(equal), over all steps of all worlds
(Fawcett 2006, section 7; the statistic of Mann & Whitney 1947); intervals are over worlds. Trouble
is that the belief is far off, or that the plan would collide from the true pose.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.tables.frames import PANEL, ends
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import NOT_KNOWN, QUANTILES, Interval, multiplicities
from benchmarks.trials.scoring import Finished
from deqmcl_gym.numerics import Bools, Floats, Indices

RECENT = 20  # steps over which log-evidence is averaged, too
_CONFLICTS = ("conflict_steps", "conflict_worlds")
_PLANS = ("scenarios", *PANEL[1:], "signal", *ends("auroc"), *_CONFLICTS)
_OTHERS = ("world", "run", "trouble")  # columns of a step beside the signals


def auroc(values: Floats, trouble: Bools, world: Indices, worlds: int) -> Interval:
    """Return how well a number ranks steps; those in trouble should have the smaller ones.

    The interval is the 95 % percentile bootstrap over worlds: 10,000 resamples with a fixed seed;
    one without a step in trouble, or with nothing else, has no AUROC and is left out. NaN unless
    two worlds or more have steps in trouble, and two or more have others. Arrays are (N,), worlds
    numbered from 0.
    """
    far, others = (np.bincount(world[trouble == flag], minlength=worlds) for flag in (True, False))
    wins = np.zeros((worlds, worlds))  # pairs of a step in trouble of world i below another of j
    for j in range(worlds):
        ordered = np.sort(values[~trouble & (world == j)])
        low = values[trouble]
        below = np.searchsorted(ordered, low, "left") + np.searchsorted(ordered, low, "right")
        wins[:, j] = np.bincount(world[trouble], ordered.size - below / 2, worlds)  # equal: half
    pairs = far.sum() * others.sum()
    area = float(wins.sum() / pairs) if pairs else math.nan
    if min((far > 0).sum(), (others > 0).sum()) < 2:
        return Interval(area)
    drawn = multiplicities(worlds)
    each = (drawn @ far) * (drawn @ others)  # pairs of each resample
    # sums of halves below 2⁵³: exact, in whatever order they are added
    resampled = ((drawn @ wins) * drawn).sum(axis=1)[each > 0] / each[each > 0]
    return Interval(area, *map(float, np.quantile(resampled, QUANTILES)))


def detection(records: Iterable[Finished]) -> dict[str, float]:
    """Return how well one method's quality tells at steps t ≥ 1 that e is far off, as columns."""
    return _detected(_steps(records, _rated), "quality", ("far_steps", "far_worlds"))


def plans_table(panels: Iterable[Panel]) -> pd.DataFrame:
    """Return a row per setting, method that reads plans, and signal.

    Is the plan still about this robot? Steps of all the scenarios of one setting are together. The
    columns are those of plans.csv, the number of the first panel, and label.
    """
    groups: dict[object, list[Panel]] = {}
    for panel in panels:
        groups.setdefault((replace(panel.setting, scenario=""), panel.swept), []).append(panel)
    rows = list[dict[str, Any]]()
    for group in groups.values():
        scenarios = " ".join(panel.setting.scenario for panel in group)
        shared = {"scenarios": scenarios, "panel": group[0].number}
        places: dict[object, list[tuple[Panel, str]]] = {}
        for panel in group:
            for label, method in panel.methods.items():
                places.setdefault(method, []).append((panel, label))
        for members in places.values():
            first, name = members[0]
            records = [r for panel, label in members for r in panel.records[label] if r.plan]
            columns = first.columns(name) | shared
            rows += [columns | signal for signal in _of_plans(_steps(records, _plan))]
    return pd.DataFrame(rows, columns=[*_PLANS, "panel", "label"])


def _of_plans(steps: pd.DataFrame) -> list[dict[str, Any]]:
    """Return a row for each signal; the trust of a lap is the lowest of its steps."""
    frames = {str(name): steps for name in steps if name not in (*_OTHERS, "trusted")}
    rows = [{"signal": name} | _detected(steps, name, _CONFLICTS) for name in frames]
    if "trusted" in steps and steps["trusted"].notna().any():  # else of one that doubts no plan
        both = steps[["trusted", "trouble"]]
        laps = both.where(both.notna().all(axis=1)).groupby([steps["world"], steps["run"]])
        least = laps.agg({"trusted": "min", "trouble": "max"}).reset_index("world")
        rows += [
            {"signal": name} | _detected(frame, "trusted", _CONFLICTS)
            for name, frame in (("trusted", steps), ("trusted_lap", least))
        ]
    return rows


def _detected(steps: pd.DataFrame, name: str, columns: tuple[str, str]) -> dict[str, float]:
    """Return how well a column tells steps in trouble, where both are known, as columns."""
    complete = steps.dropna(subset=[name, "trouble"])
    if complete.empty:
        return ends("auroc", NOT_KNOWN) | dict.fromkeys(columns, math.nan)
    trouble, world = complete["trouble"].to_numpy() > 0, complete["world"].to_numpy()
    area = auroc(complete[name].to_numpy(), trouble, world, int(steps["world"].max()) + 1)
    shares = float(trouble.mean()), float(np.unique(world[trouble]).size)
    return ends("auroc", area) | dict(zip(columns, shares, strict=True))


def _steps(
    records: Iterable[Finished], columns: Callable[[Finished], Mapping[str, Any]]
) -> pd.DataFrame:
    """Return the steps t ≥ 1 of trials as rows, with the numbers of their worlds from 0."""
    listed = list(records)
    numbers = sorted({record.trial.trial for record in listed})
    worlds = {world: i for i, world in enumerate(numbers)}
    runs = [
        pd.DataFrame({n: np.array(values, np.float64) for n, values in columns(record).items()})
        .assign(world=worlds[record.trial.trial], run=run)
        for run, record in enumerate(listed)
    ]  # fmt: skip
    return pd.concat(runs, ignore_index=True) if runs else pd.DataFrame(columns=[*_OTHERS])


def _rated(record: Finished) -> dict[str, Any]:
    """The quality, and whether e is far off, at each step."""
    quality, curve = np.full(record.steps_done, math.nan), record.curves[0]
    quality[: len(record.quality or ())] = record.quality or ()  # None is NaN
    errors = np.full(record.steps_done + 1, math.nan)  # of the states 0 … T
    listed = np.array(curve.error, np.float64)[: max(0, errors.size - curve.first_state)]
    errors[curve.first_state : curve.first_state + listed.size] = listed
    far = np.where(np.isnan(errors), math.nan, errors > record.thresholds.far)
    return {"quality": quality, "trouble": far[1:]}


def _plan(record: Finished) -> dict[str, Any]:
    """What was made of the plan, and whether it conflicts, at each step."""
    columns: dict[str, Any] = dict(record.plan or {})
    columns["trouble"] = columns.pop("conflict")
    total = np.cumsum(np.nan_to_num(np.array([0.0, *columns["log_evidence"]], np.float64)))
    last = np.arange(1, total.size)
    first = np.maximum(last - RECENT, 0)
    columns[f"log_evidence_{RECENT}"] = (total[last] - total[first]) / (last - first)
    return columns if record.quality is None else columns | {"quality": record.quality}
