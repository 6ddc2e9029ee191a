"""
A policy that finds out where it is
===================================

PPO learns to act on a localizer's belief: ``python docs/examples/ppo_localize.py``.

It needs the extra ``rl``: ``pip install '.[rl]'`` in the clone. In ``deqmcl_gym/Localize-v0`` a
lost robot drives until it knows where it is, and says so. Training runs 64 rooms natively, with a
small filter, each episode in one of 1,000 offices; the scores are of other offices and of the
task's own filter, beside those of reference policies in the same episodes: see
`Train a policy <../acting.html>`_. It prints a table of all of them and draws the learning curves.
``--load`` scores policies that were kept before.
"""

# sphinx_gallery_thumbnail_path = 'docs/figures/localize.png'  # noqa: ERA001

import argparse
import math
import sys
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from acting.scores import table

import deqmcl_gym  # noqa: F401  # registers the environments
from benchmarks.evaluation import evaluate
from localizers.tasks import OFFICE

try:
    import matplotlib.pyplot as plt
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnv, VecMonitor
except ModuleNotFoundError as missing:
    sys.exit(f"{missing.name} is not installed: pip install '.[rl]' in the clone.")

TRAINED = {"office": {**OFFICE, "seeds": [1000, 2000]}}  # scored: 0, 1, …
FILTER = {"scan": "field", "localizer": {"name": "mcl", "particles": 5000}}  # of the training
QUARTER = math.pi / 4
#: what a decision does in four steps: turns, then metres driven
DECISIONS = np.array([
    [(0, 0.2), (0, 0.2), (0, 0.2), (0, 0.2)],
    [(QUARTER / 2, 0.2), (0, 0.2), (0, 0.2), (0, 0.2)],
    [(-QUARTER / 2, 0.2), (0, 0.2), (0, 0.2), (0, 0.2)],
    [(QUARTER, 0.0), (0, 0.2), (0, 0.2), (0, 0.2)],
    [(-QUARTER, 0.0), (0, 0.2), (0, 0.2), (0, 0.2)],
    [(QUARTER, 0.0), (QUARTER, 0.0), (0, 0.2), (0, 0.2)],
    [(-QUARTER, 0.0), (-QUARTER, 0.0), (0, 0.2), (0, 0.2)],
    [(QUARTER, 0.0), (QUARTER, 0.0), (QUARTER, 0.0), (QUARTER, 0.0)],
])  # fmt: skip
STEPS = DECISIONS.shape[1]
DECLARE = len(DECISIONS)
METRES = 10.0  # of lengths in what the policy sees
SCALE = 100.0  # of rewards
SIGMA = 0.5  # m, of the beams
FADING = 0.8  # of the mean misfit, from decision to decision
SIZE = 3 * 16 + 19


class Features:
    """What a policy sees of n robots: scans, those expected at both best clusters, and numbers.

    Args:
        lidar: of the robots.
        expected: returns the exact ranges at poses (n, 3), (n, B).
    """

    def __init__(self, lidar: Any, expected: Any) -> None:
        self._lidar, self._expected = lidar, expected

    def begin(self, rooms: Any, number: int) -> None:
        """Forget what was seen in the rooms of a mask, (n,)."""
        if not hasattr(self, "misfit"):
            self.misfit, self.sure = np.ones((number, 2)), np.zeros(number)
        self.misfit[rooms], self.sure[rooms] = 1.0, 0.0

    def __call__(self, seen: Any, turn: Any, collided: Any) -> Any:
        """Return (n, SIZE) from observations of n rooms, the last turn and contact of each."""
        most = self._lidar.max_range
        best, second = (np.asarray(seen[name], np.float64) for name in ("best", "second"))
        there = [np.nan_to_num(self._expected(poses)).clip(0, most) for poses in (best, second)]
        scan = np.nan_to_num(seen["scan"], posinf=most).clip(0, most)
        off = np.stack([np.abs(scan - own).clip(0, 3).mean(axis=1) for own in there], axis=1)
        self.misfit = FADING * self.misfit + (1 - FADING) * off / SIGMA
        confident = seen["confident"][:, 0]
        self.sure = np.where(confident >= 1, self.sure + 1, 0)
        cosine, sine = np.cos(best[:, 2]), np.sin(best[:, 2])
        dx, dy = (second - best)[:, :2].T
        apart = second[:, 2] - best[:, 2]
        spread = np.sqrt(seen["covariance"][:, [0, 1], [0, 1]].sum(axis=1))
        rest = [
            (cosine * dx + sine * dy) / METRES, (cosine * dy - sine * dx) / METRES,
            np.cos(apart), np.sin(apart), spread / METRES, seen["best_share"][:, 0],
            seen["second_share"][:, 0], seen["entropy"][:, 0] / METRES, confident,
            confident >= 1, seen["clock"][:, 0], np.cos(turn), np.sin(turn), collided,
            off[:, 0] / SIGMA, off[:, 1] / SIGMA, *self.misfit.T, np.minimum(self.sure, 20) / 20,
        ]  # fmt: skip
        values = np.concatenate([scan / most, *(own / most for own in there), np.stack(rest, 1)], 1)
        return values.astype(np.float32).clip(-10, 10)


