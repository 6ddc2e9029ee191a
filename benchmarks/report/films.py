"""A run as frames: truth, cloud, mean, best cluster, plan and error in every one.

The paper's figures are of world 0: no picking. Films of a page are of the best, median and worst
world: those that the folder has, or drawn anew.
"""

import io
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import PIL.Image

from benchmarks.execution.engines import available_cpus
from benchmarks.execution.processes import Processes
from benchmarks.sweeps.store import write_files
from benchmarks.tables import state_name
from benchmarks.tables.frames import scored
from benchmarks.tables.panels import Panel
from benchmarks.trials import Trial
from benchmarks.trials.episode import Step
from benchmarks.trials.scoring import Finished
from benchmarks.trials.stage import Stage, key_of
from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.files import content_of
from deqmcl_gym.logs.motion import dead_reckoned
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Floats, Reals
from deqmcl_gym.validation import InputError, in_words
from deqmcl_gym.world import drawing
from deqmcl_gym.world.drawing import BLACK, GRAY, Color, Drawing, Image, View
from localizers import Belief, best_cluster, mean_pose
from localizers.inference.hedge import HedgedBelief

_LAYERS: tuple[tuple[int, Color, str], ...] = (  # sign of the offset, back to front
    (+1, drawing.LIGHT_BLUE, "future"),
    (-1, drawing.PINK, "past"),
    (0, drawing.ORANGE, "present"),
)
_BLIND: Color = (120, 80, 190)  # the protected cloud of a hedge, which is shown no plan
_LONGEST = 560.0  # px of the paper's room
_LEAST_SCALE = 0.01
_LAST = 1500  # ms that the last image stays
_BEST: Color = (0, 114, 178)
_PLAN: Color = (0, 158, 115)
_LINE = 24  # image pixels per line of text
_SIZE = 0.5  # of letters: legible where two rooms are a column wide
_LEAST = 6.0  # image pixels: a robot's radius, that it is seen in a building
_ARM = 5.0  # image pixels of the cross at the mean, right and up
LAP_STRIDE, _LAP_MILLISECONDS = 4, 120  # steps per frame of a lap, and how long it is shown
_STRIDE, _MILLISECONDS = 8, 200  # of a film in a page
_PATIENCE = 300.0  # seconds for one of these
_IN_PAPER = "mcl", "deq-mcl"  # methods in its figures
_FIG_5_STATE = 150
IMAGES = "images"
_LOCALIZED = "metres_to_localize"


@dataclass(frozen=True)
class Camera:
    """Draws moments of one room."""

    view: View  # the room, and how large
    radius: float  # of the robot, px
    lag: int  # L, the offset of the past and future shown, steps
    ground: Callable[[View], Drawing] = Drawing  # draws the room as it is now, below all else

    def frame(
        self,
        moment: Step,
        words: Sequence[str],
        ring: tuple[str, Reals] | None = None,
        *,
        offset: int = 0,
        ways: Sequence[tuple[Any, Color]] = (),
    ) -> Image:
        """Draw a moment: clouds, robot, plan and mean; below it lines of words, a legend.

        The mean is of the state at an offset; ``ring`` names a pose, ``ways`` are below the robot.
        """
        picture = self.scene(moment)
        legend = [(name, color) for name, color, _ in reversed(self._clouds(moment.belief))]
        legend += [("truth", GRAY), ("mean", BLACK)]
        for way, color in ways:
            picture.path(way, color, 2)
        if moment.plan is not None and len(moment.plan):
            picture.path(dead_reckoned(moment.plan, moment.truth)[:, :2], _PLAN, 2)
            legend.append(("plan", _PLAN))
        pixel_length = 1 / self.view.per_length
        radius = max(self.radius, _LEAST * pixel_length)
        picture.robot(moment.truth, radius)
        if ring is not None:
            name, (x, y, heading) = ring
            angles = heading + np.linspace(0.0, 2.0 * math.pi, 49)
            rim = np.column_stack([np.cos(angles), np.sin(angles)])
            picture.path((x, y) + 1.3 * radius * rim, _BEST, 2)
            picture.path([(x, y), (x, y) + 2.34 * radius * rim[0]], _BEST, 2)
            legend.append((name, _BEST))
        if (held := moment.belief.points(offset)) is not None:
            x, y, _ = mean_pose(*held)
            arm = _ARM * pixel_length
            for side in (arm, -arm):
                picture.path([(x - arm, y - side), (x + arm, y + side)], BLACK, 2)
        return _captioned(picture, words, legend)

    def _clouds(self, belief: Belief) -> list[tuple[str, Color, tuple[Reals, Floats]]]:
        """The clouds that a belief holds, back to front: names, colours, points."""
        clouds = [
            (f"{layer} {state_name(sign * self.lag)}", color, belief.points(sign * self.lag))
            for sign, color, layer in _LAYERS
            if self.lag or sign == 0
        ]
        if isinstance(belief, HedgedBelief):
            clouds.append(("without plans", _BLIND, belief.protected.points()))
        return [(name, color, points) for name, color, points in clouds if points is not None]

    def scene(self, moment: Step) -> Drawing:
        """Draw the map, the clouds and the step number."""
        picture = self.ground(self.view)
        for _, color, (poses, _) in self._clouds(moment.belief):
            picture.points(poses, color, size=3 if self.view.scale > 1 else 2)
        return picture.number(moment.t)


