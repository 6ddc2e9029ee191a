"""People: discs that walk to and fro in a world, in the way of the robot and of its beams."""

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from deqmcl_gym.maps.grid_kernels import enters_circle
from deqmcl_gym.maps.map import LENGTH, Caster, Map, Part, bounded, pixel
from deqmcl_gym.numerics import Bools, Floats, Indices, Point, Singles, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.differences import ordered

_LEGS = 16
_LOOKS = 8  # directions tried for the next leg
_LEAST = 50.0  # px: of a leg, and from the robot at the start
_POLITE = 10.0  # px: left between a person and the robot
_TRIES = 100


@dataclass(frozen=True, kw_only=True)
class People(Part, called="people.{}"):
    """People who walk straight from one random place to another in sight of it, and back.

    They pass through each other, but not through the robot: who would come too near turns round,
    and who would either way walks elsewhere, away from it. ``speed`` is the least and the greatest,
    per s.
    """

    number: int = bounded(10, high=1000)  #: of people, up to 1000
    radius: float = bounded(15.0, LENGTH, low=0, above=True)  #: of a person
    speed: tuple[float, float] = field(default=(25.0, 75.0), metadata=LENGTH)  #: range, per s
    seconds: float = bounded(0.4, low=0, above=True)  #: duration of a step of the robot

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "speed", ordered("people.speed", self.speed))


class Crowd:
    """The people of an episode, at ``places``, (n, 2)."""

    def __init__(
        self, people: People, floor_plan: Map, robot: Point, body: float, rng: np.random.Generator
    ) -> None:
        """Draw who walks where; nobody begins within 1 m (50 px) of the robot's rim."""
        self.radius, px = people.radius, pixel(floor_plan.unit)
        self._ground, self._least, self._rng = floor_plan, _LEAST * px, rng
        (x0, y0, x1, y1), starts = floor_plan.bounds, np.empty((0, 2))
        apart = people.radius + body + self._least
        for _ in range(_TRIES):
            if len(starts) >= people.number:
                break
            drawn = rng.uniform((x0, y0), (x1, y1), (16 + people.number, 2))
            fits = floor_plan.free(drawn, people.radius)
            fits &= ((drawn - robot) ** 2).sum(axis=1) >= apart * apart
            starts = np.vstack([starts, drawn[fits]])
        if len(starts) < people.number:
            raise InputError(
                f"there is no room for people.number = {people.number} of radius "
                f"{people.radius:g} {floor_plan.unit} apart from the robot: give fewer people, or "
                "a smaller radius."
            )
        starts = starts[: people.number]
        self._corners, self._ends = self._paths(starts, None)
        steps = people.seconds * rng.uniform(*people.speed, people.number)
        # a step that begins this far away, or ends there, does not touch the robot in between
        self._reach = people.radius + body + np.maximum(_POLITE * px, steps / 2)
        self._steps, self._arcs = steps, np.zeros(people.number)
        self._waits = np.zeros(people.number, np.intp)  # steps not taken in a row
        self.places = starts.copy()

    def walk(self, robot: Point) -> None:
        """Walk for one step of a robot, which stands still meanwhile."""
        _walk(
            self._corners, self._ends, self._steps, self._arcs, self._waits, self._reach, *robot,
            self.places,
        )  # fmt: skip
        stuck = np.flatnonzero(self._waits > 1)
        if stuck.size:
            self._corners[stuck], self._ends[stuck] = self._paths(self.places[stuck], robot)
            self._arcs[stuck], self._steps[stuck] = 0.0, np.abs(self._steps[stuck])

    def _paths(self, starts: Floats, robot: Point | None) -> tuple[Floats, Floats]:
        """Draw where people go, (n, k, 2), at first away from a robot; and the arc lengths."""
        corners, away = [starts], robot
        for _ in range(_LEGS if len(starts) else 0):
            corners.append(self._next(corners[-1], away))
            away = None
        path = np.stack(corners, axis=1)
        lengths = np.sqrt((np.diff(path, axis=1) ** 2).sum(axis=2))
        return path, np.cumsum(np.pad(lengths, ((0, 0), (1, 0))), axis=1)

    def _next(self, starts: Floats, away: Point | None) -> Floats:
        """Draw the next place of each in sight, (n, 2), away from one; who finds none stays."""
        n, ground = len(starts), self._ground
        bearings = self._rng.uniform(-math.pi, math.pi, n * _LOOKS)
        shares = self._rng.random(n * _LOOKS)
        befores = np.repeat(starts, _LOOKS, axis=0)
        seen = ground.ranges(np.column_stack([befores, bearings]), [0.0])[:, 0].astype(np.float64)
        x0, y0, x1, y1 = ground.bounds
        ways = shares * np.minimum(seen, x1 - x0 + y1 - y0)
        along = np.column_stack([arrays.cos(bearings), arrays.sin(bearings)])
        places = befores + ways[:, None] * along
        clear = ~ground.collides(befores, places, self.radius)
        if away is not None:
            clear &= ((places - befores) * (befores - away)).sum(axis=1) >= 0.0
        fits: Bools = np.reshape((ways >= self._least) & clear, (n, _LOOKS))
        chosen = places.reshape(n, _LOOKS, 2)[np.arange(n), fits.argmax(axis=1)]
        return np.where(fits.any(axis=1, keepdims=True), chosen, starts)


