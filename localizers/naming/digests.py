"""Digests of the source of plug-ins and of the files they ship; they are read, never run.

What is covered: of a package, all its files; of ``file.py``, that file, the files beside it that
have its name and another ending, and those beside or below whose names stand in its text
(``"weights.npz"``, ``f"layer-{n}.npy"``, ``"*.npz"``), unless it writes them. Names made up at run
time are not seen, nor is what it imports or downloads.
"""

import ast
import hashlib
import importlib.util
import os
import re
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path

from deqmcl_gym.files import UnreadableError, content_of, opened

_DEPTH = 4  # folders below that of a file, in which what it names is looked for
_WRITERS = {"dump", "mkdir", "save", "savetxt", "savez", "touch", "unlink"}
_WRITERS |= {"write_bytes", "write_text", "basicConfig", "FileHandler"}
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
        return digest_of(path, _patterns(content_of(path)))
    except (OSError, UnreadableError):
        return None


def digest_of(path: Path, patterns: Iterable[str]) -> str | None:
    """Digest of a file and of what it ships.

    Args:
        path: of the file.
        patterns: texts in it that may name files beside or below it.
    """
    own = {p for p in _siblings(path) if p.stem == path.stem and p.suffix != ".pyc"}
    shipped = sorted({*own, *named_files(path.parent, patterns)} - {path})
    return _digest((p, p.relative_to(path.parent)) for p in [path, *shipped])


def named_files(folder: Path, patterns: Iterable[str]) -> Iterator[Path]:
    """Yield the files in a folder that texts name: ``weights.npz``, ``nets/*.npz``.

    A file below is meant if the folders on the way to it are named, too.
    """
    parts = {part for text in patterns for part in re.split(r"[/\\]", text)}
    plain = {part for part in parts if not set("*?[") & set(part)}
    globs = {part for part in parts - plain if re.search(r"\.\w+$", part)}  # *-* would be any
    waiting = [(folder, 0)]
    while waiting:
        inside, depth = waiting.pop()
        for path in _siblings(inside / "_", folders=True):
            if path.name in plain or any(fnmatchcase(path.name, glob) for glob in globs):
                if path.is_file():
                    yield path
                elif depth < _DEPTH and path.is_dir() and path.name not in _MADE:
                    waiting.append((path, depth + 1))


def _siblings(path: Path, *, folders: bool = False) -> list[Path]:
    """Return the files in the folder of a path."""
    try:
        with os.scandir(path.parent) as entries:
            return [Path(entry.path) for entry in entries if folders or entry.is_file()]
    except OSError:
        return []


def _files(root: Path) -> list[Path]:
    """Return all files of a package except those that Python generates."""
    return sorted(
        path
        for path in root.rglob("*")
        if path.is_file() and not set(_MADE) & set(path.relative_to(root).parts)
    )


def _patterns(source: bytes) -> set[str]:
    """Return the texts in Python source that may name files; what an f-string fills in is ``*``.

    Those of a statement that writes a file are left out: what a plug-in makes, it does not ship.
    """
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return set()
    found = set()
    for statement in (node for node in ast.walk(tree) if isinstance(node, ast.stmt)):
        own = [node for child in _expressions(statement) for node in ast.walk(child)]
        if any(isinstance(node, ast.Call) and _writes(node) for node in own):
            continue
        for node in own:
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.add(node.value)
            elif isinstance(node, ast.JoinedStr):
                parts = [v.value if isinstance(v, ast.Constant) else "*" for v in node.values]
                found.add("".join(map(str, parts)))
    return {text for text in found if "\n" not in text and len(text) <= 255}


def _expressions(statement: ast.stmt) -> list[ast.AST]:
    """Return the parts of a statement that are not statements."""
    inner = (ast.stmt, ast.ExceptHandler, ast.match_case)
    return [child for child in ast.iter_child_nodes(statement) if not isinstance(child, inner)]


def _writes(call: ast.Call) -> bool:
    name = getattr(call.func, "attr", getattr(call.func, "id", ""))
    given = [*call.args, *(keyword.value for keyword in call.keywords)]
    words = [node.value for node in given if isinstance(node, ast.Constant)]
    modes = [word for word in words if isinstance(word, str) and set(word) <= set("rwaxbt+")]
    return name in _WRITERS or (name == "open" and any(set("wax+") & set(mode) for mode in modes))


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
