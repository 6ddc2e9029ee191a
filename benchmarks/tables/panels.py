"""What is compared: the methods of a setting, at one value of each swept parameter."""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from benchmarks.setup.overrides import FILES, Named, Overrides, file_names, spelt
from benchmarks.setup.scenario import Thresholds
from benchmarks.tables.frames import (
    METHOD,
    as_json,
    by_run,
    ends,
    method_columns,
    scores_in,
    setting_columns,
    trials_frame,
)
from benchmarks.tables.stats import ALPHA, Rule
from benchmarks.tables.text import BASELINE, short_name, short_names
from benchmarks.trials.scores import JOURNEY_SCORES, Score
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Method, Setting, Trial


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Methods that are compared with one another, and all that is known of them.

    In frames a method is its ``label``, of which all labels of the results are the categories.
    """

    number: int  # from 1, in the order of the results
    title: str  # what sets it apart from the other panels
    setting: Setting
    swept: Overrides  # value of each parameter that is swept in the setting
    labels: dict[Method, str]  # what each method is called, in the order of the results
    baselines: dict[Method, Method]  # what each method is compared with
    records: dict[Method, list[Finished]]  # finished trials by method
    scores: list[Score]  # of whole runs, that any of them has
    runs: pd.DataFrame  # their ``trials_frame``, with failed trials, and label
    rule: Rule | None = None  # when comparisons are decided; None: all worlds are run
    rows: pd.DataFrame = field(default_factory=pd.DataFrame)  # of it in ``results_table``

    def with_rows(self, results: pd.DataFrame) -> "Panel":
        """Return it with its rows of the table of all panels."""
        rows = results[results["panel"] == self.number]
        absent = [score for score in JOURNEY_SCORES.values() if score not in self.scores]
        rows = rows.drop(columns=[n for one in absent for n in score_columns(one)], errors="ignore")
        rows = self.labelled(rows.reset_index(drop=True))
        reference = pd.Categorical(rows["reference"], categories=rows["label"].cat.categories)
        return replace(self, rows=rows.assign(reference=reference))

    @property
    def thresholds(self) -> Thresholds:
        """What is far off, and lost."""
        return self._first.thresholds

    @property
    def unit(self) -> str:
        """The unit of lengths."""
        return self._first.unit

    @property
    def far(self) -> str:
        """What is far off: e > 50 px."""
        return f"e > {self.thresholds.far:g} {self.unit}"

    @property
    def aim(self) -> Score | None:
        """The share of whole runs that it is about; None if it is about the error."""
        return aim_of(self.scores)

    @property
    def where(self) -> str:
        """The scenario and what differs from it."""
        return self.title.removeprefix("scenario ")

    @property
    def agents(self) -> list[str]:
        """Who drives, in a word each; none if that is the scenario's own agent only."""
        return list(dict.fromkeys(short_name(one.agent.name) for one in self.labels if one.agent))

    @property
    def world(self) -> str:
        """What a trial of it is called: a world, or a run over a whole log."""
        return "world" if self._first.track is None else "run"

    @property
    def tests(self) -> int:
        """How many tests Holm's correction at x[t] is for."""
        names = ["p", *(f"{score.name}_p" for score in self.scores if score.tested)]
        return int(self.present[names].notna().to_numpy().sum())

    @property
    def records_by_label(self) -> dict[str, list[Finished]]:
        """The finished trials of each method."""
        return {label: self.records[method] for method, label in self.labels.items()}

    @property
    def present(self) -> pd.DataFrame:
        """The rows about x[t]."""
        return self.rows[self.rows["offset"] == 0]

    @property
    def ranked(self) -> pd.DataFrame:
        """The rows about x[t], the best first; see ``judged``."""
        return judged(self.present, self.aim)

    def runs_of(self, label: str) -> pd.DataFrame:
        """The runs of a method, by world and filter seed."""
        return by_run(self.runs[self.runs["label"] == label])

    def labelled(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Return a frame whose labels have all labels of the results as categories."""
        categories = self.runs["label"].cat.categories
        return frame.assign(label=pd.Categorical(frame["label"], categories=categories))

    def columns(self, method: Method) -> dict[str, Any]:
        """Return the setting and one of its methods as the columns of a row."""
        swept = {"swept": as_json(self.swept.json())}
        named = {"panel": self.number, "label": self.labels.get(method, "")}
        return setting_columns(self.setting) | swept | method_columns(method) | named

    @property
    def shared_params(self) -> dict[str, Any]:
        """The parameters in which all methods that take them agree, and which no title names."""
        params = [(method.name, method.values.json()) for method in self.labels]
        shared = {}
        for name in sorted({name for _, values in params for name in values} - {*self.swept}):
            takers = {method for method, values in params if name in values}
            # ... differs from every value: one that was not given it has the default
            values = [values.get(name, ...) for method, values in params if method in takers]
            if len(values) > 1 and all(value == values[0] for value in values):
                shared[name] = values[0]
        return shared

    @property
    def _first(self) -> Finished:
        return next(iter(self.records.values()))[0]


def judged(present: pd.DataFrame, aim: Score | None) -> pd.DataFrame:
    """Return rows about x[t] with what they are ranked by, and how they stand, the best first.

    That is score, score_low, score_high, apart (from the baseline), apart_low, apart_high, p, and
    relation: better, worse, equal, inconclusive, not compared or baseline; of a decided sweep
    better, worse, equivalent or open.
    """
    names = ("error", "diff", "") if aim is None else (aim.name, f"{aim.name}_diff", f"{aim.name}_")
    rows = present.copy()
    for column, name in zip(("score", "apart"), names[:2], strict=True):
        for end in ("", "_low", "_high"):
            known = rows.get(f"{name}{end}", pd.Series(math.nan, rows.index))
            rows[f"{column}{end}"] = known.astype(float)
    rows["p"] = rows.get(f"{names[2]}p_holm", pd.Series(math.nan, rows.index))
    smaller = aim is None
    clear = ((rows["apart_low"] > 0) | (rows["apart_high"] < 0)) & (rows["p"] < ALPHA)
    ahead = (rows["apart"] < 0) == smaller
    relations = {
        "baseline": rows["is_baseline"],
        "decided": rows["decision"].notna(),
        "not compared": rows["apart"].isna() | rows["apart_low"].isna(),
        "equal": (rows["apart_low"] == 0) & (rows["apart_high"] == 0),
        "better": clear & ahead,
        "worse": clear,
    }
    relation = np.select([*relations.values()], [*relations], "inconclusive")
    rows["relation"] = np.where(relation == "decided", rows["decision"], relation)
    order = rows["expected"].fillna(rows["score"])
    rows["order"] = order if smaller else -order
    rows["other"] = ~rows["is_baseline"]
    return rows.sort_values(["order", "other"], na_position="last").drop(columns="other")


def score_columns(score: Score) -> list[str]:
    """Name the columns of a score of whole runs: its value, and the comparison if it is tested."""
    names = [*ends(score.name), *([f"{score.name}_restricted"] if score.censored else [])]
    tested = [*ends(f"{score.name}_diff"), f"{score.name}_p", f"{score.name}_p_holm"]
    return names + (tested if score.tested else [])


class MethodGroup(NamedTuple):
    """What a panel is of: the methods of a setting at one value of each swept parameter."""

    setting: Setting
    swept: Overrides
    methods: list[Method]

    def pairs(self, baseline: str) -> list[tuple[Method, Method]]:
        """Return each method that is compared, and what with; see ``baseline_of``."""
        pairs = [(method, baseline_of(method, self.methods, baseline)) for method in self.methods]
        return [(method, reference) for method, reference in pairs if method != reference]


def groups(
    cells: Iterable[tuple[Setting, Method]], labelled: Iterable[Method] = ()
) -> list[MethodGroup]:
    """Split methods of settings into what is compared, in their order.

    A setting has a group for every value of the numbers of which one localizer, or one label, has
    several; a method without such a parameter is in each of them.
    """
    called = {method: method for method in labelled}
    settings: dict[Setting, dict[Method, None]] = {}
    for setting, method in cells:
        settings.setdefault(setting, {})[called.get(method, method)] = None
    made = []
    for setting, methods in settings.items():
        named = list(dict.fromkeys(method.name for method in methods))
        listed = sorted(methods, key=lambda method: named.index(method.name))
        made += [
            MethodGroup(setting, swept, [m for m in listed if agree(m.values, swept)])
            for swept in _swept(listed)
        ]
    return made


def panels(
    records: Iterable[Finished],
    baseline: str = BASELINE,
    failures: Iterable[Trial] = (),
    rule: Rule | None = None,
    labelled: Iterable[Method] = (),
) -> list[Panel]:
    """Split finished trials into panels, in their order; see ``baseline_of`` and ``Panel.rule``."""
    failed = list(failures)
    ended: dict[tuple[Setting, Method], list[Finished]] = {}
    for record in records:
        ended.setdefault((record.trial.setting, record.trial.method), []).append(record)
    titles = _titles(list(dict.fromkeys(setting for setting, _ in ended)))
    every = groups(ended, labelled)
    names = [_labels(methods) for _, _, methods in every]
    categories = list(dict.fromkeys(label for labels in names for label in labels.values()))
    made = []
    for number, ((setting, swept, methods), labels) in enumerate(zip(every, names, strict=True), 1):
        finished = [record for method in methods for record in ended[setting, method]]
        runs = trials_frame(
            finished, [one for one in failed if one.setting == setting and one.method in labels]
        )
        by_columns = {(*method_columns(one).values(),): label for one, label in labels.items()}
        called = [by_columns[key] for key in zip(*(runs[name] for name in METHOD), strict=True)]
        made.append(
            Panel(
                number=number,
                title=", ".join([titles[setting], *(f"{k} {v}" for k, v in swept.items())]),
                setting=setting,
                swept=swept,
                labels=labels,
                baselines={one: baseline_of(one, methods, baseline) for one in methods},
                records={one: ended[setting, one] for one in methods},
                scores=scores_in(finished),
                runs=runs.assign(label=pd.Categorical(called, categories=categories)),
                rule=rule,
            )
        )
    return made


def baseline_of(method: Method, methods: Iterable[Method], name: str) -> Method:
    """Return what a method is compared with: the localizer or the agent of that name.

    A localizer with the same agent, an agent with the same localizer; else the first method. Of
    several variants it is the one whose parameters agree with the method's, else the first; of
    those with labels the one that is named, else the first.
    """
    listed = list(methods)
    names = [(one.label, one.name, one.agent and one.agent.name) for one in listed]
    variants = [one for one, own in zip(listed, names, strict=True) if name in own] or listed[:1]
    if variants[0].label:
        return variants[0]
    if variants[0].name == name:
        same = [one for one in variants if one.agent == method.agent]
    else:
        same = [one for one in variants if one.name == method.name]
    variants = same or variants
    return next((one for one in variants if agree(one.values, method.values)), variants[0])


def agree(some: Overrides, others: Overrides) -> bool:
    """Whether the parameters that both have are the same."""
    return all(spelt(some[name]) == spelt(others[name]) for name in some.keys() & others.keys())


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
    """Values of the numbers of which one localizer has several; words, labels make variants."""
    seen: dict[tuple[str, str], set[Any]] = {}
    for method in methods:
        for name, value in method.values.items():
            if is_number(value):
                agent = method.agent if name.startswith("agent.") else None
                owner = agent.name if agent else method.label or method.name
                seen.setdefault((owner, name), set()).add(spelt(value))
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


def _labels(methods: Sequence[Method]) -> dict[Method, str]:
    """Localizer, agent or both, as far as they tell methods apart, with what else does."""
    names = short_names({method.name for method in methods})
    drivers = short_names({method.agent.name for method in methods if method.agent})
    several = len({method.agent for method in methods}) > 1
    labels = {}
    for method in methods:
        localizer = method.label or " ".join([names[method.name], *_variant(method, methods)])
        agent = "the scenario's agent"
        if method.agent:
            rivals = [other.agent for other in methods if other.agent]
            agent = " ".join([drivers[method.agent.name], *_variant(method.agent, rivals)])
        both = f"{agent} with {localizer}" if len(names) > 1 else agent
        labels[method] = both if several else localizer
    return labels


def _variant(method: Named, methods: Sequence[Named]) -> list[str]:
    """Its parameters that tell it from others of the same localizer; words alone if they do."""
    same = [other.params for other in methods if other.name == method.name]
    apart = [(n, v) for n, v in method.params.items() if not all(_has(o, n, v) for o in same)]
    words = [(name, value) for name, value in apart if not is_number(value)]
    alike = [other for other in same if all(_has(other, *word) for word in words)]
    return [f"{name}={value}" for name, value in (words if len(alike) == 1 else apart)]


def _has(params: Overrides, name: str, value: Any) -> bool:
    return name in params and spelt(params[name]) == spelt(value)


def common_words(settings: Collection[Setting]) -> list[str]:
    """What all of several settings have of world, assumptions and disturbances; of one nothing."""
    first, *others = map(_words, settings)
    return [words for words in first if others and all(words in one for one in others)]


def _titles(settings: Sequence[Setting]) -> dict[Setting, str]:
    """The scenario and what settings differ in."""
    names = short_names({setting.scenario for setting in settings})
    several_lags = len({setting.lag for setting in settings}) > 1
    several_seeds = len({setting.seed for setting in settings}) > 1
    common = common_words(settings) if settings else []
    titles = {}
    for setting in settings:
        words = [f"scenario {names[setting.scenario]}"]
        words += [own for own in _words(setting) if own not in common]
        words += [f"L {setting.lag}"] if several_lags else []
        words += [f"seed {setting.seed}"] if several_seeds else []
        titles[setting] = ", ".join(words)
    return titles


def trial_words(trial: Trial) -> list[str]:
    """Return a trial's setting and method, a part each; files without their folder."""
    return [trial.scenario, *_words(trial.setting), f"L={trial.lag}", str(trial.method)]


def _words(setting: Setting) -> list[str]:
    assumptions = setting.assumed.items()
    assumed = (f"assumed {n} {short_name(v) if isinstance(v, str) else v}" for n, v in assumptions)
    named = {n: v for n, v in setting.world.items() if n in FILES and isinstance(v, str | tuple)}
    short = setting.world | {name: file_names(value) for name, value in named.items()}
    world = (f"{name} {value}" for name, value in short.items())
    return [*world, *assumed, *map(disturbance_words, setting.disturbance)]
