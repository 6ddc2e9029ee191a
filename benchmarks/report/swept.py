"""Charts over the numbers that were swept: lines over one, maps over two or three."""

import math
from collections.abc import Iterable, Sequence
from statistics import median_high
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.report.charts import Chart, cells, line, name_ticks
from benchmarks.tables.panels import Panel, disturbance_words, is_number
from benchmarks.tables.stats import ALPHA, Interval, wilson
from benchmarks.tables.text import estimated, percent, short_names
from benchmarks.trials.scores import JOURNEY_SCORES, Score
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Trial
from benchmarks.trials.tracks import FOUND, NEAR, settled
from deqmcl_gym.maps.map import metre

_ANGLE = "assumed.prior.angle"  # rad; of a start that is wrong
_MOSTLY = 0.9  # share of runs from which on a cell is bold
_WIDE = 20  # a ratio of values above it is drawn on a logarithmic axis


def swept_charts(panels: Sequence[Panel]) -> list[Chart]:
    """Charts over each number that was swept: maps if two or three were and runs are scored.

    Where several are swept, there is a chart for every value of the others. There is none where
    methods stopped after as many worlds as their decisions needed.
    """
    if any(panel.rule for panel in panels):
        return []
    places = [place_of(panel) for panel in panels]
    axes, charts = swept_axes(places), list[Chart]()
    apart = {tuple(place.get(key) for key in axes) for place in places}
    scored = all(panel.aim for panel in panels)
    if len(axes) in (2, 3) and len(apart) == len(places) and scored:
        charts = _maps(panels, places, list(axes))
    if charts:
        return charts
    for key, others in axes.items():
        groups: dict[frozenset[tuple[str, Any]], list[int]] = {}
        for n, place in enumerate(places):
            if is_number(place.get(key)):
                rest = frozenset((k, v) for k, v in place.items() if k not in (key, *others))
                groups.setdefault(rest, []).append(n)
        shared = frozenset.intersection(*groups)
        groups = {rest: own for rest, own in groups.items() if len(own) > 1}
        for rest, members in groups.items():
            where = ", ".join(
                f"{name_of(name)} {value}" for name, value in sorted(rest - shared, key=str)
            )
            rows = pd.concat(
                panels[n].ranked.assign(**{key: places[n][key]}).sort_index() for n in members
            ).sort_values(key, kind="stable")
            aims = {panels[n].aim for n in members}
            charts.append(_curve(rows, key, others, where, aims.pop() if len(aims) == 1 else None))
    return [chart._replace(name=f"curve-{n}") for n, chart in enumerate(charts, 1)]


def place_of(panel: Panel) -> dict[str, Any]:
    """Return where a panel lies: all that can be swept, by dotted name."""
    setting = panel.setting
    disturbed = ", ".join(map(disturbance_words, setting.disturbance)) or "undisturbed"
    parts = {"world": setting.world, "assumed": setting.assumed, "params": panel.swept}
    named = {f"{part}.{name}": v for part, own in parts.items() for name, v in own.items()}
    return {
        "scenario": setting.scenario, "disturbance": disturbed, "lag": setting.lag,
        "seed": setting.seed, **named,
    }  # fmt: skip


def swept_axes(places: Sequence[dict[str, Any]]) -> dict[str, list[str]]:
    """Coordinates with two numbers or more, with those of fewer values that change with them."""
    keys = dict.fromkeys(key for place in places for key in place if key != "seed")
    varying = [key for key in keys if len({p[key] for p in places if is_number(p.get(key))}) > 1]
    found: dict[str, list[str]] = {}
    for key in varying:
        if any(key in others for others in found.values()):
            continue
        group = [key, *(k for k in varying if k != key and _together(key, k, places))]
        values = {k: [place.get(k) for place in places] for k in group}
        axis = max(group, key=lambda k: list(values.values()).count(values[k]))
        found[axis] = [k for k in group if k != axis]
    return found


