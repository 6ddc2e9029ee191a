"""Tasks of acting on a belief: find out where the robot is, or drive to a goal and know it.

``localizers.tasks`` gives these envs their localizers: ``gym.make("deqmcl_gym/Localize-v0")``.
"""

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from deqmcl_gym.envs.belief import BeliefView, Estimator, Seen
from deqmcl_gym.maps import Box, Offices
from deqmcl_gym.maps.clusters import Near, best_cluster
from deqmcl_gym.numerics import Floats, Point, Pose, Singles
from deqmcl_gym.validation import InputError, NoEpisodeError, integer, number, one_of
from deqmcl_gym.world import World
from deqmcl_gym.world.course import centred_heading
from deqmcl_gym.world.driver import NO_PLAN
from deqmcl_gym.world.episode import Body, contacts_of
from deqmcl_gym.world.rules import Commands, StepResult, check_options, scan_space, within

RIGHT = Near(1.0, math.radians(30))  # of the best cluster to the truth
_GOALS = 10_000  # drawn before a room is refused


class Starts(Protocol):
    """p(x_0): the world draws from it, and localizers begin with it; see ``localizers.Prior``."""

    def sample(self, n: int, rng: np.random.Generator) -> Floats:
        """Draw n poses, (n, 3)."""


@dataclass(frozen=True)
class Site:
    """Where an episode takes place."""

    world: World  # its parts; lap and route are not used
    localizer: Estimator  # made for its map, with ``reset`` and ``update``
    starts: Starts  # where the robot may start
    extent: Box | None = None  # (x0, y0, x1, y1) of positions in observations; None: the map's


@dataclass(frozen=True)
class Sites:
    """Where episodes take place, by the seed of the office."""

    offices: Offices  # of which each episode draws one
    of: Callable[[Any], Site]  # gives the site of a map; the worlds differ in nothing else

    def site(self, seed: int) -> Site:
        """Return that in the office of a seed."""
        return self.of(self.offices.map(seed))


