"""One episode: a robot on its way through a world, from reset to the end of its plan."""

import math

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.config import World
from deqmcl_gym.lap import Course
from deqmcl_gym.lidar import LidarSensor
from deqmcl_gym.path import Pose, wrapped
from deqmcl_gym.physics import Physics, Walls
from deqmcl_gym.plan import Plan
from deqmcl_gym.seeding import NormalRows, Stream, episode_stream
from deqmcl_gym.validation import InputError

_START_TRIES = 1000

Scan = NDArray[np.float32]


class Episode:
    """All that changes between two resets.

    Attributes:
        plan: the actions planned for this episode, done and to come.
        step: steps carried out.
        ended: whether there is no further one.
        scan: the last one, (B,) px.
    """

    def __init__(
        self, world: World, walls: Walls, course: Course, plan: Plan, *, seed: int, number: int
    ) -> None:
        """Begin the ``number``-th episode after seeding, and take its first scan.

        Raises:
            InputError: no start drawn is free.
        """
        self._world, self._path = world, course.path
        self._seed, self._number = seed, number
        self._noise = world.noise
        self._motion = NormalRows(self.stream(Stream.MOTION), 2)
        self._sensor = LidarSensor(world.floor_plan, world.lidar, self.stream(Stream.SENSOR))
        x, y, heading = self._drawn_start(course.start)
        self._start = (x, y)
        self._heading = heading if -math.pi <= heading < math.pi else wrapped(heading)
        self._physics = Physics(walls, self._start)
        self._arc = self._path.arc(self._start)
        self._progress = 0.0
        self.plan, self.step, self.ended = plan, 0, False
        self.scan = self._sensor.scan(self.pose)

    def stream(self, stream: Stream, twin: int = 0) -> np.random.Generator:
        """Return the random stream of one source in this episode, from its beginning."""
        return episode_stream(self._seed, self._number, stream, twin)

    @property
    def pose(self) -> Pose:
        """The true pose (x px, y px, θ rad)."""
        x, y = self._physics.position
        return x, y, self._heading

    @property
    def lap_done(self) -> bool:
        """Whether the progress adds up to one lap and the robot is back at its start."""
        if round(self._progress / self._path.length) < 1:
            return False
        return math.dist(self._start, self._physics.position) <= self._world.robot.radius

    def place(self, pose: Pose) -> None:
        """Put the robot somewhere; that makes no progress."""
        x, y, self._heading = pose
        self._physics.place((x, y))
        self._arc = self._path.arc((x, y))

    def advance(self, distance: float, turn: float) -> tuple[float, bool]:
        """Turn, drive, take a scan: one step of noisy motion.

        Returns:
            The progress made along the path, px; whether a wall stopped the robot.
        """
        collided = self._move(distance, turn)
        self.step += 1
        before, self._arc = self._arc, self._path.arc(self._physics.position)
        progress = self._path.advance(before, self._arc)
        self._progress += progress
        self.scan = self._sensor.scan(self.pose)
        return progress, collided

    def _move(self, distance: float, turn: float) -> bool:
        noise = self._noise
        noise_distance, noise_turn = self._motion.next().tolist()
        sd_turn = noise.turn * abs(turn) + noise.drift * distance
        self._heading = wrapped(self._heading + turn + sd_turn * noise_turn)
        driven = distance * (1 + noise.drive * noise_distance)
        return self._physics.drive(driven, self._heading)

    def _drawn_start(self, middle: Pose) -> Pose:
        start, radius = self._world.start, self._world.robot.radius
        if start.sd_position == start.sd_heading == 0.0:
            return middle
        x, y, heading = middle
        rng = self.stream(Stream.START)
        sd = np.array([start.sd_position, start.sd_position, start.sd_heading])
        for _ in range(_START_TRIES):
            dx, dy, turn = (sd * rng.standard_normal(3)).tolist()
            if self._world.floor_plan.free([(x + dx, y + dy)], radius)[0]:
                return x + dx, y + dy, heading + turn
        raise InputError(
            f"none of {_START_TRIES} starts drawn around ({x:g}, {y:g}) is free: give a smaller "
            "start.sd_position."
        )
