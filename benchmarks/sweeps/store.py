"""Results on disk: one file per trial, finished or failed, written whole or not at all."""

import hashlib
import json
import os
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import Meta, Struct

from benchmarks.trials.scoring import Finished, Record
from benchmarks.trials.spec import Trial
from deqmcl_gym.files import (
    UnreadableError,
    content_of,
    is_temporary,
    json_of,
    typed,
    writable_folder,
    write_text,
)
from deqmcl_gym.validation import InputError, one_line

SCHEMA = 4

FOLDERS = ("trials", "timings", "failed")


class _Kept(Record, frozen=True, kw_only=True):
    """A file of trials/."""

    trial: dict[str, Any]


class _Timed(Struct, frozen=True):
    """A file of timings/."""

    seconds: Annotated[float, Meta(ge=0, le=1e9)]


class _Failed(Struct, frozen=True):
    """A file of failed/."""

    trial: dict[str, Any]
    reason: str


K = TypeVar("K", bound=_Kept | _Timed | _Failed)
_FOLDER: dict[type, str] = dict(zip((_Kept, _Timed, _Failed), FOLDERS, strict=True))


class Store:
    """Trials in a folder, by key; timings apart, as they alone depend on the machine.

    A file carries its schema, its key and a checksum of its content. One that is torn, edited or
    of something else counts as missing. The checksum finds accidents: who changes a file on purpose
    can make it anew.

    Attributes:
        out: the folder.
        rejected: files that were not taken for what they should be, and why.
    """

    def __init__(self, out: Path, *, reading: bool = False) -> None:
        """Open ``out`` (made if missing), or look at what is there if it is only read.

        Raises:
            InputError: it is to be written to, and is a file or cannot be.
        """
        self.out = out if reading else writable_folder(out)
        self.rejected: dict[str, str] = {}

    def get(self, key: str, trial: Trial) -> Finished | None:
        """Return a finished trial; None if missing or rejected."""
        kept = self._read(_Kept, key, trial)
        if kept is None:
            return None
        timed = self._read(_Timed, key)
        known = {"trial": trial, "key": key, "seconds": None if timed is None else timed.seconds}
        return Finished(**(msgspec.structs.asdict(kept) | known))

    def put(self, key: str, trial: Trial, record: Record, seconds: float) -> None:
        """Keep a finished trial. The timing goes first: a trial that is there is complete.

        Raises:
            ValueError: it is no record, or holds a number that is not finite.
        """
        content = msgspec.to_builtins(record, str_keys=True, enc_hook=float)  # NumPy's numbers
        self._write(_Timed, key, {"seconds": seconds})
        self._write(_Kept, key, {"trial": trial.canonical()} | content)
        self._path(_Failed, key).unlink(missing_ok=True)

    def failure(self, key: str, trial: Trial) -> str | None:
        """Return the reason why a trial failed; None if it did not."""
        failed = self._read(_Failed, key, trial)
        return None if failed is None else failed.reason

    def put_failure(self, key: str, trial: Trial, reason: str) -> None:
        """Keep the reason why a trial failed."""
        self._write(_Failed, key, {"trial": trial.canonical(), "reason": reason})

    def refuse_obstacles(self, keys: Collection[str]) -> None:
        """Refuse a folder where something that is no file is in the way of one of ours.

        Raises:
            InputError: naming it.
        """
        for name in FOLDERS:
            folder = self.out / name
            if os.path.lexists(folder) and (folder.is_symlink() or not folder.is_dir()):
                raise InputError(f"{folder} is in the way of a folder of that name: move it away.")
            for path in folder.glob("*.json"):
                if path.stem in keys and (path.is_symlink() or not path.is_file()):
                    raise InputError(f"{path} is in the way of a file of that name: move it away.")

    def temporary(self) -> list[Path]:
        """Return what interrupted writes have left in the folders of trials, and beside them."""
        folders = [self.out, *(self.out / name for name in FOLDERS)]
        return sorted(p for folder in folders for p in folder.glob(".*") if is_temporary(p))

    def left_out(self, keys: Collection[str], asked: Collection[str]) -> Iterator[tuple[str, str]]:
        """Yield the files that belong to none of these keys, and why.

        Args:
            keys: of the trials asked for.
            asked: the same trials as ``named``.
        """
        kinds: tuple[type[_Kept | _Failed], ...] = (_Kept, _Failed)
        for kind in kinds:
            for path in sorted((self.out / _FOLDER[kind]).glob("*")):
                if is_temporary(path) or (path.stem in keys and path.suffix == ".json"):
                    continue
                why = "is no file of a trial"
                if path.suffix == ".json":
                    try:
                        same = named(_checked(path, kind, path.stem).trial) in asked
                        why = f"is of {'other code, libraries or plug-ins' if same else NOT_ASKED}"
                    except (UnreadableError, FileNotFoundError) as error:
                        why = str(error)
                yield one_line(f"{_FOLDER[kind]}/{path.name}"), why

    def _path(self, kind: type, key: str) -> Path:
        return self.out / _FOLDER[kind] / f"{key}.json"

    def _write(self, kind: type, key: str, content: dict[str, Any]) -> None:
        typed(content, kind)
        signed = {"schema": SCHEMA, "key": key} | content
        text = _json(signed | {"checksum": _checksum(signed)})
        write_text(self._path(kind, key), text, synced=False)  # the checksum tells an empty file

    def _read(self, kind: type[K], key: str, trial: Trial | None = None) -> K | None:
        path = self._path(kind, key)
        try:
            content = _checked(path, kind, key)
            if not isinstance(content, _Timed) and trial and content.trial != trial.canonical():
                raise UnreadableError("is of another trial")
        except FileNotFoundError:
            return None
        except UnreadableError as error:
            self.rejected[f"{_FOLDER[kind]}/{path.name}"] = str(error)
            return None
        return content


NOT_ASKED = "a trial that this sweep does not have"


def named(canonical: dict[str, Any]) -> str:
    """Return a canonical trial as a text that is the same for the same one."""
    return json.dumps(canonical, sort_keys=True)


def _checked(path: Path, kind: type[K], key: str) -> K:
    """Return the content of a file if it is whole, ours, and as it was written."""
    content = json_of(content_of(path))
    if (schema := content.get("schema")) != SCHEMA:
        raise UnreadableError(f"has schema {str(schema)[:20]}, not {SCHEMA}")
    if content.get("key") != key:
        raise UnreadableError("is of another trial")
    given = content.pop("checksum", None)
    try:
        expected = _checksum(content)
    except ValueError:  # 1e999 is valid JSON
        raise UnreadableError("holds a number that is infinite") from None
    if given != expected:
        raise UnreadableError("was changed after it was written: its checksum does not match")
    try:
        return typed(content, kind)
    except UnreadableError as error:
        raise UnreadableError(f"{error}, as no trial has") from None


def _checksum(content: dict[str, Any]) -> str:
    return hashlib.sha256(_json(content).encode()).hexdigest()


def _json(value: Any) -> str:
    return json.dumps(value, allow_nan=False, separators=(",", ":"), sort_keys=True) + "\n"
