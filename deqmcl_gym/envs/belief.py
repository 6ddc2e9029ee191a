"""A localizer's belief as an observation."""

import copy
import math
from typing import Any, Protocol, runtime_checkable

import gymnasium as gym
import numpy as np

from deqmcl_gym.maps import Box, Map
from deqmcl_gym.maps.clusters import drawn_poses, two_clusters
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Floats, Reals, Singles, arrays
from deqmcl_gym.validation import InputError, integer, number, one_of, shown
from deqmcl_gym.world.rules import StepResult, relative_space, relative_to

Seen = dict[str, Any]


@runtime_checkable
class Estimator(Protocol):
    """The methods of a localizer that an env calls; see ``localizers.Localizer``."""

    def reset(self, prior: Any, plan: Reals, rng: np.random.Generator) -> Any:
        """Start a new episode and return the belief."""

    def update(self, ranges: Reals, action: Reals, plan: Reals) -> Any:
        """Return the belief after one step."""


class BeliefView:
    """What an observation shows of a belief: a dict of float32 arrays, whose ``spaces`` it has.

    - ``mean`` (3,): x, y, θ in [-π, π]; the heading is the direction of the mean (cos θ, sin θ).
    - ``covariance`` (3, 3): of x, y, θ around it.
    - ``entropy`` (1,): ½ log((2πe)³ det(covariance + f)), nats, f = (0.1 px)², (0.1 px)², 10⁻⁶.
    - ``best`` (3,), ``best_share`` (1,): pose and share of the best cluster (``best_cluster``).
    - ``second`` (3,), ``second_share`` (1,): those of the best one outside it; see
      ``two_clusters``.
    - ``quality`` (1,): confidence that it is not lost, if the localizer estimates it.
    - ``particles`` (k, 3): poses drawn by weight, θ in [-π, π], if asked for.
    - ``occupancy`` (rows, columns): the share in each square of the map, the lowest row first, if
      asked for.

    Positions are bounded by ``extent`` and half of its longer side around it, ``covariance`` and
    ``entropy`` by what is possible within; of a belief that is farther off they read the bound.

    Args:
        particles: k.
        cell: side of the squares, in the map's unit; None: no ``occupancy``.
        bounds: that ``occupancy`` covers; None: the map's.
        extent: (x0, y0, x1, y1) of positions, as the spaces have them; None: as bounds.
    """

    def __init__(
        self,
        floor_plan: Map,
        *,
        has_quality: bool = False,
        particles: int = 0,
        cell: float | None = None,
        bounds: Box | None = None,
        extent: Box | None = None,
    ) -> None:
        self._unit, self._bounds = floor_plan.unit, bounds or floor_plan.bounds
        px = pixel(self._unit)
        # f, with which the entropy of a single pose is finite
        self._floor = np.array([1e-2, 1e-2, 1e-6]) * np.array([px, px, 1.0]) ** 2
        self._has_quality = has_quality
        self._particles = integer("particles", particles)
        x0, y0, x1, y1 = extent or self._bounds
        around = max(x1 - x0, y1 - y0) / 2
        low = np.array([x0 - around, y0 - around, -np.pi])
        high = np.array([x1 + around, y1 + around, np.pi])
        most = (high - low) / 2  # standard deviations within them
        poses: dict[str, tuple[int, ...]] = {"mean": (3,), "best": (3,), "second": (3,)}
        if particles:
            poses["particles"] = (particles, 3)
        self._bounded = free = {name: _box(low, high, shape) for name, shape in poses.items()}
        free["covariance"] = _box(-np.outer(most, most), np.outer(most, most), (3, 3))
        free["entropy"] = _box(_entropy(self._floor), _entropy(most**2 + self._floor), (1,))
        shares = ["best_share", "second_share"] + ["quality"] * has_quality
        parts = {name: gym.spaces.Box(0.0, 1.0, (1,)) for name in shares}
        self.spaces: dict[str, gym.spaces.Box] = {**free, **parts}
        self._cell = cell
        if cell is not None:
            side = number("cell", cell, low=0, above=True)
            x0, y0, x1, y1 = self._bounds
            self._grid = math.ceil((y1 - y0) / side), math.ceil((x1 - x0) / side)
            self.spaces["occupancy"] = gym.spaces.Box(0.0, 1.0, self._grid)

    def shown(self, belief: Any, rng: np.random.Generator) -> Seen:
        """Return the dict; ``rng`` draws the particles."""
        poses, weights = belief.points()
        best, second = two_clusters(poses, weights, unit=self._unit)
        at = np.asarray(poses, np.float64)
        sine, cosine = weights @ arrays.sin(at[:, 2]), weights @ arrays.cos(at[:, 2])
        mean = np.array([*(weights @ at[:, :2]), float(arrays.arctan2(sine, cosine))])
        off = at - mean
        off[:, 2] = arrays.wrapped(off[:, 2])
        seen: dict[str, Any] = {
            **self.moments(mean, (weights[:, None] * off).T @ off),
            "best": best.mean,
            "best_share": [min(best.share, 1.0)],
            "second": second.mean,
            "second_share": [min(second.share, 1.0)],
        }
        if self._has_quality:
            seen["quality"] = [belief.quality]
        seen |= self.cloud(poses, weights, rng)
        shown = {name: np.array(value, np.float32) for name, value in seen.items()}
        for name, space in self._bounded.items():
            np.clip(shown[name], space.low, space.high, out=shown[name])
        return shown

    def moments(self, means: Floats, covariances: Floats) -> dict[str, Floats]:
        """Return mean, covariance and entropy of one belief, or of n, (n, 3) and (n, 3, 3)."""
        log_det = np.linalg.slogdet(covariances + np.diag(self._floor))[1]
        entropy = 0.5 * (3 * math.log(2 * math.pi * math.e) + log_det)
        return {"mean": means, "covariance": covariances, "entropy": entropy[..., None]}

    def cloud(self, poses: Reals, weights: Floats, rng: np.random.Generator) -> dict[str, Reals]:
        """Return particles and occupancy, as far as they are asked for."""
        seen: dict[str, Reals] = {}
        if self._particles:
            drawn = drawn_poses(poses, weights, self._particles, rng)
            turned = np.abs(drawn[:, 2]) > np.pi  # filters count turns
            drawn[turned, 2] = arrays.wrapped(drawn[turned, 2])
            seen["particles"] = drawn
        if self._cell is not None:
            (rows, columns), (x0, y0, _, _) = self._grid, self._bounds
            column, row = np.floor((np.asarray(poses)[:, :2].T - [[x0], [y0]]) / self._cell)
            inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
            number_of = (row * columns + column)[inside].astype(np.intp)
            counted = np.bincount(number_of, weights[inside], rows * columns)
            seen["occupancy"] = np.minimum(counted, 1.0).reshape(rows, columns)
        return seen


