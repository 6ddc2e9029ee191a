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
from localizers.digests import file_digest, is_users, loaded_digest, module_digest

_MODULE = "_localizer_"  # begins the name of a module that is a file of its own
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
    verbs: Mapping[str, str]  # its methods, with their arguments
    # names that there were, which folders may hold, and what to use instead
    gone: Mapping[str, str] = field(default_factory=dict)
    added: dict[str, Any] = field(default_factory=dict)  # by name; no other process knows them
    received: dict[str, bytes] = field(default_factory=dict)  # those that came with the trials

    def names(self) -> tuple[str, ...]:
        """Names that are built in, registered or installed; none is loaded."""
        return tuple(dict.fromkeys((*self.builtin, *self.added, *sorted(self._installed))))

    @property
    def _installed(self) -> Mapping[str, str]:
        return _entry_points(self.group, tuple(sys.path))

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
        before = {name: self.added.pop(name)} if name in self.added else {}
        self.register(name, factory)
        try:
            yield
        finally:
            del self.added[name]
            self.added.update(before)

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
        own = {n: v for n, v in _defined_in(module).items() if inspect.isclass(v) and n[0] != "_"}
        fitting = [member for member, value in own.items() if not self._lacking(value)]
        if len(fitting) == 1:
            return name + f":{fitting[0]}"
        none = f"no class with {' and '.join(self.verbs)}"
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
        if not place or not all(map(str.isidentifier, attribute.split("."))):
            raise InputError(f"{named} leads to {reference!r}, but must be {_OWN}.")
        module = self._module(name, place)
        thing = self._asked(name, "imported", _member, module, attribute)
        if thing is None:
            defined = list(_defined_in(module))
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
        made = self._asked(name, f"made by {self.call}", factory, *args, **named, **params)
        return self.checked(name, made)

    def check_parameters(
        self, name: str, params: Iterable[str], taken: Iterable[str] | None
    ) -> None:
        """Refuse parameters of a name that are not among those taken (None: any)."""
        for param in params if taken is not None else ():
            one_of(f"parameter of {self.word} {name!r}", param, taken or ())

    def checked(self, name: str, made: Any) -> Any:
        """Return what was made if it has the methods of the kind, else refuse it."""
        if lacking := self._lacking(made):
            methods = " and ".join(f"{verb}({takes})" for verb, takes in self.verbs.items())
            raise InputError(
                f"the {self.word} {name!r} is of type {type(made).__name__}, without "
                f"{' and '.join(lacking)}: one has {methods}."
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

    def _lacking(self, thing: Any) -> list[str]:
        return [verb for verb in self.verbs if not callable(getattr(thing, verb, None))]

    def _module(self, name: str, place: str) -> Any:
        """Return the module at a place; a file is run, once per content."""
        if not is_path(place):
            return self._asked(name, "imported", importlib.import_module, place)
        path = Path(place)
        try:
            content = content_of(path)
        except (UnreadableError, FileNotFoundError) as error:
            words = f"{path} {error}"
            if isinstance(error, FileNotFoundError):
                near = _nearest(path.name, [file.name for file in path.parent.glob("*.py")])
                words = f"{path}: {error.strerror}{near}"
            raise InputError(f"the {self.word} {name!r} cannot be read: {words}.") from None
        return self._asked(name, "imported", _run, place, content)

    def _asked(
        self, name: str, how: str, function: Callable[..., Any], /, *a: Any, **k: Any
    ) -> Any:
        """Call code from elsewhere, the folder kept; what it raises, SystemExit too, is refused."""
        try:
            with contextlib.chdir(os.curdir):
                return function(*a, **k)
        except BaseException as error:
            if isinstance(error, InputError) or is_ctrl_c(error):
                raise
            words = f"its own code raised {raised(error)}"
            if isinstance(error, ModuleNotFoundError):
                words = f"{raised(error)}: {_MISSING}"
            raise InputError(f"the {self.word} {name!r} cannot be {how}: {words}.") from error


@cache  # by sys.path, too, which may change while a notebook runs
def _entry_points(group: str, path: tuple[str, ...]) -> dict[str, str]:
    """Return references by name; if several packages have a name, that of the first."""
    found: dict[str, str] = {}
    for package in distributions():
        with contextlib.suppress(Exception):  # whatever is wrong with a file of somebody else's
            entries = package.entry_points.select(group=group)
            found = {e.name: e.value.partition("[")[0].strip() for e in entries if e.name} | found
    return found


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
    own = [p for p in listed[given:] if p.kind is not p.VAR_POSITIONAL]
    return tuple(p.name for p in own if p.name not in named)


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


def raised(error: BaseException) -> str:
    """Say what was raised, and where in a user's code: "ValueError: words (name.py, line 7)"."""
    words, shown = in_words(error).rstrip("."), "".join(traceback.format_exception(error))
    if "BrokenProcessPool" in shown or f"No module named '{_MODULE}" in shown:  # or by its cause
        remedy = "its file.py cannot be imported by processes that it starts, so make it a package"
        words = f"{words}: {remedy}"
    frames = [f for f in traceback.extract_tb(error.__traceback__) if is_users(f.filename)]
    if not frames or isinstance(error, SyntaxError):  # it says where
        return words
    path = Path(frames[-1].filename)
    place = "the cell" if path.parent.name.startswith("ipykernel") else path.name
    return f"{words} ({place}, line {frames[-1].lineno})"


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


def _member(thing: Any, attribute: str) -> Any:
    """Return what a dotted name means in a module; None if it is not there."""
    return reduce(lambda part, name: getattr(part, name, None), attribute.split("."), thing)


def _defined_in(module: ModuleType) -> dict[str, Any]:
    members = vars(module).items()
    return {n: v for n, v in members if getattr(v, "__module__", None) == module.__name__}


def _nearest(name: str, names: Iterable[str]) -> str:
    nearest = difflib.get_close_matches(name, list(names), n=1, cutoff=0.4)
    return f" (did you mean {nearest[0]!r}?)" if nearest else ""
