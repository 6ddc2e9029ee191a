"""The robots of many rooms as flat arrays: all that changes between two resets."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.lidar import Scanner
from deqmcl_gym.seeding import NormalTable, Stream, episode_stream
from deqmcl_gym.setting import COLLISION_PENALTY, SKIN, Setting
from deqmcl_gym.vector import kernels

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]


class Moved(NamedTuple):
    """What came of a step.

    Attributes:
        rewards: progress along the path less the penalty, (n,) px.
        collided: whether a wall stopped the robot, (n,).
        ended: whether the plan is used up or, where that counts, the lap is done, (n,).
    """

    rewards: Floats
    collided: Bools
    ended: Bools


class Rooms:
    """What :class:`deqmcl_gym.episode.Episode` is for one room, for n of them.

    Attributes:
        poses: the true poses (x px, y px, θ rad), (n, 3).
        steps: carried out, (n,).
        scans: the last ones, (n, B) px float32.
    """

    def __init__(self, setting: Setting, number: int) -> None:
        """Make rooms without an episode: :meth:`begin` gives them one."""
        world, lidar = setting.world, setting.world.lidar
        self._setting = setting
        self._path = setting.course.path
        self._sides = kernels.sides(world.floor_plan.walls)
        self._noise = (world.noise.drive, world.noise.turn, world.noise.drift)
        self._radius = world.robot.radius
        self._lap = (self._path.length, self._radius if setting.ends_at_goal else -1.0)
        self._most = len(setting.course.actions)
        self._motion = NormalTable(number, 2, self._most)
        self._sensor = NormalTable(number, lidar.beams, self._most + 1)
        self._scanner = Scanner(world.floor_plan, lidar)
        self.poses = np.tile(setting.course.start, (number, 1))
        self.steps = np.zeros(number, np.intp)
        self.scans = np.zeros((number, lidar.beams), np.float32)
        self._starts = self.poses.copy()
        self._every = np.arange(number)
        self._arcs = np.zeros(number)
        self._progress = np.zeros(number)
        self._gaps = np.zeros(number)

    def begin(self, rooms: Ints, episodes: list[tuple[int, int]]) -> None:
        """Begin an episode (seed, number) in each of ``rooms``; no scan is taken yet.

        Raises:
            InputError: no start drawn is free; then all rooms stay as they were.
        """
        starts = [self._setting.start(*episode) for episode in episodes]
        self.poses[rooms] = self._starts[rooms] = np.array(starts)
        self._arcs[rooms] = np.array([self._path.arc((x, y)) for x, y, _ in starts])
        self._progress[rooms] = self._gaps[rooms] = 0.0
        self.steps[rooms] = 0
        for room, episode in zip(rooms.tolist(), episodes, strict=True):
            self._motion.renew(room, episode_stream(*episode, Stream.MOTION))
            self._sensor.renew(room, episode_stream(*episode, Stream.SENSOR))

    def move(self, commands: NDArray[np.float32], among: Bools) -> Moved:
        """Turn and drive the robots ``among``: one step of noisy motion."""
        moved = Moved(np.empty(among.size), np.empty(among.size, np.bool_), np.empty_like(among))
        self._motion.fill()
        kernels.drive(
            self.poses, self._gaps, commands, self._motion.drawn, self._motion.at, among,
            self._noise, self._sides, self._radius, SKIN, self.steps, moved.collided,
        )  # fmt: skip
        kernels.judge(
            self._path.follow(self.poses, self._arcs), moved.collided, COLLISION_PENALTY,
            self._progress, self._lap, self.poses, self._starts, self.steps, self._most,
            moved.rewards, moved.ended,
        )  # fmt: skip
        return moved

    def look(self, rooms: Ints | None = None) -> None:
        """Take a scan in each of ``rooms``; None: in all."""
        poses = self.poses if rooms is None else self.poses[rooms]
        rooms = self._every if rooms is None else rooms
        self._scanner.scan_rooms(rooms, poses, self._sensor, self.scans)
