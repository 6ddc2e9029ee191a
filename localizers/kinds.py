"""Things by name: one grammar for localizers, scan models and agents.

A name is, the first of these that it fits: built in; registered in this process; an entry point of
an installed package; ``package.module:NAME``; ``path/to/file.py:NAME``, or ``path/to/file.py`` if
that holds one of the kind. The code of others is loaded by the process that asks for it.
"""

import contextlib
import difflib
import hashlib
import importlib
import inspect
import multiprocessing
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, reduce
from importlib.metadata import distributions
from pathlib import Path
from types import ModuleType
from typing import Any, Self

from deqmcl_gym.files import UnreadableError, content_of
from deqmcl_gym.validation import InputError, in_words, one_of
from localizers.digests import file_digest, loaded_digest, module_digest

_MODULE = "_localizer_"  # begins the name of a module that is a file of its own
_LOADERS = (__file__, str(importlib.__file__), "<frozen importlib")  # of code, in a traceback
_OWN = "package.module:NAME or path/to/file.py:NAME"
_MISSING = (
    "install it, put its folder on PYTHONPATH, or give path/to/file.py:NAME; a file stands alone, "
    "so make it and what it imports beside it a package"
)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What is found by name."""

    word: str  # "localizer"
    builtin: Mapping[str, Any]  # by name
    group: str  # of entry points of installed packages
    call: str  # how one is made of what a name leads to
    verbs: tuple[str, ...]  # its methods, with their arguments
    # names that there were, which folders may hold, and what to use instead
    gone: Mapping[str, str] = field(default_factory=dict)
    added: dict[str, Any] = field(default_factory=dict)  # by name; no other process knows them
    received: dict[str, bytes] = field(default_factory=dict)  # those that came with the trials

    def names(self) -> tuple[str, ...]:
        """Names that are built in, registered or installed; none is loaded."""
        return tuple(dict.fromkeys((*self.builtin, *self.added, *sorted(self._installed))))

    @property
    def _installed(self) -> Mapping[str, str]:
        return _entry_points(tuple(sys.path)).get(self.group, {})

    def register(self, name: str, factory: Any) -> None:
        """Make ``factory(robot, **params) -> Localizer`` known as ``name``, in this process only.

        A name that was registered before means the new one, with a warning: a notebook's cell is
        run again. A built-in name, or one with a colon, is refused.
        """
        if name in self.builtin or not isinstance(name, str) or ":" in name:
            taken = "is taken by a built-in one" if name in self.builtin else "must be text"
            raise InputError(
                f"the {self.word} name {name!r} {taken}: choose another, without a colon."
            )
        if self.added.get(name, factory) is not factory:
            warnings.warn(
                f"the {self.word} {name!r} was registered before: from now on it is the new one; "
                "with localizers.registered(name, factory) registers one for a while.",
                stacklevel=2,
            )
        self.added[name] = factory

    @contextlib.contextmanager
    def registered(self, name: str, factory: Any) -> Iterator[None]:
        """Know ``factory`` as ``name`` in a ``with`` block, or in a function that it decorates."""
        before = dict(self.added)
        self.added.pop(name, None)
        self.register(name, factory)
        try:
            yield
        finally:
            del self.added[name]
            self.added.update({name: before[name]} if name in before else {})

    def is_plug_in(self, name: str) -> bool:
        """Whether a name leads to other people's code, which ``resolve`` runs."""
        return not any(name in names for names in (self.builtin, self.added, self.gone))

    def reference(self, name: object) -> str:
        """Return where a name says that its code is, "" if it does not; nothing is loaded."""
        if not isinstance(name, str):
            return ""
        return name if ":" in name or name.endswith(".py") else self._installed.get(name, "")

    def complete(self, name: str) -> str:
        """Return ``file.py:NAME`` for a ``file.py`` that holds one of the kind, else the name."""
        if not name.endswith(".py"):
            return name
        module = self._module(name, absolute_name(name))
        fitting = [
            member
            for member, value in vars(module).items()
            if inspect.isclass(value)
            and _is_of(module, value)
            and not member.startswith("_")
            and not self._lacking(value)
        ]
        if len(fitting) == 1:
            return name + f":{fitting[0]}"
        none = f"no class with {' and '.join(self._methods)}"
        raise InputError(
            f"the file {module.__file__} has {', '.join(fitting) or none}: say which one is the "
            f"{self.word}, as in {name}:{(*fitting, 'NAME')[0]}."
        )

    def resolve(self, name: str) -> Any:
        """Return the factory that a name leads to; this runs a plug-in's code."""
        if name in (ours := {**self.builtin, **self.added}):
            return ours[name]
        if name in self.gone:
            raise InputError(f"{name} is gone: {self.gone[name]}")
        if not (reference := self.reference(name)):
            one_of(self.word, name, self.names(), f", or your own as {_OWN}")
        reference = self.complete(reference)
        place, rest = split(absolute_name(reference))
        named, attribute = f"the {self.word} {name!r}", rest.removeprefix(":")
        parts = attribute.split(".")
        if not place or not all(map(str.isidentifier, parts)):
            raise InputError(f"{named} leads to {reference!r}, but must be {_OWN}.")
        module = self._module(name, place)
        thing = self._asked(name, "imported", place, reduce, _attribute, parts, module)
        if thing is None:
            defined = [member for member, value in vars(module).items() if _is_of(module, value)]
            raise InputError(
                f"{named} does not exist: {place} has no {attribute!r}"
                f"{_nearest(attribute, defined)}; it defines {', '.join(defined) or 'nothing'}."
            )
        if not callable(thing):
            raise InputError(
                f"{named} is of type {type(thing).__name__}, but must be a class or a function for "
                f"{self.call}."
            )
        return thing

    def parameters(self, name: str) -> tuple[str, ...] | None:
        """Names of the parameters of a name; None if what it leads to takes any."""
        return parameters_of(self.resolve(name))

    def make(self, name: str, params: Mapping[str, Any], *args: Any, **named: Any) -> Any:
        """Make one from the arguments that all of the kind take and from its own parameters."""
        factory = self.resolve(name)
        self.check_parameters(name, params, parameters_of(factory, len(args), named))
        if name in self.builtin:
            return factory(*args, **named, **params)
        place, how = split(absolute_name(name))[0], f"made by {self.call}"
        return self.checked(name, self._asked(name, how, place, factory, *args, **named, **params))

    def check_parameters(
        self, name: str, params: Iterable[str], taken: Iterable[str] | None
    ) -> None:
        """Refuse parameters of a name that are not among those taken (None: any)."""
        for param in params if taken is not None else ():
            one_of(f"parameter of {self.word} {name!r}", param, taken or ())

    def checked(self, name: str, made: Any) -> Any:
        """Return what was made if it has the methods of the kind, else refuse it."""
        if lacking := self._lacking(made):
            raise InputError(
                f"the {self.word} {name!r} is of type {type(made).__name__}, without "
                f"{' and '.join(lacking)}: one has {' and '.join(self.verbs)}."
            )
        return made

    def digest(self, name: str) -> str:
        """Digest of the source of a plug-in, read, not run; "" of what is built in or not there."""
        if name in self.added:
            return loaded_digest(self.added[name])
        if name in self.builtin:
            return ""
        place, _ = split(absolute_name(self.reference(name)))
        return (file_digest(place) if is_path(place) else module_digest(place)) or ""

    @property
    def _methods(self) -> list[str]:
        return [verb.partition("(")[0] for verb in self.verbs]

    def _lacking(self, thing: Any) -> list[str]:
        return [verb for verb in self._methods if not callable(getattr(thing, verb, None))]

    def _module(self, name: str, place: str) -> Any:
        """Return the module at a place; a file is run, once per content."""
        if not is_path(place):
            return self._asked(name, "imported", place, importlib.import_module, place)
        path = Path(place)
        try:
            content = content_of(path)
        except (UnreadableError, FileNotFoundError) as error:
            words = f"{path} {error}"
            if isinstance(error, FileNotFoundError):
                near = _nearest(path.name, [file.name for file in path.parent.glob("*.py")])
                words = f"{path}: {error.strerror}{near}"
            raise InputError(f"the {self.word} {name!r} cannot be read: {words}.") from None
        return self._asked(name, "imported", place, _run, place, content)

    def _asked(
        self, name: str, how: str, place: str, function: Callable[..., Any], /, *a: Any, **k: Any
    ) -> Any:
        """Call code from elsewhere, the folder kept; what it raises, SystemExit too, is refused."""
        try:
            with contextlib.chdir(os.curdir):
                return function(*a, **k)
        except BaseException as error:
            if isinstance(error, InputError) or is_ctrl_c(error):
                raise
            words = raised(error, place)
            missing = isinstance(error, ModuleNotFoundError)
            words = f"{words}: {_MISSING}" if missing else f"its own code raised {words}"
            raise InputError(f"the {self.word} {name!r} cannot be {how}: {words}.") from error


