"""
A policy that finds out where it is
===================================

PPO learns to act on a localizer's belief: ``python docs/examples/ppo_localize.py``.

It needs the extra ``rl``: ``pip install '.[rl]'`` in the clone; with ``--load`` nothing. In
``deqmcl_gym/Localize-v0`` a lost robot drives until it knows where it is, and says so. Training
has three parts, all in offices that are not scored:

1. PPO learns to drive in 64 rooms at once, with a filter that looks ranges up. An episode ends as
   soon as a declaration would be right.
2. A small net learns how probable it is that a confident belief is right, from how well scans have
   fitted it, in episodes that go on to their end.
3. The robot declares if p is at least 1 - k (steps left) / (2 x steps): if what a wrong declaration
   would cost is below a share k of what is still to be paid. k is what would have earned most in
   episodes with the task's own filter.

It prints scores beside those of reference policies in the same episodes, and draws the learning
curves. ``--load`` scores policies that were kept before.
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

OFFICES = {"office": {**OFFICE, "seeds": [1000, 1250]}}  # of training; scored: 0, 1, …
FILTER = {"scan": "table", "localizer": {"name": "mcl", "particles": 5000}}  # of training
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
SIGMA = 0.5  # m, of the beams
FADING = 0.9, 0.97  # of mean misfits, from step to step
SLACK = 1.1  # misfit, in SIGMA, from which on a sum of them grows
SIZE = 3 * 16 + 21
CONFIDENT, CLOCK = 3 * 16 + 9, 3 * 16 + 11  # of what it sees
SCALE = 100.0  # of rewards
SHARES = np.linspace(0.05, 1.0, 20)  # of what is still to be paid: k


class Features:
    """What a policy sees of n robots: scans, those expected at both best clusters, and numbers.

    Args:
        number: of robots.
        lidar: of the robots.
        expected: returns the exact ranges at poses (n, 3), (n, B).
    """

    def __init__(self, number: int, lidar: Any, expected: Any) -> None:
        self._most, self._expected = lidar.max_range, expected
        self._means = np.zeros((number, 2, len(FADING)))
        self._sums, self._sure = np.zeros((number, 2)), np.zeros(number)

    def begin(self, rooms: Any) -> None:
        """Forget what was seen in the rooms of a mask, (n,)."""
        self._means[rooms], self._sums[rooms], self._sure[rooms] = 1.0, 0.0, 0.0

    def look(self, seen: Any) -> None:
        """Take note of an observation of each room."""
        self._seen = seen
        poses = np.stack([seen["best"], seen["second"]], axis=1).astype(np.float64)
        scan = np.nan_to_num(seen["scan"], posinf=self._most).clip(0, self._most)
        exact = [np.nan_to_num(self._expected(poses[:, i])) for i in (0, 1)]
        self._there = [ranges.clip(0, self._most) for ranges in exact]
        self._scan, self._poses = scan, poses
        off = [np.abs(scan - ranges).clip(0, 3).mean(axis=1) / SIGMA for ranges in self._there]
        self._off = np.stack(off, axis=1)
        for i, fading in enumerate(FADING):
            self._means[..., i] += (1 - fading) * (self._off - self._means[..., i])
        self._sums = np.maximum(self._sums + self._off - SLACK, 0.0).clip(max=40)
        self._sure = np.where(seen["confident"][:, 0] >= 1, self._sure + 1, 0)

    def shown(self, turned: Any, collided: Any) -> Any:
        """Return (n, SIZE), given the last turn and contact of each."""
        seen, (best, second) = self._seen, np.moveaxis(self._poses, 1, 0)
        cosine, sine = np.cos(best[:, 2]), np.sin(best[:, 2])
        dx, dy = (second - best)[:, :2].T
        apart = second[:, 2] - best[:, 2]
        spread = np.sqrt(seen["covariance"][:, [0, 1], [0, 1]].sum(axis=1))
        numbers = [
            (cosine * dx + sine * dy) / METRES, (cosine * dy - sine * dx) / METRES,
            np.cos(apart), np.sin(apart), spread / METRES, seen["best_share"][:, 0],
            seen["second_share"][:, 0], seen["entropy"][:, 0] / METRES, seen["confident"][:, 0],
            self._sure > 0, self._sure / 100, seen["clock"][:, 0], np.cos(turned), np.sin(turned),
            collided, *self._means.reshape(len(best), -1).T, *(self._sums.T / 10),
        ]  # fmt: skip
        scans = [ranges / self._most for ranges in (self._scan, *self._there)]
        return np.concatenate([*scans, np.stack(numbers, 1)], 1).astype(np.float32).clip(-10, 10)


class Decisions(gym.Wrapper[Any, Any, Any, Any]):
    """A single env for the policy, which decides every fourth step, or declares."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.action_space = gym.spaces.Discrete(DECLARE + 1)
        self.observation_space = gym.spaces.Box(-10, 10, (SIZE,), np.float32)

    def reset(self, **given: Any) -> Any:
        """Begin an episode."""
        seen, info = self.env.reset(**given)
        room: Any = self.env.unwrapped
        self._features = Features(
            1, room.lidar, lambda poses: room.lidar.ranges(room.floor_plan, np.float32(poses.T))
        )
        self._features.begin([True])
        return self._shown(seen, 0.0, False), info

    def step(self, action: Any) -> Any:
        """Carry out a decision, until a contact."""
        moves = [(0.0, 0.0)] if action == DECLARE else DECISIONS[action]
        low, high = self.env.action_space.low, self.env.action_space.high
        paid, turned = 0.0, 0.0
        for turn, way in moves:
            given = np.array([way, turn, action == DECLARE], np.float32)
            seen, reward, terminated, truncated, info = self.env.step(given.clip(low, high))
            paid, turned = paid + float(reward), turned + turn
            shown = self._shown(seen, turned, info["collided"])
            if terminated or truncated or info["collided"]:
                break
        return shown, paid, terminated, truncated, info

    def _shown(self, seen: Any, turned: float, collided: Any) -> Any:
        self._features.look({name: value[None] for name, value in seen.items()})
        return self._features.shown(np.array([turned]), np.array([float(collided)]))[0]


