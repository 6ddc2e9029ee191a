"""The plug-ins of a trial: their names, and digests of their sources."""

from collections.abc import Iterable
from functools import cache

from benchmarks.setup.documents import digest_of_file
from benchmarks.setup.names import (
    AGENT,
    plug_ins_of,
    plug_ins_of_agent,
    plug_ins_of_scan,
    scenario,
    scenario_digest,
)
from benchmarks.trials.provenance import Provenance, code_digest, versions
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError
from localizers import absolute_name
from localizers.registry import LOCALIZER, SCAN_MODEL


def key_of(trial: Trial) -> str:
    """Return the name under which a trial's result is kept."""
    (key,) = keyed([trial])
    return key


def keyed(trials: Iterable[Trial]) -> dict[str, Trial]:
    """Return trials by the names under which their results are kept."""
    listed = list(trials)
    made = provenance_of(listed)
    return {made.key(trial): trial for trial in listed}


def provenance_of(trials: Iterable[Trial]) -> Provenance:
    """Return what the numbers of these trials depend on, as it is now."""
    localizer, setup = cache(LOCALIZER.digest), cache(scenario_digest)  # a file is read once
    digests: dict[str, str] = {}
    for trial in trials:
        found = [(trial.localizer, localizer(absolute_name(trial.localizer)))]
        found.append((trial.scenario, setup(absolute_name(trial.scenario))))
        if trial.agent is not None:
            found.append((trial.agent.name, AGENT.digest(trial.agent.name)))
        found += [(name, SCAN_MODEL.digest(name)) for name in plug_ins_of_scan(trial.assumed)]
        found += [(path, digest_of_file(path)) for path in trial.files]
        for name, digest in found:
            if digests.setdefault(name, digest) != digest:
                raise InputError(
                    f"two files are called {name}, one from the folder of the sweep file and one "
                    "from another folder: give the path of one of them from /."
                )
    plug_ins = {str(name): digest for name, digest in digests.items() if digest}
    return Provenance(code_digest(), versions(), plug_ins)


def guest_of(trial: Trial) -> str:
    """Return the names of a trial's plug-ins: all that are not ours; "" if none is."""
    localizer = (trial.localizer,) if LOCALIZER.is_plug_in(trial.localizer) else ()
    own = (*plug_ins_of_agent(trial.agent), *plug_ins_of_scan(trial.assumed))
    return " ".join((*localizer, *plug_ins_of(scenario(trial.scenario)), *own))