class ActingEnv(gym.Env[Seen, Singles], ABC):
    """A robot that acts on a localizer's belief; the envs below say what for.

    Actions are (distance, turn, head, …), float32: a move of ``Room-v0``, then heads in [0, 1],
    each on from 0.5. The last head declares: the robot stays where it is and the episode ends,
    judged by the world as it is, so by what the agent has seen.

    The localizer gets scans and commands, no plan. Start, motion, sensor and localizer have random
    generators of their own, spawned from ``np_random`` at each reset. Where there are ``sites``,
    each reset draws one, with another generator spawned; before the first reset the building is
    that of the first seed. ``floor_plan`` is the map of the episode, ``building`` the seed of its
    office, where one is drawn; else None.

    Args:
        site: where it acts, or the sites of which each episode draws one. The env runs a copy of
            the localizer.
        max_steps: steps after which an episode is truncated.
        particles: poses drawn from the belief, for the observation.
        cell: side of the squares of an image of the belief, for the observation; None: none.
        render_mode: None, "rgb_array" or "human".
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 30}
    _heads: tuple[str, ...] = ("declare",)
    _spec: EnvSpec | None = None

    def __init__(
        self,
        site: Site | Sites,
        *,
        max_steps: int,
        particles: int = 0,
        cell: float | None = None,
        render_mode: str | None = None,
    ) -> None:
        self._sites = site if isinstance(site, Sites) else None
        self.building: int | None = None
        if isinstance(site, Sites):
            self.building = site.offices.seeds[0]
            site = site.site(self.building)
        world = site.world
        if world.differs_from_map:
            raise InputError(
                "the world has clutter, changed walls, people or glass, but acting envs have what "
                "is on the map: leave them out."
            )
        self.lidar = world.lidar
        self._enter(site, copy.deepcopy(site.localizer))
        self.max_steps = integer("max_steps", max_steps, low=1)
        if render_mode is not None:
            one_of("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        bounds = self.floor_plan.bounds if self._sites is None else self._sites.offices.bounds
        self._extent = bounds if self._sites else site.extent or bounds
        self._view = BeliefView(
            self.floor_plan, particles=particles, cell=cell, bounds=bounds, extent=self._extent
        )
        self._commands = Commands(world.robot, self.floor_plan.unit, self._heads)
        self.action_space = self._commands.space
        share = gym.spaces.Box(0.0, 1.0, (1,))
        self.observation_space = gym.spaces.Dict(
            {"scan": scan_space(self.lidar), "clock": share, **self._view.spaces, **self._shows()}
        )
        self._body: Body | None = None
        self.steps, self._ended = 0, True

    @property
    def spec(self) -> EnvSpec | None:
        """What ``gym.make`` made this of, with the number of steps that limits its episodes."""
        return self._spec and replace(self._spec, max_episode_steps=self.max_steps)

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = spec

    @property
    def radius(self) -> float:
        """Radius of the robot's disc."""
        return self.world.robot.radius

    @property
    def pose(self) -> Pose:
        """The true pose (x, y, θ)."""
        return self._robot.pose

    @property
    def belief(self) -> Any:
        """The localizer's latest, for planners."""
        _ = self._robot  # there is one
        return self._belief

    @property
    def _robot(self) -> Body:
        if self._body is None:
            raise NoEpisodeError
        return self._body

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Begin an episode, with a localizer that knows the prior."""
        check_options(options)
        super().reset(seed=None if seed is None else integer("seed", seed))
        start, motion, sensor, filtering, self._shown = self.np_random.spawn(5)
        if self._sites is not None:
            (drawing,) = self.np_random.spawn(1)
            self.building = self._sites.offices.drawn(drawing)
            site = self._sites.site(self.building)
            self._enter(site, site.localizer)
        (x, y, heading), prior = self._begun(start)
        pose, caster = (x, y, centred_heading(heading)), self.floor_plan.cast
        self._body = Body(pose, self._walls, self.world, caster, sensor, motion)
        self._scan = self._body.scan
        self._belief = self._localizer.reset(prior, NO_PLAN, filtering)
        self.steps, self._ended = 0, False
        self._updated()
        return self._seen(), self._info(np.zeros(2, np.float32), False, False)

    def step(self, action: Singles) -> StepResult:
        """Declare, or move, take a scan and update the belief."""
        if self._ended:
            raise RuntimeError("the episode has not begun, or has ended: call reset().")
        values = self._commands.checked(action)
        command, on, collided = values[:2].copy(), values[2:] >= 0.5, False
        if on[-1]:
            command = np.zeros(2, np.float32)
        else:
            collided = self._robot.move(*command.tolist())
            ranges = self._looked(on)
            self._belief = self._localizer.update(ranges, command.copy(), NO_PLAN)
            self._updated()
        self.steps += 1
        reward, terminated, success = self._judged(on, collided)
        truncated = not terminated and self.steps >= self.max_steps
        self._ended = terminated or truncated
        info = self._info(command, collided, success)
        return self._seen(), float(reward), terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return the world, the belief and its best cluster, (h, w, 3) RGB."""
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make(..., render_mode="rgb_array").')
            return None
        from deqmcl_gym.world.drawing import LIGHT_BLUE, ORANGE, PINK, Drawing, View

        poses, weights = self.belief.points()
        best = best_cluster(poses, weights, unit=self.floor_plan.unit).mean
        drawing = Drawing(View(self.floor_plan)).points(poses[:, :2], ORANGE, 2)
        drawing.points(self._marks(), LIGHT_BLUE, 9)
        drawing.beams(self.lidar.rays(self.pose), self._scan)
        drawing.robot(best, self.radius, PINK).robot(self.pose, self.radius)
        return drawing.number(self.steps).image

    @abstractmethod
    def _shows(self) -> dict[str, gym.spaces.Box]:
        """Return the spaces of what else is observed."""

    @abstractmethod
    def _begun(self, rng: np.random.Generator) -> tuple[Pose, Starts]:
        """Begin an episode: draw the start, and say what the localizer knows of it."""

    def _updated(self) -> None:
        """Take note of a new belief."""

    @abstractmethod
    def _judged(self, on: NDArray[np.bool_], collided: bool) -> tuple[float, bool, bool]:
        """Return reward, whether the episode terminates, and whether the task is done."""

    @abstractmethod
    def _also(self) -> dict[str, Any]:
        """Return what else is observed."""

    def _enter(self, site: Site, localizer: Estimator) -> None:
        """Let the next episode take place there, with a localizer of the env's own."""
        self.world, self.floor_plan, self._starts = site.world, site.world.floor_plan, site.starts
        self._walls, self._localizer = contacts_of(site.world), localizer

    def _looked(self, on: NDArray[np.bool_]) -> Singles:
        """Take a scan, and return it for the localizer."""
        self._robot.look()
        self._scan = self._robot.scan
        return self._scan.copy()

    def _marks(self) -> Floats:
        """Points to be drawn, (n, 2)."""
        return np.empty((0, 2))

    def _seen(self) -> Seen:
        return {
            "scan": self._scan.copy(),
            "clock": np.array([self.steps / self.max_steps], np.float32),
            **self._view.shown(self.belief, self._shown),
            **{name: np.array(value, np.float32) for name, value in self._also().items()},
        }

    def _info(self, command: Singles, collided: bool, success: bool) -> dict[str, Any]:
        building = {} if self.building is None else {"building": np.int64(self.building)}
        return {
            "command": command,
            "collided": np.float64(collided),
            "is_success": np.float64(success),
            "truth": np.array(self.pose),
            **building,
        }


