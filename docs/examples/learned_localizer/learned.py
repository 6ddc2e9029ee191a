"""A learned localizer: a recurrent net corrects dead reckoning by what each beam says.

At each step the pose is moved by the command. Then every beam is compared with the map there:
by how much its range differs from the expected one, and how that would change if the pose were a
little further ahead, to the left, or turned. A small net reads each beam, a GRU the mean over the
beams, and answers with a correction of the pose in the robot's frame and its standard deviations.
Nothing is told in coordinates of the map, so what was learned in one place holds in any other, with
any number of beams, in px or m.

``train.py`` makes ``learned.npz``. To run it needs NumPy alone.
"""

from pathlib import Path

import numpy as np

from deqmcl_gym.maps.units import pixel
from deqmcl_gym.validation import InputError
from localizers import Belief, PointsBelief, Prior, RobotModel

BEAM, COMMAND, HIDDEN = 7, 2, 48  # numbers that describe a beam, a command, the state of the GRU
CORRECTION = np.array([10.0, 10.0, 0.1])  # px, px, rad: what an output of 1 stands for
_NUDGE = np.array([1.0, 1.0, 0.01])  # px, px, rad: to see how ranges change


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
        self.pose = moved(self.pose[None], np.array([action], np.float64))[0]
        beams, used = compared(self.robot, self.pose[None], np.array([ranges], np.float64))
        command = np.array([action[0] / self.px / 10, action[1]], np.float64)
        self.state, answer = self._think(beams[0], used[0], command)
        self.pose = corrected(self.pose[None], answer[None, :3] * CORRECTION * self.unit)[0]
        # the six points of a cloud with this mean and these standard deviations
        sd = np.exp(np.clip(answer[3:], -5, 5)) * CORRECTION * self.unit
        offsets = np.vstack([np.diag(sd), -np.diag(sd)]) * np.sqrt(3)
        return PointsBelief(corrected(np.tile(self.pose, (6, 1)), offsets))

    def _think(
        self, beams: np.ndarray, used: np.ndarray, command: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        net, h = self.net, self.state
        seen = np.maximum(beams @ net["beam.0.weight"].T + net["beam.0.bias"], 0)
        seen = np.maximum(seen @ net["beam.2.weight"].T + net["beam.2.bias"], 0)
        told = np.concatenate([(seen * used[:, None]).mean(axis=0), command])
        # a GRU (Cho et al. 2014), in PyTorch's order: reset, update, new
        by_input = net["memory.weight_ih"] @ told + net["memory.bias_ih"]
        by_state = net["memory.weight_hh"] @ h + net["memory.bias_hh"]
        (r, z, n), (from_r, from_z, from_n) = np.split(by_input, 3), np.split(by_state, 3)
        forget, keep = 1 / (1 + np.exp(-r - from_r)), 1 / (1 + np.exp(-z - from_z))
        h = (1 - keep) * np.tanh(n + forget * from_n) + keep * h
        return h, net["answer.weight"] @ h + net["answer.bias"]


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
    unit = np.array([px, px, 1.0])
    nudges = np.vstack([np.zeros(3), np.diag(_NUDGE * unit), -np.diag(_NUDGE * unit)])
    around = corrected(np.repeat(poses, 7, axis=0), np.tile(nudges, (n, 1)))
    expected = robot.floor_plan.ranges(around, robot.lidar.bearings).reshape(n, 7, count) / px
    with np.errstate(invalid="ignore"):
        slopes = (expected[:, 1:4] - expected[:, 4:]) / 2 / _NUDGE[:, None]
        used = (ranges >= 0) & (ranges <= robot.lidar.max_range) & np.isfinite(expected).all(1)
        off = ranges / px - expected[:, 0]
    slopes[:, 2] /= 100  # px per rad
    bearings = np.broadcast_to(robot.lidar.bearings, (n, count))
    beams = np.stack(
        [
            off / 20,
            expected[:, 0] / 200,
            *slopes.swapaxes(0, 1),
            np.cos(bearings),
            np.sin(bearings),
        ],
        axis=2,
    )
    return np.where(used[..., None], np.clip(beams, -3, 3), 0.0), used
