"""What is kept of an episode: per offset and state, the first two moments of the belief."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.episode import Moment
from benchmarks.metrics import cloud_moments
from deqmcl_gym.env import RoomEnv
from localizers import Belief

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class OffsetTrace:
    """What was believed of each state s at t = s - offset.

    Attributes:
        states: s, (k,), ascending.
        means: of x, y, cos θ, sin θ, (k, 4).
        variances: of the same, (k, 4); NaN for a belief of one point.
        wall_share: weight on poses where the robot does not fit, (k,).
    """

    states: NDArray[np.intp]
    means: Floats
    variances: Floats
    wall_share: Floats


@dataclass(frozen=True)
class Trace:
    """An episode as arrays.

    Attributes:
        truth: the true poses x_0 … x_T, (T + 1, 3).
        offsets: what was believed, by offset; only offsets that the localizer holds.
        scans_used: scans with at least one beam in range.
        seconds: the localizer's time, reset left out.
        events: the localizer's counts of trouble, if it keeps any.
    """

    truth: Floats
    offsets: dict[int, OffsetTrace]
    scans_used: int
    seconds: float
    events: dict[str, int] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """Steps carried out, T."""
        return len(self.truth) - 1


def trace_of(episode: Iterable[Moment], offsets: Iterable[int], room: RoomEnv) -> Trace:
    """Run an episode in a room to its end and keep its trace at these offsets."""
    fits = partial(room.floor_plan.free, radius=room.world.robot.radius)
    max_range = room.lidar.max_range
    rows: dict[int, list[tuple[int, Floats, Floats, float]]] = {k: [] for k in offsets}
    truth, scans_used, seconds = [], 0, 0.0
    belief: Belief | None = None
    for moment in episode:
        belief = moment.belief
        truth.append(np.asarray(moment.truth, dtype=np.float64))
        if moment.step > 0:
            seconds += moment.seconds
            with np.errstate(invalid="ignore"):
                scans_used += bool(((moment.ranges >= 0) & (moment.ranges <= max_range)).any())
        for offset, kept in rows.items():
            points = belief.points(offset)
            if points is not None and moment.step + offset >= 0:
                poses, weights = points
                mean, variance = cloud_moments(poses, weights)
                inside = ~fits(poses)
                kept.append((moment.step + offset, mean, variance, float(weights[inside].sum())))
    return Trace(
        truth=np.array(truth),
        offsets={
            offset: _stacked(scorable)
            for offset, kept in rows.items()
            if (scorable := [row for row in kept if row[0] < len(truth)])
        },
        scans_used=scans_used,
        seconds=seconds,
        events=_events(belief),
    )


def _stacked(rows: list[tuple[int, Floats, Floats, float]]) -> OffsetTrace:
    states, means, variances, wall_share = zip(*rows, strict=True)
    return OffsetTrace(np.array(states), np.array(means), np.array(variances), np.array(wall_share))


def _events(belief: Any) -> dict[str, int]:
    events = getattr(belief, "events", None)
    return {} if events is None else {name: int(count) for name, count in vars(events).items()}
