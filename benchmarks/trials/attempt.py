"""One trial under the name of its result: run to its record, or to the reason why there is none."""

import contextlib
import multiprocessing
import os
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, lru_cache

from benchmarks.setup.documents import digest_of_file
from benchmarks.setup.names import AGENT, SCAN_KIND, plug_ins_of, scenario, scenario_digest
from benchmarks.trials.provenance import Provenance, code_digest, versions
from benchmarks.trials.scoring import TrialRecord, record
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Drive, Stage
from deqmcl_gym.validation import InputError, LogWarning
from localizers import absolute_name
from localizers.kinds import is_ctrl_c, reason_of
from localizers.registry import LOCALIZER, SCAN_MODEL


def provenance_of(trials: Iterable[Trial]) -> Provenance:
    """Return what the numbers of these trials depend on, as it is now."""
    localizer, setup = cache(LOCALIZER.digest), cache(scenario_digest)  # a file is read once
    digests: dict[str, str] = {}
    for trial in trials:
        parts = [(trial.localizer, localizer(absolute_name(trial.localizer)))]
        parts.append((trial.scenario, setup(absolute_name(trial.scenario))))
        if trial.agent is not None:
            parts.append((trial.agent.name, AGENT.digest(trial.agent.name)))
        parts += [
            (n, SCAN_MODEL.digest(n)) for n in plug_ins_of(None, trial.assumed.get(SCAN_KIND))
        ]
        parts += [(path, digest_of_file(path)) for path in trial.files]
        for name, digest in parts:
            if digests.setdefault(name, digest) != digest:
                raise InputError(
                    f"two files are called {name}, one from the folder of the sweep file and one "
                    "from another folder: give the path of one of them from /."
                )
    plug_ins = {str(name): digest for name, digest in digests.items() if digest}
    return Provenance(code_digest(), versions(), plug_ins)


def key_of(trial: Trial) -> str:
    """Return the name under which a trial's result is kept."""
    return provenance_of([trial]).key(trial)


def guest_of(trial: Trial) -> str:
    """Return the names of a trial's plug-ins: all that are not ours; "" if none is."""
    localizer = (trial.localizer,) if LOCALIZER.is_plug_in(trial.localizer) else ()
    found = scenario(trial.scenario)
    usual = plug_ins_of(found.agent, getattr(found.scan, "kind", None))
    return " ".join((*localizer, *usual, *plug_ins_of(trial.agent, trial.assumed.get(SCAN_KIND))))


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of a trial: a record with the seconds it took, or a reason."""

    record: TrialRecord | None = None
    seconds: float = 0.0
    reason: str | None = None


@lru_cache(maxsize=2)
def _driven(episode: Trial, key: str) -> Drive | None:
    """Return what is driven once for all methods; its ``key`` names all that it depends on."""
    del key
    return Stage.of(episode).driven()


def attempt(trial: Trial, key: str) -> Outcome:
    """Run one trial; an error becomes its reason to have failed.

    A worker that would have another ``key`` for it has loaded other code, libraries or plug-ins.
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
            alike = _driven(trial.episode, key_of(trial.episode)) if stage.repeats else None
            trace = stage.trace(alike)
            kept = record(trace, trial.lag, stage.scenario.thresholds)
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        return Outcome(reason=reason_of(error))
    if trace.steps == 0:
        return Outcome(reason="it processed 0 steps")
    return Outcome(record=kept, seconds=trace.seconds)
