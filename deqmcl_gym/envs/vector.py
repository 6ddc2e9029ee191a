"""RoomVectorEnv: the Gymnasium vector environment; the state of many rooms as flat arrays."""

import secrets
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, iterate
from numpy.typing import NDArray

from deqmcl_gym import MAX_EPISODE_STEPS
from deqmcl_gym.envs.vector_rooms import Rooms
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics import Bools, Indices, RoomActions
from deqmcl_gym.validation import InputError, NoEpisodeError, integer, one_of, shown
from deqmcl_gym.world.course import Course
from deqmcl_gym.world.rules import RoomRules, check_options

Info = dict[str, Any]

_MODES = {mode.value: mode for mode in AutoresetMode}
MOST_ROOM_BYTES = 16 * 2**30  # of all rooms


class ManyEpisodes(VectorEnv[Any, RoomActions, NDArray[Any]]):
    """What n rooms with episodes of their own share: resets by mask or automatic, and ``info``."""

    def __init__(self, rooms: int, autoreset_mode: str | AutoresetMode) -> None:
        self.num_envs, self._mode = rooms, checked_mode(autoreset_mode)
        self.metadata = {"autoreset_mode": self._mode}
        self._begun, self._ended = np.zeros((2, rooms), np.bool_)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, Info]:
        """Begin an episode in all rooms, or in those of ``options["reset_mask"]``, (n,) bool.

        The seed s gives room i the seed s + i; a list gives each its own; a room without one begins
        the next episode in the order of its last seed. If one is refused, or no start is free, all
        episodes continue.
        """
        chosen = _chosen_rooms(options, self.num_envs)
        rooms = np.flatnonzero(chosen)
        self._begin(rooms, _checked_seeds(seed, self.num_envs))
        none = np.zeros_like(chosen)
        nothing = np.zeros((self.num_envs, 2), np.float32)
        return self._seen(), self._info(chosen, nothing, none, none)

    def _begin(self, rooms: Indices, seeds: Sequence[int | None] | None = None) -> None:
        """Begin an episode in each of ``rooms``, with ``seeds`` (n,) or as the room's next one."""
        self._draw(rooms, seeds)
        self._begun[rooms] = True
        self._ended = self._ended.copy()  # step() still uses the old array
        self._ended[rooms] = False

    def _draw(self, rooms: Indices, seeds: Sequence[int | None] | None) -> None:
        """Draw what begins an episode in each of ``rooms``, and take its first scan."""
        raise NotImplementedError

    def _seen(self) -> Any:
        """Return the observations of all rooms, as fresh arrays."""
        raise NotImplementedError

    def _state_info(self) -> Info:
        """Return what ``info`` has of the rooms as they are, fresh arrays (n, …)."""
        raise NotImplementedError

    def _due(self) -> Indices:
        """Return the rooms that a step begins anew; refuse one that a user must reset first."""
        self._check_begun("step")
        again = self._ended.nonzero()[0]  # none with SAME_STEP
        if again.size and self._mode is AutoresetMode.DISABLED:
            raise RuntimeError(
                f"the episode in room {again[0]} has ended: call reset() with its "
                "reset_mask before step()."
            )
        return again

    def _info_of_step(self, commands: RoomActions, collided: Bools, success: Bools) -> Info:
        """Return ``info`` of a step; with SAME_STEP begin the next episode where one has ended."""
        final: Info = {}
        if self._mode is AutoresetMode.SAME_STEP and np.count_nonzero(self._ended):
            ended, last = self._ended, np.full(self.num_envs, None, dtype=object)
            for room, seen in enumerate(iterate(self.observation_space, self._seen())):
                if ended[room]:
                    last[room] = seen
            info = self._info(ended, commands.copy(), collided, success)
            final = {"final_obs": last, "final_info": info}
            final |= {f"_{key}": ended.copy() for key in final}
            self._begin(np.flatnonzero(ended))
            commands[ended], collided[ended], success[ended] = 0.0, False, False
        return final | self._info(np.ones_like(collided), commands, collided, success)

    def _info(self, among: Bools, commands: RoomActions, collided: Bools, success: Bools) -> Info:
        """Return ``RoomInfo`` as arrays over the rooms, zero if not ``among``."""
        info = self._state_info() | {
            "command": commands,
            "collided": collided.astype(np.float64),
            "is_success": success.astype(np.float64),
        }
        if not among.all():
            for values in info.values():
                values[~among] = 0
        info.update({f"_{key}": among.copy() for key in info})
        return info

    def _check_begun(self, wish: str) -> None:
        if not self._begun.all():
            raise NoEpisodeError(
                f"the episode in room {self._begun.argmin()} has not begun: call reset() before "
                f"{wish}()."
            )


