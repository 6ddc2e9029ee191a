"""What a sweep is: a factorial design of settings and methods over paired worlds, as data."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from benchmarks.setup.names import absolute_agent, absolute_scenario
from benchmarks.setup.overrides import NOTHING, Named, Overrides, jsonable
from benchmarks.tables import BASELINE
from benchmarks.trials import Method, Setting, Trial, changes_of
from deqmcl_gym.validation import InputError, integer, number, one_of
from localizers import parameters

PARTS = ("world", "assumed", "params")  # of dotted names; agent.… are the agent's parameters
SCALARS = ("scenario", "lag", "disturbance", "agent")
MOST_TRIALS = 1_000_000  # trials
_CANONICAL = (  # of a sweep, in the order of its manifest
    *("title", "localizers", "scenario", "lag", "world", "assumed", "disturbance", "params"),
    *("seed", "trials", "filter_seeds", "vary"),
)

Takes = Callable[[str], tuple[str, ...] | None]


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A base, varied along axes; every combination is run by every localizer on the same worlds."""

    title: str
    localizers: tuple[Method, ...]  #: the methods compared, or their names
    scenario: str = "paper"  #: its name; a user's own as room.toml, absolute
    lag: int = 20  #: the lag L; also a parameter of each localizer that has a use for it
    world: Overrides = NOTHING
    assumed: Overrides = NOTHING
    disturbance: tuple[Overrides, ...] = ()
    agent: Named | None = None  #: who drives; None is each scenario's own agent
    params: Overrides = NOTHING
    seed: int = 0
    trials: int = 10
    filter_seeds: int = 1
    #: axes, the last one turns fastest: lists of values, which advance together, by name:
    #: "scenario", "lag", "disturbance", "agent", "agent.…", "world.…", "assumed.…" or "params.…"
    vary: tuple[Overrides, ...] = ()
    #: localizer that the others are compared with, under the same agent; or agent, on the same
    #: localizer. "" is the first agent if there are several, else ``BASELINE``.
    baseline: str = ""
    #: difference of no importance, as a share of the baseline's error or of runs: worlds are run in
    #: blocks, each method until its comparison is decided, ``trials`` at most; None: all are run
    until_decided: float | None = None
    #: names of the parameters that a localizer of a name takes; None is any
    takes: Takes = field(default=parameters, compare=False, repr=False)

    def __post_init__(self) -> None:
        changes_of(self)
        if isinstance(self.localizers, str):
            raise InputError(f"localizers is {self.localizers!r}, but must be a list of names.")
        methods = (m if isinstance(m, Method) else Method(name=m) for m in self.localizers)
        object.__setattr__(self, "localizers", tuple(methods))
        for name in ("world", "assumed"):  # nested as in TOML, or by dotted name
            object.__setattr__(self, name, Overrides.told(name, getattr(self, name)))
        object.__setattr__(self, "scenario", _scenario(self.scenario))
        object.__setattr__(self, "vary", tuple(map(_axis, self.vary)))
        if self.agent is not None:
            object.__setattr__(self, "agent", _agent(self.agent))
        if not self.baseline:
            object.__setattr__(self, "baseline", self._usual_baseline)
        self._check()

    def _check(self) -> None:
        integer("lag", self.lag)
        integer("seed", self.seed)
        if self.until_decided is not None:
            number("margin of until_decided", self.until_decided, low=0, high=1)
        integer("trials", self.trials, low=1, high=100_000)
        integer("filter_seeds", self.filter_seeds, low=1, high=100_000)
        if not self.localizers:
            raise InputError("the sweep names no localizer, so there are no combinations to run.")
        for axis in self.vary:
            for value in axis.get("lag", ()):
                integer("lag", value)
        for name in self.names:
            self.takes(_label("localizer", name))
        labels = [_label("label", method.label) for method in self.localizers if method.label]
        if twice := [label for label in labels if labels.count(label) > 1]:
            raise InputError(f"the label {twice[0]!r} is of several localizers: give each its own.")
        if self.baseline not in (BASELINE, self._usual_baseline):
            allowed = [name for m in self.localizers for name in (m.name, m.label) if name]
            one_of("baseline", self.baseline, [*allowed, *self.agents])
        for name in self.varied:
            if name.startswith("agent.") and self.agent is None and "agent" not in self.varied:
                raise InputError(
                    f"{name} is varied, but no agent is named: write agent = … beside it."
                )
            if self.varied.count(name) > 1:
                raise InputError(f"{name} is varied twice: name it in one [[vary]].")
        if self.combinations > MOST_TRIALS:
            raise InputError(
                f"the sweep has {self.combinations:,} trials, more than {MOST_TRIALS:,}: vary "
                "less, or make several sweeps of it."
            )

    @property
    def combinations(self) -> int:
        """How many trials are asked for, counted without listing them; equal ones count twice."""
        points = math.prod(len(_rows(axis)) for axis in self.vary)
        return points * len(self.localizers) * self.trials * self.filter_seeds

    @property
    def planned(self) -> int:
        """How many trials it runs, counted by cells: equal combinations are one."""
        return len({*self.cells()}) * self.trials * self.filter_seeds

    @property
    def names(self) -> list[str]:
        """Every localizer that it names."""
        return list(dict.fromkeys(method.name for method in self.localizers))

    @property
    def varied(self) -> list[str]:
        """Every name that its axes vary."""
        return [name for axis in self.vary for name in axis]

    @property
    def agents(self) -> list[str]:
        """Names of the agents that it names."""
        varied = [agent for axis in self.vary for agent in axis.get("agent", ())]
        agents = varied or ([] if self.agent is None else [self.agent])
        return list(dict.fromkeys(agent.name for agent in agents))

    @property
    def _usual_baseline(self) -> str:
        return self.agents[0] if len(self.agents) > 1 else BASELINE

    @property
    def labelled(self) -> list[Method]:
        """The methods with labels as their trials have them."""
        methods = zip(self.cells(), itertools.cycle(self.localizers), strict=False)
        return [replace(cell.method, label=m.label) for cell, m in methods if m.label]

    def cells(self) -> Iterator[Trial]:
        """Yield the first trial of each setting and method."""
        for base in self._points():
            for method in self.localizers:
                params = self.params_of(method, {"lag": base["lag"], **base["params"]})
                same = base | {"localizer": method.name, "params": params, "seed": self.seed}
                yield Trial(**same, trial=0)

    def params_of(self, method: Method, shared: Mapping[str, Any]) -> Overrides:
        """Return the shared parameters that a method takes, and its own."""
        taken = self.takes(method.name)
        useful = {k: v for k, v in shared.items() if taken is None or k in taken}
        return Overrides(useful) | method.params

    def distinct(self) -> list[Trial]:
        """Return the distinct trials by setting, then method, world, filter seed."""
        runs = itertools.product(self.cells(), range(self.trials), range(self.filter_seeds))
        return list(dict.fromkeys(replace(cell, trial=k, filter_seed=f) for cell, k, f in runs))

    def canonical(self) -> dict[str, Any]:
        """Return the sweep as JSON-able values: what a folder of results is checked against."""
        values = {name: jsonable(getattr(self, name)) for name in _CANONICAL}
        if self.agent is not None:
            values["agent"] = self.agent.json()
        if self.baseline != self._usual_baseline:
            values["baseline"] = jsonable(self.baseline)
        if self.until_decided is not None:
            values["until_decided"] = {"margin": self.until_decided}
        return values

    def _points(self) -> Iterator[dict[str, Any]]:
        """Yield the base with the values of each point of the design."""
        for point in itertools.product(*map(_rows, self.vary)):
            base: dict[str, Any] = {name: getattr(self, name) for name in (*SCALARS, *PARTS)}
            tuned: dict[str, Any] = {}  # of the agent, whichever it is
            for name, value in itertools.chain.from_iterable(point):
                group, _, rest = name.partition(".")
                if not rest:
                    base[name] = value
                elif group == "agent":
                    tuned[rest] = value
                elif isinstance(value, Overrides):  # a part beside "none": {look_ahead = 25.0}
                    base[group] |= {f"{rest}.{key}": inner for key, inner in value.items()}
                else:
                    base[group] |= {rest: value}
            if tuned:
                base["agent"] = replace(base["agent"], params=base["agent"].params | tuned)
            yield base