class LocalizeEnv(ActingEnv):
    """A lost robot drives until it knows where it is, and says so.

    **Action**: (distance, turn, declare). **Observation**: ``scan``, the keys of ``BeliefView``,
    ``confident`` (1,), the steps in a row with ``best_share`` > ``share`` as a share of ``hold``,
    at most 1; ``clock`` (1,), the share of ``max_steps`` done.

    **Reward**: -1 a step, -1 a contact. A declaration is right if in each of the last ``hold``
    steps the best cluster was within 1 m and 30° of the truth with more than ``share`` of the
    belief. If it is not, it costs 2 ``max_steps`` besides: more than anything that a robot can do
    without declaring.

    **Start**: drawn from the prior. **End**: terminated by a declaration, truncated after
    ``max_steps``.

    Args:
        site: where it is lost, or the sites of which each episode draws one; ``starts`` is p(x_0).
        share: of the belief, that its best cluster must exceed.
        hold: for how many steps in a row.
        max_steps: steps after which an episode is truncated.
        shown: ``particles``, ``cell`` and ``render_mode`` of ``ActingEnv``.
    """

    def __init__(
        self,
        site: Site | Sites,
        *,
        share: float = 0.9,
        hold: int = 30,
        max_steps: int = 300,
        **shown: Any,
    ) -> None:
        self.share = number("share", share, low=0, high=1)
        self.hold = integer("hold", hold, low=1)
        super().__init__(site, max_steps=max_steps, **shown)

    def _shows(self) -> dict[str, gym.spaces.Box]:
        return {"confident": gym.spaces.Box(0.0, 1.0, (1,))}

    def _begun(self, rng: np.random.Generator) -> tuple[Pose, Starts]:
        self._confident = self._right = 0  # steps in a row
        x, y, heading = self._starts.sample(1, rng)[0].tolist()
        return (x, y, heading), self._starts

    def _updated(self) -> None:
        best = best_cluster(*self.belief.points(), unit=self.floor_plan.unit)
        sure = best.share > self.share
        self._confident = self._confident + 1 if sure else 0
        right = sure and RIGHT([best.mean], self.pose, unit=self.floor_plan.unit)[0]
        self._right = self._right + 1 if right else 0

    def _judged(self, on: NDArray[np.bool_], collided: bool) -> tuple[float, bool, bool]:
        declared, right = bool(on[-1]), self._right >= self.hold
        wrong = declared and not right
        reward = -1.0 - collided - 2.0 * self.max_steps * wrong
        return reward, declared, declared and right

    def _also(self) -> dict[str, Any]:
        return {"confident": [min(1.0, self._confident / self.hold)]}


