"""What laws of localizers, agents and scan models share: a subject, verdicts, equality of runs.

And what they watch of this process: its global state, its threads, the processes it started.
"""

import os
import pickle
import random
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from localizers.kinds import is_ctrl_c, raised

Law = Callable[[Any], str | None]  # of a subject; it may return a remark
Laws = Mapping[Law, Law | None]  # each with the one that must hold before it is tried


class LawBrokenError(Exception):
    """A law is broken; the text is the reason."""


class LawSkippedError(Exception):
    """A law does not apply; the text is the reason."""


@dataclass(frozen=True, kw_only=True)
class Subject:
    """What is under check.

    Its kind says what to use instead of global random numbers (the ``remedy``); ``time_limit`` is
    in s.
    """

    remedy: ClassVar[str]
    name: str
    time_limit: float = 60.0

    @property
    def file(self) -> str | None:
        """The file that it is written in; an exception is told as a line of it."""
        return self.name.rpartition(":")[0]

    def history(self) -> Sequence[Any]:
        """Return what it, made anew, answers at each step of one and the same drive."""
        raise NotImplementedError

    def written(self) -> str | None:
        """Name what it writes into of all that it is given on the drive."""
        raise NotImplementedError

    def require_same(self, run: Sequence[Any], otherwise: str) -> None:
        """Raise with ``otherwise`` and from which step on, unless a run is its history, bitwise."""
        for t, (one, other) in enumerate(zip_longest(run, self.history())):
            if difference(one, other) is not None:
                raise LawBrokenError(f"{otherwise} (from step {t} on)")


@dataclass(frozen=True)
class LawVerdict:
    """The verdict on one law; the note is a reason or a remark."""

    law: str
    status: Literal["ok", "FAILED", "skipped"]
    note: str = ""
    error: BaseException | None = field(default=None, compare=False)

    def __str__(self) -> str:
        return f"{self.status:<8} {self.law}{': ' if self.note else ''}{self.note}"


@dataclass(frozen=True)
class Report:
    """The verdicts on all laws; each is tried once, by ``attempt``, when it is asked for.

    ``needs`` has the laws in their order, each with the one that must hold before it is tried.
    """

    name: str
    needs: Mapping[str, str | None]
    attempt: Callable[[str], LawVerdict]
    _tried: dict[str, LawVerdict] = field(default_factory=dict, init=False, repr=False)

    @property
    def verdicts(self) -> tuple[LawVerdict, ...]:
        """One per law, in their order."""
        return tuple(map(self.verdict, self.needs))

    @property
    def failed(self) -> tuple[LawVerdict, ...]:
        """Those of the laws that failed."""
        return tuple(verdict for verdict in self.verdicts if verdict.status == "FAILED")

    @property
    def passed(self) -> bool:
        """Whether no law failed."""
        return not self.failed

    def __str__(self) -> str:
        return "\n".join([f"{self.name}:", *map(str, self.verdicts)])

    def verdict(self, law: str) -> LawVerdict:
        """Return the verdict on a law; one that needs a law that failed is skipped."""
        need = self.needs[law]
        while need is not None and self.verdict(need).status != "FAILED":
            need = self.needs[need]
        if need is not None:
            return LawVerdict(law, "skipped", f"it fails {need!r}")
        if law not in self._tried:
            self._tried[law] = self.attempt(law)
        return self._tried[law]


def report_of(subject: Subject, laws: Laws) -> Report:
    """Return the verdicts of laws that are tried in this process, whose state is put back."""
    by_name = {law_name(law): law for law in laws}
    needs = {law_name(law): need and law_name(need) for law, need in laws.items()}
    return Report(subject.name, needs, lambda name: _tried(subject, name, by_name[name]))


def _tried(subject: Subject, name: str, law: Law) -> LawVerdict:
    try:
        with state_kept():
            return LawVerdict(name, "ok", law(subject) or "")
    except LawSkippedError as reason:
        return LawVerdict(name, "skipped", str(reason))
    except LawBrokenError as reason:
        return LawVerdict(name, "FAILED", str(reason), reason)
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        return LawVerdict(name, "FAILED", f"it raised {raised(error, subject.file)}", error)