class Rooms(gym.vector.VectorEnv[Any, Any, Any]):
    """Many rooms at once for the policy; after a contact they rest until the next decision.

    Nobody declares, but an episode ends as soon as a declaration would be right, if ``helped``.
    """

    def __init__(self, number: int, *, helped: bool = True) -> None:
        self.envs: Any = gym.make_vec(
            "deqmcl_gym/Localize-v0", num_envs=number, autoreset_mode="SameStep",
            floor_plan=OFFICES, **FILTER,
        )  # fmt: skip
        self.num_envs, self.metadata = number, self.envs.metadata
        self.single_observation_space = gym.spaces.Box(-10, 10, (SIZE,), np.float32)
        self.single_action_space = gym.spaces.Discrete(DECLARE)
        self._features = Features(number, self.envs.lidar, self.envs.ranges)
        self._helped, self.right = helped, np.zeros(number, np.int64)  # steps in a row

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        """Begin an episode in all rooms."""
        seen, told = self.envs.reset(seed=seed)
        self._look(seen, told, np.ones(self.num_envs, bool))
        none = np.zeros(self.num_envs)
        return self._features.shown(none, none), {}

    def _look(self, seen: Any, told: Any, begun: Any) -> None:
        self._features.begin(begun)
        self._features.look(seen)
        off = seen["best"] - told["truth"]
        near = np.hypot(off[:, 0], off[:, 1]) <= 1.0
        near &= np.abs((off[:, 2] + np.pi) % (2 * np.pi) - np.pi) <= math.radians(30)
        self.right[begun] = 0
        self.right = np.where(near & (seen["best_share"][:, 0] > 0.9), self.right + 1, 0)

    def step(self, actions: Any) -> Any:
        """Carry out a decision in each room; where an episode ends, the next one begins."""
        n, space = self.num_envs, self.envs.single_action_space
        paid, turned, collided = np.zeros((3, n))
        ended, success = np.zeros((2, n), bool)
        for turns, ways in DECISIONS[actions].transpose(1, 2, 0):
            driving = ~ended & (collided == 0)
            declared = ~ended & (self.right >= 30) & self._helped
            chosen = np.stack([ways * driving, turns * driving, declared], axis=1)
            chosen = chosen.astype(np.float32).clip(space.low, space.high)
            seen, rewards, terminated, truncated, told = self.envs.step(chosen)
            now = (terminated | truncated) & ~ended
            paid += np.where(ended, 0.0, rewards)
            turned += turns * driving
            success |= now & terminated
            ended |= now
            collided = np.where(ended, 0.0, np.maximum(collided, told["collided"]))
            self._look(seen, told, now)
        shown = self._features.shown(np.where(ended, 0.0, turned), collided)
        last = np.full(n, None, dtype=object)
        for room in np.flatnonzero(ended):
            last[room] = shown[room]
        final = {"final_obs": last, "final_info": {"is_success": success}}
        return shown, paid / SCALE, ended, np.zeros(n, bool), final


