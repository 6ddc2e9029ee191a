"""Localizers by name: built-in, registered, installed, or given by the place of their code.

Installed packages offer theirs by entry points of the group ``deqmcl.localizers``.
"""

import inspect
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.metadata import Distribution, distributions
from typing import Any

from deqmcl_gym.validation import InputError, one_of
from localizers.api import Localizer
from localizers.methods.amcl import amcl
from localizers.methods.cbgl import cbgl
from localizers.methods.dead_reckoning import dead_reckoning
from localizers.methods.deq_mcl import (
    deq_mcl,
    mcl,
    mcl_map,
    mcl_map_smoother,
    mcl_smoother,
)
from localizers.methods.ekf import ekf
from localizers.methods.grid import grid
from localizers.methods.plan_aware import deq_mcl_fresh, mcl_plan, mcl_plan_hedged
from localizers.models.robot import RobotModel
from localizers.naming import plugins
from localizers.naming.digests import loaded_digest
from localizers.naming.plugins import classes_in, is_file

GROUP = "deqmcl.localizers"
_VERBS = ("reset", "update")


def installed(group: str = GROUP) -> dict[str, str]:
    """References by name of the entry points of a group; none is loaded.

    A name that several packages offer differently has all their references, joined by " and ".
    Packages are looked through once in a process, and again when ``sys.path`` has changed: that
    takes as long as several trials.
    """
    return _installed(group, tuple(sys.path))


@cache
def _installed(group: str, path: tuple[str, ...]) -> dict[str, str]:
    """Return the references on a path of Python's."""
    del path
    found: dict[str, set[str]] = {}
    for distribution in _first_of_each_name():
        for name, reference in _offered(distribution, group) or ():
            found.setdefault(name, set()).add(reference)
    return {name: " and ".join(sorted(references)) for name, references in sorted(found.items())}


def unreadable() -> list[str]:
    """Names of the installed packages whose entry points cannot be read."""
    return sorted(_name(own) for own in _first_of_each_name() if _offered(own) is None)


def _first_of_each_name() -> Iterator[Distribution]:
    """Yield what is installed; of two with one name the first, which Python imports."""
    seen = set()
    for distribution in distributions():
        name = re.sub(r"[-_.]+", "-", _name(distribution)).lower()
        if name not in seen:
            seen.add(name)
            yield distribution


def _name(distribution: Distribution) -> str:
    try:
        return distribution.metadata["Name"] or repr(distribution)
    except Exception:  # no metadata, or none that can be read
        return repr(distribution)


def _offered(distribution: Distribution, group: str = GROUP) -> list[tuple[str, str]] | None:
    """Return a package's entry points of a group, (name, reference); None if they cannot be read.

    One package at a time: another one's mistake in a file of its own must not stop us.
    """
    try:
        return [
            (entry.name, entry.value.partition("[")[0].strip())
            for entry in distribution.entry_points
            if entry.group == group and entry.name
        ]
    except Exception:  # a file that is malformed, no UTF-8, no file
        return None


Factory = Callable[..., Localizer]

_FACTORIES: dict[str, Factory] = {
    "mcl": mcl,
    "mcl-smoother": mcl_smoother,
    "mcl-map": mcl_map,
    "mcl-map-smoother": mcl_map_smoother,
    "deq-mcl": deq_mcl,
    "deq-mcl-fresh": deq_mcl_fresh,
    "mcl-plan": mcl_plan,
    "mcl-plan-hedged": mcl_plan_hedged,
    "dead-reckoning": dead_reckoning,
    "grid": grid,
    "amcl": amcl,
    "cbgl": cbgl,
    "ekf": ekf,
}
_BUILT_IN = frozenset(_FACTORIES)
_RECEIVED: set[str] = set()
GONE = {  # folders may hold them
    "mcl-h": "use deq-mcl-fresh, which has its error.",
    "mcl-pilots": "use deq-mcl-fresh, which has its numbers.",
    "deq-mcl-rejuvenated": "use deq-mcl-fresh.",
}


def names() -> tuple[str, ...]:
    """Names that ``make`` knows: built-in, registered and installed ones; none is loaded."""
    return tuple(dict.fromkeys((*_FACTORIES, *installed())))


