"""An inventory of the files we wrote in a folder: nothing else there is overwritten or removed.

``written.json`` holds, by part (a report, the figures, …), a digest of what the part was made from
and the size and SHA-256 of each of its files. A file that it does not list, or that has another
content, is the user's. Files are made again only if their source, or one of them, has changed. One
writes at a time in a folder; the lock of a dead process does not count.
"""

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from msgspec import Struct, to_builtins

from deqmcl_gym.files import (
    UnreadableError,
    content_of,
    is_possible,
    is_temporary,
    json_of,
    opened,
    typed,
    writable_folder,
    write_bytes,
    write_text,
)
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


NAME = "written.json"


class Part(Struct, frozen=True):
    """What a part was made from, and the digests that each of its files may have."""

    source: str
    files: dict[str, list[str]]


def is_empty(folder: Path) -> bool:
    """Whether a folder is missing, or holds nothing but what a killed process of ours leaves."""
    try:
        return all(is_temporary(path) or is_lock(path) for path in folder.iterdir())
    except FileNotFoundError:
        return True
    except OSError:  # a file, or not to be read: said when it is to be written to
        return not folder.is_dir()


def own_subfolder(folder: Path, name: str) -> Path:
    """Return a folder of ours in a folder, to be made or written to.

    Raises:
        InputError: it is a link, which may lead out of the folder.
    """
    if (path := folder / name).is_symlink():
        raise InputError(f"{path} is a link: move it away, or give another --out.")
    return path


def own_folder(folder: Path, part: str) -> Path:
    """Make a folder for one part, or take one that holds it already.

    Raises:
        InputError: it holds files of others, or cannot be written to.
    """
    if not is_empty(folder) and part not in _read(folder):
        raise InputError(
            f"the output folder {folder} holds files, but none of this command's: give a new or "
            "an empty one."
        )
    return writable_folder(folder)


def refuse_changed(folder: Path) -> None:
    """Refuse a folder in which a file of ours was changed since it was written.

    Raises:
        InputError: naming the file.
    """
    for part in _read(folder).values():
        for name, digests in part.files.items():
            _refuse_other(folder, name, digests)


def as_written(folder: Path, name: str) -> bool:
    """Whether a file is there and is as we wrote it."""
    with suppress(InputError):
        parts = _read(folder).values()
        return any(_is_one_of(folder / name, part.files.get(name, [])) for part in parts)
    return False


def written(
    folder: Path, part: str, source: str, make: Callable[[], Mapping[str, bytes]]
) -> list[Path]:
    """Return the files that ``make`` gives for ``source``; call it only if they are not there.

    Args:
        folder: that the names of the files are in.
        part: what they are, among all that is written in the folder.
        source: names all that they are made of, and what makes them.
        make: returns their contents by name.

    Raises:
        InputError: see ``write_part``.
    """
    earlier = _read(folder).get(part)
    kept = {} if earlier is None else earlier.files
    same = earlier is not None and earlier.source == source
    if same and all(_is_one_of(folder / name, digests) for name, digests in kept.items()):
        return [folder / name for name in kept]
    return write_part(folder, part, make(), source)


def write_part(
    folder: Path, part: str, contents: Mapping[str, bytes], source: str = ""
) -> list[Path]:
    """Write files by name; those of the part written earlier and no longer made are removed.

    Raises:
        InputError: a file is in the way that is not ours. Nothing is written then.
    """
    with writing(writable_folder(folder)):
        parts = _read(folder)
        earlier = parts[part].files if part in parts else {}
        new = {n: [f"{len(c)}-{hashlib.sha256(c).hexdigest()}"] for n, c in contents.items()}
        either = {n: [*earlier.get(n, []), *new.get(n, [])] for n in {**earlier, **new}}
        for name, digests in either.items():
            _refuse_other(folder, name, digests)
        _write(folder, parts | {part: Part("", either)})  # whenever this is killed
        for name, content in contents.items():
            write_bytes(folder / name, content)
        for name in earlier.keys() - contents.keys():
            (folder / name).unlink(missing_ok=True)
        _write(folder, parts | {part: Part(source, new)})
        for path in {(folder / name).parent for name in either}:
            for left in filter(is_temporary, path.glob(".*")):
                left.unlink(missing_ok=True)
    return [folder / name for name in new]


def _refuse_other(folder: Path, name: str, digests: list[str]) -> None:
    """Refuse what stands where a file of ours is to be, unless it has one of these digests."""
    path = folder / name
    inside = [folder / parent for parent in Path(name).parents][:-1]
    other = [p for p in inside if os.path.lexists(p) and (p.is_symlink() or not p.is_dir())]
    if other or (os.path.lexists(path) and (path.is_symlink() or not _is_one_of(path, digests))):
        raise InputError(
            f"{next(iter(other), path)} is not as deqmcl wrote it: move it away, or give "
            "another --out."
        )


def _read(folder: Path) -> dict[str, Part]:
    """Return the parts in a folder; none if it has no inventory.

    Raises:
        InputError: a file of that name is no inventory of ours, or leads elsewhere.
    """
    path = folder / NAME
    try:
        parts = typed(json_of(content_of(path)), dict[str, Part])
        if not all(_is_inside(name) for part in parts.values() for name in part.files):
            raise UnreadableError("names files outside its folder, or that no folder can hold")
    except FileNotFoundError:
        return {}
    except UnreadableError as error:
        raise InputError(
            f"{path} {error}, so it is not as deqmcl wrote it: move it away, or give another --out."
        ) from None
    return parts


def _is_inside(name: str) -> bool:
    path = Path(name)
    within = not path.is_absolute() and ".." not in path.parts and path != Path()
    return within and name.isprintable() and is_possible(path)


def _write(folder: Path, parts: Mapping[str, Part]) -> None:
    write_text(folder / NAME, json.dumps(to_builtins(parts), indent=2) + "\n")


def _is_one_of(path: Path, digests: list[str]) -> bool:
    """Whether a file has one of these digests; one of another size is not read."""
    try:
        with opened(path) as file:
            size = os.fstat(file.fileno()).st_size
            if not any(digest.startswith(f"{size}-") for digest in digests):
                return False
            return f"{size}-{hashlib.file_digest(file, 'sha256').hexdigest()}" in digests
    except (FileNotFoundError, UnreadableError):
        return False
