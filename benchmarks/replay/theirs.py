"""``deqmcl score``: what another stack has estimated, as rows of a replay's table.

Beside a replay, or with a log, an estimate is scored at the log's records: there it is the stack's
last pose, carried on by the odometry since, which is what the stack itself would have said then.
Without a log it is scored at its own times, between whose poses nothing is assumed.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.files import own_folder, write_files
from benchmarks.replay.options import EVERY, NO_ERROR, first_referenced
from benchmarks.report.frames import frames_of
from benchmarks.report.tracks import accuracy, shown, tables_of
from benchmarks.setup.logs import REPLAY, ReplayScenario, check_inside
from benchmarks.setup.names import scenario
from benchmarks.setup.scenario import Thresholds
from benchmarks.sweeps.results import results_in
from benchmarks.tables.text import percent
from benchmarks.tables.tracks import Row, TrackedRun, tracks_results_csv, tracks_trials_csv
from benchmarks.trials.scores import track_scores
from benchmarks.trials.tracks import EstimatedTrack, calibration_of_gaussians
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.files import utf8
from deqmcl_gym.logs import Log, Scanner, Trajectory, referenced
from deqmcl_gym.logs.estimates import read_estimate, with_covariances
from deqmcl_gym.logs.motion import between, composed, relative
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError

_ALL = 0.99  # share of the records that an estimate need not cover without being told
_BLIND = Scanner(angles=(0.0,), max_range=1.0)


@dataclass(frozen=True, kw_only=True)
class Yardstick:
    """What estimates are scored by.

    Attributes:
        reference: the true poses, if there is no log.
        log: whose records are scored, with its reference if it has one.
        odometry: of all records of that log, played or not.
        floor_plan: the map; None: agreement is not available.
        thresholds: what counts as lost.
        judged: first record by which beliefs are judged.
        ours: the rows of a replay on this log.
    """

    reference: Trajectory | None = None
    log: Log | None = None
    odometry: Trajectory | None = None
    floor_plan: Map | None = None
    thresholds: Thresholds = REPLAY.thresholds
    judged: int = 0
    ours: Sequence[Row] = ()

    @classmethod
    def of_log(
        cls,
        log: str,
        reference: str | None,
        reading: dict[str, Any],
        floor_plan: str | None,
        every: str | None,
    ) -> "Yardstick":
        """Return a log with its reference, of the records that ``replay`` would play."""
        whole = LogEnv(log=log, reference=reference, reading=reading, map=floor_plan)
        ground = None if floor_plan is None else whole.floor_plan
        played = LogEnv(
            log=whole.log,
            start=first_referenced(whole.log),
            every=every or EVERY,
            max_beams=REPLAY.env["max_beams"],
        ).log
        if ground is not None:
            check_inside(played, ground)
        elif not played.referenced.size:
            raise InputError(f"{log} has no reference: give --reference, or --map to compare with.")
        return cls(log=played, odometry=_odometry(whole.log), floor_plan=ground)

    @classmethod
    def of_replay(cls, folder: Path) -> "Yardstick":
        """Return what a folder of ``replay`` was scored by, and its rows."""
        panel = next(iter(frames_of(results_in(folder))), None)
        rows, floor_plan = ([], None) if panel is None else shown(panel)
        if panel is None or not rows:
            raise InputError(
                f"{folder} is no folder of deqmcl replay with runs whose log and map are still "
                "there: give one, or --reference."
            )
        replayed = scenario(panel.setting.scenario).changed(panel.setting.world)
        assert isinstance(replayed, ReplayScenario)
        return cls(
            log=replayed.recording()[0],
            odometry=_odometry(replayed.whole),
            floor_plan=floor_plan,
            thresholds=replayed.thresholds,
            judged=replayed.judged,
            ours=rows,
        )

    def track(self, estimate: Trajectory) -> tuple[EstimatedTrack, Floats]:
        """Return an estimate at the records that it covers, and its covariances (n, 3, 3)."""
        if self.log is None or self.odometry is None:
            assert self.reference is not None
            log, at = _at_own_times(estimate, self.reference)
            best = estimate.poses[at]
        else:
            inside = (self.log.times >= estimate.times[0]) & (self.log.times <= estimate.times[-1])
            if not inside.any():
                raise InputError(
                    f"{estimate.source} is from {estimate.times[0]:.2f} s to "
                    f"{estimate.times[-1]:.2f} s, but {self.log.source} from "
                    f"{self.log.times[0]:.2f} s to {self.log.times[-1]:.2f} s: give the estimate "
                    "of this log, with the same clock."
                )
            log = self.log
            at = np.clip(np.searchsorted(estimate.times, log.times, side="right") - 1, 0, None)
            then = between(self.odometry.times, self.odometry.poses, estimate.times[at])
            moved = relative(then, log.odometry)
            best = composed(estimate.poses[at], moved)
            best[~inside] = np.nan
        unknown = np.full((len(best), 3, 3), np.nan)
        spread = unknown if estimate.covariances is None else estimate.covariances[at]
        return EstimatedTrack(log, best), spread

    def row(self, label: str, estimate: Trajectory) -> Row:
        """Return the row of an estimate."""
        track, spread = self.track(estimate)
        truth = (
            np.full_like(track.best, np.nan) if track.log.reference is None else track.log.reference
        )
        calibrated = calibration_of_gaussians(track.best, spread, truth, track.log.unit)
        found = track_scores(
            track, calibrated, self.thresholds, self.floor_plan, judged=self.judged
        )
        return Row(label=label, runs=[TrackedRun.of_track(track, found)])

    def uncovered(self, row: Row) -> str | None:
        """Return the warning that an estimate misses records of the log; None if few."""
        covered = int(np.isfinite(row.runs[0].track.best[:, 0]).sum())
        if self.log is None or covered >= _ALL * len(self.log):
            return None
        return (
            f"{row.label} covers {covered:,} of the {len(self.log):,} records, "
            f"{percent(covered / len(self.log))}: at the others it is not localized; errors are "
            "those of the records that it covers."
        )


def estimates_of(words: Sequence[str], covariance: str | None) -> dict[str, Trajectory]:
    """Return estimates named ``[NAME=]FILE[:TOPIC]`` by label, which is the name or the file's.

    Args:
        words: as given.
        covariance: a file of covariances for the only one.
    """
    if covariance is not None and len(words) > 1:
        raise InputError(
            f"--covariance is for one estimate, but {len(words)} are given: score one at a time, "
            "or put the covariances into columns of CSV."
        )
    found: dict[str, Trajectory] = {}
    for word in words:
        label, path, topic = _named(word)
        if label in found:
            raise InputError(f"two estimates are called {label}: write NAME=FILE for one of them.")
        read = read_estimate(path, topic)
        found[label] = read if covariance is None else with_covariances(read, covariance)
    return found


def score(
    yardstick: Yardstick, estimates: dict[str, Trajectory], out: Path
) -> tuple[list[str], str]:
    """Score estimates, write results.csv and trials.csv; return warnings, and what to print."""
    for label in estimates:
        if label in {row.label for row in yardstick.ours}:
            raise InputError(f"{label} is a localizer of the replay: write NAME=FILE for yours.")
    rows = [yardstick.row(label, estimate) for label, estimate in estimates.items()]
    every = [*yardstick.ours, *rows]
    contents = {
        "results.csv": utf8(tracks_results_csv(every, None)),
        "trials.csv": utf8(tracks_trials_csv(every)),
    }
    files = write_files(own_folder(out, "results.csv"), contents)
    texts = [*accuracy(every), *(one.text("simple") for one in tables_of(every))]
    texts += [_scored_at(yardstick, rows)]
    texts.append(f"Written to {out}: {', '.join(path.name for path in files)}.")
    return list(filter(None, map(yardstick.uncovered, rows))), "\n\n".join(texts)


def _scored_at(yardstick: Yardstick, rows: Sequence[Row]) -> str:
    if yardstick.log is None:
        known = ", ".join(f"{row.label} {len(row.runs[0].track.best):,}" for row in rows)
        return (
            f"Scored at the estimates' own times: {known} poses within the reference, which is "
            "interpolated in straight lines; give --log to follow the odometry. Metres are those "
            "of the reference."
        )
    said = (
        f"Scored at {len(yardstick.log):,} records of {Path(yardstick.log.source).name}: the last "
        "pose of the estimate, carried on by the odometry since."
    )
    return said if yardstick.log.referenced.size else f"{said} {NO_ERROR}"


def _named(word: str) -> tuple[str, str, str | None]:
    """Return label, path and topic of ``[NAME=]FILE[:TOPIC]``; a file of that name comes first."""
    label, equals, rest = word.partition("=")
    if Path(word).exists() or not equals or "/" in label:
        label, rest = "", word
    path, colon, topic = rest.rpartition(":/")
    if Path(rest).exists() or not colon:
        path, topic = rest, ""
    asked = f"/{topic}" if topic else None
    stem = re.sub(r"\.(tum|csv|txt|bag|mcap|db3)$", "", Path(path).name)
    return label.strip() or topic or stem, path, asked


def _odometry(log: Log) -> Trajectory:
    return Trajectory(log.times, log.odometry, log.source)


def _at_own_times(estimate: Trajectory, reference: Trajectory) -> tuple[Log, Any]:
    """Return records at those times of an estimate that have a reference, and which these are.

    The odometry of these records is the reference: it says how far the robot has driven.
    """
    n = estimate.times.size
    still = Log(
        _BLIND, estimate.times, np.zeros((n, 3)), np.full((n, 1), math.inf), source=estimate.source
    )
    found = referenced(still, reference)
    at, poses = found.referenced, found.reference
    assert poses is not None
    kept = found.of_records(at)
    return replace(kept, odometry=poses[at]), at
