"""Each class breaks the law of its name, and no other."""

import math
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from functools import cache

import numpy as np

from localizers import PointsBelief, PoseBelief, mean_pose
from localizers.template import MyLocalizer


class AnswersInTime(MyLocalizer):
    def update(self, ranges, action, plan):
        time.sleep(3600)


@cache
def MakesALocalizer(robot):  # noqa: N802
    return MyLocalizer(robot)


class AnswersWithBeliefs(MyLocalizer):
    def update(self, ranges, action, plan):
        super().update(ranges, action, plan)


class Told:
    """A belief whose points are told otherwise."""

    def __init__(self, belief, otherwise):
        self.belief, self.otherwise = belief, otherwise

    def points(self, offset=0):
        points = self.belief.points(offset)
        return points and self.otherwise(*points)


class Finite(MyLocalizer):
    def update(self, ranges, action, plan):
        belief = super().update(ranges, action, plan)
        return Told(belief, lambda poses, weights: (poses * [1, np.nan, 1], weights))


class WeightsSumToOne(MyLocalizer):
    def update(self, ranges, action, plan):
        belief = super().update(ranges, action, plan)
        return Told(belief, lambda poses, weights: (poses, 0.5 * weights))


class WholeTurn(MyLocalizer):
    """Looks a heading up in a table from -π to π."""

    def reset(self, prior, plan, rng):
        heading = prior.mean[2] if prior.mean else 0.0
        self.sector = "WSEN"[int((heading + math.pi) // (math.pi / 2))]
        return super().reset(prior, plan, rng)


class HalfTurn(MyLocalizer):
    """Averages headings as numbers: 179° and -179° to 0°."""

    def update(self, ranges, action, plan):
        poses, weights = super().update(ranges, action, plan).points()
        poses[:, 2] = np.arctan2(np.sin(poses[:, 2]), np.cos(poses[:, 2]))
        return PoseBelief(weights @ poses)


class SameRngSameResult(MyLocalizer):
    def reset(self, prior, plan, rng):
        return super().reset(prior, plan, np.random.default_rng())


class OtherRngOtherResult(MyLocalizer):
    def reset(self, prior, plan, rng):
        rng.random()
        return super().reset(prior, plan, np.random.default_rng(0))


class TakesTheSecondForTheTurn(MyLocalizer):
    def reset(self, prior, plan, rng):
        return super().reset(prior, plan[:, :2], rng)

    def update(self, ranges, action, plan):
        return super().update(ranges, action[:2], plan[:, :2])


class GlobalRngUntouched(MyLocalizer):
    def reset(self, prior, plan, rng):
        np.random.seed(0)  # noqa: NPY002
        np.random.rand()  # noqa: NPY002
        return super().reset(prior, plan, rng)


class ProcessStateUntouched(MyLocalizer):
    CHANGES = {
        "the working folder": lambda: os.chdir("/"),
        "signal handlers": lambda: signal.signal(signal.SIGTERM, signal.SIG_IGN),
        "np.seterr": lambda: np.seterr(divide="raise"),
        "np.set_printoptions": lambda: np.set_printoptions(precision=2),
        "the filters of warnings": lambda: warnings.simplefilter("error", BytesWarning),
        "os.environ": lambda: os.environ.update(DEQMCL_BROKEN="1"),
        "the recursion limit": lambda: sys.setrecursionlimit(5000),
        "sys.path": lambda: sys.path.insert(0, "/nowhere"),
    }

    def __init__(self, robot, *, particles=500, change="the recursion limit"):
        super().__init__(robot, particles=particles)
        self.change = change

    def update(self, ranges, action, plan):
        self.CHANGES[self.change]()
        return super().update(ranges, action, plan)


class NothingLeftRunning(MyLocalizer):
    def reset(self, prior, plan, rng):
        threading.Thread(target=time.sleep, args=(30.0,), name="lidar", daemon=True).start()
        return super().reset(prior, plan, rng)


class LeavesAProcess(MyLocalizer):
    def reset(self, prior, plan, rng):
        subprocess.Popen(["sleep", "20"])
        return super().reset(prior, plan, rng)


class RobotAndPriorNotChanged(MyLocalizer):
    def reset(self, prior, plan, rng):
        walls = self.robot.floor_plan.walls
        walls.flags.writeable = True
        walls += 0.5
        return super().reset(prior, plan, rng)


class HugeActions(MyLocalizer):
    """Keeps the sum of squares of what it drove in float32."""

    def reset(self, prior, plan, rng):
        self.driven = np.float32(0)
        return super().reset(prior, plan, rng)

    def update(self, ranges, action, plan):
        self.driven += np.square(action, dtype=np.float32).sum()
        x, y, heading = mean_pose(*super().update(ranges, np.minimum(action, 1e6), plan).points())
        return Told(PoseBelief([x, y, heading]), lambda poses, w: (poses + 0 * self.driven, w))


class InputsNotChanged(MyLocalizer):
    def update(self, ranges, action, plan):
        np.minimum(ranges, 100.0, out=ranges)
        return super().update(ranges, action, plan)


class InputsNotKept(MyLocalizer):
    """Weighs by the scan of the step before, which it has kept without a copy."""

    def reset(self, prior, plan, rng):
        self.before = None
        return super().reset(prior, plan, rng)

    def update(self, ranges, action, plan):
        seen = ranges if self.before is None else self.before
        self.before = ranges
        return super().update(seen, action, plan)


class OutputsAreFresh(MyLocalizer):
    def update(self, ranges, action, plan):
        belief = super().update(ranges, action, plan)
        held = belief.points()
        return Told(belief, lambda *fresh: held)


class BeliefsStay(MyLocalizer):
    """Is its own belief: what it said of yesterday is what it says of today."""

    def reset(self, prior, plan, rng):
        self.belief = super().reset(prior, plan, rng)
        return self

    def update(self, ranges, action, plan):
        self.belief = super().update(ranges, action, plan)
        return self

    def points(self, offset=0):
        return self.belief.points(offset)


class PriorWithoutMean(MyLocalizer):
    def reset(self, prior, plan, rng):
        self.x, self.y, self.heading = prior.mean
        return super().reset(prior, plan, rng)


class ZeroLikelihood(MyLocalizer):
    """Divides by a sum of likelihoods that may be zero."""

    def _log_likelihood(self, ranges):
        lidar = self.robot.lidar
        expected = self.robot.floor_plan.ranges(self.cloud.T, lidar.bearings)
        likelihood = np.exp(self.robot.scan.log_likelihood(ranges, expected, lidar.max_range))
        if ranges.max() == 0 and likelihood.sum() == 0:
            raise ZeroDivisionError("the likelihoods add up to 0")
        with np.errstate(divide="ignore"):
            return super()._log_likelihood(ranges)


class MaxRangeScan(MyLocalizer):
    def update(self, ranges, action, plan):
        self.farthest = ranges[ranges != self.robot.lidar.max_range].max()
        return super().update(ranges, action, plan)


class BadBeams(MyLocalizer):
    def update(self, ranges, action, plan):
        belief = super().update(ranges, action, plan)
        x, y, heading = mean_pose(*belief.points())
        return PoseBelief([x + 1e-9 * ranges.mean(), y, heading])


class OneParticle(MyLocalizer):
    def update(self, ranges, action, plan):
        poses, weights = super().update(ranges, action, plan).points()
        if len(poses) < 2:
            raise np.linalg.LinAlgError("a covariance needs two particles")
        return PointsBelief(poses, weights)


class ShortPlan(MyLocalizer):
    def update(self, ranges, action, plan):
        self.next_turn = plan[0, 1]
        return super().update(ranges, action, plan)


class ChangedPlan(MyLocalizer):
    def reset(self, prior, plan, rng):
        self.plan = plan.copy()
        return super().reset(prior, plan, rng)

    def update(self, ranges, action, plan):
        if len(self.plan) and not np.array_equal(action, self.plan[0]):
            raise AssertionError("not as planned")
        self.plan = plan.copy()
        return super().update(ranges, action, plan)


class ResetStartsAnew(MyLocalizer):
    steps = 0

    def update(self, ranges, action, plan):
        self.steps += 1
        x, y, heading = mean_pose(*super().update(ranges, action, plan).points())
        return PoseBelief([x + 0.01 * self.steps, y, heading])


class Picklable(MyLocalizer):
    def __init__(self, robot, *, particles=500):
        super().__init__(robot, particles=particles)
        self.clip = lambda ranges: ranges.clip(0, 400)


class RunsInAWorker(MyLocalizer):
    def reset(self, prior, plan, rng):
        if multiprocessing.parent_process() is not None:
            raise OSError("no device in this process")
        return super().reset(prior, plan, rng)
