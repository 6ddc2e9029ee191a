"""Tables that the code itself has: parameters, arguments, ids, scores … for ``docs.tables``."""

import inspect
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import localizers
from benchmarks.agents import AGENTS
from benchmarks.setup.names import SCENARIOS, scenario
from benchmarks.sweeps.sweepfile import SUITES, sweep_named
from benchmarks.trials.scores import JOURNEY_SCORES, METRICS, TRACK_SCORES, Score
from localizers.checks import LAWS, law_name

Table = tuple[list[str], Iterable[list[str]]]  # heads, rows


def parameters(*names: str) -> Table:
    """Return a table of the parameters of localizers, each with what it is; of several, whose.

    Those of a name after a minus are left out: "cbgl", "-mcl-map".
    """
    left_out = {
        parameter.name
        for name in names
        if name.startswith("-")
        for parameter in localizers.describe(name[1:]).parameters
    }
    names = tuple(name for name in names if not name.startswith("-"))
    rows: dict[tuple[str, str], dict[str, str]] = {}  # default by localizer by name and meaning
    for localizer in names:
        for parameter in localizers.describe(localizer).parameters:
            if parameter.name in left_out:
                continue
            row = rows.setdefault((parameter.name, parameter.meaning), {})
            row[localizer] = f"`{parameter.default_words}`".replace("'", '"')
    lines = []
    for (name, meaning), defaults in rows.items():
        values = ", ".join(dict.fromkeys(defaults.values()))
        of = "all" if len(defaults) == len(names) else ", ".join(f"`{n}`" for n in defaults)
        lines.append([f"`{name}`", values, meaning, of])
    heads = ["parameter", "default", "what it is", "of"]
    wide = len(names) > 1
    return (heads if wide else heads[:3], (line if wide else line[:3] for line in lines))


_SCORES: dict[str, Iterable[Score]] = {
    "offset": METRICS,
    "run": JOURNEY_SCORES.values(),
    "log": TRACK_SCORES.values(),
}


def scores(*kinds: str) -> Table:
    """Return a table of scores: of beliefs at an "offset", of a "run", of a whole "log"; or all."""
    rows = []
    for score in (score for kind in kinds or _SCORES for score in _SCORES[kind]):
        has_unit = score.unit not in ("", "share", score.words.split()[-1])
        meaning = score.words + (f" ({score.unit})" if has_unit else "")
        rows.append([f"`{score.name}`", meaning, score.better])
    return (["score", "what it is (unit)", "better"], rows)


def suites() -> Table:
    """Return a table of the suites."""
    sweeps = {name: sweep_named(name) for name in SUITES}
    return (
        ["suite", "trials", "what it compares"],
        ([f"`{n}`", f"{s.planned:,}", s.title] for n, s in sweeps.items()),
    )


def scenarios() -> Table:
    """Return a table of the scenarios."""
    rows = ([f"`{name}`", scenario(name).words] for name in SCENARIOS)
    return (["scenario", "what it is"], rows)


def agents() -> Table:
    """Return a table of the agents."""
    rows = ([f"`{name}`", _first_line(agent)] for name, agent in AGENTS.items())
    return (["agent", "what it does"], rows)


def laws() -> Table:
    """Return a table of the laws of a localizer."""
    rows = ([law_name(law), _first_line(law)] for law in LAWS)
    return (["law", "what must hold"], rows)


def _first_line(thing: object) -> str:
    return str(thing.__doc__).partition("\n")[0].replace("``", "`")


def ids() -> Table:
    """Return the ids of the environments: what they are, of what arguments, how long they last."""
    import gymnasium as gym

    from deqmcl_gym import ABOUT
    from deqmcl_gym.world import WORLDS

    rows = []
    for name, about in ABOUT.items():
        spec = gym.spec(f"deqmcl_gym/{name}")
        made = dict(spec.kwargs)
        if "preset" in made:
            made = _changes(WORLDS["paper"], WORLDS[made["preset"]])
        settings = ", ".join(f"`{part}={_code(value)}`" for part, value in _flat(made))
        arguments = {each: default for each, default, _ in _signature(_class(name))}
        most = spec.max_episode_steps or arguments.get("max_steps") or "none"
        together = "in kernels" if spec.vector_entry_point else "in a loop"
        if "scan" in arguments:
            together = '`scan="table"`, `mcl`'
        rows.append([f"`{name}`", about, settings, str(most), together])
    return (["`deqmcl_gym/…`", "what it is", "set", "most steps", "`make_vec`"], rows)