def camera_of(stage: Stage, scale: float = 1.6) -> Camera:
    """Return a camera for the room of a trial; a side has at most 560 pixels times the scale."""
    room = stage.room
    x0, y0, x1, y1 = room.floor_plan.bounds
    longest = max(x1 - x0, y1 - y0)
    size = scale * min(longest / pixel(room.floor_plan.unit), _LONGEST)
    small = View(room.floor_plan, scale * _LEAST_SCALE)  # a map of cells has a scale of its own
    view = View(room.floor_plan, small.scale * size / (longest * small.per_length))
    ground = room.picture if isinstance(room, RoomEnv) else Drawing
    return Camera(view, room.radius, stage.trial.lag, ground)


def png(image: Image) -> bytes:
    """Return an RGB image as PNG."""
    return cv2.imencode(".png", image[:, :, ::-1])[1].tobytes()


def webp(frames: Sequence[Image], milliseconds: int = _LAP_MILLISECONDS) -> bytes:
    """Return RGB images as an endless WebP without loss, which would leave ghosts."""
    first, *others = map(PIL.Image.fromarray, _level(frames))
    buffer = io.BytesIO()
    # A seventh of the time of OpenCV's encoder, a quarter larger: less effort, no key frames,
    # which only players that seek have a use for.
    first.save(
        buffer, "WEBP", save_all=True, append_images=others, loop=0,
        duration=[milliseconds] * len(others) + [max(milliseconds, _LAST)],
        lossless=True, method=1, quality=0, kmin=0, kmax=0,
    )  # fmt: skip
    return buffer.getvalue()


def side_by_side(images: Sequence[Image]) -> Image:
    """Return images in a row."""
    return np.hstack(_level(images))


def _level(images: Sequence[Image]) -> list[Image]:
    """Return images of one height, with white below the lower ones: legends differ in length."""
    tallest = max(map(len, images))
    return [drawing.with_strip(image, tallest - len(image)) for image in images]


