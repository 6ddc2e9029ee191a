"""Pictures of beliefs in the paper's colours: orange present, pink past, light-blue future."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import PIL.Image

from benchmarks.tables.text import TITLES, state_name
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
_LAST = 1500  # ms that the last image stays


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
        drawing, clouds = self.scene(moment)
        drawing.robot(moment.truth, self.radius)
        image = with_strip(drawing.image, 2 * _LINE + 8)
        left, below = self.view.margin, drawing.image.shape[0]
        title = TITLES.get(method, method)
        write_words(image, f"{title}{', ' if note else ''}{note}", (left, below + _LINE - 8))
        write_legend(image, [*clouds, ("robot", GRAY)], (left, below + 2 * _LINE - 4))
        return image

    @property
    def layers(self) -> list[tuple[str, Color]]:
        """All clouds that a scene may have, the present first, with their colours."""
        return [
            (f"{words} {state_name(sign * self.lag)}", color)
            for sign, color, words in reversed(_LAYERS)
            if self.lag or sign == 0
        ]

    def scene(self, moment: Moment) -> tuple[Drawing, list[tuple[str, Color]]]:
        """Draw the map, the clouds and the step number; return what is in the colours, too."""
        drawing = Drawing(self.view)
        legend: list[tuple[str, Color]] = []
        for sign, color, words in _LAYERS:
            offset = sign * self.lag
            held = moment.belief.points(offset)
            if held is None or (sign != 0 and offset == 0):
                continue
            drawing.points(held[0], color, size=3 if self.view.scale > 1 else 2)
            legend.insert(0, (f"{words} {state_name(offset)}", color))
        return drawing.number(moment.step), legend


def png(image: Image) -> bytes:
    """Return an RGB image as PNG."""
    done, content = cv2.imencode(".png", image[:, :, ::-1])
    assert done, "OpenCV encodes any RGB image as PNG"
    return content.tobytes()


def webp(frames: Sequence[Image], milliseconds: int) -> bytes:
    """Return RGB images as an animated, endless WebP without loss, which would leave ghosts.

    The last image stays for a second and a half.
    """
    first, *others = map(PIL.Image.fromarray, frames)
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
    """Return images of one height in a row."""
    return np.hstack(list(images))