class BeliefObservation(gym.Wrapper[Seen, Singles, Any, Singles], gym.utils.RecordConstructorArgs):
    """Run a localizer inside the env and add its belief to the observation.

    The observation is a dict: ``scan``, or the env's own dict, and the keys of ``BeliefView``.

    The localizer gets the same input as in a benchmark, never the true pose. Its random generator
    is spawned from the env's ``np_random`` at each reset: same seed, same beliefs.

    Args:
        env: Room-v0 or Log-v0, or one in wrappers that keep scans, or dicts with a ``scan``.
        localizer: ``localizers.make(...)``, or any object with its ``reset`` and ``update``; the
            env runs a copy of it, also when it is made anew from its ``spec``.
        prior: p(x_0), given to the localizer at each reset.
        particles, cell: as of ``BeliefView``.
        goal: of a route, "map": as the env shows it; "relative": distance and bearing from the mean
            of the belief.

    Attributes:
        belief: the latest, for planners; by ``env.get_wrapper_attr("belief")`` from outside.
    """

    def __init__(
        self,
        env: gym.Env[Any, Singles],
        localizer: Estimator,
        prior: Any,
        particles: int = 0,
        cell: float | None = None,
        goal: str = "map",
    ) -> None:
        arguments = {"localizer": localizer, "prior": prior, "particles": particles, "cell": cell}
        arguments["goal"] = one_of("goal", goal, ("map", "relative"))
        gym.utils.RecordConstructorArgs.__init__(self, _disable_deepcopy=True, **arguments)
        super().__init__(env)
        if not isinstance(localizer, Estimator):
            raise InputError(
                f"localizer is {shown(localizer)}, but must have reset and update: give "
                'localizers.make("mcl", robot).'
            )
        room: Any = env.unwrapped
        if getattr(getattr(room, "rules", None), "offices", None) is not None:
            raise InputError(
                "the env draws another building in each episode, but a localizer is made for one "
                "map: give the office a seed instead of seeds, or take Localize-v0, which makes "
                "its localizer anew."
            )
        lidar = getattr(getattr(localizer, "robot", None), "lidar", room.lidar)
        if lidar.beams != room.lidar.beams:
            raise InputError(
                f"localizer is made for {lidar.beams} beams, but the env's lidar has "
                f"{room.lidar.beams}: make it for the lidar of the env."
            )
        localizer = copy.deepcopy(localizer)
        self._localizer, self._prior = localizer, prior
        self.belief = localizer.reset(prior, np.empty((0, 2)), np.random.default_rng(0))
        self._rng, self._shows_particles = np.random.default_rng(0), particles > 0
        has_quality = getattr(self.belief, "quality", None) is not None
        self._view = BeliefView(
            room.floor_plan, has_quality=has_quality, particles=particles, cell=cell
        )
        space = env.observation_space
        shows = space.spaces if isinstance(space, gym.spaces.Dict) else {"scan": space}
        if getattr(shows.get("scan"), "shape", None) != (room.lidar.beams,):
            raise InputError(
                f"the env's observations are {shown(space)}, but a localizer needs scans of "
                f"{room.lidar.beams} beams: put BeliefObservation inside the wrapper that changes "
                "the observation."
            )
        spaces = {**shows, **self._view.spaces}
        self._relative = goal == "relative"
        if self._relative:
            if "goal" not in spaces or room.rules.goal != "map":
                raise InputError(
                    'goal is "relative", but the env shows no goal on the map: give one with a '
                    'route, observation="dict" and its own goal="map".'
                )
            mean = self._view.spaces["mean"]
            spaces["goal"] = relative_space((*mean.low[:2].tolist(), *mean.high[:2].tolist()))
        self.observation_space = gym.spaces.Dict(spaces)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Reset env and localizer."""
        seen, info = self.env.reset(seed=seed, options=options)
        (rng,) = self.unwrapped.np_random.spawn(1)
        if self._shows_particles:
            (self._rng,) = self.unwrapped.np_random.spawn(1)
        self.belief = self._localizer.reset(self._prior, _plan(info), rng)
        return self._with(seen), info

    def step(self, action: Singles) -> StepResult:
        """Step the env and update the localizer."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        scan = seen["scan"] if isinstance(seen, dict) else seen
        self.belief = self._localizer.update(scan.copy(), info["command"].copy(), _plan(info))
        return self._with(seen), reward, terminated, truncated, info

    def _with(self, seen: Any) -> Seen:
        shows: Seen = seen if isinstance(seen, dict) else {"scan": seen}
        shown = shows | self._view.shown(self.belief, self._rng)
        if self._relative:
            shown["goal"] = relative_to(shown["mean"], shown["goal"]).astype(np.float32)
        return shown


def _box(low: Any, high: Any, shape: tuple[int, ...]) -> gym.spaces.Box:
    low, high = (np.broadcast_to(np.float32(bound), shape) for bound in (low, high))
    return gym.spaces.Box(low, high)


def _entropy(variances: Floats) -> float:
    """Entropy of a normal distribution with independent parts, nats."""
    return 0.5 * float(np.log(2 * np.pi * math.e * variances).sum())


def _plan(info: dict[str, Any]) -> Reals:
    planned: Reals = info["planned_actions"][: info["planned_count"]].copy()
    return planned