class Policy:
    """Drives by one net and declares by another, which both are in a file."""

    def __init__(self, weights: dict[str, Any]) -> None:
        self._weights = weights
        self.share = float(weights["share"])

    @classmethod
    def load(cls, file: Path) -> "Policy":
        """Read a policy."""
        with np.load(file) as weights:
            return cls({name: weights[name].astype(np.float32) for name in weights})

    def _net(self, name: str, values: Any) -> Any:
        for layer in (0, 1, 2):
            values = values @ self._weights[f"{name}{layer}"].T + self._weights[f"{name}{layer}b"]
            values = np.tanh(values) if layer < 2 else values
        return values

    def drive(self, shown: Any, rng: Any = None) -> Any:
        """Return the best decision given (…, SIZE), or one drawn."""
        logits = self._net("drive", shown)
        return np.argmax(logits if rng is None else logits + rng.gumbel(size=logits.shape), axis=-1)

    def sure(self, shown: Any) -> Any:
        """Return the probability that the belief is right, 0 if it is not confident."""
        p = 1 / (1 + np.exp(-self._net("sure", shown)[..., 0]))
        return np.where(shown[..., CONFIDENT] > 0, p, 0.0)

    def predict(self, shown: Any, state: Any = None, **_: Any) -> Any:
        """Return a decision, as a model of Stable-Baselines3 does."""
        left = 1.0 - shown[..., CLOCK]
        declared = self.sure(shown) >= 1 - self.share * left / 2
        return np.where(declared, DECLARE, self.drive(shown)), state


def train(seed: int, decisions: int, rooms: int, out: Path) -> None:
    """Train a policy; keep it and its curve."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor

    import deqmcl_gym.sb3

    torch.set_num_threads(1)  # the nets are small
    envs = VecMonitor(deqmcl_gym.sb3.Rooms(Rooms(rooms)))
    model = PPO(
        "MlpPolicy", envs, seed=seed, n_steps=64, batch_size=1024, n_epochs=5, gamma=0.99,
        gae_lambda=0.95, ent_coef=0.01, learning_rate=lambda left: 5e-4 * max(left, 0.05),
        policy_kwargs={"net_arch": [64, 64]}, device="cpu",
    )  # fmt: skip
    points: list[tuple[int, float, bool]] = []  # decisions, return, whether right

    def note(known: dict[str, Any], _: Any) -> bool:
        for info, ended in zip(known["infos"], known["dones"], strict=True):
            if ended:
                said = SCALE * info["episode"]["r"], info["is_success"]
                points.append((known["self"].num_timesteps, *said))
                if len(points) % 1000 == 0:
                    _, paid, right = np.mean(points[-1000:], axis=0)
                    print(f"{points[-1][0]:>9,} decisions: return {paid:6.1f}, {right:4.0%} right")
        return True

    model.learn(decisions, callback=note)
    envs.close()
    np.save(out / f"curve-{seed}.npy", np.array(points, float))
    nets = model.policy.mlp_extractor.policy_net, model.policy.action_net
    weights = _weights("drive", [nets[0][0], nets[0][2], nets[1]])
    weights |= _sure(Policy(weights | {"share": 0.0}), seed, rooms, max(75, decisions // 400))
    policy = Policy(weights | {"share": 0.0})
    weights["share"] = _share(policy, range(1000, 1000 + max(1, decisions // 10_000)))
    np.savez(out / f"ppo-{seed}.npz", **{n: np.asarray(w, np.float16) for n, w in weights.items()})


def _weights(name: str, layers: Any) -> dict[str, Any]:
    """Return the weights of three layers as arrays."""
    weights = {}
    for i, layer in enumerate(layers):
        weights[f"{name}{i}"] = layer.weight.detach().numpy()
        weights[f"{name}{i}b"] = layer.bias.detach().numpy()
    return weights


def _sure(policy: Policy, seed: int, number: int, decisions: int) -> dict[str, Any]:
    """Train the net that knows how probable it is that a confident belief is right."""
    import torch
    from torch import nn

    rng = np.random.default_rng(seed)
    rooms = Rooms(number, helped=False)
    shown, _ = rooms.reset(seed=1_000_000 + seed)
    given, labels = [], []
    for _ in range(decisions):
        shown, *_ = rooms.step(policy.drive(shown, rng))
        confident = shown[:, CONFIDENT] > 0
        given.append(shown[confident])
        labels.append(rooms.right[confident] >= 30)
    rooms.close()
    inputs = torch.from_numpy(np.concatenate(given))
    truth = torch.from_numpy(np.concatenate(labels).astype(np.float32))
    torch.manual_seed(seed)
    net = nn.Sequential(
        nn.Linear(SIZE, 32), nn.Tanh(), nn.Linear(32, 32), nn.Tanh(), nn.Linear(32, 1)
    )
    optimizer = torch.optim.AdamW(net.parameters(), 2e-3, weight_decay=1e-2)
    rounds = 10 * len(inputs) // 1024 + 1
    schedule = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.05, rounds)
    for _ in range(rounds):
        rows = torch.from_numpy(rng.integers(len(inputs), size=1024))
        loss = nn.functional.binary_cross_entropy_with_logits(net(inputs[rows])[:, 0], truth[rows])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    print(f"whether {len(inputs):,} confident beliefs are right: cross entropy {loss:.3f}")
    return _weights("sure", net[::2])


def _share(policy: Policy, seeds: range) -> float:
    """Return the k that would have earned most, with the task's own filter."""
    paid = np.zeros((len(seeds), len(SHARES)))
    for row, seed in enumerate(seeds):
        env = gym.make("deqmcl_gym/Localize-v0", floor_plan=OFFICES)
        room: Any = env.unwrapped
        driven = Decisions(env)
        shown, _ = driven.reset(seed=seed)
        left, total, ended = np.ones(len(SHARES), bool), 0.0, False
        while left.any() and not ended:
            now = left & (policy.sure(shown) >= 1 - SHARES * (1 - shown[CLOCK]) / 2)
            wrong = 0.0 if room._right >= room.hold else 2.0 * room.max_steps
            paid[row, now] = total - 1.0 - wrong
            left &= ~now
            shown, reward, terminated, truncated, _ = driven.step(policy.drive(shown))
            total, ended = total + reward, terminated or truncated
        paid[row, left] = total
    print(f"returns by k in {len(seeds)} episodes of training: {paid.mean(axis=0).round(0)}")
    return float(SHARES[paid.mean(axis=0).argmax()])


