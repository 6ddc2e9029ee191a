"""What is compared: the methods of a setting, at one value of each swept parameter."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.setup.changes import Changes, Named, spelt
from benchmarks.setup.scenario import Thresholds
from benchmarks.tables.comparison import Comparison, baseline_of, compared
from benchmarks.tables.deciding import Rule
from benchmarks.tables.gap import Gap, LimitRuns, gaps
from benchmarks.tables.journeys import Outcomes, longest_ways
from benchmarks.tables.pairing import BASELINE, agree
from benchmarks.tables.text import short_name, short_names
from benchmarks.tables.verdict import BLIND, Rivals, Verdict, rivals, verdict
from benchmarks.trials.scores import Score
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Method, Run, Setting, Trial

# What a filter assumes of a world's numbers.
_ASSUMED = {"lidar.sigma": "scan.sigma"} | {
    f"noise.{name}": f"motion.{name}" for name in ("drive", "turn", "drift")
}


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Methods that are compared with one another.

    Attributes:
        number: from 1, in the order of the results.
        title: what sets it apart from the other panels.
        setting: of the panel.
        swept: value of each parameter that is swept in the setting.
        labels: what each method is called, in the order of the results.
        rows: every method against the baseline, at all offsets.
        gaps: every method against the limit of its target, where there is one.
        verdict: who is best; None if nothing is known.
        of_filters: the same among the methods that use scans.
        rivals: every method against the paper's, by offset.
        records: finished trials by method.
        whole: whole runs by method, with those that failed.
        thresholds: of what is far off, and lost.
        unit: of lengths.
        rule: when its comparisons are decided; None: the number of worlds was fixed before.
    """

    number: int
    title: str
    setting: Setting
    swept: Changes
    labels: dict[Method, str]
    rows: list[Comparison]
    gaps: list[Gap]
    verdict: Verdict | None
    of_filters: Verdict | None
    rivals: dict[int, Rivals]
    records: dict[Method, list[Finished]]
    whole: dict[Method, Outcomes]
    thresholds: Thresholds
    unit: str
    rule: Rule | None = None

    @property
    def far(self) -> str:
        """What is far off, in words: e > 50 px."""
        return f"e > {self.thresholds.far:g} {self.unit}"

    @property
    def aim(self) -> Score | None:
        """The share of whole runs that it is about; None if it is about the error."""
        return self.rows[0].aim

    @cached_property
    def present(self) -> list[Comparison]:
        """The rows about x_t."""
        return [row for row in self.rows if row.offset == 0]

    @cached_property
    def ranked(self) -> list[Comparison]:
        """The same, the best first."""
        return ranked(self.rows)

    @property
    def tests(self) -> int:
        """How many tests Holm's correction at x_t is for."""
        own = (p for row in self.present for p in (row.p, *(s.p for s in row.journey.values())))
        return sum(not math.isnan(p) for p in own)

    @property
    def agents(self) -> list[Named | None]:
        """Who drives, the scenario's agent as None; several are compared with one another."""
        return list(dict.fromkeys(method.agent for method in self.labels))

    def called(self, method: Method) -> str:
        """What a method is called beside others: by its label if agents are compared."""
        return self.labels[method] if len(self.agents) > 1 else short_name(method.name)

    def baseline_of(self, row: Comparison) -> Comparison:
        """The row of a method's baseline at x_t."""
        return next(one for one in self.present if one.method == row.baseline)


def ranked(rows: Iterable[Comparison]) -> list[Comparison]:
    """Rows at x_t, the best first, an unknown one last; of equal ones the baseline first."""
    present = [row for row in rows if row.offset == 0]
    return sorted(present, key=lambda row: (row.worse, not row.is_baseline))


class Group(NamedTuple):
    """What a panel is of: the methods of a setting at one value of each swept parameter."""

    setting: Setting
    swept: Changes
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


class Ended:
    """Trials that came to an end, by setting and method.

    Attributes:
        records: those that finished.
        failed: the runs of the others.
    """

    def __init__(self, records: Iterable[Finished], failures: Iterable[Trial]) -> None:
        """Sort them."""
        self.records: dict[tuple[Setting, Method], list[Finished]] = {}
        self.failed: dict[tuple[Setting, Method], list[Run]] = {}
        for record in records:
            own = record.trial.setting, record.trial.method
            self.records.setdefault(own, []).append(record)
        for trial in failures:
            self.failed.setdefault((trial.setting, trial.method), []).append(trial.run)

    def of(self, group: Group) -> dict[Method, Outcomes]:
        """Return the runs of each method of a group."""
        setting = group.setting
        members = {m: self.records.get((setting, m), []) for m in group.methods}
        longest = longest_ways(chain.from_iterable(members.values()))
        return {
            m: Outcomes(records=own, failed=self.failed.get((setting, m), ()), longest=longest)
            for m, own in members.items()
        }


def panels(
    records: Iterable[Finished],
    baseline: str = BASELINE,
    limits: Sequence[LimitRuns] = (),
    failures: Iterable[Trial] = (),
    rule: Rule | None = None,
) -> list[Panel]:
    """Split finished trials into panels, in their order, and compare the methods of each.

    Args:
        records: the finished trials.
        baseline: localizer or agent that the others are compared with.
        limits: what gaps are measured from.
        failures: the trials that failed.
        rule: when comparisons are decided; None: all worlds are run, whatever they show.
    """
    found: list[Panel] = []
    ended = Ended(records, failures)
    split = groups(ended.records)
    titles = _titles(list(dict.fromkeys(group.setting for group in split)))
    for group in split:
        setting, swept, _ = group
        whole = ended.of(group)
        members = {method: list(own.records) for method, own in whole.items()}
        first = next(iter(members.values()))[0]
        rows = compared(members, baseline, whole, rule)
        best = ranked(rows)
        filters = [row for row in best if row.method.name != BLIND]
        found.append(
            Panel(
                number=len(found) + 1,
                title=", ".join([titles[setting], *(f"{k} {v}" for k, v in swept.items())]),
                setting=setting,
                swept=swept,
                labels=_labels(list(members)),
                rows=rows,
                gaps=gaps(setting, swept, members, limits),
                verdict=verdict(best, members, whole, lead=rule is None),
                of_filters=verdict(filters, members, whole, lead=rule is None),
                rivals=rivals(members, setting.lag) if rule is None else {},
                records=members,
                whole=whole,
                thresholds=first.thresholds,
                unit=first.unit,
                rule=rule,
            )
        )
    return found


def is_number(value: Any) -> bool:
    """Whether a value can stand on an axis."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def disturbance_words(wrapper: Changes) -> str:
    """Its kind, and what it was given."""
    given = dict(wrapper)
    kind = given.pop("kind", "disturbance")
    return " ".join([kind, *(f"{name} {value}" for name, value in given.items())])


def _swept(methods: Sequence[Method]) -> list[Changes]:
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
        Changes({name: value for name, value in method.values.items() if name in names})
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


def _has(params: Changes, name: str, value: Any) -> bool:
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
