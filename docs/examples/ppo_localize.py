"""
A policy that finds out where it is
===================================

PPO learns to act on a localizer's belief: ``python docs/examples/ppo_localize.py``.

It needs the extra ``rl``: ``pip install '.[rl]'`` in the clone. In ``deqmcl_gym/Localize-v0`` a
lost robot drives until it knows where it is, and says so. Each training episode takes place in one
of 1,000 offices, drawn at reset; the scores are of other offices, beside those of reference
policies in the same episodes (`results <../acting.html>`_). It prints a table of all of them and
draws the learning curves.
"""

# sphinx_gallery_thumbnail_path = 'docs/figures/localize.png'  # noqa: ERA001

import argparse
import math
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from acting.scores import table

import deqmcl_gym  # noqa: F401  # registers the environments
from benchmarks.evaluation import Evaluation, evaluate
from localizers.tasks import OFFICE

try:
    import matplotlib.pyplot as plt
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.env_util import make_vec_env
except ModuleNotFoundError as missing:
    sys.exit(f"{missing.name} is not installed: pip install '.[rl]' in the clone.")

TRAINED = {"office": {**OFFICE, "seeds": [1000, 2000]}}  # scored: 0, 1, …
FASTER = {  # in training, for time: as many particles at first, few later; scored with mcl-map
    "name": "amcl", "min_particles": 500, "max_particles": 10_000, "laser_model_type": "robot",
    "robot_model_type": "robot", "update_min_d": 0.0, "update_min_a": 0.0,
}  # fmt: skip
TURNS = np.radians([0, 45, -45, 90, -90, 135, -135, 180])
DRIVES = 4  # steps of 0.2 m after each turn
ENVS, ROLLOUT = 8, 64  # envs of a training, and decisions in each from update to update
KEPT = 2_048  # a training keeps its policy every so many decisions
METRES = 10.0  # of lengths in the observation


