"""The CSV files of a report: exact numbers; named parts are JSON."""

import json
from collections.abc import Iterable
from dataclasses import fields
from typing import Any

from benchmarks.tables.comparison import AVERAGED, RANGED
from benchmarks.tables.journeys import scores_in, value_in
from benchmarks.tables.map_validity import ToldApart
from benchmarks.tables.panels import Panel
from benchmarks.tables.plan_validity import Validity
from benchmarks.tables.text import csv_text
from benchmarks.trials.scores import Score
from benchmarks.trials.scoring import SCORE_NAMES, Finished
from benchmarks.trials.spec import Method, Setting, Trial

_SETTING = tuple(field.name for field in fields(Setting))
_METHOD = ("method", "params")
_PANEL = (*_SETTING, "swept", *_METHOD)
_RUN = (*_SETTING, *_METHOD, "trial", "filter_seed")


def results_csv(panels: Iterable[Panel]) -> str:
    """Return results.csv: a line per panel, method and offset; nothing of the machine."""
    listed = list(panels)
    columns = dict(_COLUMNS)
    for score in scores_in(record for p in listed for own in p.records.values() for record in own):
        columns |= _of_journey(score)
    lines = (
        [*_panel(panel), *_method(row.method), *(_at(row, path) for path in columns.values())]
        for panel in listed
        for row in panel.rows
    )
    return csv_text([*_PANEL, *columns], lines)


def decisions_csv(panels: Iterable[Panel]) -> str:
    """Return decisions.csv: a line per panel, method and look at them; shares of 1, not percent."""
    lines = (
        [
            *(*_panel(panel), *_method(row.method), *_method(row.baseline)),
            *(
                row.aim.name if row.aim else "error",
                panel.rule.margin,
                interim.worlds,
                *interim.interval,
            ),
            row.decision.relation if interim is row.decision.interims[-1] else "",
        ]
        for panel in panels
        for row in panel.present
        if panel.rule is not None and row.decision is not None
        for interim in row.decision.interims
    )
    found = ("score", "margin", "worlds", "difference", "low", "high", "verdict")
    return csv_text([*_PANEL, "baseline", "baseline_params", *found], lines)


def gaps_csv(panels: Iterable[Panel]) -> str:
    """Return gaps.csv: a line per panel, method and offset."""
    plain = ("offset", "worlds", "error", "seed_sd")
    lines = (
        [
            *(*_panel(panel), *_method(row.method), *_method(row.limit)),
            *(*(getattr(row, name) for name in plain), *row.gap),
        ]
        for panel in panels
        for row in panel.gaps
    )
    return csv_text([*_PANEL, "limit", "limit_params", *plain, "gap", "gap_low", "gap_high"], lines)


def plans_csv(rows: Iterable[Validity]) -> str:
    """Return plans.csv: a line per setting, method and signal; scenarios taken together."""
    lines = (
        [
            " ".join(panel.setting.scenario for panel in row.panels),
            *_panel(row.panels[0])[1:],
            *_method(row.method),
            *(signal, *found.auroc, found.far_steps, found.far_worlds),
        ]
        for row in rows
        for signal, found in row.signals.items()
    )
    found = ("auroc", "auroc_low", "auroc_high", "conflict_steps", "conflict_worlds")
    return csv_text(["scenarios", *_PANEL[1:], "signal", *found], lines)


def maps_csv(rows: Iterable[ToldApart]) -> str:
    """Return maps.csv: a line per setting, method, question and signal."""
    lines = (
        [
            *(*_panel(row.panel), *_method(row.method), question, signal),
            *(*found.auroc, found.far_steps, found.far_worlds),
        ]
        for row in rows
        for question, signals in row.answers.items()
        for signal, found in signals.items()
    )
    found = ("auroc", "auroc_low", "auroc_high", "steps", "worlds")
    return csv_text([*_PANEL, "question", "signal", *found], lines)


