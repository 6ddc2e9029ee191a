"""Pictures of the world by OpenCV: walls, robot, beams and clouds of particles, as RGB arrays."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.maps import GridMap, Map, PolygonMap
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Floats
from deqmcl_gym.validation import InputError

Image = NDArray[np.uint8]
Color = tuple[int, int, int]

BLACK: Color = (20, 20, 20)
GRAY: Color = (128, 128, 128)
PALE: Color = (226, 226, 226)
ORANGE: Color = (255, 140, 0)
PINK: Color = (240, 90, 160)
LIGHT_BLUE: Color = (90, 180, 240)
MAPPED: Color = (40, 90, 200)  # the map, where something else is there
GLASS: Color = (120, 220, 225)
PERSON: Color = (150, 95, 40)

MOST_PIXELS = 8_192  # pixels: 200 MB
_OF_CELLS = 480  # largest side of a picture of a map of cells, in pixels at scale 1
_LEAST = 3.0  # pixels: smallest radius at which a robot is drawn
_SHADES = np.array((PALE[0], 255, BLACK[0]), np.uint8)  # of unknown, free and occupied cells
_SHIFT = 4  # OpenCV's fractional bits: sixteenths of a pixel
_FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True)
class View:
    """From the floor plan (y up) to image pixels (y down).

    ``scale`` is image pixels per px, or per 0.02 m of a map in metres. A map of cells, which may be
    a whole building, is drawn smaller: its sides are at most 480 times the scale.
    """

    floor_plan: Map
    scale: float = 2.0
    margin: int = 8

    def __post_init__(self) -> None:
        width, height = self.size
        if max(width, height) > MOST_PIXELS:
            raise InputError(
                f"a picture of the floor plan would have {width} x {height} pixels, but may have "
                f"at most {MOST_PIXELS:,} per side: give a smaller floor plan, or a smaller scale."
            )

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image, both even, as video codecs need."""
        x0, y0, x1, y1 = self.floor_plan.bounds
        sides = (x1 - x0) * self.per_length, (y1 - y0) * self.per_length
        width, height = (2 * math.ceil((side + 2 * self.margin) / 2) for side in sides)
        return width, height

    @property
    def per_length(self) -> float:
        """Image pixels per length of the floor plan's unit."""
        per_length = self.scale / pixel(self.floor_plan.unit)
        if not isinstance(self.floor_plan, GridMap):
            return per_length
        x0, y0, x1, y1 = self.floor_plan.bounds
        return min(per_length, _OF_CELLS * self.scale / max(x1 - x0, y1 - y0))

    def pixels(self, points: ArrayLike) -> Floats:
        """Image coordinates (column, row) of points, (n, 2); further columns are ignored."""
        xy = np.asarray(points, dtype=np.float64)[:, :2]
        x0, _, _, y1 = self.floor_plan.bounds
        return (xy - (x0, y1)) * (self.per_length, -self.per_length) + self.margin


