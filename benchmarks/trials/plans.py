"""How a belief read each plan it was shown, and whether that plan was about this robot."""

from collections.abc import Sequence
from math import isnan
from typing import Any

import numpy as np

from benchmarks.trials.clouds import Task
from deqmcl_gym.numerics.types import Floats, Reals
from localizers.models.plan_sensor import PlanSensor

SIGNALS = ("feasible", "tempering", "log_evidence", "valid")  # of ``PlanReading``
PLAN_COLUMNS = ("conflict", *SIGNALS)


def plan_row(belief: Any, truth: Reals, task: Task) -> list[float]:
    """Return whether the plan conflicts with the true pose, then the signals; NaN if none was read.

    It conflicts if, laid from where the robot is, it would collide: it is not about this robot, or
    no longer.
    """
    reading = getattr(belief, "plan_reading", None)
    if reading is None or np.isnan(reading.feasible):
        return [np.nan] * (1 + len(SIGNALS))
    sensor = PlanSensor(floor_plan=task.floor_plan, radius=task.radius)
    pose = np.asarray(truth, np.float32)[:, None]
    known = np.isfinite(pose).all()
    conflict = float(sensor.collisions(pose, reading.seen)[0] > 0) if known else np.nan
    return [conflict, *(float(getattr(reading, name)) for name in SIGNALS)]


def plan_columns(rows: Sequence[Sequence[float]]) -> dict[str, list[float | None]] | None:
    """Return the rows of the steps t = 1 … T as columns by name; None if no plan was read."""
    table: Floats = np.array(rows, np.float64).reshape(len(rows), 1 + len(SIGNALS))
    if np.isnan(table).all():
        return None
    columns = zip(PLAN_COLUMNS, table.T.tolist(), strict=True)
    return {name: [None if isnan(v) else v for v in own] for name, own in columns}
