"""Does a number that a localizer has detect trouble? The area under the ROC curve (AUROC).

That is P(value of a step in trouble < value of another) + ½ P(equal), over all steps of all worlds
(Fawcett 2006, section 7; the statistic of Mann & Whitney 1947); intervals are over worlds. Trouble
is that the belief is far off, the plan would collide from the true pose, or the map is wrong here.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.tables.frames import PANEL, ends
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import NOT_KNOWN, QUANTILES, Interval, multiplicities
from benchmarks.trials.scoring import Finished
from deqmcl_gym.numerics import Bools, Floats, Indices

RECENT = 20  # steps over which log-evidence is averaged, too
WRONG = 0.1  # of the returns: if more contradict the map at the true pose, it is wrong here
QUESTIONS = ("lost", "wrong", "wrong_localized", "which")  # docs/reports.md says of which steps
_PLANS = (
    "scenarios", *PANEL[1:], "signal", *ends("auroc"), "conflict_steps", "conflict_worlds",
)  # fmt: skip
_MAPS = (*PANEL, "question", "signal", *ends("auroc"), "steps", "worlds")
_RISING = ("short", "long", "repeated", "elsewhere")  # signals that are large in trouble


@dataclass(frozen=True, kw_only=True)
class Auroc:
    """AUROC of a number against whether a step is in trouble; NaN is not available."""

    auroc: Interval = NOT_KNOWN  # with its interval over worlds
    far_steps: float = math.nan  # share of steps in trouble, of those that have the number
    far_worlds: float = math.nan  # worlds with such a step; NaN if no step has the number

    def columns(self, steps: str, worlds: str) -> dict[str, Any]:
        """Return it as the columns of a row."""
        return ends("auroc", self.auroc) | {steps: self.far_steps, worlds: self.far_worlds}


def auroc(values: Floats, trouble: Bools, world: Indices, worlds: int) -> Auroc:
    """Return how well a number ranks steps; those in trouble should have the smaller ones.

    The interval is the 95 % percentile bootstrap over worlds: 10,000 resamples with a fixed seed;
    one without a step in trouble, or with nothing else, has no AUROC and is left out. NaN unless
    two worlds or more have steps in trouble, and two or more have others. Arrays are (N,), worlds
    numbered from 0.
    """
    if not values.size:
        return Auroc()
    far, others = (np.bincount(world[trouble == one], minlength=worlds) for one in (True, False))
    wins = pairs_in_order(values, trouble, world, worlds)
    pairs = far.sum() * others.sum()
    found = Interval(float(wins.sum() / pairs) if pairs else math.nan)
    if min((far > 0).sum(), (others > 0).sum()) >= 2:
        drawn = multiplicities(worlds)
        each = (drawn @ far) * (drawn @ others)  # pairs of each resample
        # sums of halves below 2⁵³: exact, in whatever order they are added
        resampled = ((drawn @ wins) * drawn).sum(axis=1)[each > 0] / each[each > 0]
        found = Interval(found.mean, *map(float, np.quantile(resampled, QUANTILES)))
    return Auroc(auroc=found, far_steps=float(trouble.mean()), far_worlds=float((far > 0).sum()))


def pairs_in_order(values: Floats, trouble: Bools, world: Indices, worlds: int) -> Floats:
    """Count pairs of a step in trouble of world i below another of j, equal ones half, (W, W)."""
    wins = np.zeros((worlds, worlds))
    for j in range(worlds):
        others = np.sort(values[~trouble & (world == j)])
        far = values[trouble]
        below = np.searchsorted(others, far, "left") + np.searchsorted(others, far, "right")
        wins[:, j] = np.bincount(world[trouble], others.size - below / 2, worlds)
    return wins


def detection(records: Iterable[Finished]) -> Auroc:
    """Return how well one method's quality tells at steps t ≥ 1 that e is far off."""
    return _auroc(_steps(records, _rated), "quality")


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
        for method in dict.fromkeys(method for panel in group for method in panel.labels):
            label = next(panel.labels[method] for panel in group if method in panel.labels)
            shared = group[0].columns(method) | {"scenarios": scenarios, "label": label}
            own = [r for panel in group for r in panel.records.get(method, []) if r.plan]
            rows += (
                shared | {"signal": signal} | found.columns("conflict_steps", "conflict_worlds")
                for signal, found in _of_plans(own).items()
            )
    return pd.DataFrame(rows, columns=[*_PLANS, "panel", "label"])