class Contacts(Protocol):
    """What a disc can touch."""

    def gap(self, centre: Point) -> float:
        """Distance of the disc's rim from the nearest of it, negative if they overlap."""

    def first_contact(self, start: Point, end: Point) -> float:
        """Share of a drive at which a disc that starts clear touches something; ∞: never."""


class Crowded:
    """Walls and people."""

    def __init__(self, walls: Contacts, crowd: Crowd, body: float) -> None:
        self._walls, self._crowd, self._size = walls, crowd, crowd.radius + body

    def gap(self, centre: Point) -> float:
        """See ``Contacts.gap``."""
        squares = ((self._crowd.places - centre) ** 2).sum(axis=1)
        return min(self._walls.gap(centre), math.sqrt(squares.min(initial=math.inf)) - self._size)

    def first_contact(self, start: Point, end: Point) -> float:
        """See ``Contacts.first_contact``."""
        (x, y), drive = start, (end[0] - start[0], end[1] - start[1])
        places = self._crowd.places.tolist()
        of_people = [enters_circle(x - at[0], y - at[1], *drive, self._size) for at in places]
        return min([self._walls.first_contact(start, end), *of_people])


def cast_among_people(
    walls: Caster, crowd: Crowd, poses: Singles, bearings: Singles, out: Singles
) -> None:
    """Cast among walls, and people before them."""
    walls(poses, bearings, out)
    _cast(poses, bearings, crowd.places, crowd.radius, out)


@compiled
def _walk(
    corners: Floats,
    ends: Floats,
    steps: Floats,
    arcs: Floats,
    waits: Indices,
    reach: Floats,
    robot_x: float,
    robot_y: float,
    places: Floats,
) -> None:
    """Walk one step along each path, to and fro; turn round instead of coming near the robot."""
    for i in range(steps.size):
        length = ends[i, -1]
        if length == 0.0:
            continue
        arc = arcs[i] + steps[i]
        if not 0.0 <= arc <= length:
            steps[i] = -steps[i]
            arc = min(max(-arc if arc < 0.0 else 2 * length - arc, 0.0), length)
        leg = 0
        while leg < ends.shape[1] - 2 and ends[i, leg + 1] < arc:
            leg += 1
        way = ends[i, leg + 1] - ends[i, leg]
        share = (arc - ends[i, leg]) / way if way > 0.0 else 0.0
        x = corners[i, leg, 0] + share * (corners[i, leg + 1, 0] - corners[i, leg, 0])
        y = corners[i, leg, 1] + share * (corners[i, leg + 1, 1] - corners[i, leg, 1])
        after = (x - robot_x) ** 2 + (y - robot_y) ** 2
        before = (places[i, 0] - robot_x) ** 2 + (places[i, 1] - robot_y) ** 2
        if after < before and after < reach[i] * reach[i]:
            steps[i] = -steps[i]
            waits[i] += 1
            continue
        waits[i] = 0
        arcs[i], places[i, 0], places[i, 1] = arc, x, y


@compiled
def _cast(poses: Singles, bearings: Singles, places: Floats, radius: float, out: Singles) -> None:
    """Shorten beams to where they enter discs: t = b - √(b² - |c|² + r²), b = c · u, if real."""
    for i in range(poses.shape[1]):
        x, y = np.float64(poses[0, i]), np.float64(poses[1, i])
        for beam in range(bearings.size):
            angle = np.float64(poses[2, i]) + np.float64(bearings[beam])
            ux, uy = cos64(angle), sin64(angle)
            nearest: float = np.float64(out[beam, i])
            for k in range(len(places)):
                px, py = places[k, 0] - x, places[k, 1] - y
                along = px * ux + py * uy
                inside = radius * radius - (px * px + py * py)
                root = along * along + inside
                if inside >= 0.0:
                    nearest = min(nearest, 0.0)
                elif along > 0.0 and root >= 0.0:
                    nearest = min(nearest, along - np.sqrt(root))
            out[beam, i] = nearest
