"""The plug-ins of a trial: who they are, and of which source."""

from collections.abc import Iterable
from functools import cache

import localizers
from benchmarks.setup.names import scenario, scenario_digest
from benchmarks.trials.provenance import provenance
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
    localizer, setup = cache(source_digest), cache(scenario_digest)  # a file is read once
    return {
        trial.key(provenance() + localizer(trial.localizer) + setup(trial.scenario)): trial
        for trial in trials
    }


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
