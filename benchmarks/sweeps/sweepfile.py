"""From a TOML file, or the name of a suite or scenario, to a ``Sweep``; see docs/sweeps.md."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.setup import documents
from benchmarks.setup.documents import from_folder, said_from
from benchmarks.setup.names import (
    SCENARIOS,
    absolute_agent,
    absolute_assumed,
    absolute_reference,
    absolute_scenario,
)
from benchmarks.setup.overrides import NOTHING, Named, Overrides, listed, located, wrappers
from benchmarks.sweeps import PARTS, Sweep, Takes
from benchmarks.trials import Method
from deqmcl_gym.files import utf8
from deqmcl_gym.validation import InputError, one_of
from localizers import absolute_name, names, parameters
from localizers.registry import LOCALIZER

_KEYS = (
    *("title", "scenario", "lag", "seed", "trials", "filter_seeds"),
    *("localizers", "world", "assumed", "disturbance", "agent", "params", "vary", "baseline"),
    "until_decided",
)
_SUITES = Path(__file__).with_name("suites")  # a sweep file each
SUITES = tuple(sorted(path.stem for path in _SUITES.glob("*.toml")))
PAPER_METHODS = ("mcl", "mcl-smoother", "mcl-map", "mcl-map-smoother", "deq-mcl", "dead-reckoning")


def sweep_named(name: str, added: Sequence[str] = ()) -> Sweep:
    """Return the sweep of a suite, a scenario or a file of either, with further localizers.

    A scenario has the methods of the paper.
    """
    is_file, of_scenarios = name.endswith(".toml"), {"words", "env", "prior"}
    if is_file and not of_scenarios & documents.read_toml(Path(name), "sweep").keys():
        return read_sweep(Path(name), added)
    if is_file or (name in SCENARIOS and name not in SUITES):
        setup, methods = absolute_scenario(name), tuple(map(Method, PAPER_METHODS))
        sweep = Sweep(title=Path(name).stem, scenario=setup, localizers=methods)
    else:
        sweep = read_sweep(_suite_file("suite or scenario", name, SCENARIOS))
    return with_localizers(sweep, added)


def paper_sweep(
    *,
    scenario: str = "paper",
    localizers: Sequence[str] = PAPER_METHODS,
    trials: int = 10,
    seed: int = 0,
    lag: int = 20,
    **params: Any,
) -> Sweep:
    """Return the paper's experiment: all methods on the same worlds of one scenario."""
    return Sweep(
        title="The paper's experiment",
        scenario=scenario,
        localizers=tuple(Method(name=name) for name in localizers),
        trials=trials,
        seed=seed,
        lag=lag,
        params=Overrides(params),
    )


def read_sweep(path: Path | str, added: Sequence[str] = (), *, above: Sequence[Path] = ()) -> Sweep:
    """Read a sweep file, and add localizers; ``above``: the files that this is the base of."""
    path = Path(path)
    table = documents.read_toml(path, "sweep")
    root = (above[0] if above else path).parent
    with documents.errors_name(path), said_from(root):
        documents.check_values(table, ("base", *_KEYS))
        files = (*above, Path(os.path.abspath(path)))
        base = _base(table.pop("base"), files) if "base" in table else None
        title = utf8(path.stem).decode()
        sweep = with_localizers(sweep_of(table, title=title, folder=path.parent, base=base), added)
        refuse_idle(sweep)
        return sweep


def with_localizers(sweep: Sweep, names: Sequence[str]) -> Sweep:
    """Return a sweep with further localizers; one that it has already is not added."""
    present = {absolute_name(method.name) for method in sweep.localizers}
    added = [name for name in dict.fromkeys(names) if absolute_name(name) not in present]
    return replace(sweep, localizers=(*sweep.localizers, *(Method(name=name) for name in added)))


def _base(name: Any, files: Sequence[Path]) -> Sweep:
    """Return the sweep that the last of these files changes."""
    if documents.as_text("base", name).endswith(".toml"):
        path = Path(located(from_folder(files[-1].parent, name)))
        if path in files:
            raise InputError(f"base is {name!r}, which is this file or changes it: name another.")
    else:
        path = _suite_file("base", name)
    return read_sweep(path, above=files)


def _suite_file(what: str, name: str, others: Iterable[str] = ()) -> Path:
    """Return the sweep file of a suite; a refusal names ``others`` that are allowed, too."""
    if name not in SUITES and Path(name).exists() and not Path(name).is_dir():
        raise InputError(
            f"{what} is the file {name}: the name of a sweep file must end in .toml, so save it "
            "under such a name."
        )
    tip = ", or a file that ends in .toml; docs/reports of the repository has those of its reports"
    return _SUITES / f"{one_of(what, name, [*SUITES, *others], tip)}.toml"