@cache
def _entry_points(path: tuple[str, ...]) -> dict[str, dict[str, str]]:
    """Return references by name by group; if several packages have a name, that of the first."""
    del path
    groups: dict[str, dict[str, str]] = {}
    for package in distributions():
        with contextlib.suppress(Exception):  # whatever is wrong with a file of somebody else's
            for entry in [entry for entry in package.entry_points if entry.name and entry.value]:
                reference = entry.value.partition("[")[0].strip()
                groups.setdefault(entry.group, {}).setdefault(entry.name, reference)
    return groups


def parameters_of(
    factory: Callable[..., Any], given: int = 1, named: Iterable[str] = ()
) -> tuple[str, ...] | None:
    """Names of a factory's parameters, without the first ``given`` and ``named``; None: any."""
    try:
        listed = list(inspect.signature(factory).parameters.values())
    except ValueError:  # some compiled callables have none to show
        return None
    if any(p.kind is p.VAR_KEYWORD for p in listed):
        return None
    beside = [*(p for p in listed[:given] if p.kind is p.VAR_POSITIONAL), *listed[given:]]
    return tuple(p.name for p in beside if p.kind is not p.VAR_POSITIONAL and p.name not in named)


class Placed(str):
    """A name as a file says it, with its path from there, and its ``place``, which is absolute."""

    place: str

    def __new__(cls, name: str, place: str) -> Self:
        """Make a name that is told as ``name``."""
        made = super().__new__(cls, name)
        made.place = place
        return made

    def __getnewargs__(self) -> tuple[str, str]:  # type: ignore[override]
        return str(self), self.place

    def __add__(self, end: str) -> "Placed":
        return Placed(f"{self}{end}", self.place + end)