def name_of(key: str) -> str:
    """Return what a coordinate is called: as in a sweep file, without its group."""
    return key.removeprefix("world.").removeprefix("params.")


def _together(one: str, other: str, places: Sequence[dict[str, Any]]) -> bool:
    pairs = {(place[one], place[other]) for place in places if one in place and other in place}
    return bool(pairs) and len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


def _curve(
    rows: pd.DataFrame, key: str, others: Sequence[str], where: str, aim: Score | None
) -> Chart:
    """The score over one number."""
    scale, unit = (1, "error e of x[t]") if aim is None else (100, "% of runs")
    numbers = ["score", "score_low", "score_high"]
    rows[numbers] = rows[numbers].astype(float) * scale
    axes = line(rows[rows["score"].notna()], key, *numbers)
    name_ticks(axes, list(rows[key]))
    swept, place = name_of(key), f": {where}" if where else ""
    over = swept + (f" (with {', '.join(map(name_of, others))})" if others else "")
    axes.set(xlabel=over, ylabel=unit)
    known = rows.loc[np.isfinite(rows["score"]) & (rows["score"] > 0), "score"]
    if aim is None and len(known) and known.max() / known.min() > _WIDE:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    else:
        axes.set_ylim(0, None)
    of = "Error" if aim is None else f"Runs {aim.words.partition(' (')[0]}"
    caption = (
        "A method without this parameter is the same everywhere. Bars: 95 % intervals over worlds."
    )
    return Chart("curve", f"{of} over {swept}{place}", caption, axes.figure)


def _maps(
    panels: Sequence[Panel], places: Sequence[dict[str, Any]], keys: Sequence[str]
) -> list[Chart]:
    """Maps over two numbers of the share of runs, over three of each test of each method."""
    told = {key: f"{key}, °" if key == _ANGLE else name_of(key) for key in keys}
    frame = pd.concat(
        panel.present.assign(
            **{
                name: np.degrees(place[key]).round(1) if key == _ANGLE else place[key]
                for key, name in told.items()
            }
        )
        for panel, place in zip(panels, places, strict=True)
        if all(key in place for key in keys)
    )
    x, y, *squares = told.values()
    if not squares:
        return [_share_map(frame, x, y, aim) for aim in {panel.aim for panel in panels} if aim]
    (square,) = squares
    scores = [one for n, one in JOURNEY_SCORES.items() if one.tested and n in frame]
    charts = []
    for number, label in enumerate(frame.loc[~frame["is_baseline"], "label"].unique(), 1):
        for score in scores:
            rows = frame[frame["label"] == label].copy()
            share, name = score.unit == "share", score.name
            scale = 100 if share else 1
            ends = rows[[f"{name}_diff{end}" for end in ("", "_low", "_high")]] * scale
            form = "+.0f" if share else "+.1f"
            clear = rows[f"{name}_p_holm"] < ALPHA
            rows["words"] = [
                estimated(Interval(*one), form).replace(" (", f"{' *' * sure}\n(")
                for one, sure in zip(ends.itertuples(index=False), clear, strict=True)
            ]
            rows["ahead"] = (-1 if score.censored else 1) * rows[f"{name}_diff"].fillna(0)
            file, what = name.replace("_", "-"), score.words.removesuffix(", median")
            caption = (
                f"Difference to the baseline in {'points' if share else 'metres'}, and its 95 % "
                "interval. Blue: ahead; red: behind; *: p < 0.05, corrected for the tests of a "
                "setting, not for the number of settings."
            )
            drawn = cells(rows, x, y, square, "ahead", "words", least=0.1 if share else 1.0)
            title = f"Where {label} is ahead: {what}"
            charts.append(Chart(f"regimes-{file}-{number}", title, caption, drawn))
    return charts


