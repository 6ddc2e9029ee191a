"""From a TOML file to a ``Sweep``; docs/sweeps.md has the table of its keys."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.setup import changes, documents
from benchmarks.setup.changes import Changes, Named, located
from benchmarks.setup.names import absolute, absolute_agent, absolute_assumed, absolute_scenario
from benchmarks.setup.paths import from_folder, said_from
from benchmarks.sweeps.design import Axis, Limit, Sweep, Takes, UntilDecided
from benchmarks.trials.spec import Method
from deqmcl_gym.files import utf8
from deqmcl_gym.validation import InputError, integer, one_of
from localizers import absolute_name, parameters
from localizers.registry import LOCALIZER

_KEYS = (
    *("title", "scenario", "lag", "seed", "trials", "filter_seeds"),
    *("localizers", "world", "assumed", "disturbance", "agent", "params", "vary", "baseline"),
    *("limit", "until_decided"),
)
_SUITES = Path(__file__).with_name("suites")  # a sweep file each


def read_sweep(path: Path | str, added: Sequence[str] = (), *, above: Sequence[Path] = ()) -> Sweep:
    """Read a sweep file.

    Args:
        path: of the file.
        added: localizers to add.
        above: the files that this one is the base of.
    """
    path = Path(path)
    given = documents.read(path, "sweep")
    root = (above[0] if above else path).parent
    with documents.errors_name(path), said_from(root):
        documents.check(given, ("base", *_KEYS))
        files = (*above, Path(os.path.abspath(path)))
        base = _base(given.pop("base"), files) if "base" in given else None
        title = utf8(path.stem).decode()
        sweep = with_localizers(sweep_of(given, title=title, folder=path.parent, base=base), added)
        _refuse_idle(sweep)
        return sweep


def with_localizers(sweep: Sweep, names: Sequence[str]) -> Sweep:
    """Return a sweep with further localizers; one that it has already is not added."""
    known = {absolute_name(method.name) for method in sweep.localizers}
    added = [name for name in dict.fromkeys(names) if absolute_name(name) not in known]
    return replace(sweep, localizers=(*sweep.localizers, *(Method(name=name) for name in added)))


def _base(name: Any, files: Sequence[Path]) -> Sweep:
    """Return the sweep that the last of these files changes."""
    if documents.text("base", name).endswith(".toml"):
        path = Path(located(from_folder(files[-1].parent, name)))
        if path in files:
            raise InputError(f"base is {name!r}, which is this file or changes it: name another.")
    else:
        path = suite_file("base", name)
    return read_sweep(path, above=files)


def suite_names() -> list[str]:
    """Names of the suites, by alphabet."""
    return sorted(path.stem for path in _SUITES.glob("*.toml"))


def suite_file(what: str, name: str) -> Path:
    """Return the sweep file of a suite."""
    try:
        return _SUITES / f"{one_of(what, name, suite_names())}.toml"
    except InputError as error:
        if Path(name).exists():
            raise InputError(
                f"{what} is the file {name}: the name of a sweep file must end in .toml, so save "
                "it under such a name."
            ) from None
        raise InputError(
            f"{str(error).rstrip('.')}, or a file that ends in .toml; docs/reports of the "
            "repository has those of its reports."
        ) from None


def sweep_of(
    given: Mapping[str, Any],
    *,
    title: str,
    takes: Takes = parameters,
    folder: Path | None = None,
    base: Sweep | None = None,
) -> Sweep:
    """Return the sweep that a TOML document says, or the manifest of a folder.

    Args:
        given: the document.
        title: unless it has one.
        takes: see ``Sweep``.
        folder: that paths are relative to; None: they stay as they are.
        base: says what the document does not.
    """
    documents.check(given, _KEYS)
    scalars = ("scenario", "lag", "seed", "trials", "filter_seeds", "baseline")
    plain = {k: given[k] for k in scalars if k in given}
    if "scenario" in plain:
        plain["scenario"] = absolute_scenario(plain["scenario"], folder or Path())
    if "baseline" in plain:
        plain["baseline"] = _localizer("baseline", plain["baseline"], folder)
    if "agent" in given:
        plain["agent"] = absolute_agent(Named.told("agent", given["agent"]), folder or Path())
    world = Changes.told("world", given.get("world", {}))
    limits = given.get("limit", [])
    limits = limits if isinstance(limits, list) else [limits]  # [[limit]], or one [limit]
    methods = _list("localizers", given.get("localizers", None if base is None else []))
    said: dict[str, Any] = plain | {
        "title": documents.text("title", given.get("title", title)),
        "localizers": tuple(_method(entry, folder) for entry in methods),
        "world": world if folder is None else world.beside(folder),
        "assumed": _assumed(Changes.told("assumed", given.get("assumed", {})), folder),
        "params": _params(Changes.told("params", given.get("params", {})), folder),
        "disturbance": _wrappers("disturbance", given.get("disturbance", [])),
        "vary": tuple(_axis(table, folder) for table in _list("vary", given.get("vary", []))),
        "limits": tuple(_limit(one, folder) for one in limits),
        "until_decided": _until_decided(given.get("until_decided")),
    }
    if base is None:
        return Sweep(takes=takes, **said)
    keys = {"title", *given} | ({"limits"} if "limit" in given else set())
    return replace(base, **{key: value for key, value in said.items() if key in keys})


def _refuse_idle(sweep: Sweep) -> None:
    """Refuse a shared parameter that no localizer has a use for: it is a misspelt one."""
    known = [sweep.takes(method.name) for method in sweep.localizers]
    if None in known:
        return
    varied = [name for axis in sweep.vary for name in axis.values]
    shared = [name.removeprefix("params.") for name in varied if name.startswith("params.")]
    for name in [*sweep.params, *shared]:
        one_of("parameter of these localizers", name, {n for own in known for n in own or ()})


def _method(entry: Any, folder: Path | None, what: str = "an entry of localizers") -> Method:
    named = Named.told(what, entry)
    name = _localizer("name of a localizer", named.name, folder)
    return Method(name=name, params=_params(named.params, folder))


def _limit(entry: Any, folder: Path | None) -> Limit:
    table = documents.table(
        "limit", entry, "a table [limit] with name, params, of, trials, filter_seeds"
    )
    for key in table:
        one_of("key in limit", key, ("name", "params", "of", "trials", "filter_seeds"))
    listed = _list("of in limit", table.get("of", []))
    of = tuple(_localizer("of in limit", name, folder) for name in listed)
    runs = {key: table[key] for key in ("trials", "filter_seeds") if key in table}
    own = {key: table[key] for key in ("name", "params") if key in table}
    method = _method(own, folder, "limit")
    return Limit(method=method, of=of, **runs)


def _until_decided(table: Any) -> UntilDecided | None:
    if table is None:
        return None
    known = documents.table("until_decided", table, "a table like {margin = 0.05}")
    for key in known:
        one_of("key in until_decided", key, ("margin",))
    return UntilDecided(**known)


def _assumed(given: Changes, folder: Path | None) -> Changes:
    return given if folder is None else absolute_assumed(given, folder)


def _params(given: Changes, folder: Path | None) -> Changes:
    return given if folder is None else given.beside(folder, changes.OF_LOCALIZERS)


def _localizer(what: str, value: Any, folder: Path | None) -> str:
    """Return a localizer's name, the path in it absolute; ``file.py`` is its only localizer."""
    name = documents.text(what, value)
    return name if folder is None else absolute(LOCALIZER, name, folder)


