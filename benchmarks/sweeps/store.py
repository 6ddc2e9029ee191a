"""The folder of a command, and in it the trials that ended, as lines of ``trials*.jsonl``.

These are appended, read, and joined by ``cat``.
A line is {"key", "trial", "record", "seconds", "crc"}, or {"key", "trial", "reason", "crc"} of a
trial that failed; "crc" is that of the line without it. The last record of a key counts, and a
reason where there is no record.
"""

import json
import os
import zlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Annotated, Any

import msgspec
from msgspec import Meta, Struct

from benchmarks.trials import Trial
from benchmarks.trials.scoring import Finished, TrialRecord
from deqmcl_gym import files
from deqmcl_gym.validation import InputError, one_line

try:
    import fcntl
except ImportError:  # Windows has no such locks: there, users must avoid two sweeps in one folder
    fcntl = None  # type: ignore[assignment]


class _Line(Struct, frozen=True, kw_only=True):
    key: str
    trial: dict[str, Any]
    record: TrialRecord | None = None
    seconds: Annotated[float, Meta(ge=0, le=1e9)] | None = None
    reason: str | None = None

    def __post_init__(self) -> None:
        if self.record is None and self.reason is None:
            raise ValueError("has neither a record nor a reason")


_DECODER = msgspec.json.Decoder(_Line)
_CRC = b',"crc":'


class Store:
    """The trials in a folder, by key; ``rejected`` are lines that are none, and why.

    What is put goes into ``file``.
    """

    def __init__(self, out: Path, file: IO[bytes] | None = None) -> None:
        self.out, self._file = out, file
        self.rejected: dict[str, str] = {}
        self._lines: dict[str, _Line] = {}
        self._names: dict[str, str] = {}  # of those read, by key
        if (out / "trials").is_dir():
            self.rejected["trials"] = "is of release 0.2.0, which kept a file for each trial"
        for path in sorted(out.glob("trials*.jsonl")):
            try:
                with files.opened(path) as lines:
                    for number, text in enumerate(lines, 1):
                        self._read(f"{path.name}, line {number}", text)
            except files.UnreadableError as error:
                self.rejected[path.name] = str(error)

    def _read(self, name: str, text: bytes) -> None:
        try:
            self._keep(_line(text), name)
        except files.UnreadableError as error:
            if text.endswith(b"\n"):  # else it was torn
                self.rejected[one_line(name)] = str(error)

    def _keep(self, line: _Line, name: str) -> None:
        before = self._lines.get(line.key)
        if line.record is not None or before is None or before.record is None:
            self._lines[line.key], self._names[line.key] = line, name

    def get(self, key: str, trial: Trial) -> Finished | None:
        """Return a finished trial; None if there is none."""
        line = self._lines.get(key)
        if line is None or line.record is None:
            return None
        parts = msgspec.structs.asdict(line.record)
        return Finished(**parts, trial=trial, key=key, seconds=line.seconds)

    def failure(self, key: str) -> str | None:
        """Return the reason why a trial failed; None if it did not."""
        line = self._lines.get(key)
        return line.reason if line is not None and line.record is None else None

    def put(self, key: str, trial: Trial, record: TrialRecord, seconds: float) -> None:
        """Keep a finished trial; ValueError: it is no record, or a number is not finite."""
        content = msgspec.to_builtins(record, str_keys=True, enc_hook=float)  # NumPy's numbers
        self._append(key, trial, {"record": content, "seconds": seconds})

    def put_failure(self, key: str, trial: Trial, reason: str) -> None:
        """Keep the reason why a trial failed."""
        self._append(key, trial, {"reason": reason})

    def left_out(self, keys: Collection[str], asked: Collection[str]) -> Iterator[tuple[str, str]]:
        """Yield the lines that belong to none of these keys, and why."""
        for key, line in self._lines.items():
            if key not in keys:
                same = named(line.trial) in asked
                other = "a trial that this sweep does not have"
                why = f"is of {'other code, libraries or plug-ins' if same else other}"
                yield self._names[key], why

    def _append(self, key: str, trial: Trial, parts: dict[str, Any]) -> None:
        assert self._file is not None, "the store is only read"
        content = {"key": key, "trial": trial.canonical()} | parts
        body = json.dumps(content, allow_nan=False, separators=(",", ":")).encode()[:-1]
        text = b"%s%s%d}\n" % (body, _CRC, zlib.crc32(body))
        line = _line(text)
        try:
            self._file.write(text)
            self._file.flush()
        except OSError as error:
            error.filename = self._file.name
            raise
        self._keep(line, "")


@contextmanager
def writing(out: Path, shard: tuple[int, int] | None = None) -> Iterator[Store]:
    """Open a folder (made if missing) to put trials there; a shard (i, n) has a file of its own.

    Its lock is the operating system's, which drops it when the process dies.
    """
    name = "trials.jsonl" if shard is None else "trials-{}-of-{}.jsonl".format(*shard)
    path = files.writable_folder(out) / name
    if path.exists() and not path.is_file():
        raise InputError(f"{path} is in the way of a file of that name: move it away.")
    with path.open("a+b") as file:
        if fcntl is not None:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(
                    f"another sweep is writing to {path}: wait until it ends, or give another "
                    "--out."
                ) from None
        _mend(file)
        yield Store(out, file)


def _mend(file: IO[bytes]) -> None:
    """End the last line of a file, or drop it if a process that was killed has torn it."""
    end = file.seek(0, os.SEEK_END)
    file.seek(max(0, end - files.MOST_BYTES))
    last = file.read().rpartition(b"\n")[2]
    try:
        if last:
            _line(last)
            file.write(b"\n")
    except files.UnreadableError:
        file.truncate(end - len(last))


def named(canonical: dict[str, Any]) -> str:
    """Return a canonical trial as a text that is the same for the same one."""
    return json.dumps(canonical, sort_keys=True)


def _line(text: bytes) -> _Line:
    body, mark, crc = text.rstrip(b"\n").rpartition(_CRC)
    if mark and b"%d}" % zlib.crc32(body) != crc:
        raise files.UnreadableError("is not as it was written")
    try:
        return _DECODER.decode(text)
    except (msgspec.MsgspecError, RecursionError):  # or a name that is no UTF-8, as Python has it
        return files.typed(files.json_of(text), _Line)


def is_empty(folder: Path) -> bool:
    """Whether a folder is missing, or holds nothing but what a killed process of ours leaves."""

    def is_begun(path: Path) -> bool:
        return path.match("trials*.jsonl") and path.is_file() and path.stat().st_size == 0

    try:
        return all(files.is_temporary(path) or is_begun(path) for path in folder.iterdir())
    except FileNotFoundError:
        return True
    except OSError:  # a file, or not to be read: reported when it is written to
        return not folder.is_dir()


def own_folder(folder: Path, *names: str) -> Path:
    """Make a folder for the files of a command, or take one that has one of its files already."""
    taken = (folder / "manifest.json").exists()  # by a sweep
    if not is_empty(folder) and (taken or not any((folder / name).exists() for name in names)):
        raise InputError(
            f"the output folder {folder} holds files, but none of this command's: give a new or "
            "an empty one."
        )
    return files.writable_folder(folder)


def write_files(folder: Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write files by name, over those of before, each whole or not at all; return their paths."""
    for name, content in contents.items():
        files.write_bytes(folder / name, content)
    for path in {(folder / name).parent for name in contents}:
        for left in filter(files.is_temporary, path.glob(".*")):  # of a process that was killed
            left.unlink(missing_ok=True)
    return [folder / name for name in contents]