class Decisions(gym.Wrapper):
    """A single env for the policy, which decides every fourth step, or declares when confident."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.action_space = gym.spaces.Discrete(DECLARE + 1)
        self.observation_space = gym.spaces.Box(-10, 10, (SIZE,), np.float32)

    def reset(self, **given: Any) -> Any:
        """Begin an episode."""
        self._seen, info = self.env.reset(**given)
        room: Any = self.env.unwrapped
        self._features = Features(
            room.lidar, lambda poses: room.lidar.ranges(room.floor_plan, poses.T.astype(np.float32))
        )
        self._features.begin(np.ones(1, bool), 1)
        return self._shown(0.0, False), info

    def step(self, action: Any) -> Any:
        """Carry out a decision, until a contact."""
        if action == DECLARE and self._seen["confident"][0] < 1:
            action = 0
        moves = [(0.0, 0.0)] if action == DECLARE else DECISIONS[action]
        paid, turned = 0.0, 0.0
        for turn, way in moves:
            given = np.array([way, turn, action == DECLARE], np.float32)
            low, high = self.env.action_space.low, self.env.action_space.high
            self._seen, reward, terminated, truncated, info = self.env.step(given.clip(low, high))
            paid, turned = paid + float(reward), turned + turn
            if terminated or truncated or info["collided"]:
                break
        shown = self._shown(turned, info["collided"])
        return shown, paid / SCALE, terminated, truncated, info

    def _shown(self, turn: float, collided: Any) -> Any:
        seen = {name: value[None] for name, value in self._seen.items()}
        return self._features(seen, np.array([turn]), np.array([float(collided)]))[0]


class ManyDecisions(VecEnv):
    """The same of many rooms at once; after a contact they rest until the next decision."""

    def __init__(self, rooms: Any, seed: int) -> None:
        self.rooms, self._seed = rooms, seed
        self._features = Features(rooms.lidar, rooms.ranges)
        self.penalty = 2.0 * rooms.max_steps  # of a wrong declaration
        box = gym.spaces.Box(-10, 10, (SIZE,), np.float32)
        super().__init__(rooms.num_envs, box, gym.spaces.Discrete(DECLARE + 1))

    def reset(self) -> Any:
        """Begin an episode in all rooms."""
        self._seen, _ = self.rooms.reset(seed=self._seed)
        everywhere = np.ones(self.num_envs, bool)
        self._features.begin(everywhere, self.num_envs)
        return self._features(self._seen, np.zeros(self.num_envs), np.zeros(self.num_envs))

    def step_async(self, actions: Any) -> None:
        """Take the decisions, (n,)."""
        unsure = self._seen["confident"][:, 0] < 1
        self._actions = np.where((actions == DECLARE) & unsure, 0, actions)

    def step_wait(self) -> Any:
        """Carry them out; where an episode ends, the next one begins, and rests up to 3 steps."""
        n, box = self.num_envs, self.rooms.single_action_space
        declared = self._actions == DECLARE
        moves = DECISIONS[np.where(declared, 0, self._actions)]
        paid, turned, collided = np.zeros((3, n))
        ended, infos = np.zeros(n, bool), [{} for _ in range(n)]
        for step in range(STEPS):
            driving = ~ended & (collided == 0)
            chosen = np.zeros((n, 3), np.float32)
            chosen[driving, 0], chosen[driving, 1] = (
                moves[driving, step, 1],
                moves[driving, step, 0],
            )
            chosen[declared & driving] = 0.0, 0.0, 1.0
            seen, rewards, terminated, truncated, told = self.rooms.step(
                chosen.clip(box.low, box.high)
            )
            wrong = declared & (rewards < -self.rooms.max_steps)
            rewards = np.where(wrong, -1.0 - self.penalty, rewards)
            paid += np.where(ended, 0.0, rewards)
            turned += np.where(driving, chosen[:, 1], 0.0)
            for room in np.flatnonzero((terminated | truncated) & ~ended):
                infos[room]["is_success"] = bool(told["final_info"]["is_success"][room])
                ended[room] = True
            collided = np.where(ended, 0.0, np.maximum(collided, told["collided"]))
        self._seen = seen
        turned[ended] = 0.0
        for room in np.flatnonzero(ended):
            infos[room]["terminal_observation"] = np.zeros(SIZE, np.float32)
            infos[room]["TimeLimit.truncated"] = False  # the clock is seen
        self._features.begin(ended, n)
        shown = self._features(seen, turned, collided)
        return shown, (paid / SCALE).astype(np.float32), ended, infos

    def close(self) -> None:
        """End the threads of the rooms."""
        self.rooms.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return what all rooms share."""
        return [getattr(self.rooms, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse."""
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        """Refuse."""
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """None is."""
        return [False] * self.num_envs


class Curve(BaseCallback):
    """Notes the end of each training episode: decisions done, return, whether it was right.

    A wrong declaration costs a third at first, and all from the middle of the training on: else the
    policy learns never to declare before it can tell right from wrong.
    """

    def __init__(self) -> None:
        super().__init__()
        self.points: list[tuple[int, float, bool]] = []

    def _on_rollout_start(self) -> None:
        envs = self.training_env.unwrapped
        share = 1 / 3 + 4 / 3 * self.num_timesteps / self.locals["total_timesteps"]
        envs.penalty = 2.0 * envs.rooms.max_steps * min(1.0, share)

    def _on_step(self) -> bool:
        for info, ended in zip(self.locals["infos"], self.locals["dones"], strict=True):
            if ended:
                own = SCALE * info["episode"]["r"], info["is_success"]
                self.points.append((self.num_timesteps, *own))
                if len(self.points) % 1000 == 0:
                    _, returned, right = np.mean(self.points[-1000:], axis=0)
                    print(
                        f"{self.num_timesteps:>9,} decisions: return {returned:7.1f}, {right:4.0%}",
                        flush=True,
                    )
        return True


def train(seed: int, decisions: int, rooms: int, out: Path) -> None:
    """Train a policy; keep it and its curve."""
    native = gym.make_vec(
        "deqmcl_gym/Localize-v0", num_envs=rooms, autoreset_mode="SameStep",
        floor_plan=TRAINED, **FILTER,
    )  # fmt: skip
    envs = VecMonitor(ManyDecisions(native, 1_000_000 * seed))
    policy = PPO(
        "MlpPolicy", envs, seed=seed, n_steps=64, batch_size=1024, n_epochs=5, gamma=0.995,
        gae_lambda=0.95, ent_coef=0.01, learning_rate=lambda left: 5e-4 * max(left, 0.05),
        policy_kwargs={"net_arch": [128, 128]}, device="cpu",
    )  # fmt: skip
    curve = Curve()
    policy.learn(decisions, callback=curve)
    np.save(out / f"curve-{seed}.npy", np.array(curve.points, float))
    policy.save(out / f"ppo-{seed}.zip")
    envs.close()


def draw(curves: list[Any], file: str, window: int = 1000) -> None:
    """Draw return and share of right episodes over the last ``window`` episodes, or over all."""
    window = min(window, *map(len, curves))
    plt.rcParams["svg.fonttype"] = "none"  # text stays text
    figure, (above, below) = plt.subplots(2, sharex=True, figsize=(6.4, 4.4), layout="constrained")
    colors = ["#0072b2", "#d55e00", "#009e73"] * 9
    for seed, (curve, color) in enumerate(zip(curves, colors, strict=False)):
        returned, right = (
            np.convolve(column, np.ones(window) / window, "valid") for column in curve.T[1:]
        )
        shown = slice(None, None, max(1, len(returned) // 300))
        done = curve[window - 1 :, 0][shown] / 1e6
        above.plot(done, returned[shown], color=color, label=f"seed {seed}")
        below.plot(done, 100 * right[shown], color=color)
    above.set(ylabel="mean return", title=f"PPO in Localize-v0, means of {window} episodes")
    below.set(ylabel="right declarations, %", xlabel="training decisions, millions")
    above.legend(frameon=False)
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file, metadata={"Date": None} if file.endswith(".svg") else None)


def main() -> None:
    """Train, score, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--decisions", type=int, default=3_000_000, help="of a training")
    parser.add_argument("--rooms", type=int, default=64)
    parser.add_argument("--seeds", default="0,1,2", help="of the trainings")
    parser.add_argument("--episodes", type=int, default=100, help="in which they are scored")
    parser.add_argument("--against", default="spin,wall-follower,four-deep", help="policies")
    parser.add_argument(
        "--load", type=Path, nargs="*", default=[], help="policies; none is trained"
    )
    parser.add_argument("--out", type=Path, default=Path("ppo-localize"), help="folder")
    given = parser.parse_args()
    torch.set_num_threads(1)  # the nets are small
    given.out.mkdir(parents=True, exist_ok=True)
    seeds = [] if given.load else given.seeds.split(",")
    for seed in seeds:
        train(int(seed), given.decisions, given.rooms, given.out)
    if seeds:
        curves = [np.load(given.out / f"curve-{seed}.npy") for seed in seeds]
        draw(curves, str(given.out / "curve.svg"))
    score = partial(evaluate, "Localize-v0", episodes=given.episodes)
    base = score("spin", reference=None)
    others = [score(name, reference=base) for name in given.against.split(",") if name != "spin"]
    for file in given.load or [given.out / f"ppo-{seed}.zip" for seed in seeds]:
        policy = PPO.load(file, device="cpu")
        policy.__name__ = file.stem
        others.append(score(policy, reference=base, wrap=Decisions))
    print(table([base, *others]).round(2).to_csv(index=False))


if __name__ == "__main__":
    main()
