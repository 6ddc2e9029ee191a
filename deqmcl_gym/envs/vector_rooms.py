"""The robots of many rooms as flat arrays: all that changes between two resets."""

from typing import NamedTuple

import numpy as np

from deqmcl_gym.envs import vector_kernels as kernels
from deqmcl_gym.numerics.types import Bools, Floats, Indices, Singles
from deqmcl_gym.world.sensor import LidarSensors
from deqmcl_gym.world.setting import SKIN, Setting
from deqmcl_gym.world.streams import NormalTable, Stream, episode_stream


class Moved(NamedTuple):
    """What came of a step.

    Attributes:
        rewards: progress along the path less the penalty, (n,).
        collided: whether a wall stopped the robot, (n,).
        terminated: whether the plan is used up or, where that counts, the lap is done, (n,).
        truncated: whether the episode is as long as it may be, (n,).
    """

    rewards: Floats
    collided: Bools
    terminated: Bools
    truncated: Bools


class Rooms:
    """What :class:`deqmcl_gym.world.episode.Episode` is for one room, for n of them.

    Attributes:
        poses: the true poses (x, y, θ), (n, 3).
        steps: carried out, (n,).
    """

    def __init__(self, setting: Setting, number: int, limit: int) -> None:
        """Make rooms without an episode, of ``limit`` steps: :meth:`begin` gives them one."""
        world, lidar = setting.world, setting.world.lidar
        self._setting = setting
        self._path = setting.course.path
        most = len(setting.course.actions)
        noise, radius = world.noise, world.robot.radius
        near = radius if setting.ends_at_goal else -1.0
        walls = kernels.sides(world.floor_plan.walls)
        # as the two kernels of a step take them
        self._driving = ((noise.drive, noise.turn, noise.drift), walls, radius, SKIN * world.pixel)
        self._judging = (
            self._path.edges, self._path.length, setting.penalty, near, most, limit,
        )  # fmt: skip
        self._motion = NormalTable(number, 2, most)
        self._lidars = LidarSensors(world.floor_plan, lidar, number, most + 1)
        self.poses = np.tile(setting.course.start, (number, 1))
        self.steps = np.zeros(number, np.intp)
        self._starts = self.poses.copy()
        self._every = np.arange(number)
        self._arcs = np.zeros(number)
        self._progress = np.zeros(number)
        self._gaps = np.zeros(number)

    def begin(self, rooms: Indices, episodes: list[tuple[int, int]]) -> None:
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
            self._lidars.renew(room, episode_stream(*episode, Stream.SENSOR))

    def move(self, commands: Singles, resting: Bools) -> Moved:
        """Turn and drive the robots that are not ``resting``: one step of noisy motion."""
        n = resting.size
        rewards, collided = np.empty(n), np.empty(n, np.bool_)
        terminated, truncated = np.empty(n, np.bool_), np.empty(n, np.bool_)
        self._motion.fill()
        kernels.drive(
            self.poses, self._gaps, commands, self._motion.drawn, self._motion.at, resting,
            *self._driving, self.steps, collided,
        )  # fmt: skip
        kernels.judge(
            self.poses, self._starts, self._arcs, self._progress, self.steps, collided,
            *self._judging, rewards, terminated, truncated,
        )  # fmt: skip
        return Moved(rewards, collided, terminated, truncated)

    def look(self, rooms: Indices | None = None) -> None:
        """Take a scan in each of ``rooms``; None: in all."""
        if rooms is None:
            self._lidars.scan(self._every, self.poses)
        else:
            self._lidars.scan(rooms, self.poses[rooms])

    @property
    def scans(self) -> Singles:
        """The last ones, (n, B)."""
        return self._lidars.scans