class Drawing:
    """A picture in the making; every method draws onto it and returns it."""

    def __init__(self, view: View) -> None:
        """Draw the empty floor plan: black walls, pale obstacles and unknown cells."""
        self.view = view
        width, height = view.size
        self.image: Image = np.full((height, width, 3), 255, dtype=np.uint8)
        if isinstance(view.floor_plan, GridMap):
            self._cells(view.floor_plan)
        elif isinstance(view.floor_plan, PolygonMap):
            self._polygons(view.floor_plan)

    def _polygons(self, floor_plan: PolygonMap) -> None:
        thickness = max(1, round(1.5 * self.view.scale))
        for obstacle in floor_plan.obstacles:
            cv2.fillPoly(self.image, [self._fixed(obstacle)], PALE, cv2.LINE_AA, _SHIFT)
        for polygon in (floor_plan.outer, *floor_plan.obstacles):
            corners = self._fixed(polygon)
            cv2.polylines(self.image, [corners], True, BLACK, thickness, cv2.LINE_AA, _SHIFT)

    def _cells(self, floor_plan: GridMap) -> None:
        ranks = np.where(floor_plan.occupancy < 0, 0, 1 + floor_plan.occupied).astype(np.uint8)
        wide = math.ceil(1 / (self.view.per_length * floor_plan.resolution))
        if wide > 1:  # cells per image pixel: a wall counts before free ones, these before unknown
            ranks = np.asarray(cv2.dilate(ranks, np.ones((wide, wide), np.uint8)), np.uint8)
        shades = _SHADES[ranks]
        corners = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
        placed = self.view.pixels(floor_plan.placed(corners + 0.5)) - 0.5  # centres of these cells
        move = cv2.getAffineTransform(corners.astype(np.float32), placed.astype(np.float32))
        height, width = self.image.shape[:2]
        flags = cv2.INTER_NEAREST
        drawn = cv2.warpAffine(shades, move, (width, height), flags=flags, borderValue=PALE[0])
        self.image[:] = drawn[:, :, None]

    def points(self, points: ArrayLike, color: Color, size: int = 3) -> "Drawing":
        """Draw a cloud of square dots, ``size`` image pixels wide; those outside are left out."""
        columns, rows = np.rint(self.view.pixels(points)).astype(np.intp).T
        height, width = self.image.shape[:2]
        for dx in range(-(size // 2), size - size // 2):
            for dy in range(-(size // 2), size - size // 2):
                column, row = columns + dx, rows + dy
                inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
                self.image[row[inside], column[inside]] = color
        return self

    def path(self, points: ArrayLike, color: Color, thickness: int = 1) -> "Drawing":
        """Draw a line through points, (n, 2)."""
        line = self._fixed(points)
        cv2.polylines(self.image, [line], False, color, thickness, cv2.LINE_AA, _SHIFT)
        return self

    def beams(self, rays: ArrayLike, ranges: ArrayLike) -> "Drawing":
        """Draw ranges (B,) along rays (x, y, angle), (B, 3), as thin lines; finite ones only."""
        starts, seen = np.asarray(rays, np.float64), np.asarray(ranges, np.float64)
        for (x, y, angle), distance in zip(starts, seen, strict=True):
            if math.isfinite(distance):
                tip = (x + distance * math.cos(angle), y + distance * math.sin(angle))
                self.path([(x, y), tip], (220, 120, 120))
        return self

    def robot(self, pose: ArrayLike, radius: float, color: Color = GRAY) -> "Drawing":
        """Draw the robot as a disc with a line along its heading."""
        x, y, heading = np.asarray(pose, dtype=np.float64)
        nose = (x + radius * math.cos(heading), y + radius * math.sin(heading))
        centre, tip = self._fixed([(x, y), nose]).tolist()
        disc = round(max(radius * self.view.per_length, _LEAST) * 2**_SHIFT)
        cv2.circle(self.image, centre, disc, color, -1, cv2.LINE_AA, _SHIFT)
        cv2.circle(self.image, centre, disc, BLACK, 1, cv2.LINE_AA, _SHIFT)
        cv2.line(self.image, centre, tip, BLACK, 2, cv2.LINE_AA, _SHIFT)
        return self

    def segments(self, walls: Floats, color: Color) -> "Drawing":
        """Draw the outline of walls (x0, y0, x1, y1), (S, 4)."""
        lines = list(self._fixed(walls.reshape(-1, 2)).reshape(-1, 2, 2))
        cv2.polylines(self.image, lines, False, color, 1, cv2.LINE_AA, _SHIFT)
        return self

    def solids(self, polygons: Floats, color: Color) -> "Drawing":
        """Draw filled convex polygons, (k, c, 2)."""
        for corners in polygons:
            cv2.fillConvexPoly(self.image, self._fixed(corners), color, cv2.LINE_AA, _SHIFT)
        return self

    def discs(self, centres: Floats, radius: float, color: Color) -> "Drawing":
        """Draw filled discs around ``centres``, (n, 2)."""
        size = round(radius * self.view.per_length * 2**_SHIFT)
        for at in self._fixed(centres).tolist():
            cv2.circle(self.image, at, size, color, -1, cv2.LINE_AA, _SHIFT)
        return self

    def number(self, step: int) -> "Drawing":
        """Write the step number at the top left."""
        write_words(self.image, str(step), (self.view.margin + 10, self.view.margin + 28), 0.8)
        return self

    def _fixed(self, points: ArrayLike) -> NDArray[np.int32]:
        fixed: NDArray[np.int32] = np.rint(self.view.pixels(points) * 2**_SHIFT).astype(np.int32)
        return fixed


def with_strip(image: Image, rows: int) -> Image:
    """Return the image with an empty white strip below, for a legend; ``rows`` even."""
    return np.pad(image, ((0, rows), (0, 0), (0, 0)), constant_values=255)


def write_words(image: Image, words: str, at: tuple[int, int], size: float = 0.5) -> None:
    """Write words (ASCII), their baseline's left end at ``at`` (column, row)."""
    cv2.putText(image, words, at, _FONT, size, BLACK, 1, cv2.LINE_AA)


def write_legend(
    image: Image, entries: list[tuple[str, Color]], at: tuple[int, int], size: float = 0.5
) -> None:
    """Write coloured dots with their words in one row, from ``at`` (column, row) rightwards."""
    column, row = at
    for words, color in entries:
        cv2.circle(image, (column + 6, row - 5), 6, color, -1, cv2.LINE_AA)
        write_words(image, words, (column + 18, row), size)
        (width, _), _ = cv2.getTextSize(words, _FONT, size, 1)
        column += 18 + width + 18
