"""
A policy that drives
====================

PPO in many rooms at once: ``python docs/examples/ppo.py``.

It needs the extra ``rl``: ``pip install '.[rl]'`` in the clone. ``deqmcl_gym.sb3.Rooms`` hands the
native vector env to Stable-Baselines3. By default the policy sees only the nine ranges of
``deqmcl_gym/Sharp-v0``, neither its pose nor its plan. The script draws the learning curve and
prints how many of 20 laps are finished: `Train a policy <../acting.html>`_ has results. Elsewhere
train ``--id`` and ``--set``, as ``--id Journey-v1 --set '{"plan": false, "goal": "relative"}'``.

.. image:: ../figures/ppo.svg
"""

# sphinx_gallery_thumbnail_path = 'docs/figures/ppo.svg'  # noqa: ERA001

import argparse
import json
import sys
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import RescaleAction

import deqmcl_gym  # noqa: F401  # registers the rooms
from benchmarks import evaluate

try:
    import matplotlib.pyplot as plt
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    from deqmcl_gym.sb3 import Rooms
except ModuleNotFoundError as missing:
    sys.exit(f"{missing.name} is not installed: pip install '.[rl]' in the clone.")

EPISODES = 20  # per evaluation


class Normalized(gym.ObservationWrapper[Any, Any, Any]):
    """A single room as the policy saw many in training."""

    def __init__(self, env: gym.Env[Any, Any], envs: VecNormalize) -> None:
        super().__init__(RescaleAction(env, np.float32(-1), np.float32(1)))
        self._envs = envs

    def observation(self, observation: Any) -> Any:
        """Return an observation in the scale of the training."""
        return self._envs.normalize_obs(observation)


class Curve(BaseCallback):
    """Evaluates the policy at regular intervals.

    Attributes:
        points: steps, share finished, mean return; (k, 3).
    """

    def __init__(self, room: str, every: int, options: dict[str, Any]) -> None:
        super().__init__()
        self.points: list[tuple[int, float, float]] = []
        self._room, self._every, self._options = room, every, options

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= len(self.points) * self._every:
            self.evaluate()

    def _on_step(self) -> bool:
        return True

    def evaluate(self) -> None:
        """Add a point."""
        found = evaluate(
            self._room, self.model, episodes=EPISODES, reference=None,
            wrap=lambda env: Normalized(env, self.training_env), **self._options,
        )  # fmt: skip
        self.points.append((self.num_timesteps, found.row["done"], found.row["return"]))
        print("{:>9,} steps: {:4.0%} finish, return {:7.1f}".format(*self.points[-1]), flush=True)


def draw(curve: Curve, room: str, file: str) -> None:
    """Draw the learning curve."""
    plt.rcParams["svg.fonttype"] = "none"  # text stays text
    steps, share, returned = np.transpose(curve.points)
    figure, (above, below) = plt.subplots(2, sharex=True, figsize=(6.4, 4.4), layout="constrained")
    above.plot(steps / 1000, 100 * share, "o-", color="#0072b2", markersize=3)
    above.set(ylabel="finished, %", ylim=(-5, 105), title=f"PPO in {room}, {EPISODES} episodes")
    below.plot(steps / 1000, returned, "o-", color="#d55e00", markersize=3)
    below.set(ylabel="mean return", xlabel="training steps, thousands")
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file, metadata={"Date": None} if file.endswith(".svg") else None)


def main() -> None:
    """Train, evaluate, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add("--id", default="Sharp-v0", help="of the room, without deqmcl_gym/")
    add("--set", type=json.loads, default={}, help="arguments of gym.make, as JSON")
    add("--steps", type=int, default=100_000, help="training steps")
    add("--rooms", type=int, default=16)
    add("--seed", type=int, default=0)
    add("--curve", default="ppo.svg", help="file of the learning curve")
    given = parser.parse_args()
    torch.set_num_threads(1)  # the nets are small
    rooms = gym.make_vec(
        f"deqmcl_gym/{given.id}", num_envs=given.rooms, autoreset_mode="SameStep", **given.set
    )
    envs = VecNormalize(VecMonitor(Rooms(rooms)), gamma=0.98)
    kind = (
        "MultiInputPolicy" if isinstance(envs.observation_space, gym.spaces.Dict) else "MlpPolicy"
    )
    policy = PPO(kind, envs, seed=given.seed, n_steps=64, batch_size=256, gamma=0.98, device="cpu")
    curve = Curve(given.id, given.steps // 30, given.set)
    policy.learn(given.steps, callback=curve)
    curve.evaluate()
    share, returned = curve.points[-1][1:]
    print(f"{share * EPISODES:.0f} of {EPISODES} episodes finished, mean return {returned:.1f}")
    draw(curve, given.id, given.curve)


if __name__ == "__main__":
    main()
