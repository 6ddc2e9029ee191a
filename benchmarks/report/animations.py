"""Best, median and worst trial as animations: drawn by the sweep, or kept in the folder.

``deqmcl report`` takes only what the folder has: it runs nothing that somebody else's folder names.
"""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from msgspec import Struct

from benchmarks.console import doing
from benchmarks.pictures.figures import FIGURES
from benchmarks.pictures.messages import shown_again
from benchmarks.sweeps.drawing import STRIDE, Animation, Promise
from benchmarks.sweeps.results import Results
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.pairing import by_world
from benchmarks.tables.panels import Panel
from benchmarks.tables.text import file_words
from benchmarks.trials.scores import JOURNEY_SCORES
from deqmcl_gym.files import UnreadableError, content_of, json_of, typed
from deqmcl_gym.validation import InputError

ANIMATED = 1  # panels with animations: they are what makes a page large
IMAGES, INDEX = "images", "laps.json"
_NONE = "the folder has none of these trials"
_LOCALIZED = JOURNEY_SCORES["metres_to_localize"]


class _Entry(Struct):
    """An animation in the index: the keys of its trials."""

    trials: list[str]


class Figure(NamedTuple):
    """A picture of ``deqmcl paper``: its file's name and content, and its words."""

    name: str
    content: bytes
    title: str
    caption: str


@dataclass(frozen=True)
class Drawn:
    """Takes the pictures that a sweep has drawn in its folder, if they are of the same trials."""

    folder: Path

    @contextmanager
    def given(self) -> Iterator[Callable[[Animation], Promise]]:
        """As ``drawing`` promises animations, but nothing is started."""
        yield lambda shown: lambda: self._of(shown)

    @cached_property
    def figures(self) -> list[Figure]:
        """The paper's figures, if ``deqmcl paper`` has drawn them in the folder."""
        folder = self.folder / "figures"
        found = []
        for path in sorted(folder.glob("*")):
            words = (words for start, words in FIGURES.items() if path.name.startswith(start))
            if told := next(words, None):
                found.append(Figure(path.name, content_of(path), *told))
        return found

    @cached_property
    def _index(self) -> dict[str, _Entry]:
        try:
            content = content_of(self.folder / IMAGES / INDEX)
            return typed(json_of(content), dict[str, _Entry])
        except (FileNotFoundError, UnreadableError):
            return {}

    def _of(self, shown: Animation) -> Animation:
        entry = self._index.get(shown.name)
        if entry is None or entry.trials != list(shown.keys):
            raise InputError(f"{_NONE}; `deqmcl sweep` draws them.")
        if why := self._spoilt(shown.name):
            raise InputError(f"{why}; `deqmcl sweep` draws it again.")
        webp, png = (content_of(path) for path in self._pictures(shown.name))
        return replace(shown, webp=webp, png=png)

    def _spoilt(self, name: str) -> str | None:
        """Say what is wrong with the pictures of an animation."""
        for path in self._pictures(name):
            if not path.exists():
                return f"{path.name} is gone"
        return None

    def _pictures(self, name: str) -> list[Path]:
        return [self.folder / IMAGES / f"{name}.{ending}" for ending in ("webp", "png")]


def animation_files(shown: Sequence[Animation]) -> dict[str, bytes]:
    """Return the pictures of animations by file name, and the index that ``Drawn`` reads."""
    if not shown:
        return {}
    index = {one.name: {"trials": list(one.keys)} for one in shown}
    pictures = {f"{one.name}.webp": one.webp for one in shown}
    pictures |= {f"{one.name}.png": one.png for one in shown}
    return pictures | {INDEX: (json.dumps(index, indent=2) + "\n").encode()}


def animations_of(panel: Panel) -> list[Animation]:
    """Choose the best, median and worst world of the panel's focus, beside its baseline.

    Nothing is drawn yet: see ``drawing``.
    """
    focus = _focus(panel.present)
    whole_log = any(record.track for own in panel.records.values() for record in own)
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
            if record.trial.trial == world
        }
        labels = tuple(panel.labels[method] for method in first)
        chosen.append(
            Animation(
                name=f"lap-{panel.number}-{place.lower()}",
                title=f"{place} of {len(ranked)} worlds",
                caption=f"World {world}, {' and '.join(labels)}: {what} of "
                f"{panel.labels[focus.method]} {value:.1f}. Every {STRIDE}th step; orange: "
                "present, pink: past, light blue: future; at the end the ways of truth and best "
                "cluster.",
                trials=tuple(record.trial for record in first.values()),
                labels=labels,
                keys=tuple(record.key for record in first.values()),
            )
        )
    return chosen


def write_laps(results: Results, folder: Path) -> str:
    """Run the trials that a report animates again, and write each as an MCAP file; say which."""
    shown = [one for panel in results.panels[:ANIMATED] for one in animations_of(panel)]
    names = []
    for animation in shown:
        for own, trial in zip(file_words(animation.labels), animation.trials, strict=True):
            path = folder / f"{animation.name}-{own}.mcap"
            with doing(f"writing {path}"):
                shown_again([trial], path.absolute())
            names.append(path.name)
    if not names:
        return "No MCAP: the report animates nothing."
    return f"MCAP in {folder}: {', '.join(names)}."


def _ranked(panel: Panel, focus: Comparison) -> tuple[list[tuple[float, int]], str]:
    """Return the worlds of a method by its error, or by the metres until it is localized."""
    worlds, what = focus.errors, "error"
    if _LOCALIZED.name in focus.journey:
        own = panel.whole[focus.method].restricted(_LOCALIZED)
        worlds, what = by_world(own), "metres to localize"
    there = {record.trial.trial for record in panel.records[focus.method]}
    ranked = [(value, world) for world, value in worlds.items() if not math.isnan(value)]
    return sorted(one for one in ranked if one[1] in there), what


def _focus(rows: Sequence[Comparison]) -> Comparison | None:
    """What is shown beside its baseline.

    Of lost robots what is localized earliest; else DEQ-MCL if it was run; else what differs most
    from its baseline; else the baseline.
    """
    found = [row for row in rows if _LOCALIZED.name in row.journey and not row.is_baseline]
    earliest = sorted(found, key=lambda row: row.journey[_LOCALIZED.name].restricted)
    named = [row for row in rows if row.method.name == "deq-mcl"]
    others = [row for row in rows if not math.isnan(row.diff.mean)]
    ranked = sorted(others, key=lambda row: -abs(row.diff.mean))
    candidates = [*earliest, *named, *ranked, *rows]
    return candidates[0] if candidates else None
