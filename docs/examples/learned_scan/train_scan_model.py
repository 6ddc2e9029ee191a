"""Train the learned scan model: ``python docs/examples/learned_scan/train_scan_model.py --help``.

Needs the extra ``rl`` (PyTorch). The data are of ``python training_data.py``:
scans, and the ranges that the map gives at the true pose. The loss is the negative log-likelihood
of the scans. It prints the mean log-likelihood of a scan, in nats, in buildings of the training and
in others, beside that of beam models that know the noise of the sensor.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from learned_scan import FLOOR, HIDDEN, READ, SAID, WIDTHS, ScanNet, features

from localizers import CensoredGaussianUniform, LatentShare

try:
    import torch
    from torch import nn
except ModuleNotFoundError as missing:
    sys.exit(f"{missing.name} is not installed: pip install '.[rl]' in the clone.")

BATCH = 1024  # scans


def net_of() -> nn.Sequential:
    """The net that ``ScanNet`` computes in NumPy; at first σ is 0.5 m."""
    net = nn.Sequential(
        nn.Linear(READ, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(),
        nn.Linear(HIDDEN, SAID),
    )  # fmt: skip
    with torch.no_grad():
        net[4].weight *= 0.1
        net[4].bias[:] = torch.tensor([2.0, 0, 0, 0, 0, -2, -0.7, -0.7, -0.7])
    return net


def log_density(
    said: torch.Tensor, measured: torch.Tensor, expected: torch.Tensor, reach: float
) -> torch.Tensor:
    """Log p(z_b | z_1 … z_{b-1}, ẑ), (n, B), as ``ScanNet.log_density``."""
    shares = said[..., :4].softmax(dim=-1) * (1 - FLOOR)
    wall = expected.clamp(max=2 * reach)
    nearer, farther = said[..., 4].sigmoid(), said[..., 5].sigmoid()
    means = torch.stack([wall, wall * nearer, wall + (2 * reach - wall) * farther], dim=-1)
    sigmas = said[..., 6:].clamp(*WIDTHS).exp()
    far = (measured[..., None] - means) / sigmas
    step = reach / 400
    inside = torch.exp(-0.5 * far**2) / (sigmas * np.sqrt(2 * np.pi))
    above, below = torch.special.ndtr(-far), torch.special.ndtr(far)
    at_max, at_zero = (measured >= reach)[..., None], (measured <= 0)[..., None]
    density = torch.where(at_max, above, torch.where(at_zero, below, inside))
    anything = torch.where((at_max | at_zero)[..., 0], step, 1.0) / (reach + 2 * step)
    uniform = (shares[..., 3] + FLOOR) * anything
    return torch.log((shares[..., :3] * density).sum(dim=-1) + uniform)


def scans_in(files: list[Path]) -> tuple[np.ndarray, np.ndarray, float]:
    """Scans and expected ranges of files, (n, B) each, and the largest range, m."""
    measured, expected = [], []
    for file in files:
        with np.load(file) as data:
            reach, beams = float(data["max_range"]), data["bearings"].size
            measured.append(np.clip(data["scan"].reshape(-1, beams), 0, reach))
            expected.append(data["expected"].reshape(-1, beams))
    return np.concatenate(measured), np.concatenate(expected), reach


def scores(model: ScanNet, file: Path) -> dict[str, float]:
    """Mean log-likelihood of a scan, nats, by model."""
    measured, expected, reach = scans_in([file])
    pairs = [*zip(measured.astype(np.float64), expected[:, None], strict=True)]
    beams = {
        "beam model": CensoredGaussianUniform(sigma=0.5),
        "latent share": LatentShare(sigma=0.5),
    }
    found = {
        name: float(np.mean([beam.log_likelihood(z, e, reach) for z, e in pairs]))
        for name, beam in beams.items()
    }
    return found | {"learned": float(model.log_density(measured, expected).sum(axis=1).mean())}


def main() -> None:
    """Train, write the weights, and print the scores."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", type=Path, nargs="+", required=True, help="to train on")
    parser.add_argument("--unseen", type=Path, nargs="*", default=[], help="to score on only")
    parser.add_argument("--epochs", type=int, default=15)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name("learned_scan.npz"))
    given = parser.parse_args()
    torch.set_num_threads(1)  # the net is small
    torch.manual_seed(given.seed)
    measured, expected, reach = scans_in(given.data)
    read = torch.from_numpy(features(measured, expected, reach))
    z, e = torch.from_numpy(measured.astype(np.float32)), torch.from_numpy(expected)
    net, began = net_of(), time.perf_counter()
    optimizer = torch.optim.Adam(net.parameters(), lr=3e-3)
    batches = -(-len(z) // BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 1e-2, given.epochs * batches)
    for epoch in range(1, given.epochs + 1):
        total = 0.0
        for some in torch.randperm(len(z)).split(BATCH):
            loss = -log_density(net(read[some]), z[some], e[some], reach).sum(dim=1).mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += loss.item() * len(some)
        seconds = time.perf_counter() - began
        print(
            f"epoch {epoch:3}: {-total / len(z):8.3f} nats a scan, after {seconds:4.0f} s",
            flush=True,
        )
    weights = {name: value.numpy() for name, value in net.state_dict().items()}
    np.savez(given.out, **weights, beams=measured.shape[1], max_range=reach)
    model = ScanNet(given.out)
    for file in (*given.data, *given.unseen):
        row = ", ".join(f"{name} {value:8.3f}" for name, value in scores(model, file).items())
        print(f"{file.name:20} {row}")


if __name__ == "__main__":
    main()
