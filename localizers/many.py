"""``Localize-v0`` many at once, for training: office, robot, scan, filter and summary are compiled.

``gym.make_vec("deqmcl_gym/Localize-v0", num_envs=64, scan="table", localizer={"name": "mcl",
"particles": 1000})``. The single env is the definition: tests drive both side by side. Rooms are
shared out to threads, and their numbers do not depend on how.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import batch_space

from deqmcl_gym.envs import vector_kernels
from deqmcl_gym.envs.acting import RIGHT
from deqmcl_gym.envs.vector import ManyEpisodes, checked_mode
from deqmcl_gym.envs.vector_rooms import Grounds, NormalTable, wide
from deqmcl_gym.maps import GridMap, Offices
from deqmcl_gym.maps.clusters import choose_cell, count_cells
from deqmcl_gym.maps.drive_kernels import drive
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Bools, Floats, Indices, Singles, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import atan2_64, cos64, sin64, wrapped64
from deqmcl_gym.validation import integer
from deqmcl_gym.world import World
from deqmcl_gym.world.course import centred_heading
from deqmcl_gym.world.episode import report, scanned
from localizers.inference.particles import fill_systematic, normalize, shifted
from localizers.models.motion import noisy_moves
from localizers.models.prior import random_poses
from localizers.models.range_table import Codes, RangeTable, TableOfMap, add_from_table
from localizers.tasks import Localize

_KEPT = 256  # offices, with their tables


def localize(
    *, num_envs: int = 1, autoreset_mode: Any = AutoresetMode.NEXT_STEP, **task: Any
) -> VectorEnv[Any, Any, Any]:
    """Return many ``Localize-v0``: compiled if they can be, else Gymnasium's loop over single ones.

    Compiled are those with ``scan="table"`` and the localizer "mcl", in offices of cells, with the
    lidar in the robot's centre, that loses no readings, and without pictures.
    """
    rooms, single = integer("num_envs", num_envs, low=1), Localize(**task)
    if _is_native(single, task):
        return LocalizeVectorEnv(single, rooms, autoreset_mode)
    return SyncVectorEnv(
        [lambda: gym.make("deqmcl_gym/Localize-v0", **task)] * rooms,
        autoreset_mode=checked_mode(autoreset_mode),
    )


def _is_native(env: Localize, task: dict[str, Any]) -> bool:
    localizer = task.get("localizer", "mcl-map")
    params = {"name": localizer} if isinstance(localizer, str) else dict(localizer)
    lidar = env.lidar
    return (
        params.pop("name", None) == "mcl"
        and not params.keys() - {"particles"}
        and task.get("scan") == "table"
        and isinstance(env.floor_plan, GridMap)
        and lidar.places == ((0.0, 0.0),)
        and not lidar.loses
        and env.render_mode is None
    )


class LocalizeVectorEnv(ManyEpisodes):
    """n rooms of a ``Localize`` env, each with its own seed, building, robot and filter."""

    def __init__(self, single: Localize, num_envs: int, autoreset_mode: Any) -> None:
        """Make ``num_envs`` rooms like a single one."""
        super().__init__(n := num_envs, autoreset_mode)
        self._single = single
        self.single_observation_space = single.observation_space
        self.single_action_space = single.action_space
        self.observation_space = batch_space(single.observation_space, n)
        self.action_space = batch_space(single.action_space, n)
        self._spaces: Any = self.observation_space
        self.world, self.lidar, self.max_steps = single.world, single.lidar, single.max_steps
        localizer: Any = single._localizer
        self._count = count = int(localizer.filter.particles)
        robot = localizer.robot
        self._source, (_, self._table) = robot.scan, _place(self.world, None, None, robot.scan)
        self._noise = tuple(vars(robot.motion)[name] for name in ("drive", "turn", "drift"))
        # of the robots
        self._grounds = Grounds(self.world, n, own=True)
        gaps, arcs, progress = np.zeros((3, n))
        robots = np.zeros((n, 3)), gaps, arcs, progress, np.zeros(n, np.intp)
        self._robots = vector_kernels.Robots(*robots)
        self._moves = NormalTable(n, 2, self.max_steps)
        self._readings = NormalTable(n, self.lidar.beams, self.max_steps + 1)
        courses = vector_kernels.Courses(  # none: of step_rooms only the motion counts
            np.zeros((n, 1, 6)), np.ones(n, np.intp), np.full(n, np.inf), np.zeros((n, 2)),
            np.full(n, np.iinfo(np.intp).max),
        )  # fmt: skip
        self._courses = tuple(courses)
        self._rules = self.world.noise.sds, (np.inf, 0.0, 0.0, -1.0), np.iinfo(np.intp).max
        self.scans = np.zeros((n, self.lidar.beams), np.float32)
        # of the filters
        self.particles = np.zeros((n, 3, count), np.float32)
        self._log_weights, self.weights = np.zeros((2, n, count))
        self._uniforms = np.zeros((n, count + 1))
        self._tables, self._shapes = np.zeros((n, 0), np.uint8), np.zeros((n, 2), np.intp)
        self._frames = np.zeros((n, 3))
        self._means, self._best, self._second = np.zeros((3, n, 3))
        self._covariances, self._shares = np.zeros((n, 3, 3)), np.zeros((n, 2))
        # of the episodes
        self.buildings, self.steps = np.zeros(n, np.int64), np.zeros(n, np.int64)
        self._confident, self._right = np.zeros((2, n), np.int64)
        # random generators: each room's, its filter's, and that of the particles it shows
        self._streams: list[np.random.Generator | None] = [None] * n
        self._of_filters: list[Any] = [None] * n
        self._of_views: list[Any] = [None] * n
        affinity = getattr(os, "sched_getaffinity", None)  # not everywhere
        self._threads = min(n, len(affinity(0)) if affinity else os.cpu_count() or 1)
        self._pool: ThreadPoolExecutor | None = None

    def step(self, actions: Singles) -> tuple[Any, Floats, Bools, Bools, dict[str, Any]]:
        """Declare, or move and update in each room; begin the next episode where one ended."""
        again, resting = self._due(), self._ended
        values = self._single._commands.checked_each(actions, resting)
        declared = (values[:, 2] >= 0.5) & ~resting
        commands = values[:, :2].copy()
        commands[resting | declared] = 0.0
        collided = self._moved(commands, resting | declared)
        self.steps[~resting] += 1
        success = declared & (self._right >= self._single.hold)
        truncated = ~declared & (self.steps >= self.max_steps) & ~resting
        rewards = -1.0 - collided - 2.0 * self.max_steps * (declared & ~success)
        rewards[resting] = 0.0
        self._ended = declared | truncated
        if again.size:
            self._begin(again)
        info = self._info_of_step(commands, collided, success)
        return self._seen(), rewards, declared, truncated, info

    def close_extras(self, **_: Any) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def __getstate__(self) -> dict[str, Any]:
        """Threads are begun anew."""
        return vars(self) | {"_pool": None}

    def _draw(self, rooms: Indices, seeds: Sequence[int | None] | None) -> None:
        for room in rooms.tolist():
            seed, rng = seeds[room] if seeds else None, self._streams[room]
            if seed is not None or rng is None:
                rng = self._streams[room] = gym.utils.seeding.np_random(seed)[0]
            start, motion, sensor, filtering, self._of_views[room] = rng.spawn(5)
            sites, building = self._single._sites, None
            if sites is not None:
                building = self.buildings[room] = sites.offices.drawn(rng.spawn(1)[0])
            world, scan = _place(self.world, sites and sites.offices, building, self._source)
            radius = world.body + world.skin
            x, y, heading = random_poses(world.floor_plan, 1, start, radius)[:, 0].tolist()
            pose = self._robots.poses[room] = x, y, centred_heading(heading)
            self._grounds.put(room, world)
            self._robots.gaps[room] = 0.0
            self.scans[room] = scanned(pose, world.floor_plan.cast, self.lidar, sensor)
            self._moves.renew(room, motion)
            self._readings.renew(room, sensor)
            stream = filtering.spawn(1)[0]
            self.particles[room] = random_poses(world.floor_plan, self._count, stream, radius)
            self._log_weights[room], self._of_filters[room] = 0.0, filtering
            size = scan.table.size
            self._tables = wide(self._tables, size)
            self._tables[room, :size] = scan.table
            self._shapes[room], self._frames[room] = scan.shape, scan.frame
        self.steps[rooms] = self._confident[rooms] = self._right[rooms] = 0
        self._summarize(rooms)

    def _moved(self, commands: Singles, still: Bools) -> Bools:
        """Move the robots that are not ``still``, take their scans, and update their filters."""
        n = self.num_envs
        moved = np.empty(n), *np.empty((3, n), np.bool_)
        self._moves.fill()
        vector_kernels.step_rooms(
            tuple(self._robots), self._grounds.kernel, self._courses, self._rules, commands,
            self._moves.drawn, self._moves.at, still, moved,
        )  # fmt: skip
        rooms = np.flatnonzero(~still)
        exact = np.empty((self.lidar.beams, rooms.size), np.float32)
        local = self._robots.poses[rooms].T.astype(np.float32, order="C")
        self.lidar.cast(self._grounds.caster(rooms), local, exact)
        self._readings.fill()
        noise = self._readings
        limits = self.lidar.sigma, self.lidar.max_range
        report(rooms, exact, noise.drawn, noise.at, *limits, self.scans)
        for room in rooms.tolist():
            self._of_filters[room].random(out=self._uniforms[room])
        self._each(
            rooms, filter_rooms, self.particles, self._log_weights, self._uniforms,
            commands.astype(np.float64), self._table.codes(self.scans), self.lidar.bearings,
            self._noise, self._table.logs, self._tables, self._shapes, self._frames,
        )  # fmt: skip
        self._summarize(rooms)
        return np.asarray(moved[1])

    def _summarize(self, rooms: Indices) -> None:
        """Take note of new beliefs."""
        size = metre(self._single.floor_plan.unit)
        self._each(
            rooms, summarize_rooms, self.particles, self._log_weights, self.weights, size,
            self._means, self._covariances, self._best, self._second, self._shares,
        )  # fmt: skip
        sure = self._shares[rooms, 0] > self._single.share
        off = self._best[rooms] - self._robots.poses[rooms]
        distance = np.hypot(off[:, 0], off[:, 1]) / size
        near = RIGHT.holds(distance, np.abs(arrays.wrapped(off[:, 2])))
        self._confident[rooms] = np.where(sure, self._confident[rooms] + 1, 0)
        self._right[rooms] = np.where(sure & near, self._right[rooms] + 1, 0)

    def _each(self, rooms: Indices, kernel: Any, *arguments: Any) -> None:
        """Run a kernel on rooms, shared out to the threads."""
        self._pool = self._pool or ThreadPoolExecutor(self._threads)
        parts = np.array_split(rooms, self._threads)
        list(self._pool.map(lambda part: kernel(part, *arguments), parts))

    def _seen(self) -> dict[str, Any]:
        view = self._single._view
        seen = {
            "scan": self.scans.copy(),
            "clock": (self.steps / self.max_steps)[:, None],
            "confident": np.minimum(1.0, self._confident / self._single.hold)[:, None],
            **view.moments(self._means, self._covariances),
            "best": self._best,
            "best_share": np.minimum(self._shares[:, :1], 1.0),
            "second": self._second,
            "second_share": np.minimum(self._shares[:, 1:], 1.0),
        }
        rooms = zip(self.particles, self.weights, self._of_views, strict=True)
        clouds = [view.cloud(states.T, weights, rng) for states, weights, rng in rooms]
        seen |= {name: np.stack([cloud[name] for cloud in clouds]) for name in clouds[0]}
        return {
            name: np.clip(np.array(values, np.float32), space.low, space.high)
            for name, values in seen.items()
            for space in [self._spaces[name]]
        }

    def _state_info(self) -> dict[str, Any]:
        info: dict[str, Any] = {"truth": self._robots.poses.copy()}
        if self._single._sites is not None:
            info["building"] = self.buildings.copy()
        return info


@lru_cache(_KEPT)
def _place(
    world: World, offices: Offices | None, building: int | None, scan: RangeTable
) -> tuple[World, TableOfMap]:
    """Return the world of a building, and the model of scans there."""
    if offices is not None and building is not None:
        world = replace(world, floor_plan=offices.map(building))
    return world, scan.made(world.floor_plan, world.lidar)


@compiled
def filter_rooms(
    rooms: Indices,
    particles: Singles,
    log_weights: Floats,
    uniforms: Floats,
    commands: Floats,
    readings: Codes,
    bearings: Floats,
    noise: tuple[float, float, float],
    logs: Floats,
    tables: Codes,
    shapes: Indices,
    frames: Floats,
) -> None:
    """Do in each of ``rooms`` what ``ParticleFilter.step`` does with a ``RangeTable``."""
    n = particles.shape[2]
    weights, likelihood, total = np.empty(n), np.empty(n), np.empty(n)
    ancestors = np.empty(n, np.intp)
    resampled, moves = np.empty((2, 3, n), np.float32)
    action = np.zeros(3)
    for room in rooms:
        normalize(log_weights[room], weights)
        fill_systematic(weights, uniforms[room, 0], ancestors)
        for axis in range(3):
            for i in range(n):
                resampled[axis, i] = particles[room, axis, ancestors[i]]
        action[0], action[2] = commands[room]
        noisy_moves(uniforms[room, 1:], action, noise[0], noise[1], noise[2], moves)
        drive(resampled, moves, particles[room])
        log_weights[room] = 0.0
        rows, columns = shapes[room]
        shape = rows, columns
        frame = frames[room, 0], frames[room, 1], frames[room, 2]
        likelihood[:] = 0.0
        add_from_table(
            particles[room], readings[room], bearings, logs, tables[room], shape, frame, likelihood
        )
        if np.isfinite(shifted(log_weights[room], likelihood, total)):
            log_weights[room] = total


@compiled
def summarize_rooms(
    rooms: Indices,
    particles: Singles,
    log_weights: Floats,
    weights: Floats,
    size: float,
    means: Floats,
    covariances: Floats,
    best: Floats,
    second: Floats,
    shares: Floats,
) -> None:
    """Fill in weights (n, N), means, covariances and the two best clusters of ``rooms``.

    ``shares`` (n, 2) are those of the clusters, ``size`` the edge of their cells.
    """
    n = particles.shape[2]
    sine, cosine = np.empty(n), np.empty(n)
    places, sector, cell = np.empty((2, n)), np.empty(n, np.intp), np.empty(n, np.intp)
    near, off = np.empty(n, np.bool_), np.empty(3)
    for room in rooms:
        states, room_weights, mean = particles[room], weights[room], means[room]
        normalize(log_weights[room], room_weights)
        for i in range(n):
            heading = np.float64(states[2, i])
            sine[i], cosine[i] = sin64(heading), cos64(heading)
        _average(states, sine, cosine, room_weights, mean)
        spread = covariances[room]
        spread[:] = 0.0
        for i in range(n):
            off[0], off[1] = states[0, i] - mean[0], states[1, i] - mean[1]
            off[2] = wrapped64(states[2, i] - mean[2])
            for j in range(3):
                for k in range(3):
                    spread[j, k] += room_weights[i] * (off[j] * off[k])
        left = room_weights.copy()
        count_cells(states, size, np.inf, places, sector, cell)
        choose_cell(places, sector, cell, left, near)
        shares[room, 0] = _average(states, sine, cosine, left * near, best[room])
        second[room] = best[room]
        left[near] = 0.0
        choose_cell(places, sector, cell, left, near)
        shares[room, 1] = _average(states, sine, cosine, left * near, second[room])


@compiled
def _average(states: Singles, sine: Floats, cosine: Floats, weights: Floats, mean: Floats) -> float:
    """Fill in the mean pose, unless all weights are 0; return their sum."""
    x, y, s, c, total = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(weights.size):
        total += weights[i]
        x, y = x + weights[i] * states[0, i], y + weights[i] * states[1, i]
        s, c = s + weights[i] * sine[i], c + weights[i] * cosine[i]
    if total > 0.0:
        mean[0], mean[1], mean[2] = x / total, y / total, atan2_64(s, c)
    return total
