"""Where animations come from: drawn by running trials again, or kept in the folder.

``deqmcl report`` takes only what the folder has: it runs nothing that somebody else's folder names.
"""

import hashlib
import json
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

from msgspec import Struct

from benchmarks.execution.engines import available_cpus
from benchmarks.execution.processes import Processes
from benchmarks.files import UnreadableError, content_of, json_of, typed
from benchmarks.report.laps import Lap, drawn, frames_of, joined
from benchmarks.trials.plugins import guest_of
from deqmcl_gym.validation import InputError

IMAGES, INDEX = "images", "laps.json"
_NONE = "the folder has none of these trials"
_PATIENCE = 300.0  # seconds for one animation

Promise = Callable[[], Lap]


class _Entry(Struct):
    """The keys of a lap's trials, and the digests of its pictures."""

    trials: list[str]
    webp: str
    png: str


class Animator(Protocol):
    """Gives laps their pictures."""

    def lacking(self, keys: Collection[str]) -> str:
        """Say what a report of these trials would lack; "" if nothing."""
        ...

    def working(self) -> Any:
        """Return a context in which laps are promised: a function from ``Lap`` to ``Promise``."""
        ...


class Drawing:
    """Runs the trials again, in workers: a plug-in that hangs or exits there does no harm."""

    def lacking(self, keys: Collection[str]) -> str:
        """All are drawn."""
        del keys
        return ""

    @contextmanager
    def working(self) -> Iterator[Callable[[Lap], Promise]]:
        """Start the workers; trials of different plug-ins are run apart, as in a sweep."""
        with Processes(available_cpus(), timeout=_PATIENCE, guest_of=_guest_of) as pool:
            yield lambda lap: _promised(lap, pool)


@dataclass(frozen=True)
class Kept:
    """Takes the pictures that a sweep has drawn in its folder, if they are of the same trials."""

    folder: Path

    def lacking(self, keys: Collection[str]) -> str:
        """Some may be gone, or drawn of other trials."""
        shown = {key for entry in self._index.values() for key in entry.trials}
        if not shown or not shown <= set(keys):
            return f"{_NONE} ({sorted(shown - set(keys))})"
        return ", ".join(filter(None, map(self._spoilt, self._index)))

    @contextmanager
    def working(self) -> Iterator[Callable[[Lap], Promise]]:
        """Nothing is to be started."""
        yield lambda lap: lambda: self._of(lap)

    @cached_property
    def _index(self) -> dict[str, _Entry]:
        try:
            content = content_of(self.folder / IMAGES / INDEX)
            return typed(json_of(content), dict[str, _Entry])
        except (FileNotFoundError, UnreadableError):
            return {}

    def _of(self, lap: Lap) -> Lap:
        entry = self._index.get(lap.name)
        if entry is None or entry.trials != list(lap.keys):
            raise InputError(f"{_NONE}; `deqmcl sweep` draws them.")
        if why := self._spoilt(lap.name):
            raise InputError(f"{why}; `deqmcl sweep` draws it again.")
        return replace(
            lap, animation=self._read(lap.name, "webp"), still=self._read(lap.name, "png")
        )

    def _spoilt(self, name: str) -> str | None:
        """Say what is wrong with the pictures of a lap."""
        for ending in ("webp", "png"):
            try:
                if _digest(self._read(name, ending)) != getattr(self._index[name], ending):
                    return f"{name}.{ending} was changed"
            except FileNotFoundError:
                return f"{name}.{ending} is gone"
            except UnreadableError as error:
                return f"{name}.{ending} {error}"
        return None

    def _read(self, name: str, ending: str) -> bytes:
        return content_of(self.folder / IMAGES / f"{name}.{ending}")


def lap_files(laps: Sequence[Lap]) -> dict[str, bytes]:
    """Return the pictures of laps by file name, and the index that ``Kept`` reads."""
    if not laps:
        return {}
    index = {
        lap.name: {
            "trials": list(lap.keys),
            "webp": _digest(lap.animation),
            "png": _digest(lap.still),
        }
        for lap in laps
    }
    pictures = {f"{lap.name}.webp": lap.animation for lap in laps}
    pictures |= {f"{lap.name}.png": lap.still for lap in laps}
    return pictures | {INDEX: (json.dumps(index, indent=2) + "\n").encode()}


def _promised(lap: Lap, pool: Processes) -> Promise:
    if len(set(map(guest_of, lap.trials))) <= 1:
        return pool.submit(drawn, lap).result
    parts = [pool.submit(frames_of, part) for part in lap.parts]
    return lambda: joined(lap, [row for part in parts for row in part.result()])


def _guest_of(lap: Lap) -> str:
    return max(map(guest_of, lap.trials), default="")  # the same of all: else it is in parts


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