def maps_table(panels: Iterable[Panel]) -> pd.DataFrame:
    """Return a row per panel, method, question and signal: maps.csv, panel and label.

    Lost, or is the map wrong here? Of trials whose world differs from the map. Signals are those of
    ``trials.map_signals``, and ``trusted``, of a method that doubts its plan. The AUROC is that of
    the natural order (small ``quality``, large ``short``); below ½ it says the opposite.
    """
    rows = [
        panel.columns(method)
        | {"question": question, "signal": signal}
        | found.columns("steps", "worlds")
        for panel in panels
        for method, records in panel.records.items()
        for (question, signal), found in _of_maps([r for r in records if r.against_map]).items()
    ]
    return pd.DataFrame(rows, columns=[*_MAPS, "panel", "label"])


def _of_plans(records: list[Finished]) -> dict[str, Auroc]:
    """Return AUROC by signal; the trust of a lap is the lowest of its steps."""
    steps = _steps(records, _plan)
    signals = {name: _auroc(steps, name) for name in _signals(steps) if name != "trusted"}
    if "trusted" in steps and steps["trusted"].notna().any():  # else of one that doubts no plan
        known = steps.dropna(subset=["trusted", "trouble"])
        laps = known.groupby(["world", "run"], as_index=False)[["trusted", "trouble"]]
        least = laps.agg({"trusted": "min", "trouble": "max"})
        signals["trusted"] = _auroc(steps, "trusted")
        signals["trusted_lap"] = _auroc(least, "trusted", int(steps["world"].max()) + 1)
    return signals


def _of_maps(records: list[Finished]) -> dict[tuple[str, str], Auroc]:
    """Return AUROC by question and signal."""
    steps = _steps(records, _map)
    if steps.empty:
        return {}
    lost, wrong, there = steps["off"] > 0, steps["wrong"] > WRONG, steps["wrong"].notna()
    trouble = {"lost": lost, "wrong": wrong, "wrong_localized": wrong, "which": lost}
    asked = {"wrong_localized": steps["off"] == 0, "which": lost | wrong}
    unknown = ~there | steps["off"].isna()
    signals, worlds = _signals(steps), int(steps["world"].max()) + 1
    steps = steps.assign(**{name: -steps[name] for name in _RISING})
    return {
        (question, name): _auroc(
            steps.assign(trouble=told)[asked.get(question, there)], name, worlds
        )
        for question in QUESTIONS
        for told in [trouble[question].astype(float).mask(unknown)]
        for name in signals
    }


_STEP = ("world", "run", "trouble", "off", "wrong")  # columns of a step beside the signals


def _signals(steps: pd.DataFrame) -> list[str]:
    return [str(name) for name in steps if name not in _STEP]


def _steps(
    records: Iterable[Finished], columns: Callable[[Finished], Mapping[str, Any]]
) -> pd.DataFrame:
    """Return the steps t ≥ 1 of trials as rows, with the numbers of their worlds from 0."""
    listed = list(records)
    worlds = {world: i for i, world in enumerate(sorted({one.trial.trial for one in listed}))}
    runs = [
        pd.DataFrame({name: np.array(values, np.float64) for name, values in columns(one).items()})
        .assign(world=worlds[one.trial.trial], run=run)
        for run, one in enumerate(listed)
    ]  # fmt: skip
    return pd.concat(runs, ignore_index=True) if runs else pd.DataFrame(columns=[*_STEP])


def _auroc(steps: pd.DataFrame, name: str, worlds: int | None = None) -> Auroc:
    """Return how well a column tells steps in trouble, of those where both are known."""
    known = steps.dropna(subset=[name, "trouble"])
    return auroc(
        known[name].to_numpy(),
        known["trouble"].to_numpy() > 0,
        known["world"].to_numpy(),
        int(steps["world"].max()) + 1 if worlds is None else worlds,
    )


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


def _map(record: Finished) -> dict[str, Any]:
    """What is true and seen of the map at each step."""
    columns: dict[str, Any] = dict(record.against_map or {})
    trusted = (record.plan or {}).get("trusted", [])
    return columns | ({"trusted": trusted} if any(one is not None for one in trusted) else {})
