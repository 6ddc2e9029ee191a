"""Pictures of beliefs in the paper's colours: orange present, pink past, light-blue future."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.files import write_bytes
from benchmarks.tables.table_1 import TITLES, state_name
from benchmarks.trials.episode import Moment
from deqmcl_gym.world.drawing import (
    GRAY,
    LIGHT_BLUE,
    ORANGE,
    PINK,
    Color,
    Drawing,
    Image,
    View,
    with_strip,
    write_legend,
    write_words,
)

_LAYERS: tuple[tuple[int, Color, str], ...] = (  # sign of the offset, back to front
    (+1, LIGHT_BLUE, "future"),
    (-1, PINK, "past"),
    (0, ORANGE, "present"),
)
_LINE = 24  # image pixels per line of text


@dataclass(frozen=True)
class Camera:
    """Draws moments of one room.

    Attributes:
        view: the room, and how large.
        radius: of the robot, px.
        lag: L, the offset of the past and future shown, steps.
    """

    view: View
    radius: float
    lag: int

    def frame(self, moment: Moment, method: str, note: str = "") -> Image:
        """Draw one moment: clouds, robot, step number; below it the method, a note, a legend."""
        drawing = Drawing(self.view)
        legend: list[tuple[str, Color]] = [("robot", GRAY)]
        for sign, color, words in _LAYERS:
            offset = sign * self.lag
            held = moment.belief.points(offset)
            if held is None or (sign != 0 and offset == 0):
                continue
            drawing.points(held[0], color, size=3 if self.view.scale > 1 else 2)
            legend.append((f"{words} {state_name(offset)}", color))
        drawing.robot(moment.truth, self.radius).number(moment.step)
        image = with_strip(drawing.image, 2 * _LINE + 8)
        left, below = self.view.margin, drawing.image.shape[0]
        title = TITLES.get(method, method)
        write_words(image, f"{title}{', ' if note else ''}{note}", (left, below + _LINE - 8))
        write_legend(image, legend[1:][::-1] + legend[:1], (left, below + 2 * _LINE - 4))
        return image


def write_png(path: Path, image: Image) -> None:
    """Write an RGB image as PNG, whole or not at all."""
    done, content = cv2.imencode(".png", image[:, :, ::-1])
    assert done, "OpenCV encodes any RGB image as PNG"
    write_bytes(path, content.tobytes())


def write_webp(path: Path, frames: Sequence[Image], milliseconds: int) -> None:
    """Write RGB images as an animated, endless WebP, whole or not at all."""
    animation = cv2.Animation()
    animation.frames = [np.ascontiguousarray(frame[:, :, ::-1]) for frame in frames]
    animation.durations = [milliseconds] * len(frames)
    animation.loop_count = 0
    quality = [cv2.IMWRITE_WEBP_QUALITY, 101]  # above 100: lossless; lossy leaves ghosts
    done, content = cv2.imencodeanimation(".webp", animation, quality)
    if not done:
        raise RuntimeError("OpenCV could not encode the animation.")
    write_bytes(path, content.tobytes())


def side_by_side(images: Sequence[Image]) -> Image:
    """Return images of one height in a row."""
    return np.hstack(list(images))