def law_name(law: Law) -> str:
    """Return the name of a law, such as "same rng same result"."""
    return law.__name__.replace("_", " ")


def difference(before: object, after: object) -> str | None:
    """Name the first number, word or array inside ``before`` that is another one in ``after``.

    What an object has only ``after``, such as caches, is no difference.
    """
    values = dict(_values(after))
    for name, value in _values(before):
        numeric = np.asarray(value).dtype.kind == "f"
        if name not in values or not np.array_equal(value, values[name], equal_nan=numeric):
            return name
    return None


def _values(thing: Any, name: str = "", depth: int = 8) -> Iterator[tuple[str, Any]]:
    """Yield all numbers, words, arrays and lengths inside an object, by where they are."""
    parts: Iterable[tuple[str, Any]] = ()
    if thing is None or isinstance(thing, np.ndarray | np.generic | int | float | str):
        yield name, thing
    elif isinstance(thing, tuple | list):
        yield name, len(thing)
        parts = ((f"{name}[{index}]", value) for index, value in enumerate(thing))
    elif isinstance(thing, Mapping):
        yield name, len(thing)
        parts = ((f"{name}.{key}".lstrip("."), value) for key, value in thing.items())
    elif hasattr(thing, "__dict__"):
        parts = ((f"{name}.{key}", value) for key, value in vars(thing).items())
    if depth:
        for where, value in parts:
            yield from _values(value, where, depth - 1)


GLOBAL_RNG = "the global random numbers of numpy or random"
ADDED_BY_IMPORTS = ("the filters of warnings", "os.environ", "sys.path", GLOBAL_RNG)


def _set_handlers(handlers: Mapping[int, Any]) -> None:
    for number, handler in handlers.items():
        if handler is not None and handler != signal.getsignal(number):
            signal.signal(number, handler)


def _set_environment(variables: Mapping[str, str]) -> None:
    os.environ.clear()
    os.environ.update(variables)


def _global_rng() -> bytes:
    return pickle.dumps((np.random.get_state(), random.getstate()))  # noqa: NPY002


def _set_global_rng(states: bytes) -> None:
    of_numpy, of_random = pickle.loads(states)
    np.random.set_state(of_numpy)  # noqa: NPY002
    random.setstate(of_random)


_STATES: dict[str, tuple[Callable[[], Any], Callable[[Any], object]]] = {  # how to read and set it
    "the working folder": (os.getcwd, os.chdir),
    "signal handlers": (
        lambda: {number: signal.getsignal(number) for number in signal.valid_signals()},
        _set_handlers,
    ),
    "np.seterr": (np.geterr, lambda kept: np.seterr(**kept)),
    "np.set_printoptions": (np.get_printoptions, lambda kept: np.set_printoptions(**kept)),
    "the filters of warnings": (
        lambda: list(warnings.filters),
        lambda kept: setattr(warnings, "filters", kept),
    ),
    "os.environ": (lambda: dict(os.environ), _set_environment),
    "the recursion limit": (sys.getrecursionlimit, sys.setrecursionlimit),
    "sys.path": (lambda: list(sys.path), lambda kept: setattr(sys, "path", kept)),
    GLOBAL_RNG: (_global_rng, _set_global_rng),
}


def process_state() -> dict[str, Any]:
    """Return the global state of this process, by name."""
    return {name: read() for name, (read, _) in _STATES.items()}


def changes_since(before: Mapping[str, Any]) -> list[str]:
    """Name what is not as it was."""
    return [name for name, now in process_state().items() if now != before[name]]


@contextmanager
def state_kept() -> Iterator[None]:
    """Put the global state of this process back after a block."""
    before = process_state()
    try:
        yield
    finally:
        for name in changes_since(before):
            _STATES[name][1](before[name])


def running() -> dict[str, str]:
    """Name this process's threads and, as far as /proc shows them, the processes it started."""
    names = {f"thread {one.ident}": f"the thread {one.name!r}" for one in threading.enumerate()}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it is gone
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
            if state != "Z" and parent == str(os.getpid()):
                names[f"process {stat.parent.name}"] = f"the process {stat.parent.name}"
    return names
