"""Results on disk: one file per trial, finished or failed, written whole or not at all."""

import hashlib
import json
from collections.abc import Collection
from pathlib import Path
from typing import Any, NoReturn

from benchmarks.files import writable_folder, write_text

SCHEMA = 3


class Store:
    """Trials in a folder, by key; timings apart, as they alone depend on the machine.

    A file carries its schema, its key and a checksum of its content. One that is torn, edited or
    of something else counts as missing.

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

    def get(self, key: str) -> dict[str, Any] | None:
        """Return a finished trial's record, with its timing; None if missing or rejected."""
        record = self._read("trials", key)
        if record is None:
            return None
        timing = self._read("timings", key) or {}
        return record | {"seconds": timing.get("seconds")}

    def put(self, key: str, record: dict[str, Any], seconds: float) -> None:
        """Keep a finished trial. The timing goes first: a trial that is there is complete."""
        self._write("timings", key, {"seconds": seconds})
        self._write("trials", key, record)
        self._path("failed", key).unlink(missing_ok=True)

    def failure(self, key: str) -> dict[str, Any] | None:
        """Return the ``trial`` that failed and the ``reason`` why; None if it did not."""
        return self._read("failed", key)

    def put_failure(self, key: str, trial: dict[str, Any], reason: str) -> None:
        """Keep the reason why a trial failed."""
        self._write("failed", key, {"trial": trial, "reason": reason})

    def strays(self, keys: Collection[str]) -> dict[str, str]:
        """Return the files that belong to none of these keys, and what they are.

        A temporary file, anywhere, is what an interrupted write leaves.
        """
        left = "was left by an interrupted write"
        found = {
            path.relative_to(self.out).as_posix(): left
            for folder in (self.out, self.out / "timings", self.out / "images")
            for path in sorted(folder.glob(".*.tmp"))
        }
        for folder in ("trials", "failed"):
            for path in sorted((self.out / folder).glob("*")):
                if path.name.endswith(".tmp"):
                    found[f"{folder}/{path.name}"] = left
                elif path.suffix != ".json" or path.stem not in keys:
                    found[f"{folder}/{path.name}"] = "is not a trial of this sweep"
        return found

    def keys(self, folder: str) -> list[str]:
        """Return the names of the files in "trials" or "failed", whatever has made them."""
        return sorted(path.stem for path in (self.out / folder).glob("*.json"))

    def _path(self, folder: str, key: str) -> Path:
        return self.out / folder / f"{key}.json"

    def _write(self, folder: str, key: str, content: dict[str, Any]) -> None:
        signed = {"schema": SCHEMA, "key": key} | content
        write_text(self._path(folder, key), _json(signed | {"checksum": _checksum(signed)}))

    def _read(self, folder: str, key: str) -> dict[str, Any] | None:
        path = self._path(folder, key)
        try:
            text = path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError) as error:
            self.rejected[f"{folder}/{path.name}"] = f"cannot be read ({error})"
            return None
        try:
            return _checked(text, key)
        except _RejectedError as error:
            self.rejected[f"{folder}/{path.name}"] = str(error)
            return None


class _RejectedError(ValueError):
    """Why a file is not what it should be."""


def _checked(text: str, key: str) -> dict[str, Any]:
    """Return the content of a file if it is whole, ours, and as it was written."""
    try:
        content = json.loads(text, parse_constant=_refuse_constant)
    except _RejectedError:
        raise
    except ValueError:
        raise _RejectedError("is torn or not JSON") from None
    if not isinstance(content, dict):
        raise _RejectedError("is not a JSON object")
    if content.get("schema") != SCHEMA:
        raise _RejectedError(f"has schema {content.get('schema')}, not {SCHEMA}")
    if content.get("key") != key:
        raise _RejectedError("belongs to another trial")
    given = content.pop("checksum", None)
    try:
        expected = _checksum(content)
    except ValueError:  # 1e999 is valid JSON
        raise _RejectedError("holds a number that is infinite") from None
    if given != expected:
        raise _RejectedError("was changed after it was written: its checksum does not match")
    del content["schema"], content["key"]
    return content


def _refuse_constant(name: str) -> NoReturn:
    raise _RejectedError(f"holds {name}, which is not a number")


def _checksum(content: dict[str, Any]) -> str:
    return hashlib.sha256(_json(content).encode()).hexdigest()


def _json(value: Any) -> str:
    return json.dumps(value, allow_nan=False, separators=(",", ":"), sort_keys=True) + "\n"
