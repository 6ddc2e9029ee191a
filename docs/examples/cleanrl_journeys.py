"""
Many rooms, one file
====================

PPO without a library, as in CleanRL: ``python docs/examples/cleanrl_journeys.py``.

It needs PyTorch and Matplotlib, as in the extra ``rl``: ``pip install '.[rl]'`` in the clone. The
native vector env of ``deqmcl_gym/Journey-v1`` runs 64 rooms, each episode in another of 1,000
offices. The policy sees the scan and the next actions of the driver's plan, all in [-1, 1], and
acts in [-1, 1]. It is scored in 100 episodes in other offices, beside ``plan``, which carries out
the first planned action. The script prints a table and draws the learning curves.

Rooms restart with ``autoreset_mode="SameStep"``: ``step`` returns the first observation of the next
episode, and the last one of the old in ``info["final_obs"]``. After a termination nothing is left
to be earned; after a truncation the value of the last observation is.
"""

import argparse
import math
import sys
import time
from typing import Any

import gymnasium as gym
import numpy as np

import deqmcl_gym  # noqa: F401  # registers the rooms

try:
    import matplotlib.pyplot as plt
    import torch
    from torch import nn
    from torch.distributions import Normal
except ModuleNotFoundError as missing:
    sys.exit(f"{missing.name} is not installed: pip install '.[rl]' in the clone.")

TRAINED, UNSEEN = [1000, 2000], [0, 1000]  # seeds of offices
AHEAD = 5  # planned actions that are seen
STEPS = 64  # of each room, from one update to the next
EPOCHS, BATCH = 4, 512  # of an update
RATE, GAMMA, LAMBDA, CLIP = 1e-3, 0.99, 0.95, 0.2
COLORS = ["#0072b2", "#d55e00", "#009e73"]


def make(rooms: int, offices: list[int]) -> Any:
    """Return rooms in offices of a range of seeds."""
    return gym.make_vec(
        "deqmcl_gym/Journey-v1", num_envs=rooms, floor_plan={"office": {"seeds": offices}},
        horizon=AHEAD, autoreset_mode="SameStep",
    )  # fmt: skip


class Policy(nn.Module):
    """Normal actions with a mean by one net, and a value by another.

    Args:
        envs: say how large observations and actions are, and their bounds.
    """

    def __init__(self, envs: Any) -> None:
        super().__init__()
        self.box, spaces = envs.single_action_space, envs.single_observation_space
        self.reach = float(spaces["scan"].high[0])
        seen = spaces["scan"].shape[0] + 2 * AHEAD
        self.actor, self.critic = _net(seen, 2, 0.01), _net(seen, 1, 1.0)
        self.log_sd = nn.Parameter(torch.full((2,), -0.5))

    def seen(self, shown: dict[str, Any]) -> torch.Tensor:
        """Return scan and plan of observations as rows in [-1, 1]."""
        low, high = self.box.low, self.box.high
        plan = 2 * (shown["plan"] - low) / (high - low) - 1
        scan = 2 * shown["scan"] / self.reach - 1
        return torch.as_tensor(np.concatenate([scan, plan.reshape(len(scan), -1)], axis=1))

    def commands(self, actions: torch.Tensor) -> Any:
        """Return actions, cut off at -1 and 1, as the rooms take them."""
        low, high = self.box.low, self.box.high
        share = (actions.clamp(-1, 1).numpy() + 1) / 2
        return np.clip(low + share * (high - low), low, high)  # again: rounding

    def density(self, seen: torch.Tensor) -> Normal:
        """Return that of the actions, each number its own."""
        return Normal(self.actor(seen), self.log_sd.exp())

    def value(self, seen: torch.Tensor) -> torch.Tensor:
        """Return what is expected to be earned from here on, discounted."""
        return self.critic(seen).squeeze(-1)