def trials_csv(records: Iterable[Finished]) -> str:
    """Return trials.csv: a line per trial, method and offset; scores of whole runs at offset 0."""
    listed = list(records)
    whole = scores_in(listed)
    trouble = ("weight_collapses", "replanned_steps", "infeasible_plans")
    counts = (*trouble, "skipped_beams", "blind_scans")
    lines = (
        [
            *_run(record.trial),
            *(score.get(name) for name in ("offset", *SCORE_NAMES)),
            *(record.steps_done, record.scans_used),
            *(record.events.get(name) for name in counts),
            *(None if score["offset"] else value_in(record, journey) for journey in whole),
        ]
        for record in listed
        for score in record.scores
    )
    header = [*_RUN, "offset", *SCORE_NAMES, "steps_done", "scans_used", *counts]
    return csv_text([*header, *(journey.name for journey in whole)], lines)


def timings_csv(records: Iterable[Finished]) -> str:
    """Return timings.csv: the localizer's own time, reset left out."""
    lines = (
        [
            *_run(record.trial),
            record.seconds,
            1000 * record.seconds / record.steps_done if record.seconds else None,
        ]
        for record in records
    )
    return csv_text([*_RUN, "seconds", "ms_per_step"], lines)


def _panel(panel: Panel) -> list[Any]:
    return [*_setting(panel.setting), _json(panel.swept.json())]


def _setting(setting: Setting) -> list[Any]:
    wrappers = [wrapper.json() for wrapper in setting.disturbance]
    changes = map(_json, (setting.world.json(), setting.assumed.json(), wrappers))
    return [setting.scenario, *changes, setting.lag, setting.seed]


def _method(method: Method) -> list[str]:
    agent = {"agent": method.agent.name} if method.agent else {}
    return [method.name, _json(agent | method.values.json())]


def _run(trial: Trial) -> list[Any]:
    return [*_setting(trial.setting), *_method(trial.method), *trial.run]


def _json(value: Any) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def _at(value: Any, path: str) -> Any:
    """Return what a dotted path of attributes and keys leads to; None: there is no such key."""
    for part in path.split("."):
        if value is not None:
            value = value.get(part) if isinstance(value, dict) else getattr(value, part)
    return value


def _ends(name: str, path: str, mean: str = "") -> dict[str, str]:
    """Where the columns of an estimate are to be read."""
    columns = {mean or name: "mean", f"{name}_low": "low", f"{name}_high": "high"}
    return {column: f"{path}.{end}" for column, end in columns.items()}


def _of_journey(score: Score) -> dict[str, str]:
    """Columns of a score of whole runs: its value, and the comparison if methods are compared."""
    name, at = score.name, f"journey.{score.name}"
    columns = _ends(name, f"{at}.value")
    if score.censored:
        columns[f"{name}_restricted"] = f"{at}.restricted"
    if score.tested:
        columns |= _ends(f"{name}_diff", f"{at}.diff")
        columns |= {f"{name}_{test}": f"{at}.{test}" for test in ("p", "p_holm")}
    return columns


_COLUMNS = {  # where they are to be read in a ``Comparison``
    **{name: name for name in ("offset", "worlds", "runs")},
    **_ends("error", "error"),
    "error_sd": "error_sd",
    **{name: f"scores.{name}.mean" for name in AVERAGED},
    **_ends("lost", "lost", "lost_rate"),
    "baseline": "baseline.reference",
    "paired_worlds": "paired_worlds",
    **_ends("diff", "diff"),
    **{name: name for name in ("win_rate", "p", "p_holm")},
    **_ends("auroc", "detection.auroc"),
    "far_steps": "detection.far_steps",
    "far_worlds": "detection.far_worlds",
    **{f"{name}_{end}": f"scores.{name}.{end}" for name in RANGED for end in ("low", "high")},
    "diff_sd": "diff_sd",
    **_ends("relative", "relative"),
}
