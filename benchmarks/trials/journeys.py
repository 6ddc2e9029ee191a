"""The scores of a whole run: is the robot found, found again, and does it arrive?

Beside ``metrics``, which are of a belief at one offset. A run has those groups of scores that its
scenario is about: see ``Stage.groups``. Lengths are in m; a pixel of the paper's room is 2 cm.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from benchmarks.trials.fixes import NEAR, RECOVERED, RECOVERED_STEPS, Fixes
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Bools, Floats, Reals

ARRIVED = 0.5  # m from the goal
_ROUNDING = 1e-6  # of shares: weights add up to 1 but for it


@dataclass(frozen=True, kw_only=True)
class Journey:
    """A run from its start to its end. n = T + 1 states.

    Attributes:
        fixes: where the best cluster was.
        driven: by the commands until each state, (n,).
        truth: true poses, (n, 3).
        collided: whether the step to each state was stopped by a wall, (n,).
        clearance: least distance of the robot's rim to a wall.
        goal: where it was to arrive, (2,); None if nowhere.
        planned: length of the route from the start to the goal; NaN without a goal.
        masses: weight within 1 m and 30° of the truth and of its twin under a half turn of the
            map, (k, 2), at the steps of ``fixes``; None if that was not asked for.
    """

    fixes: Fixes
    driven: Floats
    truth: Floats
    collided: Bools = field(default_factory=lambda: np.zeros(0, np.bool_))
    clearance: float = math.nan
    goal: Floats | None = None
    planned: float = math.nan
    masses: Floats | None = None

    @property
    def carried(self) -> int:
        """The first state after the robot was carried off: where it moved farthest uncommanded."""
        moved = np.hypot(*np.diff(self.truth[:, :2], axis=0).T)
        return 1 + int(np.argmax(moved - np.diff(self.driven)))

    @property
    def arrived(self) -> bool:
        """Whether it ends within 0.5 m of the goal, without having touched a wall."""
        assert self.goal is not None
        off = math.hypot(*(self.truth[-1, :2] - self.goal))
        return off <= ARRIVED and not self.collided.any()

    @property
    def spl(self) -> float:
        """Success weighted by path length: S · planned / max(driven, planned).

        Anderson et al. 2018, "On evaluation of embodied navigation agents"; the route stands for
        the shortest way, which would scrape along walls.
        """
        path = float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum())
        longer = max(path, self.planned)
        return float(self.arrived) * (self.planned / longer if longer > 0 else 1.0)


@dataclass(frozen=True)
class Score:
    """A score of a whole run.

    Attributes:
        name: in records and tables.
        unit: "share" (of runs; 0 or 1 of one), "m", "steps" or "" (a number).
        words: what it is, as the heading of a column.
        of: the score; NaN is not available.
        failed: the score of a run that failed; NaN: it is unknown.
        tested: whether methods are compared by it.
        digits: behind the point, in tables; None: as the unit has them.
    """

    name: str
    unit: str
    words: str
    of: Callable[[Journey], float]
    failed: float = math.nan
    tested: bool = False
    digits: int | None = None

    @property
    def censored(self) -> bool:
        """Whether infinite stands for "not within this run": metres until something happens."""
        return self.failed == math.inf


@dataclass(frozen=True)
class Group:
    """Scores that belong together."""

    name: str
    scores: tuple[Score, ...]


def _success(near: str, *, tested: bool = False) -> Score:
    distance, angle = NEAR[near]
    words = f"localized to the end ({distance:g} m, {math.degrees(angle):.0f}°)"
    name = f"success_{near}"
    return Score(name, "share", words, lambda run: run.fixes.success(near), 0.0, tested)


def _metres(name: str, words: str, of: Callable[[Journey], float]) -> Score:
    return Score(name, "m", f"{words}, median", of, math.inf, tested=True)


def _committed(run: Journey) -> float:
    late = run.fixes.rated & run.fixes.last
    return float(run.fixes.false[late].any()) if late.any() else math.nan


def _committed_steps(run: Journey) -> float:
    rated = run.fixes.rated
    return float(run.fixes.false[rated].mean()) if rated.any() else math.nan


def _to_recover(run: Journey) -> float:
    return run.fixes.metres_to_recover(run.carried)


def _late_mass(which: int) -> Callable[[Journey], float]:
    def of(run: Journey) -> float:
        assert run.masses is not None
        late = run.masses[run.fixes.last]
        return float(late[:, which].mean()) if late.size else math.nan

    return of


def _split(run: Journey) -> float:
    """The smaller share of the mass near either place, at the end: ½ undecided, 0 picked one."""
    masses = np.array([_late_mass(which)(run) for which in (0, 1)])
    return float(masses.min() / masses.sum()) if masses.sum() > 0 else math.nan


_SCORES: dict[str, tuple[Score, ...]] = {
    "lost": (
        _success("1m", tested=True),
        _success("05m"),
        _metres(
            "metres_to_localize", "metres to localize", lambda run: run.fixes.metres_to_localize
        ),
        Score("false_commitment", "share", "false commitment at the end", _committed),
        Score("false_steps", "", "false commitment, share of steps", _committed_steps),
    ),
    "ambiguity": (
        Score("mass_truth", "", "weight near the truth", _late_mass(0)),
        Score("mass_twin", "", "weight near its twin", _late_mass(1)),
        Score("mass_split", "", "smaller share of the two", _split),
    ),
    "recovery": (
        Score(
            "recovered",
            "share",
            f"recovered ({RECOVERED:g} m, {RECOVERED_STEPS} steps)",
            lambda run: float(math.isfinite(_to_recover(run))),
            0.0,
            tested=True,
        ),
        _metres("metres_to_recover", "metres to recover", _to_recover),
    ),
    "log": (
        Score(
            "position_median",
            "m",
            "position error, median",
            lambda run: float(np.median(run.fixes.distance)),
            tested=True,
            digits=3,
        ),
    ),
    "driving": (
        Score("success", "share", "arrived", lambda run: float(run.arrived), 0.0, tested=True),
        Score("spl", "", "SPL", lambda run: run.spl, 0.0),
        Score("contacts", "", "contacts", lambda run: float(run.collided.sum())),
        Score("clearance", "m", "least clearance, m", lambda run: run.clearance),
        Score("time", "steps", "steps", lambda run: float(len(run.truth) - 1)),
    ),
}
GROUPS = tuple(Group(*own) for own in _SCORES.items())
JOURNEY_SCORES = {score.name: score for group in GROUPS for score in group.scores}


Number = Annotated[float, Meta(ge=-1e100, le=1e100)]  # of a record: squares are finite


class WholeRun(Struct, frozen=True, kw_only=True):
    """What a trial's record has of its whole run.

    Attributes:
        scores: by name; None is censored or not available.
        curves: by name, each at the same steps; "way" is what was driven until then, m.
    """

    scores: dict[str, Number | None]
    curves: dict[str, list[Number]]

    def __post_init__(self) -> None:
        if other := self.scores.keys() - JOURNEY_SCORES.keys():
            raise ValueError(f"has a score of the whole run named {min(other)[:20]!r}")
        for name, value in self.scores.items():
            if not isinstance(value, float) or JOURNEY_SCORES[name].unit != "share":
                continue
            if not -_ROUNDING <= value <= 1 + _ROUNDING:
                raise ValueError(f"has {value:g} as {name}, which is a share")
        if "way" not in self.curves or len(set(map(len, self.curves.values()))) != 1:
            raise ValueError("has curves of the whole run of different lengths")


class RecordedTrack(Struct, frozen=True, kw_only=True):
    """What the record of a trial on a whole log has of it; see ``tracks.TrackLog``.

    Attributes:
        best: means of the best clusters, x, y and θ at each record of the log.
        scores: by name; None is not available.
    """

    best: tuple[list[Number], list[Number], list[Number]]
    scores: dict[str, Number | None]


def finite(scores: Mapping[str, float]) -> dict[str, float | None]:
    """Return scores as a record has them: an infinite one and an unknown one are None."""
    return {name: value if math.isfinite(value) else None for name, value in scores.items()}


def groups_named(names: Collection[str]) -> tuple[Group, ...]:
    """Return groups by name, in the order of ``GROUPS``."""
    return tuple(group for group in GROUPS if group.name in names)


def scores_of(run: Journey, groups: Sequence[Group]) -> dict[str, float]:
    """Return the scores of a run by name."""
    return {score.name: score.of(run) for score in chain.from_iterable(g.scores for g in groups)}


def whole_run(run: Journey, groups: Sequence[Group]) -> WholeRun:
    """Return what a record has of a run; curves have four digits, as a long run is many numbers."""
    fixes = run.fixes
    curves = {"way": fixes.way, "distance": fixes.distance, "angle": fixes.angle}
    if run.masses is not None:
        curves |= dict(zip(("mass_truth", "mass_twin"), run.masses.T, strict=True))
    rounded = {name: [float(f"{v:.4g}") for v in values] for name, values in curves.items()}
    return WholeRun(scores=finite(scores_of(run, groups)), curves=rounded)


_SAMPLE = 4096  # points at which a map is compared with itself
_ALIKE = 0.998  # of them: a point on a line between cells may fall to either side


def half_turned(floor_plan: Map, poses: Floats) -> Floats:
    """Return poses (n, 3) turned by 180° about the middle of a map."""
    x0, y0, x1, y1 = floor_plan.bounds
    return np.array([x0 + x1, y0 + y1, math.pi]) + np.array([-1.0, -1.0, 1.0]) * poses


def is_symmetric(floor_plan: Map) -> bool:
    """Whether a half turn about its middle gives the same map; asked at 4,096 points."""
    x0, y0, x1, y1 = floor_plan.bounds
    points = np.random.default_rng(0).uniform((x0, y0), (x1, y1), (_SAMPLE, 2))
    turned = np.array([x0 + x1, y0 + y1]) - points
    same = floor_plan.free(points) == floor_plan.free(turned)
    return float(same.mean()) >= _ALIKE


def weight_near(poses: Reals, weights: Floats, pose: Floats, metre: float) -> float:
    """Return the weight within 1 m and 30° of a pose."""
    distance, angle = NEAR["1m"]
    x, y, heading = poses.T
    dx, dy = x - pose[0], y - pose[1]
    close = np.flatnonzero(dx * dx + dy * dy <= (distance * metre) ** 2)
    turned = np.abs((heading[close] - pose[2] + math.pi) % (2 * math.pi) - math.pi)
    return float(weights[close[turned <= angle]].sum())
