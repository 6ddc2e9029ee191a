"""Localizers that are registered in this process alone, sent to others that are to run them."""

import contextlib
import pickle
import sys
import sysconfig
from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.execution.processes import Processes
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError, in_words
from localizers.digests import OURS
from localizers.registry import LOCALIZER


def knows(trial: Trial) -> bool:
    """Whether a trial's localizer is registered where this is called."""
    return trial.localizer in LOCALIZER.added


class Sending(Executor):
    """Processes that are sent what was registered here with each trial of it, unless they know it.

    They know what a script registers at its top level, which they run, too.
    """

    def __init__(self, processes: Processes) -> None:
        self._processes = processes
        self._packed: dict[str, bytes] = {}

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have ``fn(trial, …)`` run by a process that knows the trial's localizer."""
        trial, *rest = args
        if (name := trial.localizer) not in LOCALIZER.added:
            return self._processes.submit(fn, *args, **kwargs)
        if name not in self._packed:
            self._packed[name] = b"" if self._is_known(trial) else _packed(name)
        if not (packed := self._packed[name]):
            return self._processes.submit(fn, *args, **kwargs)
        return self._processes.submit(_with_sent, trial, packed, fn, *rest)

    def _is_known(self, trial: Trial) -> bool:
        try:
            return bool(self._processes.submit(knows, trial).result())
        except RuntimeError:  # the process died: its trials will tell
            return True


def _packed(name: str) -> bytes:
    """Return a registered localizer as bytes, with the code of its module if that is one's own."""
    import cloudpickle

    factory: Any = LOCALIZER.resolve(name)
    whole = factory
    while isinstance(whole, partial):
        whole = whole.func
    home = sys.modules.get(getattr(whole, "__module__", ""))
    ours = [Path(__file__).parents[2] / package for package in OURS]
    installed = [*map(Path, (sys.prefix, *sysconfig.get_paths().values())), *ours]
    file = getattr(home, "__file__", None)
    try:
        with contextlib.ExitStack() as stack:
            if (
                home is not None
                and file is not None
                and not any(Path(file).is_relative_to(place) for place in installed)
            ):
                cloudpickle.register_pickle_by_value(home)
                stack.callback(cloudpickle.unregister_pickle_by_value, home)
            return bytes(cloudpickle.dumps(factory))
    except Exception as error:
        raise InputError(
            f"the localizer {name!r} cannot be sent to other processes ({in_words(error)}): give "
            "jobs=1, or name it as file.py:NAME."
        ) from None


def _with_sent(trial: Trial, packed: bytes, fn: Callable[..., Any], *rest: Any) -> Any:
    if trial.localizer not in LOCALIZER.added:
        LOCALIZER.added[trial.localizer] = pickle.loads(packed)
        LOCALIZER.received.add(trial.localizer)
    return fn(trial, *rest)
