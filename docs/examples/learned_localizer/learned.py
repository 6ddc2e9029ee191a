"""A learned localizer: a recurrent net says how far to trust each beam, and dead reckoning.

At each step the pose is moved by the command. Then every beam is compared with the map there: by
how much its range differs from the expected one (v), and how the expected one changes if the pose
goes ahead, to the left, or turns (J). The correction is the Gauss-Newton step
(Σ w J Jᵀ + Λ)⁻¹ Σ w J v.
A small net gives the weight w of each beam, a GRU the trust Λ in the pose before. Nothing is told
in coordinates of the map, so what was learned in one place holds in any other, with any number of
beams, in px or m.

``train.py`` makes ``learned.npz``. To run it needs NumPy alone.
"""

from pathlib import Path

import numpy as np

from deqmcl_gym.maps.map import pixel
from deqmcl_gym.validation import InputError
from localizers import Belief, PointsBelief, Prior, RobotModel

BEAM, TOLD, HIDDEN = 7, 8, 32  # numbers that describe a beam and a step; the state of the GRU
CORRECTION = np.array([10.0, 10.0, 0.1])  # px, px, rad: what a correction of 1 stands for
_NUDGE = np.array([1.0, 1.0, 0.01])  # px, px, rad: to see how ranges change
_RANGE = 20.0  # px: what a difference of ranges of 1 stands for


class Learned:
    """Follows one pose and its standard deviations by a recurrent net."""

    def __init__(self, robot: RobotModel) -> None:
        self.robot = robot
        self.px = pixel(robot.floor_plan.unit)
        self.unit = np.array([self.px, self.px, 1.0])
        with np.load(Path(__file__).with_name("learned.npz")) as weights:
            self.net = {name: weights[name].astype(np.float64) for name in weights.files}

    def reset(self, prior: Prior, plan: np.ndarray, rng: np.random.Generator) -> Belief:
        """Start at the prior's mean."""
        if prior.mean is None:
            raise InputError("the prior has no mean, but the learned localizer starts from one.")
        self.pose, self.state = np.array(prior.mean, np.float64), np.zeros(HIDDEN)
        return PointsBelief(prior.sample(100, rng))

    def update(self, ranges: np.ndarray, action: np.ndarray, plan: np.ndarray) -> Belief:
        """Move by the command, look, and correct."""
        net = self.net
        self.pose = moved(self.pose[None], np.array([action], np.float64))[0]
        beams, used = compared(self.robot, self.pose[None], np.array([ranges], np.float64))
        (read,), off, slopes = beams, beams[0, :, 0], beams[0, :, 2:5]
        inner = np.maximum(read @ net["beam.0.weight"].T + net["beam.0.bias"], 0)
        trust = np.exp(inner @ net["beam.2.weight"].T + net["beam.2.bias"])[:, 0] * used[0]
        seen = (trust[:, None] * slopes).T @ slopes
        pull = (trust * off) @ slopes
        command = action[0] / self.px / 10, action[1]
        size = np.diag(seen)
        told = np.concatenate([command, np.log1p(size), pull / (size + 1)])
        self.state = self._remembered(told)
        *before, spread = net["answer.weight"] @ self.state + net["answer.bias"]
        precision = seen + np.diag(np.exp(before))
        unit = CORRECTION * self.unit
        self.pose = corrected(self.pose[None], np.linalg.solve(precision, pull)[None] * unit)[0]
        # the six points of a cloud with this mean and covariance
        root = np.linalg.cholesky(np.linalg.inv(precision)).T * np.exp(spread) * unit
        return PointsBelief(
            corrected(np.tile(self.pose, (6, 1)), np.sqrt(3) * np.vstack([root, -root]))
        )

    def _remembered(self, told: np.ndarray) -> np.ndarray:
        """Take a step of the GRU (Cho et al. 2014), in PyTorch's order: reset, update, new."""
        net, h = self.net, self.state
        by_input = net["memory.weight_ih"] @ told + net["memory.bias_ih"]
        by_state = net["memory.weight_hh"] @ h + net["memory.bias_hh"]
        (r, z, n), (from_r, from_z, from_n) = np.split(by_input, 3), np.split(by_state, 3)
        forget, keep = 1 / (1 + np.exp(-r - from_r)), 1 / (1 + np.exp(-z - from_z))
        remembered: np.ndarray = (1 - keep) * np.tanh(n + forget * from_n) + keep * h
        return remembered


def moved(poses: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """Turn poses (n, 3), then drive them, by (distance, turn), (n, 2)."""
    turn = np.column_stack([np.zeros((len(poses), 2)), actions[:, 1]])
    return corrected(poses + turn, np.column_stack([actions[:, 0], np.zeros((len(poses), 2))]))


def corrected(poses: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Move poses (n, 3) by (ahead, left, turn) in their own frames, (n, 3)."""
    sine, cosine = np.sin(poses[:, 2]), np.cos(poses[:, 2])
    ahead, left, turn = by.T
    return poses + np.column_stack(
        [cosine * ahead - sine * left, sine * ahead + cosine * left, turn]
    )


def compared(
    robot: RobotModel, poses: np.ndarray, ranges: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compare scans (n, B) with what the map says at poses (n, 3).

    Returns:
        What the net reads of each beam, (n, B, ``BEAM``), and whether to use it, (n, B).
    """
    px, (n, count) = pixel(robot.floor_plan.unit), ranges.shape
    nudges = np.vstack([np.zeros(3), np.diag(_NUDGE), -np.diag(_NUDGE)]) * (px, px, 1.0)
    around = corrected(np.repeat(poses, 7, axis=0), np.tile(nudges, (n, 1)))
    expected = robot.floor_plan.ranges(around, robot.lidar.bearings).reshape(n, 7, count) / px
    with np.errstate(invalid="ignore"):
        slopes = (expected[:, 1:4] - expected[:, 4:]) / (2 * _NUDGE / CORRECTION)[:, None] / _RANGE
        used = (ranges >= 0) & (ranges <= robot.lidar.max_range) & np.isfinite(expected).all(1)
        off = (ranges / px - expected[:, 0]) / _RANGE
    bearings = np.broadcast_to(robot.lidar.bearings, (n, count))
    read = [off, expected[:, 0] / 200, *slopes.swapaxes(0, 1), np.cos(bearings), np.sin(bearings)]
    return np.where(used[..., None], np.clip(np.stack(read, axis=2), -3, 3), 0.0), used
