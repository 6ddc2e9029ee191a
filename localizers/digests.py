"""Digests of the source of plug-ins and of the files they ship; they are read, never run.

Of a package all files count; of ``file.py`` that file and those beside it of its name and another
ending.
What is in no file, as a notebook's cells, is read from memory; imports and downloads are not seen.
"""

import glob
import hashlib
import importlib.util
import inspect
import pickle
import sys
import types
from collections.abc import Iterable, Iterator
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

from deqmcl_gym.files import UnreadableError, opened

UNREAD = "unread"  # in place of the digest of what is there, but not in a file
_MADE = {"__pycache__", ".git"}
OURS = ("deqmcl_gym", "localizers", "benchmarks")  # results have a digest of their own
_PLAIN = (type(None), type(...), bool, int, float, complex, str, bytes)
_DEFINED = (type, types.FunctionType)
_CODE = ["code", "consts", "names", "varnames", "freevars", "cellvars", "flags", "exceptiontable"]
_CODE += ["name", "argcount", "posonlyargcount", "kwonlyargcount"]
_WRAPS = ("__func__", "__self__", "func", "args", "keywords", "fget", "fset", "fdel", "__wrapped__")
_WRAPPERS = (types.MethodType, staticmethod, classmethod, property, partial, cached_property)


def module_digest(place: str) -> str | None:
    """Digest of a module's package or file; None: no such module; ``UNREAD``: no file of it."""
    top = place.partition(".")[0]
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):  # a script, a notebook, or a module that was made by hand
        return _file_of(top) or UNREAD if sys.modules.get(top) else None
    if spec is None:
        return None
    roots = [Path(root) for root in spec.submodule_search_locations or []]
    if not roots:
        return source_digest_of_file(spec.origin) or UNREAD
    files = [(path, path.relative_to(root)) for root in roots for path in _files(root)]
    return (_digest(files) if files else None) or UNREAD


def loaded_digest(thing: Any) -> str:
    """Digest of what is loaded: its file or package, its code in memory, and what that uses.

    Used are bases, default values, closures, class attributes and the globals that functions name;
    of other packages the file of the module counts. ``UNREAD`` if a value cannot be read.
    """
    home = _home(thing)
    file = _file_of(home) if _is_scripted(home) else module_digest(home)
    try:
        code = "\0".join(_words(thing, home.partition(".")[0], {}))
    except Exception:  # whatever pickle raises, or a class of somebody's own
        return file or UNREAD
    return hashlib.sha256(f"{file}\0{code}".encode(errors="surrogatepass")).hexdigest()


def _home(thing: Any) -> str:
    """Return the name of the module that something was made in."""
    while isinstance(thing, partial):
        thing = thing.func
    home = getattr(thing, "__module__", None)
    return home if isinstance(home, str) else type(thing).__module__


def _is_scripted(module: str) -> bool:
    """Whether a module is a script, a prompt, or a file of its own."""
    return getattr(sys.modules.get(module), "__spec__", None) is None


def _file_of(module: str) -> str | None:
    """Digest of the file of a module that is loaded; None if it has none."""
    return source_digest_of_file(getattr(sys.modules.get(module), "__file__", None))


def _words(thing: Any, top: str, seen: dict[int, Any]) -> Iterator[str]:
    """Say what an object is made of, as in any process; of the package ``top`` the code is read."""
    kind = type(thing)
    if kind in _PLAIN:
        yield repr(thing)
    elif kind in (set, frozenset):
        yield f"{kind.__name__} {sorted(map(repr, thing))}"
    elif id(thing) in seen:
        yield f"again {[*seen].index(id(thing))}"
    else:
        seen[id(thing)] = thing
        yield kind.__qualname__
        for part in _parts(thing, top):
            yield from _words(part, top, seen)


def _parts(thing: Any, top: str) -> Iterator[Any]:
    home = _home(thing if isinstance(thing, _DEFINED) else type(thing))
    package = home.partition(".")[0]
    inside = package not in OURS and (package == top or _is_scripted(home))
    if isinstance(thing, types.CodeType):
        yield from [getattr(thing, f"co_{name}") for name in _CODE]
    elif isinstance(thing, dict):
        yield from [part for item in thing.items() for part in item]
    elif type(thing) in (list, tuple):
        yield from thing
    elif isinstance(thing, types.ModuleType):
        yield from [thing.__name__, _file_of(thing.__name__)]
    elif isinstance(thing, _DEFINED) and not inside:
        yield from [home, thing.__qualname__, None if package in OURS else _file_of(home)]
    elif isinstance(thing, type):
        made = (*_WRAPPERS, types.FunctionType)  # all else with such names is Python's
        own = {n: v for n, v in vars(thing).items() if n[:2] != "__" or isinstance(v, made)}
        own.pop("_abc_impl", None)
        yield from [thing.__qualname__, thing.__bases__, type(thing), own]
    elif isinstance(thing, types.FunctionType):
        known, code = thing.__globals__, thing.__code__
        used = {name: known[name] for name in sorted(_names(code)) if name in known}
        closed = [cell.cell_contents for cell in thing.__closure__ or ()]
        yield from [code, thing.__defaults__, thing.__kwdefaults__, closed, used, vars(thing)]
    elif isinstance(thing, _WRAPPERS) or hasattr(thing, "__wrapped__"):
        yield from [getattr(thing, name, None) for name in _WRAPS]
    elif inspect.isroutine(thing) or inspect.ismemberdescriptor(thing):  # of C
        yield from [getattr(thing, "__module__", None), thing.__qualname__]
    elif inside and hasattr(thing, "__dict__"):
        yield from [type(thing), vars(thing)]
    else:
        yield pickle.dumps(thing)


def _names(code: types.CodeType) -> set[str]:
    """Return the names that code asks for, that within it too."""
    inner = (_names(c) for c in code.co_consts if isinstance(c, types.CodeType))
    return {*code.co_names}.union(*inner)


def source_digest_of_file(file: str | None) -> str | None:
    """Digest of a Python file and of what it ships, whatever folder it is in; None: not there."""
    if file is None:
        return None
    path = Path(file).absolute()
    try:
        beside = [p for p in path.parent.glob(f"{glob.escape(path.stem)}.*") if p.is_file()]
    except OSError:
        return None
    others = sorted(p for p in beside if p.suffix != ".pyc" and p != path)
    return _digest((p, Path(p.name)) for p in [path, *others])


def _files(root: Path) -> list[Path]:
    """Return all files in a folder except those that Python generates."""
    paths = (p for p in root.rglob("*") if not _MADE & set(p.relative_to(root).parts))
    return sorted(path for path in paths if path.is_file())


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
