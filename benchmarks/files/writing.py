"""A folder that can be written to; a file written whole or not at all."""

import os
import tempfile
from pathlib import Path

from deqmcl_gym.validation import InputError


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
            f"the output folder {path} is a file, or is inside one: give a folder."
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
