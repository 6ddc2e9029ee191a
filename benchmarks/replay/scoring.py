"""Scores of one run, and of a localizer's runs over all seeds. Lengths are in m."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.replay.errors import PoseErrors, absolute, relative_errors
from benchmarks.replay.playing import Track
from benchmarks.replay.running import Run
from benchmarks.replay.setting import metre
from benchmarks.tables.journeys import median
from benchmarks.tables.stats import wilson
from benchmarks.trials.fixes import FOUND, NEAR, Fixes
from benchmarks.trials.metrics import LEVELS, mean
from deqmcl_gym.numerics.types import Floats, Indices

_LOST_STEPS, _LOST = 20, 1.0  # records, m: as ``benchmarks.setup.thresholds``


@dataclass(frozen=True, kw_only=True)
class Played:
    """A run that has come to its end.

    Attributes:
        run: what was run.
        track: what it believed.
        agreement: share of its beams within 0.1 m and 0.3 m of the map.
    """

    run: Run
    track: Track
    agreement: tuple[float, float]

    @cached_property
    def known(self) -> Indices:
        """The records with a reference, in order."""
        return np.flatnonzero(np.isfinite(self.track.truth[:, 0]))

    @cached_property
    def way(self) -> Floats:
        """Metres driven at each record."""
        way: Floats = self.track.way / self._metre
        return way

    @cached_property
    def errors(self) -> PoseErrors | None:
        """APE of the best clusters at the records with a reference, m; None without any."""
        return self._in_metres(absolute) if self.known.size else None

    @cached_property
    def relative(self) -> PoseErrors | None:
        """RPE from record to record, m; None without two references."""
        return self._in_metres(relative_errors) if self.known.size > 1 else None

    @cached_property
    def fixes(self) -> Fixes:
        """Where the best cluster is, at the records with a reference."""
        errors = self.errors or PoseErrors(translation=np.empty(0), rotation=np.empty(0))
        return Fixes(
            steps=self.known,
            count=len(self.track.times),
            way=self.way[self.known],
            distance=errors.translation,
            angle=errors.rotation,
            quality=np.full(self.known.size, math.nan),
        )

    @property
    def scores(self) -> dict[str, float]:
        """Its numbers by column."""
        return {
            **_errors_of([self]),
            **_errors_at_stamps([self]),
            **{f"success_{near}": self.fixes.success(near) for near in reversed(NEAR)},
            **{
                f"within_{near}": mean(self.fixes.localized(near).astype(np.float64))
                for near in reversed(NEAR)
            },
            "lost": self._lost,
            "metres_to_localize": self.fixes.metres_to_localize,
            "ape_rmse": math.nan if self.errors is None else self.errors.rmse,
            "rpe_rmse": math.nan if self.relative is None else self.relative.rmse,
            **{f"coverage_{level}": self._covered(level) for level in LEVELS},
            "nees": mean(self._judged(self.track.nees)),
            "agreement_01": self.agreement[0],
            "agreement_03": self.agreement[1],
            "ms_per_step": float(1000 * np.median(self.track.seconds[1:])),
        }

    @property
    def at_stamps(self) -> Indices:
        """Which of the known records are at times of the reference's own poses."""
        between = self.run.setting.log.interpolated
        own = np.ones(self.known.size, bool) if between is None else ~between[self.known]
        return np.flatnonzero(own)

    @property
    def lost(self) -> tuple[int, float] | None:
        """The record from which on it is never again within 1 m and 30°, and the way there, m."""
        first = self.fixes.lost_at
        if first is None or not self.known.size:
            return None
        return int(self.known[first]), float(self.fixes.way[first])

    def _covered(self, level: int) -> float:
        ranks = self._judged(self.track.ranks)
        return mean((ranks <= level / 100).astype(np.float64))

    def _judged(self, values: Floats) -> Floats:
        """Return those of the records that nothing was fitted on, where they are known."""
        held_out = values[self.run.setting.judged :]
        return held_out[np.isfinite(held_out)]

    @property
    def _lost(self) -> float:
        if self.errors is None:
            return math.nan
        return float(self.errors.translation[-_LOST_STEPS:].mean() > _LOST)

    @property
    def _metre(self) -> float:
        return metre(self.run.setting.log)

    def _in_metres(self, of: Callable[[Floats, Floats], PoseErrors]) -> PoseErrors:
        found = of(self.track.best, self.track.truth)
        return PoseErrors(translation=found.translation / self._metre, rotation=found.rotation)


