"""What a sweep asks about a localizer by name; one that cannot be loaded is no reason to stop."""

from collections.abc import Iterable
from functools import cache

import localizers
from benchmarks.setup.names import scenario_digest
from benchmarks.trials.provenance import Provenance, code_digest, versions
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError
from localizers import names, parameters


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