class Motions(gym.Wrapper):
    """Actions are turns with a drive of 0.8 m after each, and to declare; seen is one array.

    What is declared while ``confident`` is below 1 is always wrong: it drives on instead. Seen are
    the scan, those expected at the two best clusters of the belief, where the second is as seen
    from the best, shares, entropy, confidence, clock, and the last turn and contact.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.action_space = gym.spaces.Discrete(len(TURNS) + 1)
        size = 3 * env.unwrapped.lidar.beams + 14
        self.observation_space = gym.spaces.Box(-10, 10, (size,), np.float32)

    def reset(self, **given: Any) -> Any:
        """Begin an episode."""
        self._dict, info = self.env.reset(**given)
        return self._seen(0.0, False), info

    def step(self, action: Any) -> Any:
        """Turn by at most 45° a step, then drive until a contact; or declare."""
        if action == len(TURNS) and self._dict["confident"][0] < 1:
            action = 0
        if action == len(TURNS):
            return self._stepped([(0.0, 0.0, 1.0)], 0.0)
        turn = float(TURNS[action])
        parts = round(abs(turn) / (math.pi / 4))
        turning = [(0.0, turn / max(parts, 1), 0.0)] * parts
        return self._stepped([*turning, *[(0.2, 0.0, 0.0)] * DRIVES], turn)

    def _stepped(self, actions: list[tuple[float, float, float]], turn: float) -> Any:
        paid = 0.0
        for action in actions:
            given = np.clip(
                np.float32(action), self.env.action_space.low, self.env.action_space.high
            )
            self._dict, reward, terminated, truncated, info = self.env.step(given)
            paid += float(reward)
            if terminated or truncated or info["collided"]:
                break
        return self._seen(turn, info["collided"]), paid / 100, terminated, truncated, info

    def _seen(self, turn: float, collided: bool) -> Any:
        seen, room = self._dict, self.env.unwrapped
        clusters = np.float32([seen["best"], seen["second"]])
        expected = np.nan_to_num(room.lidar.ranges(room.floor_plan, clusters.T))
        scans = np.concatenate([seen["scan"], *expected]).clip(0, room.lidar.max_range)
        (x, y, heading), second = clusters
        dx, dy = second[:2] - (x, y)
        cosine, sine = math.cos(heading), math.sin(heading)
        ahead, left, apart = cosine * dx + sine * dy, cosine * dy - sine * dx, second[2] - heading
        spread = math.sqrt(np.trace(seen["covariance"][:2, :2]))
        rest = [
            ahead / METRES, left / METRES, math.cos(apart), math.sin(apart), spread / METRES,
            seen["best_share"][0], seen["second_share"][0], seen["entropy"][0] / METRES,
            seen["confident"][0], float(seen["confident"][0] == 1), seen["clock"][0],
            math.cos(turn), math.sin(turn), float(collided),
        ]  # fmt: skip
        return np.concatenate([scans / room.lidar.max_range, rest]).astype(np.float32).clip(-10, 10)


class Curve(BaseCallback):
    """Notes the end of each training episode, and keeps policy and notes.

    Args:
        files: of a number of decisions: that of the policy, and that of the notes.

    Attributes:
        points: steps of the environment done, return, whether the task was done; (k, 3).
    """

    def __init__(self, files: Callable[[int], tuple[Path, Path]]) -> None:
        super().__init__()
        self.points: list[tuple[int, float, bool]] = []
        self._files, self._done = files, 0

    def _on_rollout_start(self) -> None:
        if self.num_timesteps and self.num_timesteps % KEPT == 0:
            self._on_training_end()

    def _on_training_end(self) -> None:
        saved, curve = self._files(self.num_timesteps)
        np.save(curve, np.array(self.points, float))
        self.model.save(saved)

    def _on_step(self) -> bool:
        for info, ended in zip(self.locals["infos"], self.locals["dones"], strict=True):
            if ended:
                own = info["episode"]  # of the env within Motions
                self._done += own["l"]
                self.points.append((self._done, own["r"], info["is_success"]))
                if len(self.points) % 200 == 0:
                    _, returned, right = np.mean(self.points[-200:], axis=0)
                    print(
                        f"{self._done:>9,} steps: return {returned:7.1f}, {right:4.0%}", flush=True
                    )
        return True


def train(seed: int, decisions: int, files: Callable[[int], tuple[Path, Path]]) -> None:
    """Train a policy, and keep it and its episodes as ``Curve`` does."""
    envs = make_vec_env(
        "deqmcl_gym/Localize-v0", n_envs=ENVS, seed=seed, wrapper_class=Motions,
        env_kwargs={"floor_plan": TRAINED, "localizer": FASTER},
    )  # fmt: skip
    policy = PPO(
        "MlpPolicy", envs, seed=seed, n_steps=ROLLOUT, batch_size=128, n_epochs=8, gamma=0.99,
        ent_coef=0.01, learning_rate=5e-4, device="cpu",
    )  # fmt: skip
    policy.learn(decisions, callback=Curve(files))


def policy_of(seed: int, given: argparse.Namespace) -> tuple[Any, Evaluation]:
    """Train a policy, or read it if an earlier call has; return its curve and its scores."""
    torch.set_num_threads(1)  # the nets are small

    def files(decisions: int) -> tuple[Path, Path]:
        name = f"{seed}-{decisions}"
        return given.out / f"ppo-{name}.zip", given.out / f"curve-{name}.npy"

    saved, curve = files(given.decisions)
    if not saved.exists():
        train(seed, given.decisions, files)
    policy = PPO.load(saved, device="cpu")
    policy.__name__ = f"ppo, seed {seed}"
    torch.manual_seed(seed)
    options = {"episodes": given.episodes, "wrap": Motions, "deterministic": False}
    return np.load(curve), evaluate("Localize-v0", policy, **options)


def draw(curves: list[Any], file: str, window: int = 200) -> None:
    """Draw return and share of right episodes over the last ``window`` episodes, or over all."""
    window = min(window, *map(len, curves))
    plt.rcParams["svg.fonttype"] = "none"  # text stays text
    figure, (above, below) = plt.subplots(2, sharex=True, figsize=(6.4, 4.4), layout="constrained")
    for seed, (curve, color) in enumerate(
        zip(curves, ["#0072b2", "#d55e00", "#009e73"] * 9, strict=False)
    ):
        returned, right = (
            np.convolve(column, np.ones(window) / window, "valid") for column in curve.T[1:]
        )
        above.plot(curve[window - 1 :, 0] / 1000, returned, color=color, label=f"seed {seed}")
        below.plot(curve[window - 1 :, 0] / 1000, 100 * right, color=color)
    above.set(ylabel="mean return", title=f"PPO in Localize-v0, means of {window} episodes")
    below.set(ylabel="right declarations, %", xlabel="training steps, thousands")
    above.legend(frameon=False)
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file, metadata={"Date": None} if file.endswith(".svg") else None)


def main() -> None:
    """Train, score, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--decisions", type=int, default=20_480, help="of a training")
    parser.add_argument("--seeds", type=int, default=3, help="trainings: seeds 0, 1, …")
    parser.add_argument("--episodes", type=int, default=100, help="in which they are scored")
    parser.add_argument("--against", default="spin,wall-follower,four-deep", help="policies")
    parser.add_argument("--out", type=Path, default=Path("ppo-localize"), help="folder")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given = parser.parse_args()
    if given.decisions % (ENVS * ROLLOUT):
        parser.error(f"--decisions is {given.decisions}: give a multiple of {ENVS * ROLLOUT}")
    given.out.mkdir(exist_ok=True)
    with ProcessPoolExecutor(given.jobs) as pool:
        ours = list(pool.map(partial(policy_of, given=given), range(given.seeds)))
        score = partial(evaluate, "Localize-v0", episodes=given.episodes)
        others = list(pool.map(score, given.against.split(",")))
    draw([curve for curve, _ in ours], str(given.out / "curve.svg"))
    print(table([*(own for _, own in ours), *others]).round(2).to_csv(index=False))


if __name__ == "__main__":
    main()
