"""Digests of the source of plug-ins and of the files they ship; they are read, never run.

What is covered: of a package, all its files; of ``file.py``, that file, the files beside it that
have its name and another ending, and those that it declares: names, folders or patterns, from its
folder, as in ``SHIPS = ("table.bin", "nets/*.npy")``. What it imports or downloads is not seen.
"""

import ast
import glob
import hashlib
import importlib.util
import os
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from deqmcl_gym.files import UnreadableError, content_of, opened

_MADE = ("__pycache__", ".git")


def module_digest(place: str) -> str | None:
    """Digest of the package of a module, or of the module's file; None: neither is there."""
    try:
        found = importlib.util.find_spec(place.partition(".")[0])
    except (ImportError, ValueError):
        return None
    if found is None:
        return None
    roots = [Path(root) for root in found.submodule_search_locations or []]
    if not roots:
        return None if found.origin is None else file_digest(found.origin)
    return _digest((path, path.relative_to(root)) for root in roots for path in _files(root))


def file_digest(file: str | None) -> str | None:
    """Digest of a Python file and of what it ships, whatever folder it is in; None: not there."""
    if file is None:
        return None
    path = Path(file).absolute()
    try:
        declared = _declared(content_of(path))
        beside = [p for p in path.parent.glob(f"{glob.escape(path.stem)}.*") if p.is_file()]
        shipped = {p for pattern in declared for p in _matching(path.parent, pattern)}
        others = sorted({p for p in (*beside, *shipped) if p.suffix != ".pyc"} - {path})
    except (OSError, UnreadableError):
        return None
    return _digest((p, Path(os.path.relpath(p, path.parent))) for p in [path, *others])


def _declared(source: bytes) -> list[str]:
    """Return the texts that Python source assigns to SHIPS, at its top level."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return []
    return [
        text.value
        for node in tree.body
        if isinstance(node, ast.Assign) and "SHIPS" in map(ast.unparse, node.targets)
        for text in ast.walk(node.value)
        if isinstance(text, ast.Constant) and isinstance(text.value, str)
    ]


def _matching(folder: Path, pattern: str) -> list[Path]:
    """Return the files that a name or pattern means; of a folder, all that are in it."""
    try:
        found = list(folder.glob(pattern))
    except (ValueError, NotImplementedError):  # "", or an absolute one
        return []
    return [path for one in found for path in ([one] if one.is_file() else _files(one))]


def _files(root: Path) -> list[Path]:
    """Return all files in a folder except those that Python generates."""
    return sorted(
        path
        for path in root.rglob("*")
        if path.is_file() and not set(_MADE) & set(path.relative_to(root).parts)
    )


def _digest(files: Iterable[tuple[Path, Path]]) -> str | None:
    """Digest of files under the names they are to be known by; None if one cannot be read."""
    digest = hashlib.sha256()
    for path, known in files:
        if (content := content_digest(path)) is None:
            return None
        digest.update(f"{known.as_posix()}\0{content}\0".encode(errors="surrogateescape"))
    return digest.hexdigest()


def content_digest(path: Path) -> str | None:
    """Digest of the content of one file; None: it cannot be read."""
    try:
        seen = path.stat()
        return _content(path, seen.st_size, seen.st_mtime_ns)
    except (OSError, UnreadableError):
        return None


@lru_cache(maxsize=10_000)
def _content(path: Path, size: int, modified: int) -> str:
    """SHA-256 of a file of that size and time: weights are not read again for every trial."""
    del size, modified
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
