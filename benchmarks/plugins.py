"""What a sweep asks about a localizer by name; one that cannot be loaded is no reason to stop."""

import hashlib
import inspect
from pathlib import Path

from benchmarks.provenance import provenance
from benchmarks.spec import Trial
from deqmcl_gym.validation import InputError
from localizers import names, parameters, registry


def key_of(trial: Trial) -> str:
    """Return the name under which a trial's result is kept."""
    return trial.key(provenance() + source_digest(trial.localizer))


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
    factory = registry._FACTORIES.get(name)
    if factory is None or factory.__module__.partition(".")[0] == "localizers":
        return ""
    try:
        return hashlib.sha256(Path(inspect.getfile(factory)).read_bytes()).hexdigest()
    except (OSError, TypeError):  # typed at a prompt
        return "no source"


def _elsewhere(name: str) -> bool:
    return ":" in name or name in names()
