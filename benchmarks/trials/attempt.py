"""One trial, run to its record or to the reason why there is none."""

import contextlib
import os
import warnings
from dataclasses import dataclass
from typing import Any

from benchmarks.setup.logs import ReplayScenario
from benchmarks.setup.trial_env import TrialEnv
from benchmarks.trials.episode import groups_of, scenario_of, task_of, trial_moments
from benchmarks.trials.plugins import key_of
from benchmarks.trials.scoring import record
from benchmarks.trials.spec import Trial
from benchmarks.trials.trace import Collector, Trace, trace_of
from benchmarks.trials.tracks import TrackLog
from deqmcl_gym.logs import LogWarning
from deqmcl_gym.validation import in_words
from localizers.naming.isolation import is_ctrl_c


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of a trial: a record with the seconds it took, or a reason."""

    record: dict[str, Any] | None = None
    seconds: float = 0.0
    reason: str | None = None


def trial_trace(trial: Trial) -> Trace:
    """Run one trial and return its trace."""
    room = scenario_of(trial).room()
    task, groups = task_of(room), groups_of(trial, room)
    collectors = collectors_of(trial, room)
    return trace_of(trial_moments(trial, room), trial.offsets, task, groups, collectors)


def collectors_of(trial: Trial, room: TrialEnv) -> tuple[Collector, ...]:
    """Return what else is kept of a trial: the track of one that replays a whole log."""
    setup = scenario_of(trial)
    if not isinstance(setup, ReplayScenario):
        return ()
    log, _ = setup.recording()
    return (TrackLog(log, room.floor_plan, setup.thresholds, setup.judged),)


def attempt(trial: Trial, key: str) -> Outcome:
    """Run one trial; an error becomes its reason to have failed.

    ``key`` is the name that the sweep has for it: a worker that would name it otherwise has loaded
    other code, other libraries or another plug-in.
    """
    try:
        with (
            contextlib.chdir(os.curdir),
            warnings.catch_warnings(),
        ):  # localizers may go
            warnings.simplefilter("ignore", LogWarning)  # said when the sweep was checked
            if key_of(trial) != key:
                return Outcome(
                    reason="its worker loaded other code, libraries or plug-in than the sweep: "
                    "run the command again, with the same on every machine"
                )
            trace = trial_trace(trial)
            kept = record(trace, trial.lag, scenario_of(trial).thresholds)
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        return Outcome(reason=in_words(error))
    if trace.steps == 0:
        return Outcome(reason="it processed 0 steps")
    return Outcome(record={"trial": trial.canonical()} | kept, seconds=trace.seconds)