@dataclass
class Film:
    """Draws an episode while it is run: a localizer may change its belief at the next step."""

    camera: Camera  # looks at the room
    title: str  # stands below it
    stride: int  # steps per frame
    frames: list[Image] = field(default_factory=list, init=False)  # drawn so far
    moments: list[Step] = field(default_factory=list, init=False)  # seen so far
    _best: list[Reals] = field(default_factory=list, init=False)

    def of(self, episode: Iterable[Step]) -> Iterator[Step]:
        """Pass the episode on; draw moments after they were looked at."""
        for moment in episode:
            yield moment
            self._best.append(best_of(moment, self.camera.view.floor_plan.unit))
            self.moments.append(moment)
            if moment.t % self.stride == 0:
                self.frames.append(self._frame(moment))
        self.frames.append(self._frame(moment, (self._best, _BEST)))  # with its whole way

    def _frame(self, moment: Step, *ways: tuple[Any, Color]) -> Image:
        best, belief, unit = self._best[-1], moment.belief, self.camera.view.floor_plan.unit
        digits = 0 if unit == "px" else 2
        best_off, mean_off = (
            f"{math.dist(pose[:2], moment.truth[:2]):.{digits}f} {unit}"
            for pose in (best, mean_pose(*_present(moment)))
        )
        title = self.title
        if isinstance(belief, HedgedBelief):
            title += f", trust in plans {belief.trusted:.2f}"
        words = [title, f"step {moment.t}: best {best_off}, mean {mean_off} off"]
        driven = np.array([seen.truth for seen in self.moments]), GRAY
        return self.camera.frame(moment, words, ("best cluster", best), ways=[driven, *ways])


def best_of(moment: Step, unit: str) -> Reals:
    """Return the mean of the best cluster, (3,)."""
    return np.array(best_cluster(*_present(moment), unit=unit).mean)


def _present(moment: Step) -> tuple[Reals, Floats]:
    if (points := moment.belief.points()) is None:
        raise InputError(f"its belief of state {moment.t} holds no points of the present.")
    return points


def _captioned(picture: Drawing, words: Sequence[str], legend: list[tuple[str, Color]]) -> Image:
    """Return the picture above lines of words and a legend."""
    left, (width, below) = picture.view.margin, picture.view.size
    rows: list[list[tuple[str, Color]]] = [[]]
    used = 0
    for entry in legend:
        (letters, _), _ = cv2.getTextSize(entry[0], cv2.FONT_HERSHEY_SIMPLEX, _SIZE, 1)
        used += letters + 36
        if used > width - 2 * left and rows[-1]:
            rows.append([])
            used = letters + 36
        rows[-1].append(entry)
    image = drawing.with_strip(
        picture.image, 2 * math.ceil(_LINE * (len(words) + len(rows)) / 2) + 8
    )
    for place, line in enumerate(words, 1):
        drawing.write_words(image, line, (left, below + place * _LINE - 6), _SIZE)
    for place, row in enumerate(rows, len(words) + 1):
        drawing.write_legend(image, row, (left, below + place * _LINE - 6), _SIZE)
    return image


