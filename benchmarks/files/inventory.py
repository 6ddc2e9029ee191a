"""An inventory of the files we wrote in a folder: nothing else there is overwritten or removed.

``written.json`` holds, by part (a report, the figures, …), a digest of what the part was made from
and the size and SHA-256 of each of its files. A file that it does not list, or that has another
content, is the user's. Files are made again only if their source, or one of them, has changed.
"""

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from msgspec import Struct, to_builtins

from benchmarks.files.lock import is_lock, writing
from deqmcl_gym.files import (
    UnreadableError,
    content_of,
    is_temporary,
    json_of,
    opened,
    typed,
    writable_folder,
    write_bytes,
    write_text,
)
from deqmcl_gym.validation import InputError

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
    folder.mkdir(parents=True, exist_ok=True)
    with writing(folder):
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
        names = [Path(name) for part in parts.values() for name in part.files]
        if any(name.is_absolute() or ".." in name.parts or name == Path() for name in names):
            raise UnreadableError("names files outside its folder")
    except FileNotFoundError:
        return {}
    except UnreadableError as error:
        raise InputError(
            f"{path} {error}, so it is not as deqmcl wrote it: move it away, or give another --out."
        ) from None
    return parts


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
