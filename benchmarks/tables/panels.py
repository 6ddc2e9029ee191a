"""What is compared: the methods of a setting, at one value of each swept parameter."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.setup.overrides import Named, Overrides, spelt
from benchmarks.setup.scenario import Thresholds
from benchmarks.tables.text import short_names
from benchmarks.trials.scores import JOURNEY_SCORES, Score
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Method, Setting

BASELINE = "mcl"  # localizer that others are compared with, unless a sweep says otherwise
BLIND = "dead-reckoning"  # uses no scan, so that it localizes nothing

# What a filter assumes of a world's numbers.
_ASSUMED = {"lidar.sigma": "scan.sigma"} | {
    f"noise.{name}": f"motion.{name}" for name in ("drive", "turn", "drift")
}


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Methods that are compared with one another; ``comparison`` has their numbers.

    Attributes:
        number: from 1, in the order of the results.
        title: what sets it apart from the other panels.
        setting: of the panel.
        swept: value of each parameter that is swept in the setting.
        labels: what each method is called, in the order of the results.
        baselines: what each method is compared with.
        records: finished trials by method.
        scores: of whole runs, that any of them has.
    """

    number: int
    title: str
    setting: Setting
    swept: Overrides
    labels: dict[Method, str]
    baselines: dict[Method, Method]
    records: dict[Method, list[Finished]]
    scores: list[Score]

    @property
    def thresholds(self) -> Thresholds:
        """What is far off, and lost."""
        return self._first.thresholds

    @property
    def unit(self) -> str:
        """The unit of lengths."""
        return self._first.unit

    @property
    def aim(self) -> Score | None:
        """The share of whole runs that it is about; None if it is about the error."""
        return aim_of(self.scores)

    @property
    def agents(self) -> list[Named | None]:
        """Who drives, the scenario's agent as None; several are compared with one another."""
        return list(dict.fromkeys(method.agent for method in self.labels))

    @property
    def _first(self) -> Finished:
        return next(iter(self.records.values()))[0]


class Group(NamedTuple):
    """What a panel is of: the methods of a setting at one value of each swept parameter."""

    setting: Setting
    swept: Overrides
    methods: list[Method]

    def pairs(self, baseline: str) -> list[tuple[Method, Method]]:
        """Return each method that is compared, and what with; see ``baseline_of``."""
        found = ((one, baseline_of(one, self.methods, baseline)) for one in self.methods)
        return [(method, reference) for method, reference in found if method != reference]


def groups(cells: Iterable[tuple[Setting, Method]]) -> list[Group]:
    """Split methods of settings into what is compared, in their order.

    A setting has a group for every value of the numbers of which one localizer has several; a
    method without such a parameter is in each of them.
    """
    settings: dict[Setting, dict[Method, None]] = {}
    for setting, method in cells:
        settings.setdefault(setting, {})[method] = None
    found = []
    for setting, methods in settings.items():
        named = list(dict.fromkeys(method.name for method in methods))
        listed = sorted(methods, key=lambda method: named.index(method.name))
        found += [
            Group(setting, swept, [one for one in listed if agree(one.values, swept)])
            for swept in _swept(listed)
        ]
    return found


def panels(records: Iterable[Finished], baseline: str = BASELINE) -> list[Panel]:
    """Split finished trials into panels, in their order.

    Args:
        records: the finished trials.
        baseline: localizer or agent that the others are compared with.
    """
    ended: dict[tuple[Setting, Method], list[Finished]] = {}
    for record in records:
        ended.setdefault((record.trial.setting, record.trial.method), []).append(record)
    titles = _titles(list(dict.fromkeys(setting for setting, _ in ended)))
    return [
        Panel(
            number=number,
            title=", ".join([titles[setting], *(f"{k} {v}" for k, v in swept.items())]),
            setting=setting,
            swept=swept,
            labels=_labels(methods),
            baselines={one: baseline_of(one, methods, baseline) for one in methods},
            records={one: ended[setting, one] for one in methods},
            scores=scores_in(record for one in methods for record in ended[setting, one]),
        )
        for number, (setting, swept, methods) in enumerate(groups(ended), 1)
    ]


def baseline_of(method: Method, methods: Iterable[Method], name: str) -> Method:
    """Return what a method is compared with: the localizer or the agent of that name.

    A localizer with the same agent, an agent with the same localizer; else the first method. Of
    several variants it is the one whose parameters agree with the method's, else the first.
    """
    listed = list(methods)
    variants = [other for other in listed if other.is_named(name)] or listed[:1]
    if variants[0].name == name:
        same = [one for one in variants if one.agent == method.agent]
    else:
        same = [one for one in variants if one.name == method.name]
    variants = same or variants
    return next((one for one in variants if agree(one.values, method.values)), variants[0])


def agree(some: Overrides, others: Overrides) -> bool:
    """Whether the parameters that both have are the same."""
    return all(spelt(some[name]) == spelt(others[name]) for name in some.keys() & others.keys())