def _net(size: int, out: int, gain: float) -> nn.Sequential:
    """Two layers of 64 tanh, with orthogonal weights."""
    layers = [nn.Linear(size, 64), nn.Linear(64, 64), nn.Linear(64, out)]
    for layer, scale in zip(layers, (math.sqrt(2), math.sqrt(2), gain), strict=True):
        nn.init.orthogonal_(layer.weight, scale)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(layers[0], nn.Tanh(), layers[1], nn.Tanh(), layers[2])


def trained(seed: int, steps: int, rooms: int) -> tuple[Policy, Any]:
    """Train a policy; return it, and of each episode (steps so far, return, arrived), (k, 3)."""
    torch.manual_seed(seed)
    envs = make(rooms, TRAINED)
    policy = Policy(envs)
    optimizer = torch.optim.Adam(policy.parameters(), RATE, eps=1e-5)
    shown, _ = envs.reset(seed=seed * rooms)
    seen, returned, episodes = policy.seen(shown), np.zeros(rooms), []
    updates, began = max(steps // (STEPS * rooms), 1), time.monotonic()
    for update in range(updates):
        optimizer.param_groups[0]["lr"] = RATE * (1 - update / updates)
        saw = torch.zeros(STEPS, rooms, seen.shape[1])
        did = torch.zeros(STEPS, rooms, 2)
        likely, values, earned, ended = torch.zeros(4, STEPS, rooms)
        for step in range(STEPS):
            with torch.no_grad():
                density, values[step] = policy.density(seen), policy.value(seen)
                saw[step], did[step] = seen, density.sample()
                likely[step] = density.log_prob(did[step]).sum(-1)
            shown, rewards, terminated, truncated, info = envs.step(policy.commands(did[step]))
            earned[step] = torch.as_tensor(rewards)
            over = terminated | truncated
            ended[step] = torch.as_tensor(over)
            cut = np.flatnonzero(truncated & ~terminated)
            if cut.size:  # what would have come is worth what the critic says of it
                last = [info["final_obs"][room] for room in cut]
                there = policy.seen({key: np.stack([one[key] for one in last]) for key in shown})
                with torch.no_grad():
                    earned[step, cut] += GAMMA * policy.value(there)
            returned += rewards
            done = (update * STEPS + step + 1) * rooms
            episodes += [(done, returned[room], terminated[room]) for room in np.flatnonzero(over)]
            returned[over] = 0.0
            seen = policy.seen(shown)
        with torch.no_grad():
            gains = advantages(earned, values, ended, policy.value(seen))
        rows = [part.flatten(0, 1) for part in (saw, did, likely, gains, gains + values)]
        improve(policy, optimizer, rows)
        if (update + 1) % 20 == 0 and episodes:
            _, mean, arrived = np.mean(episodes[-200:], axis=0)
            rate = done / (time.monotonic() - began)
            print(
                f"{done:>9,} steps: return {mean:6.1f}, {arrived:4.0%} arrive, {rate:,.0f} steps/s",
                flush=True,
            )
    return policy, np.array(episodes, float).reshape(-1, 3)


def advantages(
    earned: torch.Tensor, values: torch.Tensor, ended: torch.Tensor, after: torch.Tensor
) -> torch.Tensor:
    """Generalized advantage estimates, (steps, rooms).

    Args:
        earned: rewards; in the step of a truncation with the discounted value of what it ended in.
        values: of what was seen before each step.
        ended: 1 where an episode ended with the step, else 0.
        after: value of what is seen after the last step, (rooms,).
    """
    found, gain = torch.zeros_like(earned), torch.zeros_like(after)
    for step in reversed(range(len(earned))):
        goes_on = GAMMA * (1 - ended[step])
        gain = earned[step] + goes_on * after - values[step] + LAMBDA * goes_on * gain
        found[step], after = gain, values[step]
    return found


def improve(policy: Policy, optimizer: torch.optim.Optimizer, rows: list[torch.Tensor]) -> None:
    """PPO's clipped objective, and the squared error of the value."""
    for _ in range(EPOCHS):
        for chosen in torch.randperm(len(rows[0])).split(BATCH):
            saw, did, likely, gains, returns = (part[chosen] for part in rows)
            gains = (gains - gains.mean()) / (gains.std() + 1e-8)
            ratio = (policy.density(saw).log_prob(did).sum(-1) - likely).exp()
            better = torch.minimum(ratio * gains, ratio.clamp(1 - CLIP, 1 + CLIP) * gains)
            error = (policy.value(saw) - returns).square().mean()
            optimizer.zero_grad()
            (0.5 * error - better.mean()).backward()
            nn.utils.clip_grad_norm_(policy.parameters(), 0.5)
            optimizer.step()


def scored(act: Any, episodes: int) -> Any:
    """Play the first episode of each room; return (return, arrived, contacts, steps), (k, 4)."""
    envs = make(episodes, UNSEEN)
    shown, _ = envs.reset(seed=0)
    scores, driving = np.zeros((episodes, 4)), np.ones(episodes, bool)
    while driving.any():
        shown, rewards, terminated, truncated, info = envs.step(act(shown))
        collided = info["collided"].copy()
        if "final_info" in info:  # rooms that have begun again say here what ended
            over = info["_final_info"]
            collided[over] = info["final_info"]["collided"][over]
        scores[driving] += np.stack([rewards, terminated, collided, np.ones(episodes)], 1)[driving]
        driving &= ~(terminated | truncated)
    return scores


def mean_action(policy: Policy) -> Any:
    """Return the function that acts without chance."""

    @torch.no_grad()
    def act(shown: dict[str, Any]) -> Any:
        return policy.commands(policy.actor(policy.seen(shown)))

    return act


def draw(curves: list[Any], file: str, window: int = 100) -> None:
    """Draw return and share of arrivals over the last ``window`` training episodes."""
    plt.rcParams["svg.fonttype"] = "none"  # text stays text
    window = min(window, *map(len, curves))
    figure, (above, below) = plt.subplots(2, sharex=True, figsize=(6.4, 4.4), layout="constrained")
    for seed, curve in enumerate(curves):
        kept = slice(window - 1, None, max(len(curve) // 200, 1))
        steps, mean, arrived = (
            np.convolve(column, np.ones(window) / window)[: len(curve)][kept] for column in curve.T
        )
        steps, color = curve[kept, 0] / 1000, COLORS[seed % 3]
        above.plot(steps, mean, color=color, label=f"seed {seed}")
        below.plot(steps, 100 * arrived, color=color)
    above.set(ylabel="mean return", title=f"PPO in Journey-v1, means of {window} episodes")
    below.set(ylabel="arrive, %", xlabel="training steps, thousands", ylim=(-5, 105))
    above.legend(frameon=False)
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file, metadata={"Date": None} if file.endswith(".svg") else None)


def main() -> None:
    """Train, score, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=500_000, help="of a training, all rooms")
    parser.add_argument("--rooms", type=int, default=64)
    parser.add_argument("--seeds", type=int, default=3, help="trainings: seeds 0, 1, …")
    parser.add_argument("--episodes", type=int, default=100, help="in which they are scored")
    parser.add_argument("--curve", default="cleanrl-journeys.svg", help="file of the curves")
    given = parser.parse_args()
    torch.set_num_threads(1)  # the nets are small
    trainings = [trained(seed, given.steps, given.rooms) for seed in range(given.seeds)]
    agents = {f"PPO, seed {seed}": mean_action(one) for seed, (one, _) in enumerate(trainings)}
    agents["plan"] = lambda shown: shown["plan"][:, 0]
    print("| policy | return | arrive | contacts | steps |\n|---|---:|---:|---:|---:|")
    for name, act in agents.items():
        scores = scored(act, given.episodes)
        mean, error = scores.mean(axis=0), 2 * scores[:, 0].std() / math.sqrt(len(scores))
        print(f"| {name} | {mean[0]:.1f} ± {error:.1f} | {mean[1]:.0%} | {mean[2]:.1f} "
              f"| {mean[3]:.0f} |", flush=True)  # fmt: skip
    draw([curve for _, curve in trainings], given.curve)


if __name__ == "__main__":
    main()
