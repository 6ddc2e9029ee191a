"""Digests of the source of plug-ins and of the files they ship; they are read, never run.

Of a package all files count; of ``file.py`` that file and those beside it of its name and another
ending.
What is in no file, as a notebook's cells, is read from memory; imports and downloads are not seen.
"""

import glob
import hashlib
import importlib.util
import inspect
import io
import pickle
import sys
import sysconfig
from collections.abc import Iterable
from functools import cached_property, lru_cache, partial
from pathlib import Path
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

from deqmcl_gym.files import UnreadableError, opened

UNREAD = "unread"  # in place of the digest of what is there, but not in a file
OURS = ("deqmcl_gym", "localizers", "benchmarks")  # results have a digest of their own
_ROOTS = (sys.prefix, *sysconfig.get_paths().values())  # of what is installed, and Python's own
_CODE = (
    *("code", "consts", "names", "varnames", "freevars", "cellvars", "flags", "exceptiontable"),
    *("name", "argcount", "posonlyargcount", "kwonlyargcount"),
)
_WRAPPERS = (staticmethod, classmethod, property, cached_property)
_WRAPPED = ("__wrapped__", "func", "fget", "fset", "fdel")


def is_users(file: str) -> bool:
    """Whether code is in a file, or a cell, that is neither ours nor installed nor Python's."""
    roots = *map(Path, _ROOTS), *(Path(__file__).parents[1] / package for package in OURS)
    return not (file.startswith("<frozen") or any(map(Path(file).is_relative_to, roots)))


def module_digest(place: str) -> str | None:
    """Digest of a module's package or file; None: no such module; ``UNREAD``: no file of it."""
    top = place.partition(".")[0]
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):  # a script, a notebook, or a module that was made by hand
        return _digest_of_loaded(top) or UNREAD if sys.modules.get(top) else None
    if spec is None:
        return None
    roots = [Path(root) for root in spec.submodule_search_locations or []]
    if not roots:
        return file_digest(spec.origin) or UNREAD
    files = [(path, path.relative_to(root)) for root in roots for path in sorted(root.rglob("*"))]
    made = {"__pycache__", ".git"}
    ours = [(path, name) for path, name in files if path.is_file() and not made & {*name.parts}]
    return (_digest(ours) if ours else None) or UNREAD


def file_digest(file: str | None) -> str | None:
    """Digest of a Python file and of what it ships, whatever folder it is in; None: not there."""
    if file is None:
        return None
    path = Path(file).absolute()
    beside = path.parent.glob(f"{glob.escape(path.stem)}.*")
    others = sorted(p for p in beside if p.is_file() and p.suffix != ".pyc" and p != path)
    return _digest((p, Path(p.name)) for p in [path, *others])


def _digest(files: Iterable[tuple[Path, Path]]) -> str | None:
    """Digest of files under the names they are to be known by; None if one cannot be read."""
    digest = hashlib.sha256()
    for path, name in files:
        if (content := content_digest(path)) is None:
            return None
        digest.update(f"{name.as_posix()}\0{content}\0".encode(errors="surrogateescape"))
    return digest.hexdigest()


def content_digest(path: Path) -> str | None:
    """SHA-256 of the content of one file; None: it cannot be read."""
    try:
        seen = path.stat()
        return _content(path, seen.st_size, seen.st_mtime_ns)
    except (OSError, UnreadableError):
        return None


@lru_cache(maxsize=10_000)
def _content(path: Path, *_: int) -> str:
    """Of a file of that size and time: weights are not read again for every trial."""
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def loaded_digest(thing: Any) -> str:
    """Digest of what is loaded: its file or package, its code in memory, and what that uses.

    Used are bases, default values, closures, class attributes and the globals that functions name;
    of other packages the file of the module counts. ``UNREAD`` if a value cannot be read.
    """
    made_by = thing
    while isinstance(made_by, partial):
        made_by = made_by.func
    home = getattr(made_by, "__module__", None) or type(made_by).__module__
    file = _digest_of_loaded(home) if _is_scripted(home) else module_digest(home)
    content = io.BytesIO()
    try:
        _Contents(content, home.partition(".")[0]).dump(thing)
    except Exception:  # whatever pickle raises, or a class of somebody's own
        return file or UNREAD
    return hashlib.sha256(f"{file}\0".encode() + content.getvalue()).hexdigest()


class _Contents(pickle.Pickler):
    """Pickles what code is made of, the same in any process; of the package ``top`` all is read."""

    def __init__(self, file: io.BytesIO, top: str) -> None:
        super().__init__(file, 5)
        self._top = top

    def persistent_id(self, thing: Any) -> str | None:
        """Sets have no order; whether equal texts are one object differs between processes."""
        if type(thing) in (set, frozenset):
            return f"{type(thing).__name__} {sorted(map(repr, thing))}"
        return repr(thing) if type(thing) in (str, bytes) else None

    def reducer_override(self, thing: Any) -> Any:
        parts = None if thing is list else self._parts(thing)
        return NotImplemented if parts is None else (list, (), [type(thing).__qualname__, *parts])

    def _parts(self, thing: Any) -> list[Any] | None:
        """Return what something is made of; None: what pickle says."""
        if isinstance(thing, ModuleType):
            return [thing.__name__, _digest_of_loaded(thing.__name__)]
        if isinstance(thing, CodeType):
            return [getattr(thing, f"co_{name}") for name in _CODE]
        if isinstance(thing, type | FunctionType):
            return self._defined(thing)
        is_bound = isinstance(thing, MethodType | partial)
        if isinstance(thing, _WRAPPERS) or (hasattr(thing, "__wrapped__") and not is_bound):
            return [getattr(thing, name, None) for name in _WRAPPED]
        is_of_c = inspect.isroutine(thing) or inspect.ismemberdescriptor(thing)
        named = is_of_c and not is_bound
        return [getattr(thing, "__module__", None), thing.__qualname__] if named else None

    def _defined(self, thing: Any) -> list[Any]:
        home, package = thing.__module__, thing.__module__.partition(".")[0]
        if package in OURS or not (package == self._top or _is_scripted(home)):
            return [home, thing.__qualname__, package not in OURS and _digest_of_loaded(home)]
        if isinstance(thing, type):  # what else has names with two underscores is Python's
            wrappers = (FunctionType, *_WRAPPERS)
            named = [(n, v) for n, v in vars(thing).items() if n != "_abc_impl"]
            members = {n: v for n, v in named if n[:2] != "__" or isinstance(v, wrappers)}
            return [thing.__qualname__, thing.__bases__, type(thing), members]
        names, namespace = _names(thing.__code__), thing.__globals__
        used = {name: namespace[name] for name in sorted(names) if name in namespace}
        closed = [cell.cell_contents for cell in thing.__closure__ or ()]
        defaults = thing.__defaults__, thing.__kwdefaults__
        return [thing.__code__, *defaults, closed, used, vars(thing)]


def _is_scripted(module: str) -> bool:
    """Whether a module is a script, a prompt, or a file of its own."""
    return getattr(sys.modules.get(module), "__spec__", None) is None


def _digest_of_loaded(module: str) -> str | None:
    """Digest of the file of a module that is loaded; None if it has none."""
    return file_digest(getattr(sys.modules.get(module), "__file__", None))


def _names(code: CodeType) -> set[str]:
    """Return the names that code asks for, that within it too."""
    inner = (_names(c) for c in code.co_consts if isinstance(c, CodeType))
    return {*code.co_names}.union(*inner)