def sweep_of(
    given: Mapping[str, Any],
    *,
    title: str,
    takes: Takes = parameters,
    folder: Path | None = None,
    base: Sweep | None = None,
) -> Sweep:
    """Return the sweep that a TOML document says, or the manifest of a folder.

    Paths in it are relative to ``folder``; None: they stay as they are. ``base`` says what the
    document does not.
    """
    documents.check_values(given, _KEYS)
    names, per_localizer = _Names(folder), dict[str, Overrides]()
    read: dict[str, Callable[[Any], Any]] = {
        "title": partial(documents.as_text, "title"),
        "scenario": names.scenario,
        "localizers": lambda value: tuple(map(names.method, listed("localizers", value))),
        "world": lambda value: names.world(Overrides.told("world", value)),
        "assumed": lambda value: names.assumed(Overrides.told("assumed", value)),
        "disturbance": partial(wrappers, "disturbance"),
        "agent": names.agent,
        "params": partial(Overrides.told, "params"),
        "vary": lambda value: tuple(map(names.axis, listed("vary", value))),
        "baseline": partial(names.localizer, "baseline"),
        "until_decided": _until_decided,
    }
    whole = {"title": title} | ({"localizers": None} if base is None else {}) | dict(given)
    values = {key: read[key](value) if key in read else value for key, value in whole.items()}
    if "params" in values:
        values["params"], per_localizer = _split(values["params"], names)
    sweep = Sweep(takes=takes, **values) if base is None else replace(base, **values)
    return with_params(sweep, per_localizer)


def with_settings(sweep: Sweep, values: Mapping[str, Any]) -> Sweep:
    """Return a sweep with single values changed, as ``--set`` has them; files as from here.

    Names are keys of a sweep file such as trials, parts such as world.lidar.beams or
    assumed.scan.sigma, params.KEY of all localizers or params.LOCALIZER.KEY of one, agent.KEY, and
    vary.NAME with a list, which becomes an axis, or takes the place of that of the same name.
    """
    names, plain = _Names(Path()), dict[str, Any]()
    parts: dict[str, dict[str, Any]] = {part: {} for part in (*PARTS, "agent", "vary")}
    for name, value in values.items():
        part, dot, rest = name.partition(".")
        if part in parts and rest:
            parts[part][rest] = value
        elif part == "until_decided" and rest:
            plain[part] = plain.get(part, {}) | {rest: value}
        elif dot or part in (*PARTS, "vary"):
            one_of("name of a setting", name, (*_KEYS, *(f"{p}.…" for p in parts)))
        else:
            plain[name] = value
    if plain:
        sweep = sweep_of(plain, title=sweep.title, folder=Path(), base=sweep)
    params, per_localizer = _split(Overrides.told("params", parts["params"]), names)
    lists = {name: v if isinstance(v, list) else [v] for name, v in parts["vary"].items()}
    axes = [names.axis({name: values}) for name, values in lists.items()]
    by_name = {name: axis for axis in axes for name in axis}
    existing = [by_name.pop(next(iter(a)), a) if len(a) == 1 else a for a in sweep.vary]
    changes: dict[str, Any] = {
        "world": sweep.world | names.world(Overrides.told("world", parts["world"])),
        "assumed": sweep.assumed | names.assumed(Overrides.told("assumed", parts["assumed"])),
        "params": sweep.params | params,
        "vary": (*existing, *by_name.values()),  # each in the place of the one of its name
    }
    if parts["agent"]:
        if sweep.agent is None:
            raise InputError("agent.… is set, but no agent is named: set agent=NAME, too.")
        changes["agent"] = replace(sweep.agent, params=sweep.agent.params | parts["agent"])
    if agents := [agent for axis in axes for agent in axis.get("agent", ())]:
        usual = "" if len(agents) > 1 else sweep.baseline
        changes |= {"agent": None, "baseline": plain.get("baseline", usual)}
    changed = with_params(replace(sweep, **changes), per_localizer)
    for name in values:
        if name in changed.varied:
            raise InputError(f"{name} is set, but the sweep varies it: set vary.{name}, a list.")
    varied = [name for name in lists if name.startswith("params.")]
    refuse_idle(changed, [*params, *(name.removeprefix("params.") for name in varied)])
    return changed


