"""Drive a localizer along and compare what it believes, bit by bit."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import localizers
from deqmcl_gym.maps import Lidar, Map
from localizers import Prior, RobotModel
from localizers.inference import FilterLocalizer

Drive, Noise = tuple[np.ndarray, np.ndarray], tuple[float, float, float]
Beliefs = Sequence[localizers.Belief]
STILL = localizers.OdometryMotion(drive=0.0, turn=0.0, drift=0.0)


def wrapped(angle: Any) -> Any:
    return np.angle(np.exp(1j * np.asarray(angle)))


def sample_size(weights: np.ndarray) -> float:
    return weights.sum() ** 2 / np.square(weights).sum()


def robot_of(floor_plan: Map, lidar: Lidar, noise: Noise, sigma: float) -> RobotModel:
    """A robot of noise (drive, turn, drift) whose beams have this standard deviation."""
    drive, turn, drift = noise
    motion = localizers.OdometryMotion(drive=drive, turn=turn, drift=drift)
    scan = localizers.GaussianUniform(sigma=sigma)
    return RobotModel(floor_plan=floor_plan, lidar=lidar, motion=motion, scan=scan)


def density(beam: Any, ranges: Any, expected: Any, max_range: float) -> np.ndarray:
    """Density of each range, (B,), at the end of the range mass, given each exact one, (n, B)."""
    exact = np.asarray(expected, np.float32)
    measured = np.asarray(ranges, float)
    columns = [slice(k, k + 1) for k in range(measured.size)]
    each = [beam.log_likelihood(measured[k], exact[:, k].copy(), max_range) for k in columns]
    return np.exp(np.stack(each, axis=1))


def small(name: str, particles: int) -> dict[str, float]:
    """Parameters that make a method quick: this many particles, a coarse grid."""
    if name == "cbgl":
        return {"particles": particles, "poses": particles, "matched": min(10, particles)}
    if "particles" in (localizers.parameters(name) or ()):
        return {"particles": particles}
    if name == "amcl":
        return {"min_particles": particles, "max_particles": particles, "field_cell": 0.2}
    return {"cell": 35.0, "headings": 12} if name == "grid" else {}


def varied(localizer: FilterLocalizer, **parts: Any) -> FilterLocalizer:
    return FilterLocalizer(localizer.robot, replace(localizer.filter, **parts))


def follow(
    localizer: localizers.Localizer, prior: Prior, drive: Drive, seed: int = 0, plans: Any = None
) -> list[localizers.Belief]:
    """Beliefs at t = 0 … T; the plan is the rest of the drive unless ``plans`` are given."""
    actions, scans = drive
    if plans is None:
        plans = [actions[t:] for t in range(len(actions) + 1)]
    beliefs = [localizer.reset(prior, plans[0], np.random.default_rng(seed))]
    for action, scan, plan in zip(actions, scans, plans[1:], strict=True):
        beliefs.append(localizer.update(scan, action, plan))
    return beliefs


def started(name: str, robot: RobotModel, prior: Prior, **params: Any) -> Any:
    localizer = localizers.make(name, robot, **params)
    localizer.reset(prior, [], np.random.default_rng(0))
    return localizer


def updated(name: str, robot: RobotModel, prior: Prior, scan, action=(0, 0), **params) -> Any:
    return started(name, robot, prior, **params).update(scan, action, [])


def same(one: Beliefs, other: Beliefs, offsets: Sequence[int] = (0,)) -> bool:
    for a, b in zip(one, other, strict=True):
        for offset in offsets:
            p, q = a.points(offset) or (), b.points(offset) or ()
            if len(p) != len(q) or not all(map(np.array_equal, p, q)):
                return False
    return True