def _share_map(frame: pd.DataFrame, x: str, y: str, aim: Score) -> Chart:
    """A map of the share of runs for each method."""
    shares = frame[[aim.name, f"{aim.name}_low", f"{aim.name}_high"]].astype(float)
    words = [
        estimated(Interval(*one).percent, ".0f", " %").replace(" (", "\n(")
        for one in shares.itertuples(index=False)
    ]
    rows = frame.assign(
        method=frame["label"].astype(str),
        share=shares[aim.name],
        words=words,
        mostly=shares[aim.name] >= _MOSTLY,
    )
    drawn = cells(rows, x, y, "method", "share", "words", least=1.0, bold="mostly")
    caption = (
        "Share of runs, and Wilson's 95 % interval, with every value of the two numbers; "
        f"{percent(_MOSTLY)} or more is bold."
    )
    return Chart("shares", f"Runs {aim.words}", caption, drawn)


WITHIN = 10.0  # m, or half of a log's segment if that is less
_ERRORS = ("prior.distance", "prior.angle")
_PLACE = ["localizer", "distance_m", "angle_deg"]
_COLUMNS = (
    *(*_PLACE, "runs", "localized", "share", "share_low", "share_high"),
    *("metres_median", "steps_median"),
)
_NEVER = math.inf, math.inf


def starts_table(records: Iterable[Finished], failures: Iterable[Trial] = ()) -> pd.DataFrame:
    """Return basin.csv: a row per localizer and error of the start; none of other priors.

    Localized: within 10 m, or half of a log's segment, the best cluster comes within 1 m and 30° of
    the truth, and stays there to the end of the run. A failed run counts as never localized.
    """
    listed = list(records)
    size = metre(listed[0].unit) if listed else 1.0
    ended = [(one.trial, *_reached(one)) for one in listed]
    ended += [(trial, *_NEVER) for trial in failures]
    ended = [one for one in ended if one[0].assumed.keys() & {*_ERRORS}]
    labels = _labels([trial for trial, *_ in ended])
    runs = []
    for label, (trial, way, steps) in zip(labels, ended, strict=True):
        distance, angle = (trial.assumed.get(name, 0.0) for name in _ERRORS)
        within = min(WITHIN, trial.world.get("segment", math.inf) / size / 2)
        place = label, distance / size, round(math.degrees(angle), 1)
        runs.append((*place, way, steps, way <= within))
    frame = pd.DataFrame(runs, columns=[*_PLACE, "way", "steps", "localized"])
    frame["localizer"] = pd.Categorical(labels, list(dict.fromkeys(labels)))
    rows = []
    for cell, own in frame.groupby(_PLACE, observed=True):
        count, localized = len(own), int(own["localized"].sum())
        share = localized / count
        medians = median_high(own["way"]), median_high(own["steps"])
        rows.append((*cell, count, localized, share, *wilson(share, count), *medians))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _reached(record: Finished) -> tuple[float, float]:
    """Metres and steps until a run is localized for good."""
    if record.journey is None:
        return _NEVER
    curves = record.journey.curves
    first = settled(NEAR[FOUND].holds(np.array(curves["distance"]), np.array(curves["angle"])))
    return _NEVER if first is None else (curves["way"][first], float(first))


def _labels(trials: Sequence[Trial]) -> list[str]:
    """Name the localizer of each trial, with what else its trials differ in than the error."""
    short = short_names({trial.localizer for trial in trials})
    first: dict[str, dict[str, Any]] = {}
    apart: dict[str, set[str]] = {name: set() for name in short}
    places = []
    for trial in trials:
        place = {"scenario": trial.scenario, **trial.world, **trial.assumed, **trial.params}
        place = {name: value for name, value in place.items() if name not in _ERRORS}
        usual = first.setdefault(trial.localizer, place)
        names = place.keys() | usual.keys()
        apart[trial.localizer] |= {n for n in names if place.get(n) != usual.get(n)}
        places.append(place)
    return [
        " ".join([short[name], *(f"{n} {place[n]}" for n in sorted(apart[name]) if n in place)])
        for name, place in zip((trial.localizer for trial in trials), places, strict=True)
    ]
