"""Reference policies of acting: who stands still, spins or wanders, and who looks for information.

All are agents: made with a ``RobotModel`` for each episode, asked with a belief and the env's info.
They give no plan. Those that draw random numbers seed them with the first scan, ``info["ranges"]``,
so that the same episode is driven the same way.
"""

import math
from typing import Any

import numpy as np

from deqmcl_gym.maps.clusters import drawn_poses
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Floats, Reals, Singles
from deqmcl_gym.validation import InputError, integer
from deqmcl_gym.world.driver import NO_PLAN
from localizers import Belief, RobotModel

_STEP = 10.0  # px: 0.2 m, a drive
_TURN = math.pi / 12  # a turn on the spot
_METRE = 50.0  # px
_SAMPLES = 64  # poses of the belief that are looked ahead from
_HEADINGS = 12  # of one motion
_DRIVES = 7  # steps of one motion: 1.4 m
_SEQUENCES = 48  # of motions, where there are several
_CONTACT = 3.0  # nats that a certain contact costs
_STEPS = 0.02  # nats that a step costs whoever drives to a goal


class Still:
    """Stands still."""

    sees_belief = False

    def __init__(self, robot: RobotModel) -> None:
        self._px = pixel(robot.floor_plan.unit)

    def plan_at_reset(self, info: dict[str, Any]) -> Reals:
        self._rng = rng_of(info)
        return NO_PLAN

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals]:
        return np.array(self._next(belief, info), np.float32), NO_PLAN

    def _next(self, belief: Belief, info: dict[str, Any]) -> tuple[float, float]:
        return 0.0, 0.0


class Spin(Still):
    """Turns on the spot, as Nav2's recovery behaviour Spin does."""

    sees_belief = False

    def _next(self, belief: Belief, info: dict[str, Any]) -> tuple[float, float]:
        return 0.0, _TURN


class RandomWalk(Still):
    """Drives on, swaying at random; turns by a random angle after a contact."""

    sees_belief = False

    def __init__(self, robot: RobotModel) -> None:
        super().__init__(robot)
        self._left = 0  # turns to come, negative to the right

    def _next(self, belief: Belief, info: dict[str, Any]) -> tuple[float, float]:
        if info["collided"]:
            self._left = int(self._rng.integers(4, 13)) * int(self._rng.choice((-1, 1)))
        if self._left:
            side = math.copysign(1.0, self._left)
            self._left -= int(side)
            return 0.0, side * _TURN
        return _STEP * self._px, float(np.clip(0.1 * self._rng.standard_normal(), -_TURN, _TURN))


class WallFollower(Still):
    """Follows the wall to its right by the scan, 0.6 m away; turns left before one ahead."""

    sees_belief = False

    def __init__(self, robot: RobotModel) -> None:
        super().__init__(robot)
        bearings = robot.lidar.bearings
        self._ahead = np.abs(bearings) < math.radians(25)
        self._right = np.abs(bearings + math.radians(60)) < math.radians(35)
        if not (self._ahead.any() and self._right.any()):
            raise InputError(
                "wall-follower needs beams ahead and to its right: give a lidar with 16 beams and "
                "a field of view of 2π."
            )
        self._mean: Floats | None = None  # of the last scans: one is noisy

    def _next(self, belief: Belief, info: dict[str, Any]) -> tuple[float, float]:
        scan = np.asarray(info["ranges"], np.float64)
        self._mean = scan if self._mean is None else 0.6 * self._mean + 0.4 * scan
        metre = _METRE * self._px
        if info["collided"] or self._mean[self._ahead].min() < 0.9 * metre:
            self._mean = None
            return 0.0, 2 * _TURN
        off = float(self._mean[self._right].min()) / metre - 0.7
        return _STEP * self._px, float(np.clip(-0.5 * off, -_TURN, _TURN))


