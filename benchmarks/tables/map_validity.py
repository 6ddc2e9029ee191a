"""Lost, or the map is wrong here? AUROC of what is seen at the best cluster against what is true.

Signals: see ``trials.map_signals``; and ``trusted``, of a method that doubts its plan. Of each the
AUROC is that of its natural order: a small ``quality``, a large share ``short``; below ½ it says
the opposite.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.tables.auroc import Auroc, Steps, auroc_of_steps
from benchmarks.tables.pairing import worlds_of
from benchmarks.tables.panels import Panel
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Method
from deqmcl_gym.numerics.types import Floats

WRONG = 0.1  # of the returns: if more contradict the map at the true pose, it is wrong here
QUESTIONS = {
    "lost": "lost, against all other steps",
    "wrong": "the map is wrong here, against all other steps",
    "wrong_localized": "the map is wrong here, of localized steps",
    "which": "lost, against steps that are localized where the map is wrong",
}
_RISING = ("short", "long", "repeated", "elsewhere")  # signals that are large in trouble


@dataclass(frozen=True, kw_only=True)
class ToldApart:
    """How well each signal answers each question, for one method on one setting.

    Attributes:
        panel: of the setting.
        method: what it is.
        answers: AUROC by question and signal.
    """

    panel: Panel
    method: Method
    answers: Mapping[str, Mapping[str, Auroc]]


def told_apart(panels: Iterable[Panel]) -> list[ToldApart]:
    """Return a row for each panel and method whose worlds differ from the map."""
    return [
        ToldApart(panel=panel, method=method, answers=_answers(own))
        for panel in panels
        for method, records in panel.records.items()
        if (own := [record for record in records if record.against_map])
    ]


def _answers(records: Sequence[Finished]) -> dict[str, dict[str, Auroc]]:
    worlds = [[_columns(record) for record in own] for own in worlds_of(records)]
    signals = [name for name in worlds[0][0] if name not in ("off", "wrong")]
    return {
        question: {
            name: auroc_of_steps([_steps(own, question, name) for own in worlds])
            for name in signals
        }
        for question in QUESTIONS
    }


def _columns(record: Finished) -> dict[str, Floats]:
    """What is true and the signals of a trial by name, (T,) each; NaN where there is none."""
    columns = dict(record.against_map or {})
    trusted = (record.plan or {}).get("trusted", [])
    if any(value is not None for value in trusted):
        columns["trusted"] = trusted
    return {name: np.array(values, np.float64) for name, values in columns.items()}


def _steps(runs: Sequence[Mapping[str, Floats]], question: str, name: str) -> Steps:
    """A signal and whether the answer is yes, of the steps of a world that have both."""
    off, wrong, values = (
        np.concatenate([run[key] for run in runs]) for key in ("off", "wrong", name)
    )
    known = ~np.isnan(values) & ~np.isnan(wrong) & ~np.isnan(off)
    if question == "which":
        known &= (off > 0) | (wrong > WRONG)
    if question == "wrong_localized":
        known &= off == 0
    yes = wrong > WRONG if question.startswith("wrong") else off > 0
    return (-values if name in _RISING else values)[known], yes[known]
