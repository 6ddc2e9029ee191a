"""What the report shows side by side: a setting, with the parameters that are swept in it."""

import json
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any

from benchmarks.tables.comparison import Comparison, comparisons
from benchmarks.tables.pairing import BASELINE, Method, Record, Setting, method_of, setting_of
from benchmarks.tables.table_1 import TITLES

Params = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Methods that are compared on one setting, at one value of each swept parameter.

    Attributes:
        number: from 1, in the order of the results.
        title: what sets it apart from the other panels.
        setting: of the panel.
        labels: what each method is called, in the order of the results.
        rows: comparisons, all offsets.
        records: finished trials by method.
    """

    number: int
    title: str
    setting: Setting
    labels: dict[Method, str]
    rows: list[Comparison]
    records: dict[Method, list[Record]]

    @property
    def present(self) -> list[Comparison]:
        """The rows about x_t."""
        return [row for row in self.rows if row.offset == 0]

    def own(self, method: Method) -> list[Record]:
        """Finished trials of a method."""
        return self.records.get(method, [])


def panels(
    rows: Sequence[Comparison], records: Sequence[Record], baseline: str = BASELINE
) -> list[Panel]:
    """Split the results into panels, in their order."""
    finished: dict[tuple[Setting, Method], list[Record]] = {}
    for record in records:
        key = setting_of(record["trial"]), method_of(record["trial"])
        finished.setdefault(key, []).append(record)
    settings = list(dict.fromkeys(row.setting for row in rows))
    named = _names(settings)
    found: list[Panel] = []
    for setting in settings:
        own = [row for row in rows if row.setting == setting]
        methods = list(dict.fromkeys(row.method for row in own))
        for swept in _swept_values(methods):
            members = [m for m in methods if _agrees(_params(m), swept)]
            labels = _labels(members)
            kept = {method: finished.get((setting, method), []) for method in labels}
            words = [named[setting], *(f"{name} {value}" for name, value in swept.items())]
            found.append(
                Panel(
                    number=len(found) + 1,
                    title=", ".join(words),
                    setting=setting,
                    labels=labels,
                    rows=_within([row for row in own if row.method in labels], kept, baseline),
                    records=kept,
                )
            )
    return found


def _within(
    rows: list[Comparison], records: dict[Method, list[Record]], baseline: str
) -> list[Comparison]:
    """The rows, those of methods without the swept parameter anew: their baseline is here, too."""
    strayed = {(row.method, row.offset) for row in rows if row.baseline not in records}
    if not strayed:
        return rows
    anew = comparisons([record for own in records.values() for record in own], baseline)
    here = {(row.method, row.offset): row for row in anew}
    return [here[at] if (at := (row.method, row.offset)) in strayed else row for row in rows]


def short_name(localizer: str) -> str:
    """A name for pictures: a plug-in's class or file without the way to it."""
    return localizer.rsplit(":", 1)[-1].rsplit("/", 1)[-1]


def as_number(value: Any) -> float | None:
    """The number that a value of JSON stands for, infinity among them; None if it is none."""
    if isinstance(value, bool):
        return None
    if value in ("inf", "-inf"):
        return float(value)
    return float(value) if isinstance(value, int | float) else None


def full_name(localizer: str) -> str:
    """The method's name in words, if it has one."""
    return TITLES.get(localizer, localizer)


def _swept_values(methods: Sequence[Method]) -> list[Params]:
    """Values of the numbers of which one localizer has several; [{}] if there are none.

    Words tell the forms of a localizer apart, which stand side by side.
    """
    seen: dict[tuple[str, str], set[str]] = {}
    for method in methods:
        for name, value in _params(method).items():
            if as_number(value) is not None:
                seen.setdefault((method.localizer, name), set()).add(json.dumps(value))
    names = {name for (_, name), values in seen.items() if len(values) > 1}
    taken: list[Params] = []
    for method in methods:
        values = {name: value for name, value in _params(method).items() if name in names}
        if values not in taken:
            taken.append(values)
    # what says less than another one, and nothing else, is no panel of its own
    return [
        values
        for values in taken
        if not any(len(more) > len(values) and _agrees(values, more) for more in taken)
    ]


def _labels(methods: Sequence[Method]) -> dict[Method, str]:
    names = {method: short_name(method.localizer) for method in methods}
    if len(set(names.values())) < len({method.localizer for method in methods}):
        names = {method: method.localizer for method in methods}
    return {method: " ".join([name, *_form(method, methods)]) for method, name in names.items()}


def _form(method: Method, methods: Sequence[Method]) -> list[str]:
    """Its parameters that tell it from the methods of the same localizer."""
    same = [_params(other) for other in methods if other.localizer == method.localizer]
    return [
        f"{name}={value}"
        for name, value in _params(method).items()
        if any(other.get(name) != value for other in same)
    ]


def _names(settings: Sequence[Setting]) -> dict[Setting, str]:
    """The scenario and what differs from it; lag and seed where settings differ in them."""
    several_lags = len({setting.lag for setting in settings}) > 1
    several_seeds = len({setting.seed for setting in settings}) > 1
    names = {}
    for setting in settings:
        words = [f"scenario {setting.scenario}"]
        words += [f"{name} {value}" for name, value in json.loads(setting.world).items()]
        words += [f"assumed {name} {value}" for name, value in json.loads(setting.assumed).items()]
        words += [_disturbance(one) for one in json.loads(setting.disturbance)]
        words += [f"L {setting.lag}"] if several_lags else []
        words += [f"seed {setting.seed}"] if several_seeds else []
        names[setting] = ", ".join(words)
    assert len(set(map(astuple, settings))) == len(settings)
    return names


def _disturbance(one: Params) -> str:
    rest = " ".join(f"{name} {value}" for name, value in one.items() if name != "kind")
    return f"{one.get('kind', 'disturbance')} {rest}".strip()


def _params(method: Method) -> Params:
    params: Params = json.loads(method.params)
    return params


def _agrees(some: Params, others: Params) -> bool:
    return all(some[name] == others[name] for name in some.keys() & others.keys())
