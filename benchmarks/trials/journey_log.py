"""What is kept of a whole run while it lasts, and how it stands in a record."""

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.trials.clouds import Task
from benchmarks.trials.episode import Moment
from benchmarks.trials.fixes import Fixes, driven, metre
from benchmarks.trials.journeys import Group, Journey, WholeRun, half_turned, weight_near, whole_run
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Reals
from localizers import best_cluster, quality_of


class JourneyLog:
    """Collects a run from its moments; the best cluster is sought once a step."""

    def __init__(self, task: Task, groups: Sequence[Group]) -> None:
        self._task, self._groups = task, groups
        self._metre = metre(task.floor_plan.unit)
        self._turned = any(group.name == "ambiguity" for group in groups)
        self._truth: list[Reals] = []
        self._commanded: list[Reals] = []
        self._collided: list[bool] = []
        self._fixes: list[list[float]] = []  # step, x, y, θ, quality, masses
        self._goal: Reals | None = None
        self._planned = math.nan

    def see(self, moment: Moment) -> None:
        """Take in a step."""
        self._truth.append(moment.truth)
        self._collided.append(moment.collided)
        self._goal = moment.goal
        if moment.step == 0 and moment.route is not None:
            self._planned = float(np.hypot(*np.diff(moment.route, axis=0).T).sum())
        if moment.action is not None:
            self._commanded.append(moment.action)
        if self._groups and (points := moment.belief.points()) is not None:
            poses, weights = np.asarray(points[0]), np.asarray(points[1], np.float64)
            best = best_cluster(poses, weights, unit=self._task.floor_plan.unit).mean
            quality = quality_of(moment.belief)
            rated = math.nan if quality is None else quality
            row = [moment.step, *best, rated]
            if self._turned:
                here = np.asarray(moment.truth, np.float64)
                there = half_turned(self._task.floor_plan, here[None])[0]
                row += [weight_near(poses, weights, at, self._metre) for at in (here, there)]
            self._fixes.append(row)

    def kept(self) -> tuple[WholeRun | None, None]:
        """Return the part of a record about this run; None if nothing is asked."""
        if not self._groups or not self._fixes:
            return None, None
        return whole_run(self.journey(), self._groups), None

    def journey(self) -> Journey:
        """Return the run so far."""
        size = np.array([self._metre, self._metre, 1.0])
        truth = np.array(self._truth, np.float64) / size
        table = np.array(self._fixes, np.float64)
        steps = table[:, 0].astype(np.intp)
        off = truth[steps] - table[:, 1:4] / size
        way = driven(self._commanded) / self._metre
        goal = None if self._goal is None else np.asarray(self._goal, np.float64) / self._metre
        room = self._task.floor_plan.distance(np.array(self._truth, np.float64)[:, :2])
        return Journey(
            fixes=Fixes(
                steps=steps,
                count=len(truth),
                way=way[steps],
                distance=np.hypot(off[:, 0], off[:, 1]),
                angle=np.abs(arrays.wrapped(off[:, 2])),
                quality=table[:, 4],
            ),
            driven=way,
            truth=truth,
            collided=np.array(self._collided),
            clearance=float(room.min() - self._task.radius) / self._metre,
            goal=goal,
            planned=self._planned / self._metre,
            masses=table[:, 5:] if self._turned else None,
        )
