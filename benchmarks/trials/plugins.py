"""What a sweep asks about a localizer by name; one that cannot be loaded is no reason to stop."""

from collections.abc import Iterable
from functools import cache

import localizers
from benchmarks.setup.names import scenario_digest
from benchmarks.trials.provenance import provenance
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError
from localizers import names, parameters


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


def takes(name: str) -> tuple[str, ...] | None:
    """Return the names of a localizer's parameters; None if it takes any, or cannot be loaded.

    Trials of a plug-in that cannot be loaded fail with the reason.

    Raises:
        InputError: a plain name that nobody has.
    """
    try:
        return parameters(name)
    except InputError:
        if _elsewhere(name):
            return None
        raise


def loads(name: str) -> bool:
    """Whether a localizer can be loaded."""
    try:
        parameters(name)
    except InputError:
        return False
    return True


def source_digest(name: str) -> str:
    """Return a digest of the source of a localizer from elsewhere; "" for our own."""
    try:
        return localizers.source_digest(name) or ""
    except InputError:  # it cannot be found: its trials fail with the reason
        return ""


def _elsewhere(name: str) -> bool:
    return ":" in name or name in names()
