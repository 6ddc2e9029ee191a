"""A file written whole or not at all."""

import gzip
import os
import tempfile
from pathlib import Path

from deqmcl_gym.validation import InputError


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file beside its place, then rename it; packed if its name ends in .gz.

    Raises:
        InputError: it cannot be written there.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            draft = Path(folder) / path.name
            packed = path.suffix.lower() == ".gz"
            draft.write_bytes(gzip.compress(content, mtime=0) if packed else content)
            os.replace(draft, path)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror}): give another path."
        ) from None