def register(name: str, factory: Factory) -> None:
    """Make ``factory(robot, **params) -> Localizer`` known as ``name``, in this process only.

    A name that was registered before means the new one, with a warning: a notebook's cell is run
    again.

    Raises:
        InputError: the name is that of a built-in localizer, or has a colon.
    """
    if name in _BUILT_IN:
        raise InputError(f"the localizer name {name!r} is taken by a built-in one: choose another.")
    if not isinstance(name, str) or plugins.is_reference(name):
        raise InputError(f"the localizer name is {name!r}, but must be text without a colon.")
    if name in _FACTORIES and _FACTORIES[name] is not factory:
        warnings.warn(
            f"the localizer {name!r} was registered before: from now on it is the new one; "
            "with localizers.registered(name, factory) registers one for a while.",
            stacklevel=2,
        )
    _FACTORIES[name] = factory


@contextmanager
def registered(name: str, factory: Factory) -> Iterator[None]:
    """Know ``factory`` as ``name`` in a ``with`` block, or while a function runs that it decorates.

    Raises:
        InputError: see ``register``.
    """
    before = None if name in _BUILT_IN else _FACTORIES.pop(name, None)
    register(name, factory)
    try:
        yield
    finally:
        del _FACTORIES[name]
        if before is not None:
            _FACTORIES[name] = before


def receive(name: str, factory: Factory) -> None:
    """Know ``factory`` as ``name``, as the process does that sent it."""
    _FACTORIES[name] = factory
    _RECEIVED.add(name)


def is_received(name: str) -> bool:
    """Whether a name came from the process that sends the trials: its code is the sender's."""
    return name in _RECEIVED


def is_registered(name: str) -> bool:
    """Whether a name was registered in this process: other processes do not know it."""
    return name in _FACTORIES and name not in _BUILT_IN


def is_plug_in(name: str) -> bool:
    """Whether a name leads to other people's code, which ``resolve`` runs."""
    return name not in _FACTORIES and name not in GONE


def resolve(name: str) -> Factory:
    """Return the factory that a name leads to, from the first of these that has it.

    A built-in name; a registered one; an entry point of group ``deqmcl.localizers``;
    ``package.module:NAME``; ``path/to/file.py:NAME``. This runs the code of a plug-in.

    Raises:
        InputError: there is no such name, its code cannot be imported, or it is not a factory.
    """
    if name in _FACTORIES:
        return _FACTORIES[name]
    found = plugins.load(_reference(name), name)
    if not callable(found):
        raise InputError(
            f"the localizer {name!r} is {_a(found)}, but must be a class or a function that makes "
            "a localizer for a robot."
        )
    if not _takes_a_robot(found):
        raise InputError(
            f"the localizer {name!r} takes no robot, but must be called as factory(robot) or "
            "factory(robot, **parameters)."
        )
    factory: Factory = found
    return factory


def make(name: str, robot: RobotModel, **params: Any) -> Localizer:
    """Make a localizer.

    Args:
        name: see ``resolve``.
        robot: its map, its sensor and the assumed noise.
        params: parameters of the method, see ``parameters(name)``.

    Raises:
        InputError: unknown name or parameter (the nearest valid one is named), or a bad value.
        RuntimeError: what the factory made has no ``reset`` or no ``update``.
    """
    factory = resolve(name)
    valid = parameters_of(factory)
    for param in params:
        if valid is not None:
            one_of(f"parameter of localizer {name!r}", param, valid)
    return made_by(factory, name, robot, **params)


def made_by(factory: Factory, name: str, robot: RobotModel, **params: Any) -> Localizer:
    """Return what a factory makes if it is a localizer, else raise; ``name`` is for the error."""
    made = factory(robot, **params)
    lacking = [verb for verb in _VERBS if not callable(getattr(made, verb, None))]
    if lacking:
        raise RuntimeError(
            f"the localizer {name!r} is {_a(made)} without {' and '.join(lacking)}: a localizer "
            "has reset(prior, plan, rng) and update(ranges, action, plan)."
        )
    return made


