"""
A policy that drives laps
=========================

PPO learns to drive laps with nine laser beams: ``python docs/examples/ppo.py``.

It needs the extra ``rl``: ``pip install '.[rl]'`` in the clone. The policy sees only the nine
ranges of ``deqmcl_gym/Sharp-v0``, neither its pose nor its plan. The script draws the learning
curve and prints how many of 20 laps are finished. ``--id`` trains in another room; where the
observation is a dict, the policy sees all of it. `Results <../acting.html>`_.

.. image:: ../figures/ppo.svg
"""

# sphinx_gallery_thumbnail_path = 'docs/figures/ppo.svg'  # noqa: ERA001

import argparse
import sys
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import wrappers

import deqmcl_gym  # noqa: F401  # registers the rooms

try:
    import matplotlib.pyplot as plt
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.env_util import make_vec_env
except ModuleNotFoundError as missing:
    sys.exit(f"{missing.name} is not installed: pip install '.[rl]' in the clone.")

EPISODES = 20  # per evaluation
UNSEEN = 1_000_000  # first seed of an evaluation
ONE = np.float32(1)
SCALE = 100  # of rewards


def normalised(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    """Return the room with actions and observations in [-1, 1] and rewards of about 1."""
    if isinstance(env.observation_space, gym.spaces.Dict):
        env = wrappers.FlattenObservation(env)
    env = wrappers.RescaleAction(wrappers.RescaleObservation(env, -ONE, ONE), -ONE, ONE)
    return wrappers.TransformReward(env, lambda reward: reward / SCALE)


def evaluated(policy: PPO, room: str) -> tuple[float, float]:
    """Drive ``EPISODES`` rooms; return the share that finish, and the mean return."""
    sync = {"vectorization_mode": "sync", "wrappers": [normalised]}
    envs = gym.make_vec(room, num_envs=EPISODES, **sync)
    seen, _ = envs.reset(seed=UNSEEN)
    finished, driving = np.zeros(EPISODES, bool), np.ones(EPISODES, bool)
    returned = np.zeros(EPISODES)
    while driving.any():
        actions, _ = policy.predict(seen, deterministic=True)
        seen, rewards, terminated, truncated, _ = envs.step(actions)
        returned += SCALE * rewards * driving
        finished |= terminated & driving
        driving &= ~(terminated | truncated)
    return float(finished.mean()), float(returned.mean())


class Curve(BaseCallback):
    """Evaluates the policy at regular intervals.

    Attributes:
        room: its id.
        every: steps from one evaluation to the next.
        points: steps, share finished, mean return; (k, 3).
    """

    def __init__(self, room: str, every: int) -> None:
        super().__init__()
        self.room, self.every = room, every
        self.points: list[tuple[int, float, float]] = []

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= len(self.points) * self.every:
            self.points.append((self.num_timesteps, *evaluated(self.model, self.room)))
            print("{:>9,} steps: {:4.0%} finish, return {:7.1f}".format(*self.points[-1]))

    def _on_step(self) -> bool:
        return True


def draw(curve: Curve, file: str) -> None:
    """Draw the learning curve."""
    plt.rcParams["svg.fonttype"] = "none"  # text stays text
    steps, share, returned = np.transpose(curve.points)
    figure, (above, below) = plt.subplots(2, sharex=True, figsize=(6.4, 4.4), layout="constrained")
    above.plot(steps / 1000, 100 * share, "o-", color="#0072b2", markersize=3)
    above.set(
        ylabel="finished, %", ylim=(-5, 105), title=f"PPO in {curve.room}, {EPISODES} episodes"
    )
    below.plot(steps / 1000, returned, "o-", color="#d55e00", markersize=3)
    below.set(ylabel="mean return", xlabel="training steps, thousands")
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file, metadata={"Date": None} if file.endswith(".svg") else None)


def main() -> None:
    """Train, evaluate, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--id", default="Sharp-v0", help="of the room, without deqmcl_gym/")
    parser.add_argument("--steps", type=int, default=60_000, help="training steps")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--curve", default="ppo.svg", help="file of the learning curve")
    given = parser.parse_args()
    torch.set_num_threads(1)  # the nets are small
    room = f"deqmcl_gym/{given.id}"
    rooms = make_vec_env(room, n_envs=8, seed=given.seed, wrapper_class=normalised)
    policy = PPO(
        "MlpPolicy", rooms, seed=given.seed, n_steps=128, batch_size=256, gamma=0.98,
        learning_rate=3e-4, device="cpu",
    )  # fmt: skip
    curve = Curve(room, every=2_000)
    policy.learn(given.steps, callback=curve)
    curve.points.append((policy.num_timesteps, *evaluated(policy, room)))
    share, returned = curve.points[-1][1:]
    print(f"{share * EPISODES:.0f} of {EPISODES} episodes finished, mean return {returned:.1f}")
    draw(curve, given.curve)


if __name__ == "__main__":
    main()
