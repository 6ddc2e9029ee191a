"""A localizer's belief as an observation, and its error as a reward."""

import copy
import math
from typing import Any, Protocol, SupportsFloat, runtime_checkable

import gymnasium as gym
import numpy as np

from deqmcl_gym.envs.wrappers import room_of
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Reals, Singles
from deqmcl_gym.validation import LARGEST, InputError, shown

Seen = dict[str, Any]
StepResult = tuple[Seen, SupportsFloat, bool, bool, dict[str, Any]]

# (0.1 px)², 10⁻⁶ rad²: the entropy of a single pose is finite
_FLOOR = np.array([1e-2, 1e-2, 1e-6])


@runtime_checkable
class Estimator(Protocol):
    """The methods of a localizer that an env calls; see ``localizers.Localizer``."""

    def reset(self, prior: Any, plan: Reals, rng: np.random.Generator) -> Any:
        """Start a new episode and return the belief."""

    def update(self, ranges: Reals, action: Reals, plan: Reals) -> Any:
        """Return the belief after one step."""


class BeliefObservation(gym.Wrapper[Seen, Singles, Any, Singles], gym.utils.RecordConstructorArgs):
    """Run a localizer inside the env and add its belief to the observation.

    The observation is a dict: ``scan``, or the env's own dict, and

    - ``mean`` (3,): of the belief, x, y, θ in [-π, π]; the heading is the direction of the mean
      (cos θ, sin θ).
    - ``covariance`` (3, 3): of x, y, θ around it.
    - ``entropy`` (1,): ½ log((2πe)³ det(covariance + f)), nats, f = (0.1 px)², (0.1 px)², 10⁻⁶.
    - ``quality`` (1,): P(not lost), if the localizer estimates it.

    The localizer gets the same input as in a benchmark, never the true pose. Its random generator
    is spawned from the env's ``np_random`` at each reset: same seed, same beliefs.

    Args:
        env: Room-v0 or Log-v0, or one in wrappers that keep scans, or dicts with a ``scan``.
        localizer: ``localizers.make(...)``, or any object with its ``reset`` and ``update``; the
            env runs a copy of it, also when it is made anew from its ``spec``.
        prior: p(x_0), given to the localizer at each reset.

    Raises:
        InputError: the env shows no scan, or the localizer is none.
    """

    def __init__(self, env: gym.Env[Any, Singles], localizer: Estimator, prior: Any) -> None:
        given = {"localizer": localizer, "prior": prior}
        gym.utils.RecordConstructorArgs.__init__(self, _disable_deepcopy=True, **given)
        super().__init__(env)
        if not isinstance(localizer, Estimator):
            raise InputError(
                f"localizer is {shown(localizer)}, but must have reset and update: give "
                'localizers.make("mcl", robot).'
            )
        room: Any = env.unwrapped
        lidar = getattr(getattr(localizer, "robot", None), "lidar", room.lidar)
        if lidar.beams != room.lidar.beams:
            raise InputError(
                f"localizer is made for {lidar.beams} beams, but the env's lidar has "
                f"{room.lidar.beams}: make it for the lidar of the env."
            )
        localizer = copy.deepcopy(localizer)
        self._localizer, self._prior = localizer, prior
        self._floor = _FLOOR * np.array([pixel(room.floor_plan.unit)] * 2 + [1.0]) ** 2
        tried = localizer.reset(prior, np.empty((0, 2)), np.random.default_rng(0))
        shapes = {"mean": (3,), "covariance": (3, 3), "entropy": (1,)}
        spaces = {name: gym.spaces.Box(-LARGEST, LARGEST, shape) for name, shape in shapes.items()}
        self._has_quality = getattr(tried, "quality", None) is not None
        if self._has_quality:
            spaces["quality"] = gym.spaces.Box(0.0, 1.0, (1,))
        own = env.observation_space
        shows = own.spaces if isinstance(own, gym.spaces.Dict) else {"scan": own}
        if getattr(shows.get("scan"), "shape", None) != (room.lidar.beams,):
            raise InputError(
                f"the env's observations are {shown(own)}, but a localizer needs scans of "
                f"{room.lidar.beams} beams: put BeliefObservation inside the wrapper that changes "
                "the observation."
            )
        self.observation_space = gym.spaces.Dict({**shows, **spaces})

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Reset env and localizer."""
        seen, info = self.env.reset(seed=seed, options=options)
        (rng,) = self.unwrapped.np_random.spawn(1)
        belief = self._localizer.reset(self._prior, _plan(info), rng)
        return self._with(seen, belief), info

    def step(self, action: Singles) -> StepResult:
        """Step the env and update the localizer."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        scan = seen["scan"] if isinstance(seen, dict) else seen
        belief = self._localizer.update(scan.copy(), info["action"].copy(), _plan(info))
        return self._with(seen, belief), reward, terminated, truncated, info

    def _with(self, seen: Any, belief: Any) -> Seen:
        mean, covariance = _moments(*belief.points())
        log_det = float(np.linalg.slogdet(covariance + np.diag(self._floor))[1])
        entropy = 0.5 * (3 * math.log(2 * math.pi * math.e) + log_det)
        shows = dict(seen) if isinstance(seen, dict) else {"scan": seen}
        shows["mean"], shows["covariance"] = mean.astype(np.float32), covariance.astype(np.float32)
        shows["entropy"] = np.array([entropy], np.float32)
        if self._has_quality:
            shows["quality"] = np.array([belief.quality], np.float32)
        return shows


class LocalizationReward(
    gym.Wrapper[Seen, Singles, Seen, Singles], gym.utils.RecordConstructorArgs
):
    """Replace the reward by -‖mean - truth‖ in (x, y), in the map's unit: active localization.

    The reward is highest where the localizer is most accurate.

    Args:
        env: with a BeliefObservation among its wrappers, and no wrapper around it that changes the
            observation.

    Raises:
        InputError: there is no BeliefObservation, or the env is not Room-v0.
    """

    def __init__(self, env: gym.Env[Seen, Singles]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)
        room_of(env)
        spaces = getattr(env.observation_space, "spaces", {})
        if "mean" not in spaces:
            raise InputError(
                f"the env's observations are {shown(env.observation_space)}, but the error needs "
                "an estimate: put LocalizationReward around a BeliefObservation."
            )

    def step(self, action: Singles) -> StepResult:
        """Step; the reward is the negative error of the localizer."""
        seen, _, terminated, truncated, info = self.env.step(action)
        dx, dy = seen["mean"][:2] - info["truth"][:2]
        return seen, -float(np.hypot(dx, dy)), terminated, truncated, info


def _plan(info: dict[str, Any]) -> Reals:
    planned: Reals = info["planned_actions"][: info["planned_count"]].copy()
    return planned


def _moments(poses: Reals, weights: Floats) -> tuple[Floats, Floats]:
    """Return the mean pose and the covariance around it of weighted poses (n, 3)."""
    at = np.asarray(poses, np.float64)
    heading = at[:, 2]
    sine, cosine = weights @ arrays.sin(heading), weights @ arrays.cos(heading)
    mean = np.array([*(weights @ at[:, :2]), float(arrays.arctan2(sine, cosine))])
    off = at - mean
    off[:, 2] = arrays.wrapped(off[:, 2])
    return mean, (weights[:, None] * off).T @ off
