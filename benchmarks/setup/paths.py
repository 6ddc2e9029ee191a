"""Paths that documents name: found from the document's folder, and what the files there hold."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from hashlib import sha256
from pathlib import Path

from deqmcl_gym.files import UnreadableError, content_of, yaml_of
from localizers.digests import content_digest
from localizers.kinds import Placed

_ROOT: ContextVar[Path | None] = ContextVar("folder of the sweep file that is read", default=None)


@contextmanager
def said_from(root: Path) -> Iterator[None]:
    """Let paths that are relative to some folder be ``Placed``, said from this one."""
    token = _ROOT.set(Path(os.path.abspath(root)))
    try:
        yield
    finally:
        _ROOT.reset(token)


def from_folder(folder: Path, path: str) -> str:
    """Return a path from a folder as an absolute one; ~ is the home folder."""
    whole, root = os.path.abspath(folder / os.path.expanduser(path)), _ROOT.get()
    if root is None or os.path.isabs(os.path.expanduser(path)):
        return whole
    return Placed(Path(os.path.relpath(whole, root)).as_posix(), whole)


def file_digest(path: str) -> str:
    """Digest of a file of a world; that of a map covers its image, that of a folder all its files.

    A missing file has one, too: what reads the file reports it.
    """
    digest = sha256()
    for own in _parts(Path(path.place if isinstance(path, Placed) else path)):
        digest.update(f"{own.name}\0{content_digest(own)}\0".encode(errors="surrogateescape"))
    return digest.hexdigest()


def _parts(path: Path) -> list[Path]:
    if os.path.isdir(path):  # a bag of ROS 2, whose files stand side by side
        whole = path.glob("*") if (path / "metadata.yaml").is_file() else ()
        return sorted(part for part in whole if part.is_file())
    if path.suffix.lower() not in (".yaml", ".yml"):
        return [path]
    try:
        said = yaml_of(content_of(path))
        image = said.get("image") if isinstance(said, dict) else None
    except (FileNotFoundError, UnreadableError):  # whoever loads the map says so
        image = None
    return [path, path.parent / image] if isinstance(image, str) else [path]
