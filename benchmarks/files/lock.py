"""One writer at a time in a folder; the lock of a dead process does not count."""

import contextlib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from deqmcl_gym.validation import InputError

try:
    import fcntl
except ImportError:  # Windows has no such locks: there, users must avoid two sweeps in one folder
    fcntl = None  # type: ignore[assignment]

_NAME = re.compile(r"\.deqmcl(-[a-z0-9-]+)?\.lock")


def is_lock(path: Path) -> bool:
    """Whether a file is a lock of ours."""
    return _NAME.fullmatch(path.name) is not None and path.is_file() and not path.is_symlink()


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Wait until nobody else writes tables and pictures into ``folder``, and keep others waiting.

    Shards of a sweep run at the same time, but each writes its report alone.
    """
    with _held(folder, ".deqmcl-writing.lock", shared=False, wait=True):
        yield


@contextmanager
def locked(folder: Path, shard: str | None = None) -> Iterator[None]:
    """Keep others from writing to ``folder``, for as long as this process lives.

    The operating system holds the lock (flock) and drops it when the process dies, however it
    dies. A whole sweep is alone in its folder; different shards share it, the same one does not.

    Raises:
        InputError: a living process has the lock.
    """
    with contextlib.ExitStack() as held:
        if shard is None:
            held.enter_context(_held(folder, ".deqmcl.lock", shared=False))
        else:
            own = f".deqmcl-{shard.replace('/', '-of-')}.lock"
            held.enter_context(_held(folder, ".deqmcl.lock", shared=True))
            held.enter_context(_held(folder, own, shared=False))
        yield


@contextmanager
def _held(folder: Path, name: str, *, shared: bool, wait: bool = False) -> Iterator[None]:
    file = _acquired(folder, name, shared=shared, wait=wait)
    try:
        if not shared:
            file.truncate(0)
            file.write(f"{os.getpid()}\n")
            file.flush()
        yield
    finally:
        _released(file, folder / name)


def _released(file: IO[str], path: Path) -> None:
    """Remove the file, unless others still share it."""
    if fcntl is None:
        file.close()  # Windows removes no open file …
        with contextlib.suppress(PermissionError):  # … such as that of another shard
            path.unlink(missing_ok=True)
        return
    if _got(file, shared=False):
        path.unlink(missing_ok=True)
    file.close()


def _acquired(folder: Path, name: str, *, shared: bool, wait: bool) -> IO[str]:
    path = folder / name
    if os.path.lexists(path) and not is_lock(path):
        raise InputError(f"{path} is in the way of a lock of that name: move it away.")
    while True:
        file = path.open("a+")
        if not _got(file, shared=shared, wait=wait):
            with file:
                file.seek(0)
                holder = file.read().strip()
            who = f"another sweep (process {holder})" if holder else "another sweep"
            raise InputError(
                f"{who} is writing to {folder}: wait until it ends, or give another --out."
            )
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                return file
        file.close()  # its last holder removed it just now


def _got(file: IO[str], *, shared: bool, wait: bool = False) -> bool:
    if fcntl is None:
        return True
    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    try:
        fcntl.flock(file, kind if wait else kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
