"""The plug-ins of a trial: who they are, and of which source."""

from collections.abc import Iterable
from functools import cache

import localizers
from benchmarks.setup.names import scenario, scenario_digest
from benchmarks.trials.provenance import Provenance, code_digest, versions
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError
from localizers.naming.plugins import is_reference
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


def provenance_of(trials: Iterable[Trial]) -> Provenance:
    """Return what the numbers of these trials depend on, as it is now."""
    localizer, setup = cache(source_digest), cache(scenario_digest)  # a file is read once
    digests: dict[str, str] = {}
    for trial in trials:
        digests[trial.localizer] = localizer(trial.localizer)
        digests[trial.scenario] = setup(trial.scenario)
    plug_ins = {name: digest for name, digest in digests.items() if digest}
    return Provenance(code_digest(), versions(), plug_ins)


def guest_of(trial: Trial) -> str:
    """Return the names of a trial's plug-ins: localizer, scenario, agent; "" if all is ours."""
    localizer = (trial.localizer,) if is_plug_in(trial.localizer) else ()
    return " ".join((*localizer, *_guests_in(trial.scenario)))


def source_digest(name: str) -> str:
    """Return a digest of the source of a localizer from elsewhere; "" for our own."""
    try:
        return localizers.source_digest(name) or ""
    except InputError:  # it cannot be found: its trials fail with the reason
        return ""


@cache
def _guests_in(name: str) -> tuple[str, ...]:
    """Return the names of a scenario and its agent, as far as they are plug-ins."""
    return tuple(filter(is_reference, (name, scenario(name).agent)))
