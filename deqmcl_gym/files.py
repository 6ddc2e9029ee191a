"""A file written whole or not at all."""

import os
import tempfile
from pathlib import Path

PREFIX, SUFFIX = ".deqmcl-", ".tmp"  # of the temporary file that an interrupted write leaves


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: first to a temporary file beside it, then renamed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=PREFIX, suffix=SUFFIX)
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
            error.filename = str(path)  # for a full disk, Python names no file
        raise