def scores_in(records: Iterable[Finished]) -> list[Score]:
    """Return the scores of whole runs that any of these records has, in their order."""
    names = {name for record in records if record.journey for name in record.journey.scores}
    return [score for name, score in JOURNEY_SCORES.items() if name in names]


def aim_of(scores: Iterable[Score]) -> Score | None:
    """Return the share of whole runs that these are about; None if they are about the error.

    Who was carried off is to be found again; who was lost, to be localized.
    """
    shares = [one for one in scores if one.tested and one.unit == "share"]
    return shares[-1] if shares else None


def is_number(value: Any) -> bool:
    """Whether a value can stand on an axis."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def disturbance_words(wrapper: Overrides) -> str:
    """Its kind, and what it was given."""
    given = dict(wrapper)
    kind = given.pop("kind", "disturbance")
    return " ".join([kind, *(f"{name} {value}" for name, value in given.items())])


def _swept(methods: Sequence[Method]) -> list[Overrides]:
    """Values of the numbers of which one localizer has several; none of them if there are none.

    A word makes variants of a localizer, which appear side by side.
    """
    seen: dict[tuple[str, str], set[Any]] = {}
    for method in methods:
        for name, value in method.values.items():
            if is_number(value):
                seen.setdefault((_owner(method, name), name), set()).add(spelt(value))
    names = {name for (_, name), values in seen.items() if len(values) > 1}
    taken = dict.fromkeys(
        Overrides({name: value for name, value in method.values.items() if name in names})
        for method in methods
    )
    # what says less than another one, and nothing else, is no panel of its own
    return [
        swept
        for swept in taken
        if not any(len(more) > len(swept) and agree(swept, more) for more in taken)
    ]


def _owner(method: Method, name: str) -> str:
    """The localizer or the agent that has a parameter."""
    agent = method.agent if name.startswith("agent.") else None
    return agent.name if agent else method.name


def _labels(methods: Sequence[Method]) -> dict[Method, str]:
    """Localizer, agent or both, as far as they tell methods apart, with what else does."""
    names = short_names({method.name for method in methods})
    drivers = short_names({method.agent.name for method in methods if method.agent})
    several = len({method.agent for method in methods}) > 1
    labels = {}
    for method in methods:
        localizer = " ".join([names[method.name], *_variant(method, methods)])
        own = Method(method.agent.name, method.agent.params) if method.agent else None
        agent = "the scenario's agent"
        if own is not None:
            rivals = [Method(m.agent.name, m.agent.params) for m in methods if m.agent]
            agent = " ".join([drivers[own.name], *_variant(own, rivals)])
        both = f"{agent} with {localizer}" if len(names) > 1 else agent
        labels[method] = both if several else localizer
    return labels


def _variant(method: Method, methods: Sequence[Method]) -> list[str]:
    """Its parameters that tell it from the methods of the same localizer; words alone if they do.

    A variant named by words is another choice of models, and the numbers that go with it are as
    long as they are uninteresting.
    """
    same = [other.params for other in methods if other.name == method.name]
    apart = [(n, v) for n, v in method.params.items() if not all(_has(o, n, v) for o in same)]
    words = [(name, value) for name, value in apart if not is_number(value)]
    alike = [other for other in same if all(_has(other, *word) for word in words)]
    return [f"{name}={value}" for name, value in (words if len(alike) == 1 else apart)]


def _has(params: Overrides, name: str, value: Any) -> bool:
    return name in params and spelt(params[name]) == spelt(value)


def _titles(settings: Sequence[Setting]) -> dict[Setting, str]:
    """The scenario and what differs from it; lag and seed where settings differ in them."""
    names = short_names({setting.scenario for setting in settings})
    several_lags = len({setting.lag for setting in settings}) > 1
    several_seeds = len({setting.seed for setting in settings}) > 1
    titles = {}
    for setting in settings:
        words = [f"scenario {names[setting.scenario]}"]
        words += [f"{name} {value}" for name, value in setting.world.short().items()]
        words += _assumed(setting)
        words += map(disturbance_words, setting.disturbance)
        words += [f"L {setting.lag}"] if several_lags else []
        words += [f"seed {setting.seed}"] if several_seeds else []
        titles[setting] = ", ".join(words)
    return titles


def _assumed(setting: Setting) -> list[str]:
    """What filters assume; in a few words if they assume all that the world is told to be."""
    told = {_ASSUMED[name]: value for name, value in setting.world.items() if name in _ASSUMED}
    alike = bool(told) and told.items() <= setting.assumed.items()
    apart = [(n, value) for n, value in setting.assumed.items() if not (alike and n in told)]
    words = [f"assumed {name} {_without_folder(value)}" for name, value in apart]
    return [*words, "filters assume the same"] if alike else words


def _without_folder(value: Any) -> Any:
    """Return ``path/file.py:NAME`` as "file:NAME"; other values as they are."""
    place, _, name = str(value).rpartition(":")
    return f"{Path(place).stem}:{name}" if place.endswith(".py") else value