def draw(curves: list[Any], file: str, window: int = 1000) -> None:
    """Draw return and share of right episodes over the last ``window`` episodes, or over all."""
    import matplotlib.pyplot as plt

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
    below.set(ylabel="right beliefs, %", xlabel="training decisions, millions")
    above.legend(frameon=False)
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file, metadata={"Date": None} if file.endswith(".svg") else None)


def main() -> None:
    """Train, score, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--decisions", type=int, default=500_000, help="of a training")
    parser.add_argument("--rooms", type=int, default=64)
    parser.add_argument("--seeds", default="0,1,2", help="of the trainings")
    parser.add_argument("--episodes", type=int, default=100, help="in which they are scored")
    parser.add_argument(
        "--against",
        default="wall-follower,spin,four-deep",
        help="policies; gains are above the first",
    )
    parser.add_argument(
        "--load", type=Path, nargs="*", default=[], help="policies; none is trained"
    )
    parser.add_argument("--out", type=Path, default=Path("ppo-localize"), help="folder")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    seeds = [] if given.load else given.seeds.split(",")
    try:
        for seed in seeds:
            train(int(seed), given.decisions, given.rooms, given.out)
        if seeds:
            curves = [np.load(given.out / f"curve-{seed}.npy") for seed in seeds]
            draw(curves, str(given.out / "curve.svg"))
    except ModuleNotFoundError as missing:
        sys.exit(f"{missing.name} is not installed: pip install '.[rl]' in the clone.")
    score = partial(evaluate, "Localize-v0", episodes=given.episodes)
    first, *names = given.against.split(",")
    base = score(first, reference=None)
    others = [score(name, reference=base) for name in names]
    for file in given.load or [given.out / f"ppo-{seed}.npz" for seed in seeds]:
        policy: Any = Policy.load(file)
        policy.__name__ = file.stem
        others.append(score(policy, reference=base, wrap=Decisions))
    print(table([base, *others]).round(2).to_csv(index=False))


if __name__ == "__main__":
    main()