@dataclass(frozen=True, kw_only=True)
class Row:
    """A localizer's runs.

    Attributes:
        localizer: its name.
        played: those that came to their end, by seed.
        failed_seeds: of those that did not; they count as no success.
    """

    localizer: str
    played: Sequence[Played]
    failed_seeds: Sequence[int] = ()

    @property
    def failed(self) -> int:
        """How many runs did not come to their end."""
        return len(self.failed_seeds)

    @property
    def seeds(self) -> int:
        """How many runs there are."""
        return len(self.played) + self.failed

    @property
    def scores(self) -> dict[str, float]:
        """Its numbers by column.

        Errors are those of all records of all runs; ``_stamps``: of those at the reference's own
        times. Success is a share of all runs, lost a share of
        those that ended. Metres to localize are the median over all runs, where failed runs and
        those that never localize count as infinite. All else is the mean over runs that ended.
        """
        each = [played.scores for played in self.played]
        if not each:
            return {}
        found = {name: float(np.mean([scores[name] for scores in each])) for name in each[0]}
        done = len(each) / self.seeds
        shares = {f"success_{near}": found[f"success_{near}"] * done for near in NEAR}
        low, high = wilson(shares[f"success_{FOUND}"], self.seeds)
        metres = [scores["metres_to_localize"] for scores in each] + [math.inf] * self.failed
        return {
            **found,
            **_errors_of(self.played),
            **_errors_at_stamps(self.played),
            **shares,
            f"success_{FOUND}_low": low,
            f"success_{FOUND}_high": high,
            "metres_to_localize": median(metres),
        }

    @property
    def middle(self) -> Played:
        """The run of the median error, or without a reference of the median agreement."""
        by = "agreement_03" if self.played[0].errors is None else "position_median"
        ordered = sorted(self.played, key=lambda played: played.scores[by])
        return ordered[(len(ordered) - 1) // 2]

    @property
    def worst(self) -> Played:
        """The run with the fewest records within 1 m and 30°, then with the largest 95 % error.

        Without a reference, the run of the least agreement.
        """

        def worse(played: Played) -> tuple[float, ...]:
            scores = played.scores
            if played.errors is None:
                return (scores["agreement_03"],)
            return scores[f"within_{FOUND}"], -scores["position_p95"]

        return min(self.played, key=worse)


def rows_of(runs: Mapping[str, Run], played: Mapping[str, Played]) -> list[Row]:
    """Return a row per localizer, in the order in which they were named."""
    names = list(dict.fromkeys(run.localizer for run in runs.values()))
    return [
        Row(
            localizer=name,
            played=[
                played[key] for key, run in runs.items() if run.localizer == name and key in played
            ],
            failed_seeds=[
                run.seed for key, run in runs.items() if run.localizer == name and key not in played
            ],
        )
        for name in names
    ]


def _errors_of(played: Sequence[Played]) -> dict[str, float]:
    """Return quantiles over all records with a reference: m, m, rad."""
    errors = [one.errors for one in played if one.errors is not None]
    if not errors:
        return dict.fromkeys(("position_median", "position_p95", "heading_median"), math.nan)
    position = np.concatenate([one.translation for one in errors])
    heading = np.concatenate([one.rotation for one in errors])
    return {
        "position_median": float(np.median(position)),
        "position_p95": float(np.quantile(position, 0.95)),
        "heading_median": float(np.median(heading)),
    }


def _errors_at_stamps(played: Sequence[Played]) -> dict[str, float]:
    """Return medians over the records at the reference's own times: m, rad."""
    errors = [(one.errors, one.at_stamps) for one in played if one.errors is not None]
    found = [(own.translation[at], own.rotation[at]) for own, at in errors if at.size]
    if not found:
        return {"position_median_stamps": math.nan, "heading_median_stamps": math.nan}
    position, heading = map(np.concatenate, zip(*found, strict=True))
    return {
        "position_median_stamps": float(np.median(position)),
        "heading_median_stamps": float(np.median(heading)),
    }
