"""Writing of log files, compressed or not."""

import gzip
from pathlib import Path

from deqmcl_gym.files import write_bytes
from deqmcl_gym.validation import InputError


def save(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; compressed if its name ends in .gz.

    Raises:
        InputError: it cannot be written there.
    """
    packed = path.suffix.lower() == ".gz"
    try:
        write_bytes(path, gzip.compress(content, mtime=0) if packed else content)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror}): give another path."
        ) from None
