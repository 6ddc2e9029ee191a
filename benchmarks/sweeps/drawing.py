"""Animations of trials, which are run again: that gives the same again."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from benchmarks.execution.engines import available_cpus
from benchmarks.execution.processes import Processes
from benchmarks.pictures.figures import camera_of
from benchmarks.pictures.film import Film, png, side_by_side, webp
from benchmarks.trials.plugins import key_of
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.validation import InputError

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


Promise = Callable[[], Animation]


@contextmanager
def drawing() -> Iterator[Callable[[Animation], Promise]]:
    """Start workers that draw what is given: a plug-in that hangs or exits there does no harm."""
    with Processes(available_cpus(), timeout=_PATIENCE) as pool:
        yield lambda shown: pool.submit(drawn, shown).result


def drawn(shown: Animation) -> Animation:
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
