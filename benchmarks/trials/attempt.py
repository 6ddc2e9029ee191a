"""One trial, run to its record or to the reason why there is none."""

import contextlib
import multiprocessing
import os
import warnings
from dataclasses import dataclass

from benchmarks.trials.plugins import key_of
from benchmarks.trials.scoring import Record, record
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.validation import LogWarning
from localizers.kinds import is_ctrl_c, reason_of
from localizers.registry import LOCALIZER


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of a trial: a record with the seconds it took, or a reason."""

    record: Record | None = None
    seconds: float = 0.0
    reason: str | None = None


def attempt(trial: Trial, key: str) -> Outcome:
    """Run one trial; an error becomes its reason to have failed.

    ``key`` is the name that the sweep has for it: a worker that would name it otherwise has loaded
    other code, other libraries or another plug-in. What was registered here is the sweep's own.
    """
    try:
        with contextlib.chdir(os.curdir), warnings.catch_warnings():  # localizers may go
            warnings.simplefilter("ignore", LogWarning)  # said when the sweep was checked
            here = multiprocessing.parent_process() is None
            own = LOCALIZER.added if here else LOCALIZER.received
            if trial.localizer not in own and key_of(trial) != key:
                return Outcome(
                    reason="its worker loaded other code, libraries or plug-in than the sweep: "
                    "run the command again, with the same on every machine"
                )
            stage = Stage.of(trial)
            trace = stage.trace()
            kept = record(trace, trial.lag, stage.scenario.thresholds)
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        return Outcome(reason=reason_of(error))
    if trace.steps == 0:
        return Outcome(reason="it processed 0 steps")
    return Outcome(record=kept, seconds=trace.seconds)
