"""One sweep at a time in a folder; the lock of a process that is gone counts for nothing."""

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from deqmcl_gym.validation import InputError

try:
    import fcntl
except ImportError:  # no such locks on Windows: there, two sweeps are the user's to avoid
    fcntl = None  # type: ignore[assignment]


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
            held.enter_context(_held(folder, ".lock", shared=False))
        else:
            held.enter_context(_held(folder, ".lock", shared=True))
            held.enter_context(_held(folder, f".lock-{shard.replace('/', '-of-')}", shared=False))
        yield


@contextmanager
def _held(folder: Path, name: str, *, shared: bool) -> Iterator[None]:
    file = _acquired(folder, name, shared=shared)
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


def _acquired(folder: Path, name: str, *, shared: bool) -> IO[str]:
    path = folder / name
    while True:
        file = path.open("a+")
        if not _got(file, shared=shared):
            with file:
                raise InputError(_taken(folder, file))
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                return file
        file.close()  # its last holder removed it just now


def _got(file: IO[str], *, shared: bool) -> bool:
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _taken(folder: Path, file: IO[str]) -> str:
    file.seek(0)
    holder = file.read().strip()
    who = f"another sweep (process {holder})" if holder else "another sweep"
    return f"{who} is writing to {folder}: wait until it ends, or give another --out."
