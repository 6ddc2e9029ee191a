"""The runs of localizers on a log: the scores of a localizer, results.csv and trials.csv.

Lengths are in m, angles in rad. Errors are those of best clusters.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import pandas as pd

from benchmarks.tables.frames import csv_of, milliseconds_per_step, value_in
from benchmarks.tables.stats import wilson
from benchmarks.trials.metrics import middle
from benchmarks.trials.scores import JOURNEY_SCORES, TRACK_GROUPS, journey_scores
from benchmarks.trials.scoring import Finished
from benchmarks.trials.tracks import FOUND, NEAR, EstimatedTrack
from deqmcl_gym.logs import Log

RESULTS = (
    "position_median", "position_p95", "heading_median", "position_median_stamps",
    "heading_median_stamps", "success_1m", "success_1m_low", "success_1m_high", "success_05m",
    "within_1m", "within_05m", "metres_to_localize", "lost", "coverage_50", "coverage_80",
    "coverage_95", "nees", "log_score", "ape_rmse", "rpe_rmse", "agreement_01", "agreement_03",
    "ms_per_step",
)  # fmt: skip
_TRIALS = tuple(name for name in RESULTS if not name.endswith(("_low", "_high")))
_OF_RUNS = [score for name, score in JOURNEY_SCORES.items() if name in _TRIALS]
_COMPARED = ("success_1m", "metres_to_localize", "position_median")


@dataclass(frozen=True)
class TrackedRun:
    """A run that has come to its end.

    Attributes:
        seed: which run of the localizer it is.
        track: on the log.
        scores: its numbers by column; NaN is not available.
    """

    seed: int
    track: EstimatedTrack
    scores: Mapping[str, float]

    @classmethod
    def of(cls, record: Finished, log: Log) -> Self:
        """Return the run of a record on a log."""
        assert record.track is not None
        own = record.track
        found = dict.fromkeys(_TRIALS, math.nan)  # of a record made before a score was added
        found |= {name: value for name, value in own.scores.items() if value is not None}
        found |= {score.name: value_in(record, score) for score in _OF_RUNS}
        found |= {"ms_per_step": milliseconds_per_step([record])}
        return cls(record.trial.trial, EstimatedTrack(log, np.array(own.best).T), found)

    @classmethod
    def of_track(cls, track: EstimatedTrack, scores: Mapping[str, float]) -> Self:
        """Return the run of somebody else's track, of which no time is known."""
        whole = {} if not track.known.size else journey_scores(track.journey(), TRACK_GROUPS)
        found = {score.name: whole.get(score.name, math.nan) for score in _OF_RUNS}
        return cls(0, track, {**scores, **found, "ms_per_step": math.nan})


@dataclass(frozen=True, kw_only=True)
class Row:
    """The runs of a localizer on a log.

    Attributes:
        label: what it is called.
        runs: those that came to their end, by seed.
        failed: how many did not; they count as no success.
    """

    label: str
    runs: Sequence[TrackedRun]
    failed: int = 0

    @property
    def seeds(self) -> int:
        """How many runs there are."""
        return len(self.runs) + self.failed

    @cached_property
    def scores(self) -> dict[str, float]:
        """Its numbers by column.

        Errors are those of all records of all runs; ``_stamps``: of those at the reference's own
        times. Success is a share of all runs, lost a share of those that ended. Metres to localize
        are the median over all runs, where failed runs and those that never localize count as
        infinite; ms per step the median over those that ended. All else is the mean over these.
        """
        if not self.runs:
            return {}
        each = [run.scores for run in self.runs]
        found = {name: float(np.mean([scores[name] for scores in each])) for name in _TRIALS}
        tracks = [run.track for run in self.runs]
        position = np.concatenate([own.errors.translation for own in tracks])
        heading = np.concatenate([own.errors.rotation for own in tracks])
        near = np.concatenate([own.errors.translation[own.at_stamps] for own in tracks])
        turned = np.concatenate([own.errors.rotation[own.at_stamps] for own in tracks])
        shares = {f"success_{name}": found[f"success_{name}"] for name in NEAR}
        shares = {name: share * len(each) / self.seeds for name, share in shares.items()}
        low, high = wilson(shares[f"success_{FOUND}"], self.seeds)
        metres = [own["metres_to_localize"] for own in each] + [math.inf] * self.failed
        return found | {
            "position_median": middle(position),
            "position_p95": float(np.quantile(position, 0.95)) if position.size else math.nan,
            "heading_median": middle(heading),
            "position_median_stamps": middle(near),
            "heading_median_stamps": middle(turned),
            **shares,
            f"success_{FOUND}_low": low,
            f"success_{FOUND}_high": high,
            "metres_to_localize": float(np.median(metres)),
            "ms_per_step": float(pd.Series([own["ms_per_step"] for own in each]).median()),
        }

    @property
    def middle(self) -> TrackedRun:
        """The run of the median error, or without a reference of the median agreement."""
        by = "position_median" if self.runs[0].track.known.size else "agreement_03"
        ordered = sorted(self.runs, key=lambda run: run.scores[by])
        return ordered[(len(ordered) - 1) // 2]

    @property
    def worst(self) -> TrackedRun:
        """The run with the fewest records within 1 m and 30°, then with the largest 95 % error.

        Without a reference, the run of the least agreement.
        """
        return min(self.runs, key=worse)


def worse(run: TrackedRun) -> tuple[float, ...]:
    """What runs are ordered by, the worst first: see ``Row.worst``."""
    scores = run.scores
    if not run.track.known.size:
        return (scores["agreement_03"],)
    return scores[f"within_{FOUND}"], -scores["position_p95"]


def rows_of(
    records: Mapping[str, Sequence[Finished]], failed: Mapping[str, int], log: Log
) -> list[Row]:
    """Return a row for each of the records' labels.

    Args:
        records: finished trials by label, in the order of their seeds.
        failed: number of those that failed by label.
        log: that they were run on.
    """
    return [
        Row(label=label, runs=[TrackedRun.of(one, log) for one in own], failed=failed.get(label, 0))
        for label, own in records.items()
    ]


def tracks_results_csv(rows: Iterable[Row], compared: pd.DataFrame | None) -> str:
    """Return results.csv: a line per localizer, its scores, then its differences to the first.

    Args:
        rows: of the localizers.
        compared: their ``results_table``; None if they are not compared.
    """
    ends = ("diff", "diff_low", "diff_high", "p_holm")
    further = [f"{score}_{end}" for score in _COMPARED for end in ends]
    told = [
        {"localizer": row.label, "seeds": row.seeds, "failed": row.failed} | row.scores
        for row in rows
    ]
    table = pd.DataFrame(told, columns=["localizer", "seeds", "failed", *RESULTS])
    if compared is None:
        return csv_of(table.reindex(columns=[*table, *further]))
    beside = compared[(compared["panel"] == 1) & (compared["offset"] == 0)].set_index("label")
    return csv_of(table.join(beside.reindex(columns=further), on="localizer"))


def tracks_trials_csv(rows: Iterable[Row]) -> str:
    """Return trials.csv: a line per run that came to its end."""
    runs = [
        {"localizer": row.label, "seed": run.seed, **run.scores} for row in rows for run in row.runs
    ]
    return csv_of(pd.DataFrame(runs, columns=["localizer", "seed", *_TRIALS]))
