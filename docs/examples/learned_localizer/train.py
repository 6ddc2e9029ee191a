"""Train the learned localizer: ``python docs/examples/learned_localizer/train.py``.

Needs the extra ``rl``: ``pip install '.[rl]'`` in the clone. Laps are driven in
``deqmcl_gym/Sharp-v0``, 64 rooms at once, from starts all around the lap. Each start is a draw from
the prior that the benchmark tells its filters, and the net begins at its mean. The loss is the
negative log-likelihood of the true pose under the answer, by truncated backpropagation through
time.
"""

import argparse
import sys
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
from learned import BEAM, CORRECTION, HIDDEN, TOLD, compared, moved

import deqmcl_gym  # noqa: F401  # registers the rooms
from localizers import RobotModel

try:
    import torch
    from torch import nn
except ModuleNotFoundError as missing:
    sys.exit(f"{missing.name} is not installed: pip install '.[rl]' in the clone.")

ROOM = "deqmcl_gym/Sharp-v0"
ROOMS = 64
WINDOW = 17  # steps between two steps of the optimizer


class Net(nn.Module):
    """What ``learned.Learned`` computes in NumPy."""

    def __init__(self) -> None:
        super().__init__()
        self.beam = nn.Sequential(nn.Linear(BEAM, 16), nn.ReLU(), nn.Linear(16, 1))
        self.memory = nn.GRUCell(TOLD, HIDDEN)
        self.answer = nn.Linear(HIDDEN, 4)
        nn.init.zeros_(self.answer.weight)  # begins as a filter of constant gain

    def forward(
        self, beams: torch.Tensor, used: torch.Tensor, command: torch.Tensor, state: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return the new state, the correction (n, 3), its precision (n, 3, 3), the log spread."""
        off, slopes = beams[..., 0], beams[..., 2:5]
        trust = self.beam(beams)[..., 0].exp() * used
        weighed = trust[..., None] * slopes
        seen = weighed.transpose(1, 2) @ slopes
        pull = (weighed * off[..., None]).sum(dim=1)
        size = torch.diagonal(seen, dim1=1, dim2=2)
        state = self.memory(torch.cat([command, size.log1p(), pull / (size + 1)], dim=1), state)
        answer = self.answer(state)
        precision = seen + torch.diag_embed(answer[:, :3].exp())
        return state, torch.linalg.solve(precision, pull), precision, answer[:, 3]


def lap(net: Net, optimizer: torch.optim.Optimizer, rng: np.random.Generator, steps: int) -> float:
    """Drive a lap in all rooms, learning on the way; return the mean error, px."""
    path = gym.make(ROOM).unwrapped.course.path
    start = {"pose": path.at(rng.uniform(0, path.length)), "sd_position": 10.0, "sd_heading": 0.1}
    rooms = gym.make_vec(ROOM, num_envs=ROOMS, start=start, horizon=1, ends_at_goal=False)
    robot = RobotModel(floor_plan=rooms.floor_plan, lidar=rooms.lidar)
    _, info = rooms.reset(seed=int(rng.integers(2**31)))
    pose = torch.tile(torch.tensor(rooms.course.start, dtype=torch.float32), (ROOMS, 1))
    state = torch.zeros(ROOMS, HIDDEN)
    scale = torch.tensor(CORRECTION, dtype=torch.float32)
    loss, errors = torch.zeros(()), []
    for step in range(1, min(steps, len(rooms.plan)) + 1):
        scans, *_, info = rooms.step(info["planned_actions"][:, 0])
        action = info["command"].astype(np.float64)
        before = pose.detach().numpy().astype(np.float64)
        beams, used = compared(robot, after := moved(before, action), scans.astype(np.float64))
        pose = pose + torch.tensor(after - before, dtype=torch.float32)
        state, by, precision, spread = net(
            *(torch.tensor(part, dtype=torch.float32) for part in (beams, used)),
            torch.tensor(action / (10, 1), dtype=torch.float32),
            state,
        )
        pose = pose + in_the_room(by * scale, pose[:, 2])
        off = in_the_frame(torch.tensor(info["truth"], dtype=torch.float32) - pose, pose[:, 2])
        root = torch.linalg.cholesky(precision)
        far = ((off / scale)[:, None] @ root)[:, 0] / spread.exp()[:, None]
        log_root = torch.diagonal(root, dim1=1, dim2=2).log().sum(dim=1)
        surprise = 0.5 * (far**2).sum(dim=1) + 3 * spread - log_root
        loss = loss + surprise.clamp(max=50.0).mean()
        errors.append(float(off[:, :2].detach().norm(dim=1).mean()))
        if step % WINDOW == 0:
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(net.parameters(), 5.0)
            optimizer.step()
            loss, pose, state = torch.zeros(()), pose.detach(), state.detach()
    return float(np.mean(errors))


def in_the_room(by: torch.Tensor, heading: torch.Tensor) -> torch.Tensor:
    """Turn (ahead, left, turn) into (x, y, θ), (n, 3)."""
    sine, cosine = heading.sin(), heading.cos()
    x, y = cosine * by[:, 0] - sine * by[:, 1], sine * by[:, 0] + cosine * by[:, 1]
    return torch.stack([x, y, by[:, 2]], dim=1)


def in_the_frame(by: torch.Tensor, heading: torch.Tensor) -> torch.Tensor:
    """Turn (x, y, θ) into (ahead, left, turn), turns in [-π, π], (n, 3)."""
    off = in_the_room(by, -heading)
    turn = torch.atan2(off[:, 2].sin(), off[:, 2].cos())
    return torch.cat([off[:, :2], turn[:, None]], dim=1)


def main() -> None:
    """Train and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laps", type=int, default=120, help="of all rooms")
    parser.add_argument("--steps", type=int, default=10_000, help="of a lap, at most")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", default=str(Path(__file__).with_name("learned.npz")))
    given = parser.parse_args()
    torch.set_num_threads(1)  # the nets are small
    torch.manual_seed(given.seed)
    rng, net, began = np.random.default_rng(given.seed), Net(), time.perf_counter()
    optimizer = torch.optim.Adam(net.parameters(), lr=3e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, given.laps, 1e-5)
    for number in range(1, given.laps + 1):
        error = lap(net, optimizer, rng, given.steps)
        schedule.step()
        if number % 10 == 0 or number == given.laps:
            seconds = time.perf_counter() - began
            print(f"lap {number:4}: mean error {error:6.2f} px, after {seconds:4.0f} s", flush=True)
    np.savez(given.out, **{name: value.numpy() for name, value in net.state_dict().items()})


if __name__ == "__main__":
    main()
