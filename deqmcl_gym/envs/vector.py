"""RoomVectorEnv: the Gymnasium vector environment; the state of many rooms as flat arrays."""

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, iterate
from numpy.typing import NDArray

from deqmcl_gym.envs import vector_kernels as kernels
from deqmcl_gym.maps import GridMap, Map
from deqmcl_gym.maps.grid_kernels import NO_CELLS
from deqmcl_gym.numerics.types import Bools, Floats, Indices, Singles
from deqmcl_gym.registration import MAX_EPISODE_STEPS
from deqmcl_gym.validation import InputError, integer, one_of, shown
from deqmcl_gym.world.config import World
from deqmcl_gym.world.driver import FixedPlan
from deqmcl_gym.world.reality import Reality
from deqmcl_gym.world.rules import RoomInfo, RoomRules
from deqmcl_gym.world.sensor import LidarSensors, NormalTable, Stream, episode_stream

if TYPE_CHECKING:  # OpenCV is only loaded for pictures
    from deqmcl_gym.world.drawing import Drawing


class Rooms:
    """:class:`deqmcl_gym.world.episode.Episode` for n rooms at a time.

    Attributes:
        poses: the true ones (x, y, θ), (n, 3).
        steps: number carried out, (n,).
        progress: along the path since reset, (n,).
        scans: the last ones, (n, B).
    """

    def __init__(self, rules: RoomRules, number: int, limit: int) -> None:
        """Make ``number`` rooms, with at most ``limit`` steps; :meth:`begin` starts episodes."""
        world, course = rules.world, rules.course
        self._rules = rules
        most = len(course.actions)
        walls, cells = _obstacles(world.floor_plan)
        numbers = kernels.Rules(
            noise=rules.noise, walls=walls, cells=cells,
            radius=world.body, skin=world.skin, reach=world.reach,
            edges=course.path.edges, length=course.path.length, rewards=rules.rewards, most=most,
            limit=limit,
        )  # fmt: skip
        self._motion = NormalTable(number, 2, most)
        self._lidars = LidarSensors(world.floor_plan, world.lidar, number, most + 1)
        poses, steps = np.tile(course.start, (number, 1)), np.zeros(number, np.intp)
        gaps, arcs, progress = np.zeros((3, number))
        self._robots = kernels.Robots(poses, gaps, arcs, progress, steps)
        self.poses, self.steps, self.progress = poses, steps, progress
        self.scans = self._lidars.scans
        self._numbers = numbers
        self._fixed = tuple(self._robots), tuple(numbers)  # as the kernel takes them
        # in a world that differs from its map, each room's own, as the kernel takes them
        self._own: dict[int, tuple[tuple[Any, ...], tuple[Any, ...]]] = {}
        self.realities: dict[int, Reality] = {}
        self._every = np.arange(number)

    @staticmethod
    def bytes_each(rules: RoomRules) -> int:
        """Approximate memory of a room: its random numbers, its scan and the plan shown."""
        beams, steps = rules.world.lidar.beams, len(rules.course.actions)
        rows = NormalTable.rows(2, steps), NormalTable.rows(beams, steps + 1)
        numbers = 2 * rows[0] + beams * (rows[1] + 2) + 2 * rules.plan.horizon + 64
        ground = rules.world.floor_plan
        if isinstance(ground, GridMap) and _differs(rules.world):  # each room has cells of its own
            numbers += ground.occupancy.size
        return 8 * numbers

    def begin(self, rooms: Indices, episodes: list[tuple[int, int]]) -> None:
        """Begin an episode (seed, number) in each of ``rooms``; no scan is taken yet.

        Raises:
            InputError: no drawn start is free. All rooms are then unchanged.
        """
        rules = self._rules
        if _differs(rules.world):
            drawn = [
                Reality.drawn(
                    rules.world, rules.course, rules.plan, partial(episode_stream, *episode)
                )
                for episode in episodes
            ]
            there = [replace(rules, world=real.world) for real in drawn]
        else:
            drawn, there = [], [rules] * len(episodes)
        starts = [
            own.start(rules.course, *episode) for own, episode in zip(there, episodes, strict=True)
        ]
        arcs = [rules.first_arc(rules.course, (x, y)) for x, y, _ in starts]
        self.poses[rooms], self._robots.arcs[rooms] = np.array(starts), np.array(arcs)
        self._robots.gaps[rooms] = self.progress[rooms] = 0.0
        self.steps[rooms] = 0
        for room, episode in zip(rooms.tolist(), episodes, strict=True):
            self._motion.renew(room, episode_stream(*episode, Stream.MOTION))
            self._lidars.renew(room, episode_stream(*episode, Stream.SENSOR))
        for room, real in zip(rooms.tolist(), drawn, strict=False):
            self._become_real(room, real)

    def _become_real(self, room: int, real: Reality) -> None:
        """Let a room have walls of its own."""
        ground, one = real.world.floor_plan, slice(room, room + 1)
        self.realities[room] = real
        self._lidars.own[room] = ground.local.caster
        walls, cells = _obstacles(ground)
        robots = tuple(values[one] for values in self._robots)
        self._own[room] = robots, tuple(self._numbers._replace(walls=walls, cells=cells))

    def move(self, commands: Singles, resting: Bools) -> tuple[Floats, Bools, Bools, Bools]:
        """Turn and drive the robots that are not ``resting``: one step of noisy motion.

        Returns:
            ``kernels.Moved``: rewards, collided, terminated, truncated.
        """
        n = resting.size
        moved = np.empty(n), np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty(n, np.bool_)
        noise = self._motion
        noise.fill()
        if not self._own:
            kernels.step(*self._fixed, commands, noise.drawn, noise.at, resting, moved)
        for room, own in self._own.items():
            one = slice(room, room + 1)
            said = tuple(values[one] for values in moved)
            drawn, at = noise.drawn[one], noise.at[one]
            kernels.step(*own, commands[one], drawn, at, resting[one], said)
        return moved

    def picture(self, room: int) -> "Drawing":
        """Draw what is in a room, without its robot."""
        from deqmcl_gym.world.drawing import Drawing

        view, real = self._rules.view, self.realities.get(room)
        return Drawing(view) if real is None else real.picture(view, None)

    def observe(self, rooms: Indices | None = None) -> None:
        """Take a scan in each of ``rooms``; None: in all."""
        if rooms is None:
            self._lidars.scan(self._every, self.poses)
        else:
            self._lidars.scan(rooms, self.poses[rooms])