def by_cell(trials: Iterable[Trial]) -> dict[tuple[Setting, Method], list[Trial]]:
    """Sort trials by setting and method, in the order in which these come first."""
    cells: dict[tuple[Setting, Method], list[Trial]] = {}
    for trial in trials:
        cells.setdefault((trial.setting, trial.method), []).append(trial)
    return cells


def _axis(given: Any) -> Overrides:
    """Return what is varied together: k values by name; those of scenarios and agents absolute."""
    axis = Overrides.told("vary", given)
    lengths = {name: len(values) for name, values in axis.items()}
    for name, length in lengths.items():
        group, _, rest = name.partition(".")
        if not (group in (*PARTS, "agent") and rest):
            allowed = (*SCALARS, *(f"{g}.…" for g in (*PARTS, "agent")))
            one_of("name in [[vary]]", name, allowed)
        if length == 0:
            raise InputError(f"[[vary]] {name} is empty: give one value or more.")
    if len(set(lengths.values())) > 1:
        counted = ", ".join(f"{name}: {length}" for name, length in lengths.items())
        raise InputError(
            f"one [[vary]] has lists of different lengths ({counted}): they advance together; "
            "write a [[vary]] for each to get all combinations."
        )
    if not lengths:
        raise InputError("a [[vary]] is empty: give a name and its values.")
    made_absolute = {"scenario": _scenario, "agent": _agent}
    return axis | {n: tuple(map(of, axis[n])) for n, of in made_absolute.items() if n in axis}


def _rows(axis: Overrides) -> list[list[tuple[str, Any]]]:
    """Return names and values of each point of an axis."""
    return [[*zip(axis, row, strict=True)] for row in zip(*axis.values(), strict=True)]


def _agent(agent: Any) -> Named:
    named = absolute_agent(agent if isinstance(agent, Named) else Named.told("agent", agent))
    _label("agent", named.name)
    return named


def _scenario(name: str) -> str:
    return _label("scenario", absolute_scenario(name))


def _label(kind: str, name: str) -> str:
    """Refuse a name that cannot stand in a table."""
    if not name.isprintable():
        raise InputError(
            f"the {kind} {name!a} has a line break, a control character or a byte that is no "
            "UTF-8 in its name: rename its file."
        )
    return name
