"""Animations of trials, which are run again: that gives the same again."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from benchmarks.execution.engines import available_cpus
from benchmarks.execution.processes import Processes
from benchmarks.pictures.figures import camera_of
from benchmarks.pictures.film import Film, png, side_by_side, webp
from benchmarks.trials.plugins import guest_of, key_of
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.drawing import Image

STRIDE = 8  # steps per frame
_MILLISECONDS = 200
_SCALE = 1.0
_PATIENCE = 300.0  # seconds for one animation


@dataclass(frozen=True, kw_only=True)
class Animation:
    """One world, shown in motion.

    Attributes:
        name: file name without ending.
        title: heading.
        caption: what is to be seen.
        trials: shown side by side, one of each method.
        labels: of the methods.
        keys: the names under which their results are kept.
        webp: the animation; empty until it is drawn.
        png: its end, for those who want no motion.
    """

    name: str
    title: str
    caption: str
    trials: tuple[Trial, ...]
    labels: tuple[str, ...]
    keys: tuple[str, ...]
    webp: bytes = b""
    png: bytes = b""

    @property
    def parts(self) -> "list[Animation]":
        """The animation of each of its trials alone."""
        shown = zip(self.trials, self.labels, self.keys, strict=True)
        return [replace(self, trials=(t,), labels=(n,), keys=(key,)) for t, n, key in shown]


Promise = Callable[[], Animation]


@contextmanager
def drawing() -> Iterator[Callable[[Animation], Promise]]:
    """Start workers that draw what is given: a plug-in that hangs or exits there does no harm.

    Trials of different plug-ins are run apart, as in a sweep.
    """

    def guest(shown: Animation) -> str:
        return max(map(guest_of, shown.trials), default="")  # the same of all: else it is in parts

    def promised(shown: Animation) -> Promise:
        if len(set(map(guest_of, shown.trials))) <= 1:
            return pool.submit(drawn, shown).result
        parts = [pool.submit(frames_of, part) for part in shown.parts]
        return lambda: joined(shown, [row for part in parts for row in part.result()])

    with Processes(available_cpus(), timeout=_PATIENCE, guest_of=guest) as pool:
        yield promised


def drawn(shown: Animation) -> Animation:
    """Return an animation with its pictures: its trials are run again; see ``frames_of``."""
    return joined(shown, frames_of(shown))


def frames_of(shown: Animation) -> list[list[Image]]:
    """Return the frames of each of its trials, which are run again.

    Raises:
        InputError: its code is another one by now.
    """
    if tuple(map(key_of, shown.trials)) != shown.keys:
        raise InputError("code, libraries or a plug-in were changed since its trials were run.")
    rows = []
    for trial, label in zip(shown.trials, shown.labels, strict=True):
        stage = Stage.of(trial)
        film = Film(camera_of(stage, _SCALE), label, STRIDE)
        for _ in film.of(stage.moments()):
            pass
        rows.append(film.frames)
    return rows


def joined(shown: Animation, rows: Sequence[Sequence[Image]]) -> Animation:
    """Return it with its pictures: the frames of its trials, side by side."""
    longest = max(map(len, rows))
    padded = [[*row, *[row[-1]] * (longest - len(row))] for row in rows]  # who ends first waits
    frames = [side_by_side(images) for images in zip(*padded, strict=True)]
    return replace(shown, webp=webp(frames, _MILLISECONDS), png=png(frames[-1]))  # the whole way