class TrackEnv(ActingEnv):
    """A robot drives to a goal on its belief; each scan costs, and blind driving blurs the belief.

    **Action**: (distance, turn, sense, declare). Without ``sense`` no scan is taken: the localizer
    only predicts. **Observation**: ``scan``, zeros if none was taken; ``sensed`` (1,), 1 if one
    was; ``goal`` (2,); ``clock`` (1,), the share of ``max_steps`` done; the keys of ``BeliefView``.

    **Reward**: -1 a scan; 100 for a declaration within ``tolerance`` of the goal, -100 for one
    elsewhere and for a contact.

    **Start**: anywhere; the localizer begins with a prior around it. The goal is drawn at least
    ``least`` away. **End**: terminated by a declaration or a contact, truncated after
    ``max_steps``.

    Args:
        site: where it drives, or the sites of which each episode draws one; start and goal are
            drawn from its ``starts``.
        around: called with ``mean``, gives p(x_0) around a pose; the mean itself is drawn so that
            the start is distributed like that around it.
        tolerance: distance from the goal within which a declaration is right, in the map's unit.
        least: least distance from the start to the goal, in the map's unit.
        max_steps: steps after which an episode is truncated.
        shown: ``particles``, ``cell`` and ``render_mode`` of ``ActingEnv``.
    """

    _heads = ("sense", "declare")

    def __init__(
        self,
        site: Site | Sites,
        around: Callable[..., Starts],
        *,
        tolerance: float = 40.0,
        least: float = 150.0,
        max_steps: int = 200,
        **shown: Any,
    ) -> None:
        self._around = around
        self.tolerance = number("tolerance", tolerance, low=0, above=True)
        self._least = number("least", least, low=0)
        super().__init__(site, max_steps=max_steps, **shown)

    @property
    def goal(self) -> Point:
        """Where the robot is to declare (x, y)."""
        _ = self._robot  # there is one
        return self._goal

    def _shows(self) -> dict[str, gym.spaces.Box]:
        return {"sensed": gym.spaces.Box(0.0, 1.0, (1,)), "goal": within(self._extent)}

    def _begun(self, rng: np.random.Generator) -> tuple[Pose, Starts]:
        self._sensed = True
        for _ in range(_GOALS):
            start, goal = self._starts.sample(2, rng).tolist()
            if math.dist(start[:2], goal[:2]) >= self._least:
                break
        else:
            raise InputError(
                f"no start and goal {self._least:g} {self.floor_plan.unit} apart were found: give "
                "a smaller least."
            )
        x, y, heading = start
        self._goal = goal[0], goal[1]
        (mean,) = self._around(mean=(x, y, heading)).sample(1, rng).tolist()
        return (x, y, heading), self._around(mean=mean)

    def _looked(self, on: NDArray[np.bool_]) -> Singles:
        self._sensed = bool(on[0])
        if self._sensed:
            return super()._looked(on)
        self._scan = np.zeros(self.lidar.beams, np.float32)
        return np.full(self.lidar.beams, np.nan, np.float32)

    def _judged(self, on: NDArray[np.bool_], collided: bool) -> tuple[float, bool, bool]:
        if on[-1]:
            arrived = math.dist(self.pose[:2], self.goal) <= self.tolerance
            return (100.0 if arrived else -100.0), True, arrived
        return -1.0 * self._sensed - 100.0 * collided, collided, False

    def _also(self) -> dict[str, Any]:
        return {"sensed": [float(self._sensed)], "goal": self.goal}

    def _marks(self) -> Floats:
        return np.array([self.goal])