def write_paper_figures(trials: Sequence[Trial], folder: Path) -> list[Path]:
    """Draw the figures, of the first of the trials of each method that is shown."""
    first = [t for t in trials if (t.trial, t.filter_seed) == (0, 0) and t.localizer in _IN_PAPER]
    stages = {trial.localizer: Stage.of(trial) for trial in first}
    episodes = {method: list(stage.moments()) for method, stage in stages.items()}
    contents: dict[str, bytes] = {}
    for method, episode in episodes.items():
        half_way = episode[(len(episode) - 1) // 2]
        contents[f"fig4_{method}.png"] = png(camera_of(stages[method]).frame(half_way, [method]))
    if "deq-mcl" in episodes:
        contents |= _fig_5(camera_of(stages["deq-mcl"]), episodes["deq-mcl"])
    if shown := [method for method in _IN_PAPER if method in episodes]:
        small = camera_of(stages[shown[0]], scale=1.2)
        laps = [
            [small.frame(moment, [method]) for moment in episodes[method][::LAP_STRIDE]]
            for method in shown
        ]
        frames = [side_by_side(row) for row in zip(*laps, strict=True)]
        contents["lap.webp"] = webp(frames)
    return write_files(folder, contents)


def _fig_5(camera: Camera, episode: Sequence[Step]) -> dict[str, bytes]:
    """State 150 seen at step 150, and looked back at L steps later; the same if L = 0."""
    images: dict[str, bytes] = {}
    later = _FIG_5_STATE + camera.lag
    if later < len(episode):
        for step, offset in ((_FIG_5_STATE, 0), (later, -camera.lag)):
            words = [f"deq-mcl, state {_FIG_5_STATE} seen at step {step}"]
            ring = ("true pose then", episode[_FIG_5_STATE].truth) if offset else None
            frame = camera.frame(episode[step], words, ring, offset=offset)
            images[f"fig5_step{step}.png"] = png(frame)
    return images


@dataclass(frozen=True, kw_only=True)
class Animation:
    """One world in motion, a trial of each method side by side."""

    name: str  # of its files, without ending
    title: str  # what is to be seen
    caption: str
    runs: dict[str, Finished]  # one of each method, by label
    webp: bytes = b""  # the animation; empty until it is filmed
    png: bytes = b""  # its end, for those who want no motion


def filmed(shown: Animation) -> Animation:
    """Return an animation with its pictures: its trials are run again."""
    if any(key_of(run.trial) != run.key for run in shown.runs.values()):
        raise InputError("code, libraries or a plug-in were changed since its trials were run.")
    rows = []
    for label, run in shown.runs.items():
        stage = Stage.of(run.trial)
        film = Film(camera_of(stage, scale=1.0), label, _STRIDE)
        deque(film.of(stage.moments()), maxlen=0)
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


def animations(panels: Sequence[Panel], folder: Path, draw: bool) -> tuple[list[Animation], str]:
    """Return the films of the first panel, drawn if the folder lacks some; and why none are."""
    chosen = films_of(panels[0]) if panels else []
    stored = []
    for film in chosen:
        moving, still = (folder / IMAGES / f"{film.name}.{ending}" for ending in ("webp", "png"))
        if moving.is_file() and still.is_file():
            stored.append(replace(film, webp=content_of(moving), png=content_of(still)))
    if len(stored) == len(chosen) or not draw:
        why = "the folder has none of these worlds; `deqmcl sweep` draws them."
        return stored, "" if stored or not chosen else why
    # a plug-in that hangs or exits there does no harm
    with Processes(available_cpus(), timeout=_PATIENCE) as pool:
        promises = [pool.submit(filmed, film) for film in chosen]
        try:
            return [promise.result() for promise in promises], ""
        except InputError as error:
            return [], str(error)
        except Exception as error:  # a plug-in that is gone is no reason to say nothing
            return [], f"its trials could not be run again ({in_words(error)})"


def films_of(panel: Panel) -> list[Animation]:
    """Choose the best, median and worst world of what is in focus, beside its baseline."""
    rows = panel.present
    if rows.empty or panel.world == "run":  # of a whole log, which has its own pictures
        return []
    focus = _focus(rows)
    name, what = "error", "error"
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
            for record in reversed(panel.records[label])
            if record.trial.trial == world
        }
        reached = f"{value:.1f}" if math.isfinite(value) else "never"
        chosen.append(
            Animation(
                name=f"lap-{panel.number}-{place.lower()}-{world}",
                title=f"{place} of {len(ranked)} worlds",
                caption=f"World {world}, {' and '.join(first)}: {what} of {focus['label']} "
                f"{reached}. Every {_STRIDE}th step; orange: present, pink: past, light blue: "
                "future; at the end the ways of truth and best cluster.",
                runs=first,
            )
        )
    return chosen


def _focus(rows: pd.DataFrame) -> pd.Series:
    """What is localized earliest if robots are lost, else DEQ-MCL, else what differs most."""
    others = rows[~rows["is_baseline"]]
    if _LOCALIZED in rows and others[f"{_LOCALIZED}_restricted"].notna().any():
        return others.sort_values(f"{_LOCALIZED}_restricted", kind="stable").iloc[0]
    named = rows[rows["method"] == "deq-mcl"]
    compared = others[others["diff"].notna()]
    compared = compared.iloc[(-compared["diff"].abs()).argsort(kind="stable")]
    return pd.concat([named, compared, rows]).iloc[0]