def absolute_name(name: str) -> str:
    """Return a name, its path absolute, by which a process in any folder finds the same thing."""
    if isinstance(name, Placed):
        return name.place
    place, rest = split(name)
    return f"{Path(os.path.expanduser(place)).absolute()}{rest}" if is_path(place) else name


def split(name: str) -> tuple[str, str]:
    """Return the place of a name, and what follows, with the colon; a plain name has no place."""
    place, colon, attribute = name.rpartition(":")
    return (name, "") if name.endswith((".py", ".toml")) else (place, colon + attribute)


def is_path(place: str) -> bool:
    """Whether a place is a file, not a module."""
    return place.endswith((".py", ".toml")) or "/" in place or "\\" in place


def is_ctrl_c(error: BaseException) -> bool:
    """Whether an error is the user's Ctrl-C; in a worker it can only come from a plug-in."""
    return isinstance(error, KeyboardInterrupt) and multiprocessing.parent_process() is None


def raised(error: BaseException, file: str | None = None) -> str:
    """Say what was raised and where, deepest in ``file``: "ValueError: words (name.py, line 7)"."""
    words = reason_of(error).rstrip(".")
    frames = [
        f for f in traceback.extract_tb(error.__traceback__) if not f.filename.startswith(_LOADERS)
    ]
    frames = [frame for frame in frames if frame.filename == file] or frames
    if not frames or isinstance(error, SyntaxError):  # it says where
        return words
    path = Path(frames[-1].filename)
    place = "the cell" if path.parent.name.startswith("ipykernel") else path.name
    return f"{words} ({place}, line {frames[-1].lineno})"


def reason_of(error: BaseException) -> str:
    """Return an error in words; of a file whose own processes cannot import it, what to do."""
    shown = "".join(traceback.format_exception(error))  # and what caused it
    if "BrokenProcessPool" not in shown and f"No module named '{_MODULE}" not in shown:
        return in_words(error)
    remedy = "its file.py cannot be imported by processes that it starts, so make it a package"
    return f"{in_words(error).rstrip('.')}: {remedy}"


def _run(path: str, source: bytes) -> ModuleType:
    """Run a file as a module of its own, once per content: an edited file is another module."""
    content = hashlib.sha256(b"\0".join((path.encode(), source))).hexdigest()
    name = f"{_MODULE}{content[:16]}"
    if name not in sys.modules:
        code = compile(source, path, "exec")
        module = sys.modules[name] = ModuleType(name)  # dataclasses and pickle look it up
        module.__file__ = path
        try:
            exec(code, vars(module))
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]


def _attribute(thing: Any, name: str) -> Any:
    return getattr(thing, name, None)


def _is_of(module: ModuleType, value: Any) -> bool:
    return getattr(value, "__module__", None) == module.__name__


def _nearest(name: str, names: Iterable[str]) -> str:
    nearest = difflib.get_close_matches(name, list(names), n=1, cutoff=0.4)
    return f" (did you mean {nearest[0]!r}?)" if nearest else ""
