"""Results on disk: one file per finished trial, written whole or not at all."""

import json
import os
import tempfile
from pathlib import Path
from typing import Any

from deqmcl_gym.validation import InputError

SCHEMA = 1


class Store:
    """Finished trials in a folder, by key; timings apart, as they alone depend on the machine."""

    def __init__(self, out: Path) -> None:
        """Open ``out`` (made if missing).

        Raises:
            InputError: it is a file, or cannot be written to.
        """
        self.out = writable_folder(out)
        self._trials = self.out / "trials"
        self._timings = self.out / "timings"

    def get(self, key: str) -> dict[str, Any] | None:
        """Return a finished trial's record, with its timing; None if missing or damaged."""
        record = _read(self._trials / f"{key}.json")
        if record is None or record.get("schema") != SCHEMA or record.get("key") != key:
            return None
        timing = _read(self._timings / f"{key}.json") or {}
        return record | {"seconds": timing.get("seconds")}

    def put(self, key: str, record: dict[str, Any], seconds: float) -> None:
        """Keep a finished trial. The timing goes first: a trial that is there is complete."""
        write_text(self._timings / f"{key}.json", _json({"seconds": seconds}))
        write_text(self._trials / f"{key}.json", _json({"schema": SCHEMA, "key": key} | record))


def writable_folder(path: Path) -> Path:
    """Make a folder if it is missing.

    Raises:
        InputError: it is a file, or cannot be written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except (FileExistsError, NotADirectoryError):
        raise InputError(
            f"the output folder {path} is a file, or lies below one: give a folder."
        ) from None
    except OSError as error:
        raise InputError(
            f"the output folder {path} cannot be written to ({error.strerror}): give another one."
        ) from None
    return path


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: beside it first, then renamed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException as error:
        Path(name).unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename = str(path)  # a full disk does not say which file
        raise


def _json(value: Any) -> str:
    return json.dumps(value, allow_nan=False, separators=(",", ":"), sort_keys=True) + "\n"


def _read(path: Path) -> dict[str, Any] | None:
    try:
        value = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    return value if isinstance(value, dict) else None
