"""What is compared: the methods of a setting, at one value of each swept parameter."""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.setup.overrides import FILES, Named, Overrides, file_names, spelt
from benchmarks.tables import BASELINE, frames, short_name, short_names
from benchmarks.tables.stats import ALPHA, Rule
from benchmarks.trials import Method, Setting, Trial
from benchmarks.trials.scores import JOURNEY_SCORES, Score
from benchmarks.trials.scoring import Finished


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Methods that are compared with one another, and all that is known of them, by label.

    In frames a label is a category, of which all labels of the results are the categories.
    """

    number: int  # from 1, in the order of the results
    title: str  # what sets it apart from the other panels
    setting: Setting
    swept: Overrides  # value of each parameter that is swept in the setting
    methods: dict[str, Method]  # in the order of the results
    baselines: dict[str, str]  # what each method is compared with
    records: dict[str, list[Finished]]  # finished trials
    scores: list[Score]  # of whole runs, that any of them has
    runs: pd.DataFrame  # their ``trials_frame``, with failed trials, and label
    rule: Rule | None = None  # when comparisons are decided; None: all worlds are run
    rows: pd.DataFrame = field(default_factory=pd.DataFrame)  # of it in ``results_table``

    def with_rows(self, results: pd.DataFrame) -> "Panel":
        """Return it with its rows of the table of all panels."""
        rows = results[results["panel"] == self.number].reset_index(drop=True)
        absent = [score for score in JOURNEY_SCORES.values() if score not in self.scores]
        rows = rows.drop(columns=[n for s in absent for n in score_columns(s)], errors="ignore")
        return replace(self, rows=self.labelled(rows))

    @property
    def aim(self) -> Score | None:
        """The share of whole runs that it is about; None if it is about the error.

        Who was carried off is to be found again; who was lost, to be localized.
        """
        shares = [score for score in self.scores if score.tested and score.unit == "share"]
        return shares[-1] if shares else None

    @property
    def where(self) -> str:
        """The scenario and what differs from it."""
        return self.title.removeprefix("scenario ")

    @property
    def world(self) -> str:
        """What a trial of it is called: a world, or a run over a whole log."""
        return "world" if self.first.track is None else "run"

    @property
    def tests(self) -> int:
        """How many tests Holm's correction at x[t] is for."""
        names = ["p", *(f"{score.name}_p" for score in self.scores if score.tested)]
        return int(self.present[names].notna().to_numpy().sum())

    @property
    def present(self) -> pd.DataFrame:
        """The rows about x[t]."""
        return self.rows[self.rows["offset"] == 0]

    @cached_property
    def ranked(self) -> pd.DataFrame:
        """The rows about x[t] with what they are ranked by, and how they stand, the best first.

        That is score, score_low, score_high, apart (from the baseline), apart_low, apart_high, p,
        and relation: better, worse, equal, inconclusive, not compared or baseline; of a decided
        sweep better, worse, equivalent or open.
        """
        rows, aim = self.present.copy(), self.aim
        names = ("error", "diff", "p_holm")
        if aim is not None:
            names = (aim.name, f"{aim.name}_diff", f"{aim.name}_p_holm")
        unknown = pd.Series(math.nan, rows.index)
        for column, name in zip(("score", "apart"), names[:2], strict=True):
            for end in ("", "_low", "_high"):
                rows[f"{column}{end}"] = rows.get(f"{name}{end}", unknown).astype(float)
        rows["p"] = rows.get(names[2], unknown)
        clear = ((rows["apart_low"] > 0) | (rows["apart_high"] < 0)) & (rows["p"] < ALPHA)
        relations = {
            "baseline": rows["is_baseline"],
            "decided": rows["decision"].notna(),
            "not compared": rows["apart"].isna() | rows["apart_low"].isna(),
            "equal": (rows["apart_low"] == 0) & (rows["apart_high"] == 0),
            "better": clear & ((rows["apart"] < 0) == (aim is None)),
            "worse": clear,
        }
        relation = np.select([*relations.values()], [*relations], "inconclusive")
        rows["relation"] = np.where(relation == "decided", rows["decision"], relation)
        rows["order"] = (1 if aim is None else -1) * rows["expected"].fillna(rows["score"])
        return rows.sort_values(["order", "is_baseline"], ascending=[True, False])

    def runs_of(self, label: str) -> pd.DataFrame:
        """The runs of a method, by world and filter seed."""
        return frames.by_run(self.runs[self.runs["label"] == label])

    def labelled(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Return a frame whose labels have all labels of the results as categories."""
        return frame.astype({"label": self.runs["label"].dtype})

    def columns(self, label: str) -> dict[str, Any]:
        """Return the setting and one of its methods as the columns of a row."""
        return {
            **frames.setting_columns(self.setting),
            "swept": frames.as_json(self.swept.json()),
            **frames.method_columns(self.methods[label]),
            "panel": self.number,
            "label": label,
        }

    @property
    def first(self) -> Finished:
        """Its first trial, which has the unit and the thresholds of all."""
        return next(iter(self.records.values()))[0]


def score_columns(score: Score) -> list[str]:
    """Name the columns of a score of whole runs: its value, and the comparison if it is tested."""
    names = [*frames.ends(score.name), *([f"{score.name}_restricted"] if score.censored else [])]
    tested = [*frames.ends(f"{score.name}_diff"), f"{score.name}_p", f"{score.name}_p_holm"]
    return names + (tested if score.tested else [])


def panels(
    records: Iterable[Finished],
    baseline: str = BASELINE,
    failures: Iterable[Trial] = (),
    rule: Rule | None = None,
    labelled: Iterable[Method] = (),
    planned: Iterable[tuple[Setting, Method]] = (),
) -> list[Panel]:
    """Split finished trials into what is compared, in their order; see ``baseline_of``.

    A setting has a panel for every value of the numbers of which one localizer, or one label, has
    several; a method without such a parameter is in each of them. Methods that are ``planned`` are
    in their panels before a trial of them has ended.
    """
    failed, with_labels = list(failures), {method: method for method in labelled}
    settings: dict[Setting, dict[Method, list[Finished]]] = {}
    for setting, method in planned:
        settings.setdefault(setting, {})[with_labels.get(method, method)] = []
    for record in records:
        method = record.trial.method
        ended = settings.setdefault(record.trial.setting, {})
        ended.setdefault(with_labels.get(method, method), []).append(record)
    groups = [(setting, *group) for setting, ended in settings.items() for group in _groups(ended)]
    distinct = dict.fromkeys(label for *_, methods in groups for label in methods)
    labels = pd.CategoricalDtype([*distinct])
    titles = _titles([*settings])
    made = []
    for number, (setting, swept, methods) in enumerate(groups, 1):
        finished = {label: settings[setting][method] for label, method in methods.items()}
        listed = [record for group in finished.values() for record in group]
        called = {method: label for label, method in methods.items()}
        unfinished = [t for t in failed if t.setting == setting and t.method in called]
        runs = frames.trials_frame(listed, unfinished)
        row_labels = [called[r.trial.method] for r in listed for _ in r.scores]
        row_labels += [called[trial.method] for trial in unfinished]
        made.append(
            Panel(
                number=number,
                title=", ".join([titles[setting], *(f"{k} {v}" for k, v in swept.items())]),
                setting=setting,
                swept=swept,
                methods=methods,
                baselines={n: called[baseline_of(m, called, baseline)] for n, m in methods.items()},
                records=finished,
                scores=frames.scores_in(listed),
                runs=runs.assign(label=pd.Series(row_labels, dtype=labels)),
                rule=rule,
            )
        )
    return made


def _groups(methods: Iterable[Method]) -> list[tuple[Overrides, dict[str, Method]]]:
    """Split the methods of a setting by the values of swept parameters; methods by label."""
    named = list(methods)
    names = list(dict.fromkeys(method.name for method in named))
    named.sort(key=lambda method: names.index(method.name))
    return [
        (swept, _labels([method for method in named if agree(method.values, swept)]))
        for swept in _swept(named)
    ]


def baseline_of(method: Method, methods: Iterable[Method], name: str) -> Method:
    """Return what a method is compared with: the localizer or the agent of that name.

    A localizer with the same agent, an agent with the same localizer; else the first method. Of
    several variants it is the one whose parameters agree with the method's, else the first; of
    those with labels the one that is named, else the first.
    """
    listed = list(methods)
    variants = [m for m in listed if name in (m.label, m.name, m.agent and m.agent.name)]
    variants = variants or listed[:1]
    if variants[0].label:
        return variants[0]
    if variants[0].name == name:
        same = [v for v in variants if v.agent == method.agent]
    else:
        same = [v for v in variants if v.name == method.name]
    variants = same or variants
    return next((v for v in variants if agree(v.values, method.values)), variants[0])


def agree(some: Overrides, others: Overrides) -> bool:
    """Whether the parameters that both have are the same."""
    return all(spelt(some[name]) == spelt(others[name]) for name in some.keys() & others.keys())


def is_number(value: Any) -> bool:
    """Whether a value can stand on an axis."""
    return isinstance(value, int | float) and not isinstance(value, bool)


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


def _labels(methods: Sequence[Method]) -> dict[str, Method]:
    """Localizer, agent or both, as far as they tell methods apart, with what else does."""
    names = short_names({method.name for method in methods})
    rivals = [method.agent for method in methods if method.agent]
    drivers = short_names({agent.name for agent in rivals})
    several = len({method.agent for method in methods}) > 1
    labels = {}
    for method in methods:
        localizer = method.label or " ".join([names[method.name], *_variant(method, methods)])
        agent = "the scenario's agent"
        if method.agent:
            agent = " ".join([drivers[method.agent.name], *_variant(method.agent, rivals)])
        both = f"{agent} with {localizer}" if len(names) > 1 else agent
        labels[both if several else localizer] = method
    return labels


def _variant(method: Named, methods: Sequence[Named]) -> list[str]:
    """Its parameters that tell it from others of the same localizer; texts alone if they do."""
    same = [other.params for other in methods if other.name == method.name]
    distinct = [(n, v) for n, v in method.params.items() if not all(_has(o, n, v) for o in same)]
    texts = [(name, value) for name, value in distinct if not is_number(value)]
    alike = [other for other in same if all(_has(other, *text) for text in texts)]
    return [f"{name}={value}" for name, value in (texts if len(alike) == 1 else distinct)]


def _has(params: Overrides, name: str, value: Any) -> bool:
    return name in params and spelt(params[name]) == spelt(value)


def common_words(settings: Collection[Setting]) -> list[str]:
    """What all of several settings have of world, assumptions and disturbances; of one nothing."""
    first, *others = map(_setting_words, settings)
    return [part for part in first if others and all(part in other for other in others)]


def _titles(settings: Sequence[Setting]) -> dict[Setting, str]:
    """The scenario and what settings differ in."""
    names = short_names({setting.scenario for setting in settings})
    several_lags = len({setting.lag for setting in settings}) > 1
    several_seeds = len({setting.seed for setting in settings}) > 1
    common = common_words(settings) if settings else []
    titles = {}
    for setting in settings:
        parts = [f"scenario {names[setting.scenario]}"]
        parts += [part for part in _setting_words(setting) if part not in common]
        parts += [f"L {setting.lag}"] if several_lags else []
        parts += [f"seed {setting.seed}"] if several_seeds else []
        titles[setting] = ", ".join(parts)
    return titles


def trial_words(trial: Trial) -> list[str]:
    """Return a trial's setting and method, a part each; files without their folder."""
    return [trial.scenario, *_setting_words(trial.setting), f"L={trial.lag}", str(trial.method)]


def _setting_words(setting: Setting) -> list[str]:
    names = {name: short_name(v) for name, v in setting.assumed.items() if isinstance(v, str)}
    assumed = (f"assumed {n} {_plain(value)}" for n, value in (setting.assumed | names).items())
    named = {n: v for n, v in setting.world.items() if n in FILES and isinstance(v, str | tuple)}
    short = setting.world | {name: file_names(value) for name, value in named.items()}
    world = (f"{name} {_plain(value)}" for name, value in short.items())
    return [*world, *assumed, *map(disturbance_words, setting.disturbance)]


def _plain(value: Any) -> Any:
    """A number of many digits with six; anything else as it is."""
    return f"{value:g}" if isinstance(value, float) and len(repr(value)) > 8 else value


def disturbance_words(wrapper: Overrides) -> str:
    """Its kind, and its arguments."""
    arguments = dict(wrapper)
    kind = arguments.pop("kind", "disturbance")
    return " ".join([kind, *(f"{name} {value}" for name, value in arguments.items())])