class LookAhead(Still):
    """Drives where the scans expected from different poses of the belief disagree most.

    A motion is a turn and a drive of 1.4 m. For each of some motions (or sequences of them), the
    mutual information between pose and scans is estimated from poses x_i drawn from the belief,

        I = -1/n Σ_i log 1/n Σ_j exp(-|ô_i - ô_j|² / 8σ²),

    a lower bound for normal beams (Kolchinsky & Tracey 2017); ô_i are the exact scans on the way
    from x_i, σ that of the beam model, tempered. The first motion of the best is carried out, then
    it looks again; after a contact at once. It turns on the spot while nothing is believed.
    """

    def __init__(self, robot: RobotModel, *, depth: int = 1) -> None:
        super().__init__(robot)
        self._robot = robot
        self._depth = integer("depth", depth, low=1, high=16)
        scan: Any = robot.scan
        sigma, power = getattr(scan, "sigma", _METRE * self._px / 2), getattr(scan, "power", 1.0)
        self._variance = sigma**2 / power
        self._queue: list[tuple[float, float]] = []

    def _next(self, belief: Belief, info: dict[str, Any]) -> tuple[float, float]:
        if info["collided"]:
            self._queue = []
        if not self._queue:
            if (points := points_of(belief)) is None:
                return 0.0, _TURN
            poses = np.asarray(drawn_poses(*points, _SAMPLES, self._rng), np.float64)
            turns = self._turns()
            with np.errstate(under="ignore"):
                values = [self._value(poses, each, info) for each in turns]
            self._queue = self._motion(float(turns[int(np.argmax(values))][0]))
        return self._queue.pop(0)

    def _turns(self) -> Floats:
        """Turns before each drive of the motions that are compared, (m, depth)."""
        turns = np.arange(_HEADINGS, dtype=np.float64) * (2 * np.pi / _HEADINGS)
        all_round: Floats = (turns + np.pi) % (2 * np.pi) - np.pi
        if self._depth == 1:
            return all_round[:, None]
        drawn: Floats = self._rng.choice(all_round, (_SEQUENCES, self._depth))
        return drawn

    def _motion(self, turn: float) -> list[tuple[float, float]]:
        """Return the actions of a turn and a drive."""
        parts = max(1, math.ceil(abs(turn) / (np.pi / 4) - 1e-9))
        turning = [(0.0, turn / parts)] * parts if turn else []
        return turning + [(_STEP * self._px, 0.0)] * _DRIVES

    def _value(self, poses: Floats, turns: Floats, info: dict[str, Any]) -> float:
        """Return what a sequence of motions is worth, in nats."""
        path, blocked = self._rolled_out(poses, turns)
        return self._information(path) - _CONTACT * float(blocked.mean())

    def _rolled_out(self, poses: Floats, turns: Floats) -> tuple[Floats, Floats]:
        """Poses after each motion, (depth, n, 3); contacts, (n,): one into a wall only turns."""
        floor_plan, radius = self._robot.floor_plan, self._robot.radius
        way, at, path = _DRIVES * _STEP * self._px, poses, []
        blocked = np.zeros(len(poses))
        for turn in turns:
            after = at + np.array([0.0, 0.0, turn])
            ends = after[:, :2] + way * np.column_stack([np.cos(after[:, 2]), np.sin(after[:, 2])])
            stopped = floor_plan.collides(at, ends, radius)
            after[:, :2] = np.where(stopped[:, None], at[:, :2], ends)
            blocked += stopped
            path.append(after)
            at = after
        return np.stack(path), blocked

    def _information(self, path: Floats) -> float:
        """Mutual information of poses and the scans on their ways, path (k, n, 3), nats."""
        k, n, _ = path.shape
        lidar = self._robot.lidar
        flat = path.reshape(k * n, 3)
        seen = lidar.ranges(self._robot.floor_plan, flat.T.astype(np.float32))
        seen = np.nan_to_num(np.minimum(seen, lidar.max_range), nan=0.0)
        scans = seen.reshape(k, n, -1).transpose(1, 0, 2).reshape(n, -1).astype(np.float64)
        norms = (scans**2).sum(axis=1)
        squares = np.maximum(norms[:, None] + norms - 2 * scans @ scans.T, 0.0)
        alike = np.exp(-squares / (8 * self._variance)).mean(axis=1)
        return float(-np.log(alike).mean())


class FreeEnergy(LookAhead):
    """Minimizes expected free energy: information (epistemic) and what it prefers (pragmatic).

    It prefers no contact, few steps, and to be near a goal: 1 nat per metre of the samples' mean.
    """

    def __init__(self, robot: RobotModel, *, depth: int = 2) -> None:
        super().__init__(robot, depth=depth)

    def _value(self, poses: Floats, turns: Floats, info: dict[str, Any]) -> float:
        path, blocked = self._rolled_out(poses, turns)
        steps = sum(len(self._motion(float(turn))) for turn in turns)
        pragmatic = -_CONTACT * float(blocked.mean()) - _STEPS * steps
        if "goal" in info:
            off = np.hypot(*(path[-1, :, :2] - info["goal"]).T)
            pragmatic -= float(off.mean()) / (_METRE * self._px)
        return self._information(path) + pragmatic


def points_of(belief: Belief) -> tuple[Reals, Floats] | None:
    """Return the poses and weights of the present; None if there is nothing to plan from."""
    points = belief.points()
    return None if points is None or len(points[0]) == 0 else points


def rng_of(info: dict[str, Any]) -> np.random.Generator:
    """Return the random numbers of a policy, seeded with the scan."""
    scan: Singles = np.ascontiguousarray(info["ranges"], np.float32)
    return np.random.default_rng(np.frombuffer(scan.tobytes(), np.uint32))


def four_deep(robot: RobotModel) -> LookAhead:
    """As greedy, over four motions, of which it carries out the first."""
    return LookAhead(robot, depth=4)