def _axis(table: Any, folder: Path | None) -> Axis:
    values = Changes.told("vary", documents.table("vary", table, "a [[vary]] table"))

    def point(name: str, value: Any) -> Any:
        if name == "disturbance":
            return _wrappers(name, value)
        if name == "scenario":
            return absolute_scenario(value, folder or Path())
        if name == "agent":
            return absolute_agent(Named.told(name, value), folder or Path()).json()
        group, _, key = name.partition(".")
        if folder is None or group == "agent":
            return value
        beside = {"params": _params, "assumed": _assumed}.get(group, Changes.beside)
        return beside(Changes({key: value}), folder)[key]

    listed = {name: _list(f"[[vary]] {name}", given) for name, given in values.items()}
    return Axis(
        values=Changes({n: tuple(point(n, one) for one in own) for n, own in listed.items()})
    )


def _wrappers(what: str, value: Any) -> tuple[Changes, ...]:
    wanted = "a table like {kind = 'kidnap', step = 100}"
    tables = (documents.table(f"an entry of {what}", one, wanted) for one in _list(what, value))
    return tuple(
        Changes({k: _repeated(v) if k == "actions" else v for k, v in table.items()})
        for table in tables
    )


def _repeated(actions: Any) -> Any:
    """Return a list of actions with each [drive, turn, steps] as so many [drive, turn]."""
    if not isinstance(actions, list | tuple):
        return actions
    found = []
    for action in actions:
        if isinstance(action, list | tuple) and len(action) == 3:
            found += [action[:2]] * integer("steps of an action", action[2], low=1, high=100_000)
        else:
            found.append(action)
    return found


def _list(what: str, value: Any) -> Sequence[Any]:
    if value is None:
        raise InputError(f"{what} is missing: write {what} = [ … ].")
    if not isinstance(value, list | tuple):
        hint = ": write [[vary]]" if what == "vary" else ""
        raise InputError(f"{what} is {value!r}, but must be a list{hint}.")
    return value
