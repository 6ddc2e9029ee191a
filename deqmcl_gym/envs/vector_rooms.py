"""Rooms: the state of many rooms between two resets, as flat arrays."""

import numpy as np

from deqmcl_gym.envs import vector_kernels as kernels
from deqmcl_gym.maps import GridMap
from deqmcl_gym.maps.disc_kernels import NO_CELLS
from deqmcl_gym.numerics.types import Bools, Floats, Indices, Singles
from deqmcl_gym.world.sensor import LidarSensors
from deqmcl_gym.world.setting import Setting
from deqmcl_gym.world.streams import NormalTable, Stream, episode_stream


class Rooms:
    """:class:`deqmcl_gym.world.episode.Episode` for n rooms at a time."""

    def __init__(self, setting: Setting, number: int, limit: int) -> None:
        """Make ``number`` rooms, with at most ``limit`` steps; :meth:`begin` starts episodes."""
        world, course = setting.world, setting.course
        self._setting = setting
        ground = world.floor_plan
        cells = ground.cells if isinstance(ground, GridMap) else NO_CELLS
        noise, most = world.noise, len(course.actions)
        rules = kernels.Rules(
            noise=(float(noise.drive), float(noise.turn), float(noise.drift)),
            walls=kernels.sides(np.empty((0, 4)) if cells is not NO_CELLS else ground.walls),
            cells=cells,
            radius=world.body,
            skin=world.skin,
            reach=world.reach,
            edges=course.path.edges,
            length=course.path.length,
            rewards=setting.rewards,
            most=most,
            limit=limit,
        )
        self._motion = NormalTable(number, 2, most)
        self._lidars = LidarSensors(world.floor_plan, world.lidar, number, most + 1)
        gaps, arcs, progress = np.zeros((3, number))
        self._robots = kernels.Robots(
            poses=np.tile(course.start, (number, 1)),
            gaps=gaps,
            arcs=arcs,
            progress=progress,
            steps=np.zeros(number, np.intp),
        )
        self._fixed = tuple(self._robots), tuple(rules)  # as the kernel takes them
        self._every = np.arange(number)

    @staticmethod
    def bytes_each(setting: Setting) -> int:
        """Approximate memory of a room: its random numbers, its scan and the plan shown."""
        beams, steps = setting.world.lidar.beams, len(setting.course.actions)
        rows = NormalTable.rows(2, steps), NormalTable.rows(beams, steps + 1)
        numbers = 2 * rows[0] + beams * (rows[1] + 2) + 2 * setting.plan.horizon + 64
        return 8 * numbers

    @property
    def poses(self) -> Floats:
        """The true poses (x, y, θ), (n, 3)."""
        return self._robots.poses

    @property
    def steps(self) -> Indices:
        """Steps carried out, (n,)."""
        return self._robots.steps

    @property
    def progress(self) -> Floats:
        """Progress along the path since reset, (n,)."""
        return self._robots.progress

    @property
    def scans(self) -> Singles:
        """The last scans, (n, B)."""
        return self._lidars.scans

    def begin(self, rooms: Indices, episodes: list[tuple[int, int]]) -> None:
        """Begin an episode (seed, number) in each of ``rooms``; no scan is taken yet.

        Raises:
            InputError: no drawn start is free. All rooms are then unchanged.
        """
        setting = self._setting
        starts = [setting.start(setting.course, *episode) for episode in episodes]
        robots = self._robots
        robots.poses[rooms] = np.array(starts)
        robots.arcs[rooms] = np.array(
            [setting.first_arc(setting.course, (x, y)) for x, y, _ in starts]
        )
        robots.gaps[rooms] = robots.progress[rooms] = 0.0
        robots.steps[rooms] = 0
        for room, episode in zip(rooms.tolist(), episodes, strict=True):
            self._motion.renew(room, episode_stream(*episode, Stream.MOTION))
            self._lidars.renew(room, episode_stream(*episode, Stream.SENSOR))

    def move(self, commands: Singles, resting: Bools) -> tuple[Floats, Bools, Bools, Bools]:
        """Turn and drive the robots that are not ``resting``: one step of noisy motion.

        Returns:
            ``kernels.Moved``: rewards, collided, terminated, truncated.
        """
        n = resting.size
        moved = np.empty(n), np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty(n, np.bool_)
        noise = self._motion
        noise.fill()
        kernels.step(*self._fixed, commands, noise.drawn, noise.at, resting, moved)
        return moved

    def observe(self, rooms: Indices | None = None) -> None:
        """Take a scan in each of ``rooms``; None: in all."""
        if rooms is None:
            self._lidars.scan(self._every, self.poses)
        else:
            self._lidars.scan(rooms, self.poses[rooms])