def parameters(name: str) -> tuple[str, ...] | None:
    """Names of a localizer's parameters; None if its factory takes any."""
    return _parameters_of_ours(name) if name in _BUILT_IN else parameters_of(resolve(name))


@cache  # a sweep asks for each of its points
def _parameters_of_ours(name: str) -> tuple[str, ...] | None:
    return parameters_of(_FACTORIES[name])


def parameters_of(factory: Callable[..., Any]) -> tuple[str, ...] | None:
    """Names of a factory's parameters beside the robot, its first; None if it takes any."""
    given = _given(factory)
    if given is None:
        return None
    beside = given[1:] if given and given[0].kind is not given[0].VAR_POSITIONAL else given
    return _names(beside)


def arguments_of(factory: Callable[..., Any]) -> tuple[str, ...] | None:
    """Names of all that a factory takes; None if it takes any."""
    given = _given(factory)
    return None if given is None else _names(given)


def _given(factory: Callable[..., Any]) -> list[inspect.Parameter] | None:
    try:
        given = list(inspect.signature(factory).parameters.values())
    except ValueError:  # some compiled callables have none to show
        return None
    return None if any(p.kind is p.VAR_KEYWORD for p in given) else given


def _names(given: list[inspect.Parameter]) -> tuple[str, ...]:
    return tuple(p.name for p in given if p.kind is not p.VAR_POSITIONAL)


def source_digest(name: str) -> str | None:
    """Digest of a plug-in: it changes whenever its file, its package or its weights are edited.

    ``localizers.naming.digests`` documents what it covers. Files are read, not run, so a plug-in
    that cannot be imported has one too. None for a built-in localizer, whose source is this
    package's, and if it is not there; ``UNREAD`` if there is nothing to read. It is stored with
    results.

    Raises:
        InputError: a plain name that does not exist.
    """
    if name in _BUILT_IN:
        return None
    if name not in _FACTORIES:
        return plugins.reference_digest(_reference(name))
    return loaded_digest(_FACTORIES[name])


def complete(name: str, kind: str = "localizer", verbs: Sequence[str] = _VERBS) -> str:
    """Return ``file.py:NAME`` for a ``file.py`` that holds one localizer, else the name as it is.

    Args:
        name: as given.
        kind: of what it names, for the error message.
        verbs: the methods that one has.

    Raises:
        InputError: the file holds none or several, or cannot be read.
    """
    if not is_file(name):
        return name
    file = plugins.absolute_name(name)
    found = classes_in(file, verbs)
    if len(found) != 1:
        none = f"has no class with {' and '.join(verbs)}"
        several = f"has {', '.join(found)}" if found else none
        raise InputError(
            f"the file {file} {several}: say which one is the {kind}, as in "
            f"{name}:{found[0] if found else 'NAME'}."
        )
    return name + f":{found[0]}"


def _reference(name: str) -> str:
    """Return the reference of a name that is neither built in nor registered."""
    if isinstance(name, str) and plugins.is_reference(name):
        return plugins.absolute_name(name)
    if isinstance(name, str) and is_file(name):
        raise InputError(
            f"the localizer {name!r} is a file: add the name of a class or function in it, as in "
            f"{complete(name)}."
        )
    if name in GONE:
        raise InputError(f"{name} is gone: {GONE[name]}")
    known = installed()
    try:
        reference = known[one_of("localizer", name, {*_FACTORIES, *known})]
    except InputError as error:
        silent = unreadable()
        raise InputError(
            f"{str(error).rstrip('.')}, or a plug-in as package.module:NAME or path/to/file.py:NAME"
            + (f" (the entry points of {', '.join(silent)} cannot be read)." if silent else ".")
        ) from None
    if " and " in reference:
        raise InputError(
            f"the localizer name {name!r} is offered by several installed packages, {reference}: "
            "name the one you mean by its module."
        )
    return reference


def _takes_a_robot(factory: Any) -> bool:
    try:
        inspect.signature(factory).bind_partial(None)
    except (TypeError, ValueError) as error:
        return isinstance(error, ValueError)  # some compiled callables have no signature to show
    return True


def _a(thing: object) -> str:
    kind = type(thing).__name__
    return "None" if thing is None else f"{'an' if kind[0].lower() in 'aeiou' else 'a'} {kind}"
