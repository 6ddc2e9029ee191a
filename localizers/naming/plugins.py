"""Localizers from other people's code: ``package.module:NAME``, ``file.py:NAME``.

Loading runs that code, so it happens only when a plug-in is used. Any failure is
reported in one sentence, as an ``InputError``.
"""

import contextlib
import difflib
import hashlib
import importlib
import importlib.util
import os
import pkgutil
import sys
import traceback
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

from deqmcl_gym.files import UnreadableError, content_of
from deqmcl_gym.validation import InputError, in_words
from localizers.naming.digests import file_digest, module_digest
from localizers.naming.isolation import is_ctrl_c


def is_reference(name: str) -> bool:
    """Whether a name says where the code is, as ``package.module:NAME`` or ``file.py:NAME``."""
    return ":" in name


def absolute_name(name: str) -> str:
    """Return a name by which a process in any other folder finds the same localizer.

    The one place where the path of ``path/to/file.py:NAME`` is made absolute; ``~`` is the home
    folder. All other names stay as they are.
    """
    place, colon, attribute = name.rpartition(":")
    if not _is_path(place):
        return name
    return f"{Path(place).expanduser().absolute()}{colon}{attribute}"


def load(reference: str, name: str, kind: str = "localizer") -> Any:
    """Return what a reference leads to.

    Args:
        reference: ``package.module:NAME`` or ``path/to/file.py:NAME``.
        name: as the user gave it, for the error message.
        kind: of what it names, for the error message.

    Raises:
        InputError: there is no such module, file or attribute, or its code fails while importing.
    """
    named = f"the {kind} {name!r}"
    place, _, attribute = reference.rpartition(":")
    if not place or not all(part.isidentifier() for part in attribute.split(".")):
        raise InputError(
            f"{named} leads to {reference!r}, but must be package.module:NAME or "
            "path/to/file.py:NAME."
        )
    path = Path(place).expanduser().absolute() if _is_path(place) else None
    source = b"" if path is None else _source(path, named)
    try:
        with contextlib.chdir(os.curdir):  # comes back, wherever it goes
            module = importlib.import_module(place) if path is None else _run(path, source)
        found: Any = module
        for part in attribute.split("."):
            if not hasattr(found, part):  # a module may run code of its own to find out
                break
            found = getattr(found, part)
        else:
            return found
    except SyntaxError as error:
        raise InputError(
            f"{named} has a syntax error in {error.filename}, line {error.lineno}: {error.msg}."
        ) from error
    except BaseException as error:  # whatever a plug-in raises while importing
        if is_ctrl_c(error):
            raise
        missing = error.name if isinstance(error, ModuleNotFoundError) else None
        if path is None and missing and f"{place}.".startswith(f"{missing}."):
            raise _no_module(named, missing) from None
        raise InputError(
            f"{named} cannot be imported: its own code raised {raised(error, str(path))}."
        ) from error
    own = _offered(module)
    raise InputError(
        f"{named} does not exist: {place} has no {attribute!r}"
        f"{_nearest(attribute, own)}; it defines {', '.join(own) or 'nothing'}."
    )


def reference_digest(reference: str) -> str | None:
    """SHA-256 of the code behind a reference; see ``digests``. It is read, not run."""
    place = absolute_name(reference).rpartition(":")[0]
    return file_digest(place) if _is_path(place) else module_digest(place)


def raised(error: BaseException, file: str | None = None) -> str:
    """Say what was raised and where: "ValueError: words (name.py, line 7)".

    The line is the deepest one in ``file``, or the deepest of all.
    """
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if frame.filename == file] or frames
    said = in_words(error).rstrip(".")
    return f"{said} ({Path(own[-1].filename).name}, line {own[-1].lineno})" if own else said


def _source(path: Path, named: str) -> bytes:
    try:
        return content_of(path)
    except UnreadableError as error:
        raise InputError(f"{named} cannot be read: {path} {error}.") from None
    except FileNotFoundError as error:
        beside = sorted(file.name for file in path.parent.glob("*.py"))
        raise InputError(
            f"{named} cannot be read: {path}: {error.strerror}{_nearest(path.name, beside)}."
        ) from None


def _run(path: Path, source: bytes) -> ModuleType:
    """Run a file as a module of its own, once per content: an edited file is another module."""
    content = hashlib.sha256(b"\0".join((str(path).encode(), source))).hexdigest()
    name = f"_localizer_{content[:16]}"
    if name not in sys.modules:
        code = compile(source, str(path), "exec")
        module = ModuleType(name)
        module.__file__ = str(path)
        sys.modules[name] = module  # dataclasses and pickle look a class's module up
        try:
            exec(code, vars(module))
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]


def _no_module(named: str, missing: str) -> InputError:
    parent, _, last = missing.rpartition(".")
    folders = getattr(sys.modules.get(parent), "__path__", None) if parent else None
    beside = [found.name for found in pkgutil.iter_modules(folders)]
    return InputError(
        f"{named} does not exist: no module is named {missing!r}"
        f"{_nearest(last, beside)}; install it, put its folder on PYTHONPATH, or give the path of "
        "its file as path/to/file.py:NAME."
    )


def _is_path(place: str) -> bool:
    return place.endswith(".py") or "/" in place or "\\" in place


def _offered(module: ModuleType) -> list[str]:
    """Names of the classes and functions that a module defines itself."""
    return [
        name
        for name, value in vars(module).items()
        if callable(value) and getattr(value, "__module__", None) == module.__name__
    ]


def _nearest(name: str, names: Iterable[str]) -> str:
    nearest = difflib.get_close_matches(name, list(names), n=1, cutoff=0.4)
    return f" (did you mean {nearest[0]!r}?)" if nearest else ""