def arguments(name: str) -> Table:
    """Return the arguments of an id, or of a part of it (``Office``), from the code's own words."""
    owner = _class(name)
    if is_dataclass(owner):
        return (["key", "default", "meaning"], _keys("", owner, owner))
    rows = []
    for argument, default, meaning in _signature(owner):
        part, asked = _part(argument) if name == "Room-v0" else (None, True)
        if asked:
            rows.append([f"`{argument}`", f"`{_code(default)}`", meaning])
        if part is not None:
            rows += _keys(f"{argument}.", type(part), part)
    return (["argument", "default", "meaning"], rows)


def _class(name: str) -> Any:
    import gymnasium as gym
    from gymnasium.envs.registration import load_env_creator

    import deqmcl_gym

    if "-v" not in name:
        return getattr(deqmcl_gym, name, None) or getattr(deqmcl_gym.maps, name)
    return load_env_creator(str(gym.spec(f"deqmcl_gym/{name}").entry_point))


def _signature(cls: type) -> Iterator[tuple[str, Any, str]]:
    """Yield the arguments of a class and of those that it is derived from, with their words."""
    seen = set()
    for owner in (base for base in cls.__mro__ if base.__module__.split(".")[0] != "gymnasium"):
        words = _words(owner)
        for argument in inspect.signature(owner).parameters.values():
            asked = argument.default is not argument.empty
            if asked and argument.name in words and argument.name not in seen:
                seen.add(argument.name)
                yield argument.name, argument.default, words[argument.name]


def _words(owner: type) -> dict[str, str]:
    """Return what the docstring of a class says of each argument."""
    section = (inspect.getdoc(owner) or "").partition("Args:\n")[2].partition("\n\n")[0]
    meanings: dict[str, str] = {}
    for names, words in re.findall(r"^    (\w[\w, ]*): ((?:.*\n?)(?:     .*\n?)*)", section, re.M):
        meaning = " ".join(words.split()).removesuffix(".").replace("``", "`").replace("|", "or")
        meanings |= dict.fromkeys(names.split(", "), meaning)
    return meanings


def _part(argument: str) -> tuple[Any, bool]:
    """Return a part of the world with its defaults, and whether a world may be without it."""
    from deqmcl_gym import world
    from deqmcl_gym.world import WORLDS

    if argument in world._OPTIONAL:
        return world._OPTIONAL[argument](), True
    part = getattr(WORLDS["paper"], argument, None)
    return (None, True) if argument == "floor_plan" or part is None else (part, False)


def _keys(prefix: str, owner: Any, defaults: Any) -> list[list[str]]:
    """Return a row for each field of a dataclass, with the comment ``#:`` above or beside it."""
    source = inspect.getsource(owner)
    lines = re.findall(r"((?:^    #: .*\n)*)^    (\w+): [^\n#]*(?:#: (.*))?$", source, re.M)
    meanings = {n: " ".join(above.replace("#:", "").split()) or side for above, n, side in lines}
    rows = []
    for field in fields(owner):
        unit = {1: " px", -1: " /px"}.get(field.metadata.get("length", 0), "")
        code = _code(getattr(defaults, field.name))
        value = f"`{code}`{unit if code != 'None' else ''}"
        rows.append([f"`{prefix}{field.name}`", value, meanings[field.name].replace("``", "`")])
    return rows


def _changes(of: Any, to: Any) -> dict[str, Any]:
    """Return what differs between two dataclasses, part by part."""
    changes: dict[str, Any] = {}
    for field in fields(of):
        old, new = getattr(of, field.name), getattr(to, field.name)
        if old != new:
            changes[field.name] = {} if is_dataclass(new) else new
            if is_dataclass(old) and is_dataclass(new):
                changes[field.name] = _changes(old, new)
    return changes


def _flat(parts: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, value in parts.items():
        if name == "floor_plan" or not (isinstance(value, dict) and value):
            yield name, value
        else:
            yield from ((f"{name}.{key}", each) for key, each in value.items())


def _code(value: Any) -> str:
    """Return a value as code; angles as shares of π."""
    share = value / math.pi if isinstance(value, float) else 0.0
    for below in (1, 2, 4, 12):
        if share and math.isclose(share * below, round(share * below), abs_tol=1e-9):
            times = round(share * below)
            return f"{times if times != 1 else ''}π{f'/{below}' if below > 1 else ''}"
    return repr(value).replace("'", '"')


OF_CODE: dict[str, Callable[..., Table]] = {  # by the word of their marker
    table.__name__: table
    for table in (parameters, scores, suites, scenarios, agents, laws, ids, arguments)
}
