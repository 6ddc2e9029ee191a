"""What is kept of an episode: per offset and state, what was believed and how it fits the truth."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from benchmarks.trials.episode import Moment
from benchmarks.trials.metrics import CloudScores, cloud_moments, cloud_scores
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.numerics.types import Floats, Indices, Reals
from localizers import Belief, quality_of

Points = tuple[Reals, Floats]

PROFILE_STRIDE = 5  # states between those at which the error is taken at every offset
_PROFILE_OFFSETS = 4  # on either side of the present


@dataclass(frozen=True, kw_only=True)
class OffsetTrace:
    """What was believed of each state s at t = s - offset.

    Attributes:
        states: s, (k,), ascending.
        means: of x, y, cos θ, sin θ, (k, 4).
        variances: of the same, (k, 4); NaN for a belief of one point.
        wall_share: weight on poses where the robot does not fit, (k,).
        energy, rank, nees: see ``metrics.CloudScores``, (k,); NaN where not available.
    """

    states: Indices
    means: Floats
    variances: Floats
    wall_share: Floats
    energy: Floats
    rank: Floats
    nees: Floats


@dataclass(frozen=True)
class Trace:
    """An episode as arrays.

    Attributes:
        truth: the true poses x_0 … x_T, (T + 1, 3).
        offsets: what was believed, by offset; only offsets that the localizer holds.
        scans_used: scans with at least one beam in range.
        seconds: the localizer's time, reset left out.
        events: the localizer's counts of trouble, if it keeps any.
        quality: P(not lost) after step t = 0 … T, (T + 1,); NaN where the belief gives none.
        profile: means of (x, y, cos θ, sin θ) at more offsets, by offset: states (k,) and means
            (k, 4), at every ``PROFILE_STRIDE``-th state.
    """

    truth: Floats
    offsets: dict[int, OffsetTrace]
    scans_used: int
    seconds: float
    quality: Floats
    events: dict[str, int] = field(default_factory=dict)
    profile: dict[int, tuple[Indices, Floats]] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """Steps carried out, T."""
        return len(self.truth) - 1


def trace_of(episode: Iterable[Moment], offsets: Iterable[int], room: RoomEnv) -> Trace:
    """Run an episode in a room to its end and keep its trace at these offsets.

    A belief about a future state waits for the truth of that state.
    """
    fits = partial(room.floor_plan.free, radius=room.world.robot.radius)
    max_range = room.lidar.max_range
    rows: dict[int, list[tuple[int, CloudScores, float]]] = {k: [] for k in offsets}
    profile: dict[int, list[tuple[int, Floats]]] = {k: [] for k in _between(rows)}
    waiting: dict[int, list[tuple[int, Points]]] = {}
    truth: list[Floats] = []
    quality: list[float] = []
    scans_used, seconds = 0, 0.0
    belief: Belief | None = None
    for moment in episode:
        belief = moment.belief
        truth.append(np.asarray(moment.truth, dtype=np.float64))
        rated = quality_of(belief)
        quality.append(np.nan if rated is None else rated)
        if moment.step > 0:
            seconds += moment.seconds
            with np.errstate(invalid="ignore"):
                scans_used += bool(((moment.ranges >= 0) & (moment.ranges <= max_range)).any())
        for offset in rows:
            state = moment.step + offset
            if state >= 0 and (points := belief.points(offset)) is not None:
                waiting.setdefault(max(state, moment.step), []).append((offset, points))
        for offset, (poses, weights) in waiting.pop(moment.step, ()):
            state = moment.step + min(offset, 0)
            in_wall = float(weights[~fits(poses)].sum())
            rows[offset].append((state, cloud_scores(poses, weights, truth[state]), in_wall))
        for offset, kept in profile.items():
            state = moment.step + offset
            if state >= 0 and state % PROFILE_STRIDE == 0 and (points := belief.points(offset)):
                kept.append((state, cloud_moments(*points)[0]))
    return Trace(
        truth=np.array(truth),
        offsets={offset: _stacked(kept) for offset, kept in rows.items() if kept},
        scans_used=scans_used,
        seconds=seconds,
        quality=np.array(quality),
        events=_events(belief),
        profile={
            offset: (np.array([state for state, _ in known]), np.array([m for _, m in known]))
            for offset, kept in profile.items()
            if (known := [row for row in kept if row[0] < len(truth)])
        },
    )


def _between(offsets: Iterable[int]) -> list[int]:
    """Offsets at equal steps as far as the outermost of those scored, these left out."""
    scored = set(offsets)
    lag = max(map(abs, scored), default=0)
    step = max(1, lag // _PROFILE_OFFSETS)
    return [k for k in range(-lag, lag + 1) if k % step == 0 and k not in scored]


def _stacked(rows: list[tuple[int, CloudScores, float]]) -> OffsetTrace:
    return OffsetTrace(
        states=np.array([state for state, _, _ in rows]),
        means=np.array([scores.mean for _, scores, _ in rows]),
        variances=np.array([scores.variance for _, scores, _ in rows]),
        wall_share=np.array([in_wall for _, _, in_wall in rows]),
        energy=np.array([scores.energy for _, scores, _ in rows]),
        rank=np.array([scores.rank for _, scores, _ in rows]),
        nees=np.array([scores.nees for _, scores, _ in rows]),
    )


def _events(belief: Any) -> dict[str, int]:
    events = getattr(belief, "events", None)
    return {} if events is None else {name: int(count) for name, count in vars(events).items()}
