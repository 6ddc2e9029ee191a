"""How wrong a start may be: runs of a displaced prior that are localized soon and for good."""

import math
from collections.abc import Iterable, Sequence
from statistics import median_high
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.tables.stats import wilson
from benchmarks.tables.text import short_names
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Trial
from benchmarks.trials.tracks import FOUND, NEAR, settled
from deqmcl_gym.maps.map import metre

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
