"""What is compared: the methods of a setting, at one value of each swept parameter."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.setup.changes import Changes
from benchmarks.tables.comparison import Comparison, compared
from benchmarks.tables.gap import Gap, LimitRuns, gaps
from benchmarks.tables.pairing import (
    BASELINE,
    Method,
    Record,
    Run,
    Setting,
    agree,
    method_of,
    run_of,
    setting_of,
)
from benchmarks.tables.thresholds import Thresholds, thresholds_of

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
        records: finished trials by method.
        failed: runs that failed by method.
        thresholds: far and lost, and the unit of length.
    """

    number: int
    title: str
    setting: Setting
    swept: Changes
    labels: dict[Method, str]
    rows: list[Comparison]
    gaps: list[Gap]
    records: dict[Method, list[Record]]
    failed: dict[Method, list[Run]]
    thresholds: Thresholds

    @property
    def present(self) -> list[Comparison]:
        """The rows about x_t."""
        return [row for row in self.rows if row.offset == 0]


def panels(
    records: Iterable[Record],
    baseline: str = BASELINE,
    limits: Sequence[LimitRuns] = (),
    failures: Iterable[dict[str, Any]] = (),
) -> list[Panel]:
    """Split finished trials into panels, in their order, and compare the methods of each.

    A setting has a panel for every value of the numbers of which one localizer has several; a
    method without such a parameter is in each of them. ``failures`` are the trials that failed.
    """
    failed: dict[tuple[Setting, Method], list[Run]] = {}
    for record in ({"trial": trial} for trial in failures):
        failed.setdefault((setting_of(record), method_of(record)), []).append(run_of(record))
    settings: dict[Setting, dict[Method, list[Record]]] = {}
    for record in records:
        methods = settings.setdefault(setting_of(record), {})
        methods.setdefault(method_of(record), []).append(record)
    titles = _titles(list(settings))
    found: list[Panel] = []
    for setting, methods in settings.items():
        named = list(dict.fromkeys(method.localizer for method in methods))
        listed = sorted(methods, key=lambda method: named.index(method.localizer))
        for swept in _swept(listed):
            members = {m: methods[m] for m in listed if agree(m.params, swept)}
            lacking = {method: failed.get((setting, method), []) for method in members}
            found.append(
                Panel(
                    number=len(found) + 1,
                    title=", ".join([titles[setting], *(f"{k} {v}" for k, v in swept.items())]),
                    setting=setting,
                    swept=swept,
                    labels=_labels(list(members)),
                    rows=compared(members, baseline, lacking),
                    gaps=gaps(setting, swept, members, limits),
                    records=members,
                    failed=lacking,
                    thresholds=thresholds_of(next(iter(members.values()))[0]),
                )
            )
    return found


def short_name(localizer: str) -> str:
    """A name for pictures: a plug-in's class or file without the way to it."""
    return localizer.rsplit(":", 1)[-1].rsplit("/", 1)[-1]


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
        for name, value in method.params.items():
            if is_number(value):
                seen.setdefault((method.localizer, name), set()).add(value)
    names = {name for (_, name), values in seen.items() if len(values) > 1}
    taken = dict.fromkeys(
        Changes({name: value for name, value in method.params.items() if name in names})
        for method in methods
    )
    # what says less than another one, and nothing else, is no panel of its own
    return [
        swept
        for swept in taken
        if not any(len(more) > len(swept) and agree(swept, more) for more in taken)
    ]


def _labels(methods: Sequence[Method]) -> dict[Method, str]:
    names = {method: short_name(method.localizer) for method in methods}
    if len(set(names.values())) < len({method.localizer for method in methods}):
        names = {method: method.localizer for method in methods}
    return {method: " ".join([name, *_variant(method, methods)]) for method, name in names.items()}


def _variant(method: Method, methods: Sequence[Method]) -> list[str]:
    """Its parameters that tell it from the methods of the same localizer; words alone if they do.

    A variant named by words is another choice of models, and the numbers that go with it are as
    long as they are uninteresting.
    """
    same = [other.params for other in methods if other.localizer == method.localizer]
    apart = [(n, v) for n, v in method.params.items() if any(other.get(n) != v for other in same)]
    words = [(name, value) for name, value in apart if not is_number(value)]
    alike = [other for other in same if all(other.get(name) == value for name, value in words)]
    return [f"{name}={value}" for name, value in (words if len(alike) == 1 else apart)]


def _titles(settings: Sequence[Setting]) -> dict[Setting, str]:
    """The scenario and what differs from it; lag and seed where settings differ in them."""
    several_lags = len({setting.lag for setting in settings}) > 1
    several_seeds = len({setting.seed for setting in settings}) > 1
    titles = {}
    for setting in settings:
        words = [f"scenario {setting.scenario}"]
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
    words = [f"assumed {name} {value}" for name, value in apart]
    return [*words, "filters assume the same"] if alike else words