class RoomVectorEnv(ManyEpisodes):
    """n rooms of :class:`deqmcl_gym.envs.RoomEnv`, each with its own seed and episodes.

    docs/environment.md describes what differs from one room. Where episodes draw offices,
    ``floor_plan`` is that of the first seed: see :attr:`floor_plans`.
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
        """Make ``num_envs`` equal rooms, with ``render_mode`` None or "rgb_array".

        Args:
            max_episode_steps: number of steps after which episodes are truncated; None is 408, the
                registered limit, and -1 is no limit, as in ``gym.make``.
            autoreset_mode: "NextStep", "SameStep" or "Disabled", or Gymnasium's own constant.
            room: further arguments of :class:`deqmcl_gym.envs.RoomEnv`.
        """
        self._limit = _limit(max_episode_steps)
        self._rules = rules = RoomRules.of(**room)
        _check_together(rules)
        super().__init__(_number(num_envs, rules), autoreset_mode)
        self.world = rules.world
        self.floor_plan, self.lidar = self.world.floor_plan, self.world.lidar
        self.metadata |= {"render_modes": ["rgb_array"], "render_fps": 30}
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

    @property
    def floor_plans(self) -> tuple[Map, ...]:
        """The map of each room in its episode."""
        begun, rooms = self._rooms.begun, range(self.num_envs)
        return tuple(begun[i].mapped if i in begun else self.floor_plan for i in rooms)

    @property
    def courses(self) -> tuple[Course, ...]:
        """The course of each room in its episode; NoEpisodeError before all have begun one."""
        self._check_begun("courses")
        return tuple(self._rooms.begun[room].course for room in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """The seed of each room, None before its first reset."""
        return tuple(None if episode is None else episode[0] for episode in self._episodes)

    def step(
        self, actions: RoomActions
    ) -> tuple[Any, NDArray[Any], NDArray[Any], NDArray[Any], Info]:
        """Turn, then drive in each room; where an episode ended, begin the next one.

        If actions are refused, no room has taken its step.
        """
        again, resting = self._due(), self._ended
        commands = self._rules.commands.checked_each(actions, resting)
        if again.size:
            self._begin(again)
            commands[again] = 0.0
        rewards, collided, terminated, truncated = self._rooms.move(commands, resting)
        self._rooms.observe(np.flatnonzero(~resting))
        self._ended = terminated | truncated
        info = self._info_of_step(commands, collided, terminated.copy())
        return self._seen(), rewards, terminated, truncated, info

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return each room as it is, (h, w, 3) RGB, or None without a render mode."""
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make_vec(..., render_mode="rgb_array").')
            return None
        self._check_begun("render")
        rooms, drawn, view = self._rooms, self._rules.picture, self._rules.view
        states = zip(self.courses, rooms.poses.tolist(), rooms.scans, rooms.steps, strict=True)
        return tuple(
            drawn(rooms.begun[room].picture(view, None), course, (x, y, heading), scan, int(step))
            for room, (course, (x, y, heading), scan, step) in enumerate(states)
        )

    def _draw(self, rooms: Indices, seeds: Sequence[int | None] | None) -> None:
        numbers = rooms.tolist()
        episodes = [self._next_episode(room, seeds[room] if seeds else None) for room in numbers]
        self._rooms.begin(rooms, episodes)
        for room, episode in zip(numbers, episodes, strict=True):
            self._episodes[room] = episode
        self._rooms.observe(rooms)

    def _next_episode(self, room: int, seed: int | None) -> tuple[int, int]:
        """Seed and number of a room's next episode."""
        last = self._episodes[room]
        if seed is not None:
            return seed, 0
        if last is not None:
            return last[0], last[1] + 1
        return secrets.randbits(128), 0

    def _seen(self) -> Any:
        rooms, rules = self._rooms, self._rules
        if rules.observation == "scan":
            return rooms.scans.copy()
        courses = rooms.courses
        goals = None if rules.journeys is None else courses.goals
        shares = rooms.progress / rooms.lengths, rooms.steps / courses.limits
        return rules.seen(rooms.scans, rooms.plans()[0], *shares, goals, rooms.poses)

    def _state_info(self) -> Info:
        planned, count = self._rooms.plans()
        info: Info = {
            "planned_actions": planned,
            "planned_count": count,
            "truth": self._rooms.poses.copy(),
        }
        if self._rules.journeys is not None and self._rules.observation == "scan":
            info["goal"] = self._rooms.courses.goals.copy()
        if self._rules.offices is not None:
            info["building"] = self._rooms.buildings.copy()
        return info


