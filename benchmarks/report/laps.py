"""Best, median and worst trial as animations: trials run again, which gives the same again."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from benchmarks.pictures.figures import camera_of
from benchmarks.pictures.film import Film
from benchmarks.pictures.frames import png, side_by_side, webp
from benchmarks.tables.comparison import Comparison, outcomes_of
from benchmarks.tables.pairing import by_world
from benchmarks.tables.panels import Panel
from benchmarks.trials.episode import trial_moments
from benchmarks.trials.journeys import JOURNEY_SCORES
from benchmarks.trials.plugins import key_of
from benchmarks.trials.spec import Trial, frozen, unworded
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.drawing import Image

_STRIDE = 8  # steps per frame
_MILLISECONDS = 200
_SCALE = 1.0
_LOCALIZED = JOURNEY_SCORES["metres_to_localize"]


@dataclass(frozen=True, kw_only=True)
class Lap:
    """One world, to be shown as an animation.

    Attributes:
        name: file name without ending.
        title: heading.
        caption: what is to be seen.
        trials: shown side by side, one of each method.
        labels: of the methods.
        keys: the names under which their results are kept.
        animation: WebP.
        still: PNG, for those who want no motion.
    """

    name: str
    title: str
    caption: str
    trials: tuple[Trial, ...]
    labels: tuple[str, ...]
    keys: tuple[str, ...]
    animation: bytes = b""
    still: bytes = b""

    @property
    def parts(self) -> "list[Lap]":
        """The lap of each of its trials alone."""
        shown = zip(self.trials, self.labels, self.keys, strict=True)
        return [replace(self, trials=(t,), labels=(n,), keys=(key,)) for t, n, key in shown]


def laps(panel: Panel) -> list[Lap]:
    """Choose the best, median and worst world of the panel's focus, beside its baseline.

    Nothing is drawn yet: see ``drawn``.
    """
    focus = _focus(panel.present)
    whole_log = any("track" in record for own in panel.records.values() for record in own)
    if focus is None or whole_log:  # which is too long, and has its own pictures
        return []
    ranked, what = _ranked(panel, focus)
    places = {"Best": ranked[0], "Median": ranked[(len(ranked) - 1) // 2], "Worst": ranked[-1]}
    shown = dict.fromkeys((focus.baseline, focus.method))
    chosen = []
    for place, (value, world) in list(places.items())[: 1 if len(ranked) == 1 else None]:
        first = {
            method: record
            for method in shown
            for record in reversed(panel.records[method])
            if record["trial"]["trial"] == world
        }
        labels = tuple(panel.labels[method] for method in first)
        chosen.append(
            Lap(
                name=f"lap-{panel.number}-{place.lower()}",
                title=f"{place} of {len(ranked)} worlds",
                caption=f"World {world}, {' and '.join(labels)}: {what} of "
                f"{panel.labels[focus.method]} {value:.1f}. Every {_STRIDE}th step; orange: "
                "present, pink: past, light blue: future; at the end the ways of truth and best "
                "cluster.",
                trials=tuple(trial_of(record["trial"]) for record in first.values()),
                labels=labels,
                keys=tuple(record["key"] for record in first.values()),
            )
        )
    return chosen


def drawn(lap: Lap) -> Lap:
    """Return the lap with its pictures: its trials are run again; see ``frames_of``."""
    return joined(lap, frames_of(lap))


def frames_of(lap: Lap) -> list[list[Image]]:
    """Return the frames of each of a lap's trials, which are run again.

    Raises:
        InputError: its code is another one by now.
    """
    if tuple(map(key_of, lap.trials)) != lap.keys:
        raise InputError("code, libraries or a plug-in were changed since its trials were run.")
    return [_frames(*shown) for shown in zip(lap.trials, lap.labels, strict=True)]


def joined(lap: Lap, rows: Sequence[Sequence[Image]]) -> Lap:
    """Return the lap with its pictures: the frames of its trials, side by side."""
    longest = max(map(len, rows))
    padded = [[*row, *[row[-1]] * (longest - len(row))] for row in rows]  # who ends first waits
    frames = [side_by_side(images) for images in zip(*padded, strict=True)]
    still = png(frames[-1])  # the whole way
    return replace(lap, animation=webp(frames, _MILLISECONDS), still=still)


def trial_of(canonical: dict[str, Any]) -> Trial:
    """Return the trial that a record names."""
    given = {f.name: unworded(canonical[f.name]) for f in fields(Trial) if f.name in canonical}
    for name in ("world", "assumed", "params"):
        given[name] = frozen(given.get(name, {}))
    given["disturbance"] = tuple(frozen(one) for one in given.get("disturbance", ()))
    return Trial(**given)


def _ranked(panel: Panel, focus: Comparison) -> tuple[list[tuple[float, int]], str]:
    """Return the worlds of a method by its error, or by the metres until it is localized."""
    worlds, what = focus.errors, "error"
    if _LOCALIZED.name in focus.journey:
        own = outcomes_of(panel.records, panel.failed)[focus.method]
        worlds, what = by_world(own.restricted(_LOCALIZED)), "metres to localize"
    there = {record["trial"]["trial"] for record in panel.records[focus.method]}
    ranked = [(value, world) for world, value in worlds.items() if not math.isnan(value)]
    return sorted(one for one in ranked if one[1] in there), what


def _focus(rows: Sequence[Comparison]) -> Comparison | None:
    """What is shown beside its baseline.

    Of lost robots what is localized earliest; else DEQ-MCL if it was run; else what differs most
    from its baseline; else the baseline.
    """
    found = [row for row in rows if _LOCALIZED.name in row.journey and not row.is_baseline]
    earliest = sorted(found, key=lambda row: row.journey[_LOCALIZED.name].restricted)
    named = [row for row in rows if row.method.localizer == "deq-mcl"]
    others = [row for row in rows if not math.isnan(row.diff.mean)]
    ranked = sorted(others, key=lambda row: -abs(row.diff.mean))
    candidates = [*earliest, *named, *ranked, *rows]
    return candidates[0] if candidates else None


def _frames(trial: Trial, label: str) -> list[Image]:
    camera = camera_of(trial, _SCALE)
    film = Film(camera, label, _STRIDE)
    for _ in film.of(trial_moments(trial)):
        pass
    return film.frames
