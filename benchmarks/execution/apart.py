"""Calls that may run a plug-in, each in a process of its own: what it does there ends there.

No code of a localizer, scenario or agent from elsewhere runs in the process of a command, not even
its import: its trials run in workers (``engines``), and all else that is asked of it is asked here.
The exceptions are what was registered in this very process, and a ``module:factory`` executor that
runs here.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import replace
from functools import cache
from itertools import groupby
from typing import TypeVar

import localizers
from benchmarks.execution.processes import Processes, TimedOutError, WorkerDiedError
from benchmarks.setup.names import plug_ins_of, scenario_digest
from benchmarks.trials.plugins import guest_of, provenance_of, setup_guests
from benchmarks.trials.provenance import Provenance
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.validation import InputError, in_words
from localizers.naming.plugins import is_reference
from localizers.naming.registry import is_plug_in

T = TypeVar("T")
Parameters = tuple[str, ...] | None  # names; None is any

_SECONDS = ContextVar("seconds to answer a question", default=60.0)


@contextmanager
def answered_within(seconds: float | None) -> Iterator[None]:
    """Give plug-ins so long to be imported and made when they are asked; None is a minute."""
    token = _SECONDS.set(_SECONDS.get() if seconds is None else seconds)
    try:
        yield
    finally:
        _SECONDS.reset(token)


def apart(function: Callable[..., T], *arguments: object, timeout: float | None = None) -> T:
    """Return ``function(*arguments)``, called in a process of its own.

    Raises:
        WorkerDiedError: the process ended.
        TimedOutError: it took longer than ``timeout`` s, by default what any guest may take.
    """
    with Processes(1, timeout=timeout, guest_of=lambda *_: "a guest") as process:
        answer: T = process.submit(function, *arguments).result()
    return answer


def where_safe(trials: Collection[Trial], function: Callable[..., T], *arguments: object) -> T:
    """Return ``function(*arguments)``, which runs these trials; apart if they have plug-ins."""
    guests = " ".join(dict.fromkeys(filter(None, map(guest_of, trials))))
    if not guests:
        return function(*arguments)
    try:
        return apart(function, *arguments)
    except (WorkerDiedError, TimedOutError) as error:
        raise RuntimeError(f"{guests}: {error}") from None


def parameters(name: str) -> Parameters:
    """Return what ``localizers.parameters`` does, without running a plug-in here.

    Raises:
        InputError: there is no such localizer, or it cannot be loaded.
    """
    if not is_plug_in(name):
        return localizers.parameters(name)
    found = localizers.absolute_name(name)
    said = _asked(found, localizers.source_digest(name))
    if isinstance(said, str):
        raise InputError(said.replace(repr(found), repr(name)))
    return said


def takes(name: str) -> Parameters:
    """Return the names of a localizer's parameters; None if it takes any, or cannot be loaded.

    Trials of a plug-in that cannot be loaded fail with the reason.

    Raises:
        InputError: a plain name that nobody has.
    """
    try:
        return parameters(name)
    except InputError:
        if is_reference(name) or name in localizers.names():
            return None
        raise


def provenance(trials: Iterable[Trial]) -> Provenance:
    """Return what the numbers of these trials depend on, as it is now.

    Raises:
        InputError: a scenario cannot be read, or is refused.
    """
    return provenance_of(
        trials, lambda name: _asked_setup(plug_ins_of(name), scenario_digest, name)
    )


def check_settings(trials: Iterable[Trial]) -> None:
    """Build the world of each trial, what its filters assume, and its agent.

    Raises:
        InputError: something of it is refused, or a plug-in fails at it.
    """
    by_guests: dict[tuple[str, tuple[str, ...]], list[Trial]] = {}
    for trial in trials:
        by_guests.setdefault((trial.scenario, setup_guests(trial)), []).append(trial)
    for (_, guests), own in by_guests.items():
        _asked_setup(guests, _check_settings, own)


def check_methods(trials: Collection[Trial]) -> None:
    """Let the localizer of each trial look at its parameters; see ``Stage.check_params``.

    Raises:
        InputError: one refuses them. Any other trouble of a plug-in is left to its trials.
    """
    by_guest: dict[str, list[Trial]] = {}
    for trial in trials:
        try:
            parameters(trial.localizer)
        except InputError:
            continue
        by_guest.setdefault(guest_of(trial), []).append(trial)
    _check_all(by_guest.pop("", ()))
    for own in by_guest.values():
        checked_apart(_check_all, own)


def checked_apart(check: Callable[..., None], *arguments: object) -> None:
    """Call a check of a plug-in; if it ends its process or takes too long, its trials will tell.

    Raises:
        InputError: the check does.
    """
    with suppress(WorkerDiedError, TimedOutError):
        apart(check, *arguments, timeout=_SECONDS.get())


def _check_settings(trials: Collection[Trial]) -> None:
    for trial in trials:
        Stage.of(trial).check()


def _asked_setup(plug_ins: Sequence[str], function: Callable[..., T], *arguments: object) -> T:
    """Return ``function(*arguments)``, which sets up a scenario; apart if it has plug-ins."""
    guests = " with ".join(map(repr, plug_ins))
    if not guests:
        return function(*arguments)
    try:
        return apart(function, *arguments, timeout=_SECONDS.get())
    except (InputError, BrokenExecutor):
        raise
    except Exception as error:
        ended = isinstance(error, WorkerDiedError | TimedOutError)
        words = str(error) if ended else in_words(error)
        raise InputError(f"{guests} cannot be set up: {words.rstrip('.')}.") from None


def _check_all(trials: Collection[Trial]) -> None:
    for _, own in groupby(trials, lambda t: (t.scenario, t.world, t.assumed, t.disturbance)):
        first, *others = own
        stage = Stage.of(first)
        for trial in (first, *others):
            replace(stage, trial=trial).check_params()


@cache  # by its source, too: an edited plug-in is asked again
def _asked(name: str, digest: str | None) -> Parameters | str:
    """Return a plug-in's parameters, or why they cannot be had."""
    del digest
    try:
        return apart(localizers.parameters, name, timeout=_SECONDS.get())
    except BrokenExecutor:  # there are no processes to ask
        raise
    except InputError as error:
        return str(error)
    except Exception as error:
        return f"the localizer {name!r} cannot be imported: {str(error).rstrip('.')}."
