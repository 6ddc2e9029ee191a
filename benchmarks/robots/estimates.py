"""``deqmcl score``: what another stack has estimated, as runs beside those of a replay.

With a log an estimate is scored at its records: there it is the stack's last pose, carried on by
the odometry since, as the stack would have said. Without a log it is scored at its own times.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.report.runs import run_of_track, tracks_table, tracks_trials
from benchmarks.report.tracks import accuracy, published, tables_of, tracked
from benchmarks.robots import EVERY, NO_ERROR
from benchmarks.robots.calibration import first_judged, late_words
from benchmarks.setup.logs import REPLAY, LogScenario, check_inside
from benchmarks.setup.names import scenario
from benchmarks.sweeps.results import results_in
from benchmarks.sweeps.store import own_folder, write_files
from benchmarks.tables import percent
from benchmarks.tables.frames import csv_of
from benchmarks.trials.scores import track_scores
from benchmarks.trials.trace import calibration_of
from benchmarks.trials.tracks import EstimatedTrack
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.files import utf8
from deqmcl_gym.logs import Log, Scanner, Trajectory, referenced
from deqmcl_gym.logs.motion import between, composed, relative
from deqmcl_gym.logs.trajectory import read_estimate
from deqmcl_gym.maps import Map
from deqmcl_gym.validation import InputError

_ENDINGS = r"\.(tum|csv|txt|bag|mcap|db3)(\.gz)?$"
_ALL = 0.99  # share of the records that an estimate must cover, else there is a warning
_MOST = 0.9  # and of a reference's time, which may begin before the robot drives


@dataclass(frozen=True)
class Played:
    """The records of a log at which estimates are scored, all of them, its map, runs on it."""

    log: Log
    whole: Log
    floor_plan: Map | None
    setup: LogScenario = REPLAY
    runs: pd.DataFrame | None = None

    def track(self, estimate: Trajectory) -> EstimatedTrack:
        """Return an estimate at the records that it covers."""
        log, times = self.log, estimate.times
        inside = (log.times >= times[0]) & (log.times <= times[-1])
        if not inside.any():
            raise InputError(
                f"{estimate.source} is from {times[0]:.2f} s to {times[-1]:.2f} s, but "
                f"{log.source} from {log.times[0]:.2f} s to {log.times[-1]:.2f} s: give the "
                "estimate of this log, with the same clock."
            )
        at = np.clip(np.searchsorted(times, log.times, side="right") - 1, 0, None)
        then = between(self.whole.times, self.whole.odometry, times[at])
        best = composed(estimate.poses[at], relative(then, log.odometry))
        best[~inside] = np.nan
        return EstimatedTrack(log, best, estimate.spread_at(at))


def played_before(folder: Path) -> Played:
    """Return what a folder of ``replay`` has played, and its runs."""
    panels = results_in(folder).panels
    replayed = tracked(panels[0]) if panels else None
    if replayed is None or replayed[0].empty:
        raise InputError(
            f"{folder} is no folder of deqmcl replay with runs whose log and map are still there: "
            "give one, or --reference."
        )
    runs, floor_plan = replayed
    setup = scenario(panels[0].setting.scenario).changed(panels[0].setting.world)
    assert isinstance(setup, LogScenario)
    return Played(setup.recording()[0], setup.whole, floor_plan, setup, runs)


def played_by_replay(
    log: str,
    reference: str | None,
    reading: Mapping[str, Any],
    floor_plan: str | None,
    every: str | None,
) -> Played:
    """Return a log with its reference, of the records that ``replay`` would play."""
    env = LogEnv(log=log, reference=reference, reading=reading, map=floor_plan)
    whole, ground = env.log, None if floor_plan is None else env.floor_plan
    start, most = next(iter(whole.referenced.tolist()), 0), REPLAY.env["max_beams"]
    played = LogEnv(log=whole, start=start, every=every or EVERY, max_beams=most).log
    if ground is not None:
        check_inside(played, ground)
    elif not played.referenced.size:
        raise InputError(f"{log} has no reference: give --reference, or --map to compare with.")
    return Played(played, whole, ground)


def at_own_times(estimate: Trajectory, reference: Trajectory) -> EstimatedTrack:
    """Return an estimate at its times with a reference, its odometry there."""
    times, n = estimate.times, estimate.times.size
    blind = Scanner(angles=(0.0,), max_range=1.0), times, np.zeros((n, 3)), np.full((n, 1), np.inf)
    log = referenced(Log(*blind, source=estimate.source), reference)
    at, poses = log.referenced, log.reference
    assert poses is not None
    log = replace(log.of_records(at), odometry=poses[at])
    return EstimatedTrack(log, estimate.poses[at], estimate.spread_at(at))


def runs_of(label: str, estimate: Trajectory, by: Played | Trajectory) -> pd.DataFrame:
    """Return an estimate as a run, scored on a log or by a reference alone.

    Its covariances are judged as published; with enough of a reference there is a second run, with
    those that a calibration to the first part would publish.
    """
    track = by.track(estimate) if isinstance(by, Played) else at_own_times(estimate, by)
    setup, floor_plan = (by.setup, by.floor_plan) if isinstance(by, Played) else (REPLAY, None)
    judged = setup.judged or first_judged(track.log) or 0
    runs = {label: None, f"{label}, calibrated": calibration_of(track, judged)}
    scored = {
        name: track_scores(track, judged, calibration, setup.thresholds, floor_plan)
        for name, calibration in runs.items()
        if name == label or calibration is not None
    }
    return pd.concat(run_of_track(name, track, values) for name, values in scored.items())


def estimates_of(words: Sequence[str]) -> dict[str, Trajectory]:
    """Return estimates ``[NAME=]FILE[:TOPIC]`` by name; a file of that name comes first."""
    estimates: dict[str, Trajectory] = {}
    for word in words:
        label, equals, rest = word.partition("=")
        if Path(word).exists() or not equals or "/" in label:
            label, rest = "", word
        path, colon, topic = rest.rpartition(":/")
        if Path(rest).exists() or not colon:
            path, topic = rest, ""
        label = label.strip() or topic or re.sub(_ENDINGS, "", Path(path).name)
        if label in estimates:
            raise InputError(f"two estimates are called {label}: write NAME=FILE for one of them.")
        estimates[label] = read_estimate(path, f"/{topic}" if topic else None)
    return estimates


def score(
    by: Played | Trajectory, estimates: Mapping[str, Trajectory], out: Path
) -> tuple[list[str], str, pd.DataFrame]:
    """Score estimates, write results.csv and trials.csv; return warnings, text and table."""
    ours = [by.runs] if isinstance(by, Played) and by.runs is not None else []
    for label in estimates:
        if any(label in set(before["label"]) for before in ours):
            raise InputError(f"{label} is a localizer of the replay: write NAME=FILE for yours.")
    theirs = pd.concat(runs_of(label, estimate, by) for label, estimate in estimates.items())
    runs = pd.concat([*ours, theirs])
    table = tracks_table(runs, None)
    contents = {"results.csv": utf8(csv_of(table)), "trials.csv": utf8(csv_of(tracks_trials(runs)))}
    files = write_files(own_folder(out, "results.csv"), contents)
    plain = theirs[theirs["label"].isin(estimates)]
    tracks = plain[["label", "track"]].to_numpy()
    covered = {label: np.isfinite(track.best[:, 0]) for label, track in tracks}
    warnings: list[str | None] = [
        f"{label} covers {poses.sum():,} of the {poses.size:,} records, {percent(poses.mean())}: "
        "at the others it is not localized; errors are those of the records that it covers."
        for label, poses in covered.items()
        if poses.sum() < _ALL * poses.size
    ]
    if isinstance(by, Played):
        clock, posed = (by.whole.times, by.whole.odometry), by.whole.posed
        whose = "odometry"
        if by.whole.reference is not None:
            reference = by.whole.times[posed], by.whole.reference[posed]
            warnings.append(late_words("the reference", *clock, *reference, whose))
        how = (
            f"Scored at {len(by.log):,} records of {Path(by.log.source).name}: the last pose of "
            "the estimate, carried on by the odometry since."
        )
        how += "" if by.log.referenced.size else f" {NO_ERROR}"
    else:
        clock, whose = (by.times, by.poses), "reference"
        warnings += [
            f"{label} covers {percent(share)} of the reference's time: errors, and whether it is "
            "localized to the end, are of that part."
            for label, estimate in estimates.items()
            if (share := np.ptp(by.times.clip(*estimate.times[[0, -1]])) / np.ptp(by.times)) < _MOST
        ]
        counts = ", ".join(f"{label} {len(poses):,}" for label, poses in covered.items())
        how = (
            f"Scored at the estimates' own times: {counts} poses within the reference, which is "
            "interpolated in straight lines; give --log to follow the odometry. Metres are those "
            "of the reference."
        )
    warnings += [late_words(n, *clock, est.times, est.poses, whose) for n, est in estimates.items()]
    texts = [
        *accuracy(pd.concat([*ours, plain])),
        *(table.text() for table in tables_of(runs)),
        how,
        *published(runs),
        f"Written to {out}: {', '.join(path.name for path in files)}.",
    ]
    return [*filter(None, warnings)], "\n\n".join(texts), table
