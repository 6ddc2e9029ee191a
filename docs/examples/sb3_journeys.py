"""
Many rooms in Stable-Baselines3
===============================

The native vector env as a VecEnv: ``python docs/examples/sb3_journeys.py``.

It needs the extra ``rl``: ``pip install '.[rl]'`` in the clone. ``make_vec_env`` of
Stable-Baselines3 steps single rooms one by one; ``Rooms`` hands it those of ``gym.make_vec``, all
in one call. PPO then trains on journeys, each in an office of its own, and sees scan, goal and the
plan of the driver. Actions are in [-1, 1]; ``VecNormalize`` scales observations and rewards.
"""

import argparse
import sys
from typing import Any

import gymnasium as gym
import numpy as np

import deqmcl_gym  # noqa: F401  # registers the rooms

try:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize
except ModuleNotFoundError as missing:
    sys.exit(f"{missing.name} is not installed: pip install '.[rl]' in the clone.")

OFFICES = {"office": {"seeds": [0, 1000]}}


class Rooms(VecEnv):
    """Rooms of ``gym.make_vec``, made with ``autoreset_mode="SameStep"``, as a VecEnv.

    Attributes:
        rooms: the vector env.
    """

    def __init__(self, rooms: gym.vector.VectorEnv[Any, Any, Any]) -> None:
        self.rooms = rooms
        box = rooms.single_action_space
        self._low, self._span = box.low, (box.high - box.low) / 2
        unit = gym.spaces.Box(-1.0, 1.0, box.shape, np.float32)
        super().__init__(rooms.num_envs, rooms.single_observation_space, unit)

    def reset(self) -> Any:
        """Begin an episode in all rooms, with the seeds given before, if any."""
        seeds = None if None in self._seeds else self._seeds
        self._reset_seeds()
        seen, _ = self.rooms.reset(seed=seeds)
        return seen

    def step_async(self, actions: Any) -> None:
        """Take the actions, (n, 2) in [-1, 1]."""
        self._actions = self._low + (np.clip(actions, -1, 1) + 1) * self._span

    def step_wait(self) -> Any:
        """Step all rooms; where an episode ends, the next one begins."""
        box = self.rooms.single_action_space
        actions = np.clip(self._actions, box.low, box.high).astype(np.float32)  # rounding
        seen, rewards, terminated, truncated, told = self.rooms.step(actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for room in np.flatnonzero(terminated | truncated):
            infos[room]["terminal_observation"] = told["final_obs"][room]
            infos[room]["TimeLimit.truncated"] = bool(truncated[room] and not terminated[room])
        return seen, rewards.astype(np.float32), terminated | truncated, infos

    def close(self) -> None:
        """Nothing is left open."""
        self.rooms.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return what all rooms share, once for each."""
        return [getattr(self.rooms, attr_name)] * len(self._indices(indices))

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Rooms have no wrappers of their own."""
        return [False] * len(self._indices(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: rooms are equal."""
        raise NotImplementedError("rooms that run together are equal: make others instead.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        """Refuse: rooms that run together have no methods of their own."""
        raise NotImplementedError("rooms that run together have no methods of their own.")

    def _indices(self, indices: Any) -> Any:
        return list(self._get_indices(indices))


def main() -> None:
    """Train, and print the mean return of the last episodes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000, help="training steps")
    parser.add_argument("--rooms", type=int, default=64)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    torch.set_num_threads(1)  # the nets are small
    rooms = gym.make_vec(
        "deqmcl_gym/Journey-v1", num_envs=given.rooms, floor_plan=OFFICES, horizon=5,
        autoreset_mode="SameStep",
    )  # fmt: skip
    envs = VecNormalize(
        VecMonitor(Rooms(rooms)), norm_obs_keys=["scan", "goal", "plan"], gamma=0.99
    )
    policy = PPO(
        "MultiInputPolicy", envs, seed=given.seed, n_steps=64, batch_size=512, gamma=0.99,
        device="cpu",
    )  # fmt: skip
    policy.learn(given.steps)
    lately = [episode["r"] for episode in policy.ep_info_buffer]
    print(f"mean return of the last {len(lately)} episodes: {np.mean(lately or [np.nan]):.1f}")


if __name__ == "__main__":
    main()