def checked_mode(mode: Any) -> AutoresetMode:
    """Return a mode given by its name, or as Gymnasium's constant."""
    return _MODES[one_of("autoreset_mode", getattr(mode, "value", mode), _MODES)]


def _chosen_rooms(options: Mapping[str, Any] | None, number: int) -> Bools:
    """Return which rooms a reset begins, (n,)."""
    check_options(options)
    mask = options.get("reset_mask") if options else None
    if mask is None:
        return np.ones(number, np.bool_)
    chosen = np.asarray(mask)
    if chosen.dtype != np.bool_ or chosen.shape != (number,) or not chosen.any():
        raise InputError(
            f"reset_mask is {mask!r}, but must be {number} Boolean values, at least one "
            "of them True."
        )
    return chosen.copy()


def _checked_seeds(seed: object, number: int) -> list[int | None]:
    """Return a seed for each room, or None; see ``ManyEpisodes.reset``."""
    if seed is None:
        return [None] * number
    if not isinstance(seed, Sequence | np.ndarray) or isinstance(seed, str):
        first = integer("seed", seed)
        return list(range(first, first + number))
    if len(seed) != number:
        raise InputError(
            f"seed has {len(seed)} numbers, but there are {number} rooms: give one "
            "seed for each, or a single number."
        )
    return [None if value is None else integer("seed", value) for value in seed]


def journeys(*, max_episode_steps: int | None = None, **room: Any) -> RoomVectorEnv:
    """Return rooms without a time limit unless one is given, as ``Journey-v1`` has none."""
    steps = -1 if max_episode_steps is None else max_episode_steps
    return RoomVectorEnv(max_episode_steps=steps, **room)


def _limit(steps: int | None) -> int:
    never: int = np.iinfo(np.intp).max
    if steps == -1:
        return never
    limit = MAX_EPISODE_STEPS if steps is None else steps
    return min(integer("max_episode_steps", limit, low=1), never)


def _number(rooms: int, rules: RoomRules) -> int:
    count, each = integer("num_envs", rooms, low=1), Rooms.bytes_each(rules)
    if count > (most := MOST_ROOM_BYTES // each):
        raise InputError(
            f"num_envs is {shown(count)}, but a room takes {each:,} bytes, and all may take "
            f"{MOST_ROOM_BYTES // 2**30} GiB: allowed values: 1 to {most:,}."
        )
    return count


def _check_together(rules: RoomRules) -> None:
    """Refuse what single rooms only can do."""
    world = rules.world
    if world.people is not None or world.glass is not None:
        part = "glass have walls of glass" if world.people is None else "people have crowds"
        raise InputError(
            f"the rooms of a world with {part} of their own, so they run one by one: "
            'give gym.make_vec(..., vectorization_mode="sync").'
        )
    if rules.journeys is not None and rules.horizon is None:
        raise InputError(
            "the rooms have a route each, whose plans differ in length: give a horizon, such as "
            "horizon=50."
        )
