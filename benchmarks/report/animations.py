"""Best, median and worst trial as films: those that the folder has, or drawn anew."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from benchmarks.execution.engines import available_cpus
from benchmarks.execution.processes import Processes
from benchmarks.pictures.film import Film, camera_of, png, side_by_side, webp
from benchmarks.tables.frames import scored
from benchmarks.tables.panels import Panel
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage, key_of
from deqmcl_gym.files import content_of
from deqmcl_gym.validation import InputError, in_words

STRIDE = 8  # steps per frame
_MILLISECONDS = 200
_SCALE = 1.0
_PATIENCE = 300.0  # seconds for one animation
IMAGES = "images"
_LOCALIZED = "metres_to_localize"


@dataclass(frozen=True, kw_only=True)
class Animation:
    """One world in motion, a trial of each method side by side."""

    name: str  # of its files, without ending
    title: str  # what is to be seen
    caption: str
    trials: tuple[Trial, ...]  # one of each method
    labels: tuple[str, ...]
    keys: tuple[str, ...]  # under which their results are kept
    webp: bytes = b""  # the animation; empty until it is filmed
    png: bytes = b""  # its end, for those who want no motion


def filmed(shown: Animation) -> Animation:
    """Return an animation with its pictures: its trials are run again."""
    if tuple(map(key_of, shown.trials)) != shown.keys:
        raise InputError("code, libraries or a plug-in were changed since its trials were run.")
    rows = []
    for trial, label in zip(shown.trials, shown.labels, strict=True):
        stage = Stage.of(trial)
        film = Film(camera_of(stage, _SCALE), label, STRIDE)
        for _ in film.of(stage.moments()):
            pass
        rows.append(film.frames)
    longest = max(map(len, rows))
    padded = [[*row, *[row[-1]] * (longest - len(row))] for row in rows]  # who ends first waits
    frames = [side_by_side(images) for images in zip(*padded, strict=True)]
    return replace(shown, webp=webp(frames, _MILLISECONDS), png=png(frames[-1]))  # the whole way


def pictures_of_paper(folder: Path) -> dict[str, bytes]:
    """Return the figures that ``deqmcl paper`` has drawn in the folder, if it has, by name."""
    paths = sorted((folder / "figures").glob("*"))
    shown = (path for path in paths if path.name.startswith(("fig4_", "fig5_step", "lap")))
    return {path.name: content_of(path) for path in shown}


def films(panels: Sequence[Panel], folder: Path, *, draw: bool) -> tuple[list[Animation], str]:
    """Return the films of the first panel, and why there are none.

    Those that the folder has not are drawn, if that is asked for, by workers: a plug-in that hangs
    or exits there does no harm.
    """
    chosen = films_of(panels[0]) if panels else []
    kept = [film for one in chosen if (film := _of(one, folder)) is not None]
    if len(kept) == len(chosen) or not draw:
        why = "the folder has none of these worlds; `deqmcl sweep` draws them."
        return kept, "" if kept or not chosen else why
    with Processes(available_cpus(), timeout=_PATIENCE) as pool:
        promises = [pool.submit(filmed, one) for one in chosen]
        try:
            return [promise.result() for promise in promises], ""
        except InputError as error:
            return [], str(error)
        except Exception as error:  # a plug-in that is gone is no reason to say nothing
            return [], f"its trials could not be run again ({in_words(error)})"


def films_of(panel: Panel) -> list[Animation]:
    """Choose the best, median and worst world of what is in focus, beside its baseline."""
    whole_log = any(record.track for records in panel.records.values() for record in records)
    rows = panel.present
    if rows.empty or whole_log:  # which is too long, and has its own pictures
        return []
    focus = _focus(rows)
    name, what = ("error", "error")
    if _LOCALIZED in rows and pd.notna(focus[_LOCALIZED]):
        name, what = _LOCALIZED, "metres to localize"
    runs = scored(panel.runs_of(focus["label"]))
    ranked = runs.groupby("trial")[name].mean().dropna().sort_values(kind="stable")
    if ranked.empty:
        return []
    places = {"Best": 0, "Median": (len(ranked) - 1) // 2, "Worst": len(ranked) - 1}
    chosen = []
    for place, n in list(places.items())[: 1 if len(ranked) == 1 else None]:
        world, value = int(ranked.index[n]), ranked.iloc[n]
        first = {
            label: record
            for label in dict.fromkeys((focus["reference"], focus["label"]))
            for record in reversed(panel.records_by_label[label])
            if record.trial.trial == world
        }
        reached = f"{value:.1f}" if math.isfinite(value) else "never"
        chosen.append(
            Animation(
                name=f"lap-{panel.number}-{place.lower()}-{world}",
                title=f"{place} of {len(ranked)} worlds",
                caption=f"World {world}, {' and '.join(first)}: {what} of {focus['label']} "
                f"{reached}. Every {STRIDE}th step; orange: present, pink: past, light blue: "
                "future; at the end the ways of truth and best cluster.",
                trials=tuple(record.trial for record in first.values()),
                labels=tuple(first),
                keys=tuple(record.key for record in first.values()),
            )
        )
    return chosen


def _focus(rows: pd.DataFrame) -> pd.Series:
    """What is localized earliest if robots are lost, else DEQ-MCL, else what differs most."""
    others = rows[~rows["is_baseline"]]
    if _LOCALIZED in rows and others[f"{_LOCALIZED}_restricted"].notna().any():
        return others.sort_values(f"{_LOCALIZED}_restricted", kind="stable").iloc[0]
    named = rows[rows["method"] == "deq-mcl"]
    apart = others[others["diff"].notna()]
    apart = apart.iloc[(-apart["diff"].abs()).argsort(kind="stable")]
    return pd.concat([named, apart, rows]).iloc[0]


def _of(film: Animation, folder: Path) -> Animation | None:
    """Return a film with its pictures; None if the folder has not both."""
    moving, still = (folder / IMAGES / f"{film.name}.{ending}" for ending in ("webp", "png"))
    if not moving.is_file() or not still.is_file():
        return None
    return replace(film, webp=content_of(moving), png=content_of(still))
