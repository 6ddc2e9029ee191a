"""The plug-ins of a trial: their names, and digests of their sources."""

from collections.abc import Callable, Iterable
from functools import cache

import localizers
from benchmarks.setup.changes import file_digest
from benchmarks.setup.names import (
    agent_digest,
    plug_ins_of,
    plug_ins_of_agent,
    plug_ins_of_scan,
    scenario_digest,
)
from benchmarks.trials.provenance import Provenance, code_digest, versions
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError
from localizers.naming.plugins import absolute_name, reference_digest
from localizers.naming.registry import is_plug_in


def key_of(trial: Trial) -> str:
    """Return the name under which a trial's result is kept."""
    (key,) = keyed([trial])
    return key


def keyed(trials: Iterable[Trial]) -> dict[str, Trial]:
    """Return trials by the names under which their results are kept."""
    listed = list(trials)
    made = provenance_of(listed)
    return {made.key(trial): trial for trial in listed}


def provenance_of(
    trials: Iterable[Trial], setup_digest: Callable[[str], str] = scenario_digest
) -> Provenance:
    """Return what the numbers of these trials depend on, as it is now.

    Args:
        trials: any.
        setup_digest: of a scenario; it runs those that are plug-ins.
    """
    localizer, setup = cache(source_digest), cache(setup_digest)  # a file is read once
    digests: dict[str, str] = {}
    for trial in trials:
        found = [(trial.localizer, localizer(absolute_name(trial.localizer)))]
        found.append((trial.scenario, setup(absolute_name(trial.scenario))))
        if trial.agent is not None:
            found.append((trial.agent.name, agent_digest(trial.agent.name)))
        found += [(name, reference_digest(name) or "") for name in plug_ins_of_scan(trial.assumed)]
        found += [(path, file_digest(path)) for path in trial.files]
        for name, digest in found:
            if digests.setdefault(name, digest) != digest:
                raise InputError(
                    f"two files are called {name}, one from the folder of the sweep file and one "
                    "from another folder: give the path of one of them from /."
                )
    plug_ins = {str(name): digest for name, digest in digests.items() if digest}
    return Provenance(code_digest(), versions(), plug_ins)


def setup_guests(trial: Trial) -> tuple[str, ...]:
    """Return the names of a trial's plug-ins but its localizer: scenario, agent, scan model."""
    own = (*plug_ins_of_agent(trial.agent), *plug_ins_of_scan(trial.assumed))
    return (*plug_ins_of(trial.scenario), *own)


def guest_of(trial: Trial) -> str:
    """Return the names of a trial's plug-ins: all that are not ours; "" if none is."""
    localizer = (trial.localizer,) if is_plug_in(trial.localizer) else ()
    return " ".join((*localizer, *setup_guests(trial)))


def source_digest(name: str) -> str:
    """Return a digest of the source of a localizer from elsewhere; "" for our own."""
    try:
        return localizers.source_digest(name) or ""
    except InputError:  # it cannot be found: its trials fail with the reason
        return ""