def _differs(world: World) -> bool:
    """Whether each room has walls of its own."""
    return world.clutter is not None or world.changed_walls is not None


def _obstacles(ground: Map) -> tuple[Floats, tuple[Any, ...]]:
    """Return the walls and the cells of a map, as ``kernels.Rules`` has them: one is empty."""
    if isinstance(ground, GridMap):
        return kernels.sides(np.empty((0, 4))), ground.cells
    return kernels.sides(ground.walls), NO_CELLS


Actions = Singles
Info = dict[str, Any]
StepResult = tuple[Any, NDArray[Any], NDArray[Any], NDArray[Any], Info]

_MASKS = tuple(f"_{key}" for key in sorted(RoomInfo.__required_keys__))
_MODES = {mode.value: mode for mode in AutoresetMode}
MAX_BYTES = 16 * 2**30  # of all rooms


class RoomVectorEnv(VectorEnv[Any, Actions, NDArray[Any]]):
    """n rooms of :class:`deqmcl_gym.envs.room.RoomEnv`, each with its own seed and episodes.

    docs/environment.md describes what differs from one room.

    Attributes:
        floor_plan: the map m, for localizers too.
        lidar: the sensor's geometry and noise, for localizers too.
        world: all parts of the world, as configured.
        course: the lap as planned: path, start and actions.
    """

    def __init__(
        self,
        *,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **room: Any,
    ) -> None:
        """Make ``num_envs`` equal rooms.

        Args:
            num_envs: n.
            max_episode_steps: number of steps after which episodes are truncated; None is 408, the
                registered limit, and -1 is no limit, as in ``gym.make``.
            autoreset_mode: "NextStep", "SameStep" or "Disabled", or Gymnasium's own constant.
            render_mode: None or "rgb_array".
            room: further arguments of :class:`deqmcl_gym.envs.room.RoomEnv`.
        """
        self._limit = _limit(max_episode_steps)
        self._mode = _MODES[
            one_of("autoreset_mode", getattr(autoreset_mode, "value", autoreset_mode), _MODES)
        ]
        self._rules = rules = RoomRules.of(**room)
        self._plan = _same_for_all(rules)
        self.num_envs = _number(num_envs, rules)
        self.world, self.course = rules.world, rules.course
        self.floor_plan, self.lidar = self.world.floor_plan, self.world.lidar
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": 30,
            "autoreset_mode": self._mode,
        }
        if render_mode is not None:
            one_of("render_mode", render_mode, self.metadata["render_modes"])
            _ = rules.view  # refuses a room too large for a picture
        self.render_mode = render_mode
        self.single_observation_space = rules.observation_space
        self.single_action_space = rules.commands.space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._rooms = Rooms(rules, self.num_envs, self._limit)
        # seed and number since the seed of each room's episode
        self._episodes: list[tuple[int, int] | None] = [None] * self.num_envs
        self._all_begun = False
        self._all = np.ones(self.num_envs, np.bool_)
        self._ended = np.zeros(self.num_envs, np.bool_)

    @property
    def plan(self) -> Actions:
        """The actions planned for each episode, done and to come, (T, 2) float32."""
        return self._plan.actions.copy()

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """The seed of each room, None before its first reset."""
        return tuple(None if episode is None else episode[0] for episode in self._episodes)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, Info]:
        """Begin an episode in all rooms, or in those of ``options["reset_mask"]``.

        Args:
            seed: s gives room i the seed s + i; a list gives each its own; a room without one
                begins the next episode in the order of its last seed.
            options: ``reset_mask``: (n,) bool.

        Raises:
            InputError: a seed or option is bad, or no start is free. All episodes then continue.
        """
        chosen = self._chosen(options)
        rooms = np.flatnonzero(chosen)
        self._begin(rooms, self._checked_seeds(seed))
        self._rooms.observe(rooms)
        nothing = np.zeros((self.num_envs, 2), np.float32)
        return self._seen(), self._info(chosen, nothing, np.zeros_like(chosen))

    def step(self, actions: Actions) -> StepResult:
        """Turn, then drive in each room; where an episode ended, begin the next one.

        Raises:
            InputError: actions are bad. No room has then taken its step.
        """
        self._check_begun("step")
        resting = self._ended  # all False with SAME_STEP
        again = resting.nonzero()[0]
        if again.size and self._mode is AutoresetMode.DISABLED:
            raise RuntimeError(
                f"the episode in room {again[0]} has ended: call reset() with its "
                "reset_mask before step()."
            )
        commands = self._rules.commands.checked_each(actions, resting)
        if again.size:
            self._begin(again)
            commands[again] = 0.0
        rewards, collided, terminated, truncated = self._rooms.move(commands, resting)
        self._rooms.observe()
        self._ended = terminated | truncated
        final: Info = {}
        if self._mode is AutoresetMode.SAME_STEP and np.count_nonzero(self._ended):
            final = self._begun_again(commands, collided)
        info = self._info(self._all, commands, collided)
        return self._seen(), rewards, terminated, truncated, final | info

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return each room as it is, (h, w, 3) RGB, or None without a render mode."""
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make_vec(..., render_mode="rgb_array").')
            return None
        self._check_begun("render")
        rooms = self._rooms
        seen = zip(rooms.poses.tolist(), rooms.scans, rooms.steps.tolist(), strict=True)
        return tuple(
            self._rules.picture(rooms.picture(room), self.course, *told)
            for room, told in enumerate(seen)
        )

    def _begin(self, rooms: Indices, seeds: Sequence[int | None] | None = None) -> None:
        """Begin an episode in each of ``rooms``, with ``seeds`` (n,) or as the room's next one."""
        numbers = rooms.tolist()
        episodes = [self._next_episode(room, seeds[room] if seeds else None) for room in numbers]
        self._rooms.begin(rooms, episodes)
        for room, episode in zip(numbers, episodes, strict=True):
            self._episodes[room] = episode
        self._all_begun = self._all_begun or None not in self._episodes
        self._ended = self._ended.copy()  # step() still uses the old array
        self._ended[rooms] = False

    def _next_episode(self, room: int, seed: int | None) -> tuple[int, int]:
        """Seed and number of a room's next episode."""
        last = self._episodes[room]
        if seed is not None:
            return seed, 0
        if last is not None:
            return last[0], last[1] + 1
        return secrets.randbits(128), 0

    def _begun_again(self, commands: Actions, collided: Bools) -> Info:
        """Begin the next episode where one has ended; return its last observation and info."""
        ended = self._ended.copy()
        rooms = np.flatnonzero(ended)
        last = np.full(self.num_envs, None, dtype=object)
        for room, seen in enumerate(iterate(self.observation_space, self._seen())):
            if ended[room]:
                last[room] = seen
        said = self._info(ended, commands.copy(), collided.copy())
        final: Info = {"final_obs": last, "final_info": said}
        self._begin(rooms)
        self._rooms.observe(rooms)
        commands[ended], collided[ended] = 0.0, False
        return final | {f"_{key}": ended.copy() for key in final}

    def _seen(self) -> Any:
        """Return the observations of all rooms, as fresh arrays."""
        rooms, plan = self._rooms, self._plan
        if self._rules.observation == "scan":
            return rooms.scans.copy()
        planned, _ = plan.after_each(rooms.steps)
        covered = rooms.progress / self._rules.course.path.length
        return self._rules.seen(rooms.scans, planned, covered, rooms.steps / plan.limit)

    def _info(self, among: Bools, commands: Actions, collided: Bools) -> Info:
        """Return ``RoomInfo`` as arrays over the rooms, zero and masked out if not ``among``.

        ``commands`` and ``collided`` become part of it and must not be used elsewhere.
        """
        planned, count = self._plan.after_each(self._rooms.steps)
        told: Info = {
            "planned_actions": planned,
            "planned_count": count,
            "action": commands,
            "collided": collided,
            "truth": self._rooms.poses.copy(),
        }
        if among is not self._all:
            for values in told.values():
                values[~among] = 0
        told.update({mask: among.copy() for mask in _MASKS})
        return told

    def _chosen(self, options: object) -> Bools:
        if options is not None and not isinstance(options, Mapping):
            raise InputError(f"options is {options!r}, but must be None or hold a reset_mask.")
        for key in options or ():
            one_of("reset option", key, ("reset_mask",))
        mask = options.get("reset_mask") if options else None
        if mask is None:
            return np.ones(self.num_envs, np.bool_)
        chosen = np.asarray(mask)
        if chosen.dtype != np.bool_ or chosen.shape != (self.num_envs,) or not chosen.any():
            raise InputError(
                f"reset_mask is {mask!r}, but must be {self.num_envs} Boolean values, at least one "
                "of them True."
            )
        return chosen.copy()

    def _checked_seeds(self, seed: object) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if not isinstance(seed, Sequence | np.ndarray) or isinstance(seed, str):
            first = integer("seed", seed)
            return list(range(first, first + self.num_envs))
        if len(seed) != self.num_envs:
            raise InputError(
                f"seed has {len(seed)} numbers, but there are {self.num_envs} rooms: give one "
                "seed for each, or a single number."
            )
        return [None if one is None else integer("seed", one) for one in seed]

    def _check_begun(self, wish: str) -> None:
        if not self._all_begun:
            raise RuntimeError(
                f"the episode in room {self._episodes.index(None)} has not begun: call reset() "
                f"before {wish}()."
            )


def _limit(steps: int | None) -> int:
    never: int = np.iinfo(np.intp).max
    if steps == -1:
        return never
    given = MAX_EPISODE_STEPS if steps is None else steps
    return min(integer("max_episode_steps", given, low=1), never)


def _number(rooms: int, rules: RoomRules) -> int:
    given, each = integer("num_envs", rooms, low=1), Rooms.bytes_each(rules)
    if given > (most := MAX_BYTES // each):
        raise InputError(
            f"num_envs is {shown(given)}, but a room takes {each:,} bytes, and all may take "
            f"{MAX_BYTES // 2**30} GiB: allowed values: 1 to {most:,}."
        )
    return given


def _same_for_all(rules: RoomRules) -> FixedPlan:
    world, others = rules.world, ""
    if rules.journeys is not None:
        part, others = "a route have plans", ", horizon=50"
    elif not isinstance(rules.plan, FixedPlan):
        part = "a driver have plans"
    elif world.people is not None:
        part = "people have crowds"
    elif world.glass is not None:
        part = "glass have walls of glass"
    else:
        return rules.plan
    raise InputError(
        f"the rooms of a world with {part} of their own, so they run one by one: "
        f'give gym.make_vec(..., vectorization_mode="sync"{others}).'
    )