def with_params(sweep: Sweep, params: Mapping[str, Overrides]) -> Sweep:
    """Return a sweep with parameters of single localizers; refuse what one does not take."""
    names = {absolute_name(name): name for name in sweep.names}
    checked = {}
    for alias, values in params.items():
        name = one_of("localizer in params", names.get(absolute_name(alias), alias), sweep.names)
        LOCALIZER.check_parameters(name, values, parameters(name))
        checked[name] = values
    methods = [replace(m, params=m.params | checked.get(m.name, {})) for m in sweep.localizers]
    return replace(sweep, localizers=tuple(methods)) if checked else sweep


def params_by_localizer(given: dict[str, Any], localizers: Sequence[str]) -> dict[str, Overrides]:
    """Return ``KEY`` of all localizers that take it, and ``LOCALIZER.KEY`` of one, by localizer."""
    plain = Sweep(title="", localizers=tuple(map(Method, localizers)))
    sweep = with_settings(plain, {f"params.{name}": value for name, value in given.items()})
    return {method.name: sweep.params_of(method, sweep.params) for method in sweep.localizers}


def _split(params: Overrides, names: "_Names") -> tuple[Overrides, dict[str, Overrides]]:
    """Return the parameters of all localizers, and by localizer those that are of one alone."""
    per_localizer: dict[str, Overrides] = {}
    for name, value in params.items():
        localizer, _, key = name.rpartition(".")
        if localizer:
            localizer = names.localizer("params", localizer)
            per_localizer[localizer] = per_localizer.get(localizer, NOTHING) | {key: value}
    shared = {name: value for name, value in params.items() if "." not in name}
    return Overrides(shared), per_localizer


def check_localizers(named: Sequence[str]) -> None:
    """Refuse no localizer, an unknown one, and one that is named twice."""
    if not named:
        raise InputError(f"no localizer is named: allowed values: {', '.join(names())}.")
    for name in named:
        parameters(name)
    if len(set(named)) < len(named):
        raise InputError(f"a localizer is named twice in {', '.join(named)}.")


def refuse_idle(sweep: Sweep, names: Iterable[str] | None = None) -> None:
    """Refuse a shared parameter that no localizer has a use for: it is a misspelt one.

    Of ``names``, or of all that the sweep has and varies.
    """
    taken = [sweep.takes(method.name) for method in sweep.localizers]
    if None in taken:
        return
    varied = [name.removeprefix("params.") for name in sweep.varied if name.startswith("params.")]
    for name in [*sweep.params, *varied] if names is None else names:
        one_of("parameter of these localizers", name, {n for keys in taken for n in keys or ()})


@dataclass(frozen=True)
class _Names:
    """Names by which any process finds what a document names; ``folder`` as of ``sweep_of``."""

    folder: Path | None

    def scenario(self, name: Any) -> str:
        return absolute_scenario(name, self.folder or Path())

    def agent(self, value: Any) -> Named:
        return absolute_agent(Named.told("agent", value), self.folder or Path())

    def localizer(self, what: str, value: Any) -> str:
        """Return a localizer's name; ``file.py`` is its only localizer."""
        name = documents.as_text(what, value)
        return name if self.folder is None else absolute_reference(LOCALIZER, name, self.folder)

    def world(self, values: Overrides) -> Overrides:
        return values if self.folder is None else values.beside(self.folder)

    def assumed(self, values: Overrides) -> Overrides:
        return values if self.folder is None else absolute_assumed(values, self.folder)

    def method(self, entry: Any, what: str = "an entry of localizers") -> Method:
        label = ""
        if isinstance(entry, Mapping):
            for key in entry:
                one_of(f"key of {what}", key, ("name", "params", "label"))
            if "label" in entry:
                label = documents.as_text("label of a localizer", entry["label"])
            entry = {key: value for key, value in entry.items() if key != "label"}
        named = Named.told(what, entry)
        name = self.localizer("name of a localizer", named.name)
        return Method(name=name, params=named.params, label=label)

    def axis(self, table: Any) -> Overrides:
        axis = Overrides.told("vary", documents.as_table("vary", table, "a [[vary]] table"))

        def point(name: str, value: Any) -> Any:
            group, _, key = name.partition(".")
            if name == "disturbance":
                return wrappers(name, value)
            if name == "scenario":
                return self.scenario(value)
            if name == "agent":
                return self.agent(value)
            if group not in PARTS or group == "params":
                return value
            return getattr(self, group)(Overrides({key: value}))[key]

        lists = {name: listed(f"[[vary]] {name}", value) for name, value in axis.items()}
        return Overrides({n: tuple(point(n, v) for v in values) for n, values in lists.items()})


def _until_decided(table: Any) -> Any:
    options = documents.as_table("until_decided", table, "a table like {margin = 0.05}")
    for key in options:
        one_of("key in until_decided", key, ("margin",))
    return options.get("margin", 0.05)
