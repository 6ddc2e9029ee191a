"""Lost, and found again: how well scans agree with the map, and where on it they agree better.

A belief that may be right is not given up for a place that looks alike: places that are found run
on beside it, and one of them takes over only if it explains the scans to come clearly better.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from deqmcl_gym.logs.motion import composed, has_moved, relative
from deqmcl_gym.logs.odometry import Stretch
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Floats, Singles, arrays
from deqmcl_gym.validation import integer, number
from localizers.api import Belief, best_cluster
from localizers.models import RobotModel
from localizers.models.nav2_scan import DistanceTable
from localizers.models.prior import GaussianPrior, random_poses
from localizers.models.scan import Scan

_NEAR = 0.15  # m from a wall: where a beam ends that agrees with the map
_SIGMA = 0.2  # m, of what is climbed when scans are matched
_CELL = 0.05  # m, of the table on a map of polygons
_APART = 0.2, math.radians(5)  # m, rad between two scans that are compared
_MEDIAN = 5  # scans
_KEPT = 10  # scans that places are searched by
_MATCHED = 50  # the best of all poses by three of them
_DISTINCT = 0.5, 0.3  # m, rad between those of these that run on
_SAME = 1.3, math.radians(40)  # m, rad: a place so near to the belief does not replace it
_FINE = 0.1, 0.05, 3  # first steps of a matcher, m and rad, and how often they are halved
_WIDE = 0.5, 0.2, 4
_MOST = 30  # its steps
_SPREAD = 0.25, 0.1  # m, rad: SD of the belief that begins where the robot is found
_SURE = 0.8  # agreement from which on a scan shows the heading
_DELAYS = 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0  # s
_TURNS, _FADING = 20, 0.98  # turns that are needed, and how fast they are forgotten
_NOWHERE = np.empty((0, 3))


@dataclass(frozen=True, kw_only=True)
class Relocalization:
    """When a lost robot's belief is replaced, and by what: for ``Tracker(…, recovery=…)``."""

    doubt: float = 0.85  #: agreement of the belief below which better places are looked for
    poses: int = 50_000  #: drawn in free space at each search
    #: m that a place runs on beside the belief before it may replace it; 1 rad of turning is 1 m
    way: float = 3.0
    least: float = 0.8  #: agreement that it must have on this way
    margin: float = 0.15  #: by which it must agree better than the belief

    def __post_init__(self) -> None:
        integer("recovery.poses", self.poses, low=_MATCHED)
        number("recovery.way", self.way, low=0)
        for name in ("doubt", "least", "margin"):
            number(f"recovery.{name}", getattr(self, name), low=0, high=1)


@dataclass(frozen=True)
class Seen:
    """A scan and the odometry's pose at it."""

    odometry: Floats  # (3,)
    scan: Scan


class MapAgreement:
    """The share of a scan's returns that end within 0.15 m of a wall; and poses matched to it."""

    def __init__(self, robot: RobotModel) -> None:
        """Make the tables of a robot's map."""
        self.metre = metre(robot.floor_plan.unit)
        self._lidar = robot.lidar
        reach, cell = 2 * _SIGMA * self.metre, _CELL * self.metre
        squares, frame = DistanceTable.of(robot.floor_plan, reach, cell)
        away = squares * (frame[-1] / self.metre) ** 2  # m²
        near, climbed = away <= _NEAR**2 + 1e-9, arrays.exp(-0.5 * away / _SIGMA**2)
        self._near = DistanceTable(near.astype(np.float32), frame)
        self._climbed = DistanceTable(climbed.astype(np.float32), frame)

    def returns(self, ranges: Singles) -> Scan:
        """Return a scan whose usable beams have a return."""
        scan = Scan.of(np.array(ranges, np.float64), self._lidar.max_range)
        return scan.without(True, scan.ranges >= self._lidar.max_range)

    def __call__(self, poses: Floats, seen: Seen) -> tuple[Floats, Floats]:
        """Share of a scan's returns that agree near each pose (n, 3), (n,); and where, (n, 3)."""
        matched, _ = self.matched(poses, [seen], *_FINE)
        return self._mean(self._near, matched, [seen]), matched

    def ranked(self, poses: Floats, seen: Sequence[Seen]) -> Floats:
        """How well scans, the last of them from these poses (n, 3), fit the map, (n,)."""
        return self._mean(self._climbed, poses, seen)

    def matched(
        self, poses: Floats, seen: Sequence[Seen], step: float, turn: float, halvings: int
    ) -> tuple[Floats, Floats]:
        """Return poses (n, 3), each climbed up ``ranked`` by a compass search, and that, (n,)."""
        matched, cost = arrays.compass_search(
            lambda tried: -self.ranked(tried, seen),
            poses,
            (step * self.metre, step * self.metre, turn),
            halvings=halvings,
            most=_MOST,
            moved=composed,
        )
        return matched, -cost

    def _mean(self, table: DistanceTable, poses: Floats, seen: Sequence[Seen]) -> Floats:
        """Mean of a table where the beams of scans end, 0 off it, (n,)."""
        out, beams = np.zeros(len(poses)), 0
        for record in seen:
            back = relative(seen[-1].odometry[None], record.odometry[None])[0]
            states = np.ascontiguousarray(composed(poses, back).T, np.float32)
            ranges, used = record.scan.ranges[record.scan.usable], record.scan.usable
            for origins, rows in self._lidar.fans(states, used):
                values = table.at_ends(origins, ranges[rows], self._lidar.bearings[used][rows])
                out += values.sum(axis=0, dtype=np.float64, where=np.isfinite(values))
            beams += record.scan.beams
        return out / beams


class ScanDelay:
    """By how much stamps of scans are late: the odometry has turned as they have, but before."""

    def __init__(self) -> None:
        """Begin without a turn."""
        self._last: tuple[float, float] | None = None  # time and heading of the scan before
        self._errors, self._turns = np.zeros(len(_DELAYS)), 0

    @property
    def seconds(self) -> float:
        """The delay that explains the latest turns clearly better than none, s; 0 if none does."""
        best = int(self._errors.argmin())
        clear = self._errors[0] > 1.5 * self._errors[best]
        return _DELAYS[best] if self._turns >= _TURNS and clear else 0.0

    def add(self, time: float, heading: float | None, odometry: Stretch) -> None:
        """Take the heading on the map that a scan of this stamp shows, rad; None if it does not."""
        last, self._last = self._last, None if heading is None else (time, heading)
        if last is None or heading is None:
            return
        turned = []
        for delay in _DELAYS:
            before, after = odometry.at(last[0] - delay), odometry.at(time - delay)
            if before is None or after is None:
                return
            turned.append(after[2] - before[2])
        by = arrays.wrapped(np.array(turned))
        if np.ptp(by) >= 0.05:  # rad: else all delays tell the same
            off = np.abs(arrays.wrapped(heading - last[1] - by)).clip(max=0.2)  # a wrong match
            self._errors, self._turns = _FADING * self._errors + off, self._turns + 1


@dataclass
class Lookout:
    """What a tracker knows of how well its scans agree with the map."""

    robot: RobotModel
    recovery: Relocalization | None
    seen: deque[Seen] = field(default_factory=lambda: deque(maxlen=_KEPT))
    shares: deque[float] = field(default_factory=lambda: deque(maxlen=_MEDIAN))
    pose: Floats = field(default_factory=partial(np.zeros, 3))  # the belief's
    places: Floats = field(default_factory=_NOWHERE.copy)  # that run on, (k, 3)
    #: how well they and the belief agreed since, a row a scan, (1 + k,)
    compared: list[Floats] = field(default_factory=list)
    way: float = 0.0  # m since they were found
    delay: ScanDelay = field(default_factory=ScanDelay)

    @cached_property
    def agreement(self) -> MapAgreement:
        """That of the robot's map, whose tables are made when they are needed."""
        return MapAgreement(self.robot)

    @property
    def share(self) -> float | None:
        """Median of the shares of the latest five scans that agree; None before there are five."""
        return float(np.median(self.shares)) if len(self.shares) == _MEDIAN else None

    def begin(self) -> None:
        """Begin with a new belief."""
        self.shares.clear()
        self._drop()

    def _drop(self) -> None:
        self.places, self.compared, self.way = _NOWHERE, [], 0.0

    def look(
        self,
        time: float,
        stretch: Stretch,
        ranges: Singles,
        belief: Belief,
        rng: np.random.Generator,
    ) -> GaussianPrior | None:
        """Compare a scan with the map, if one is due; return where a lost robot is found."""
        odometry, metre = np.array(stretch.at(time)), self.agreement.metre
        last = self.seen[-1].odometry if self.seen else None
        if last is not None and not has_moved(last, odometry, _APART[0] * metre, _APART[1]):
            return None
        scan = self.agreement.returns(ranges)
        points = belief.points()
        if scan.beams == 0 or points is None:
            return None
        self.pose = np.array(best_cluster(*points, unit=self.robot.floor_plan.unit).mean)
        self.seen.append(Seen(odometry, scan))
        share, matched = self.agreement(self.pose[None], self.seen[-1])
        self.delay.add(time, float(matched[0, 2]) if share[0] >= _SURE else None, stretch)
        self.shares.append(float(share[0]))
        if len(self.places) and last is not None:
            moved = relative(last[None], odometry[None])[0]
            self.places = self.agreement.matched(
                composed(self.places, moved), list(self.seen), *_FINE
            )[0]
            shares, _ = self.agreement(self.places, self.seen[-1])
            self.compared.append(np.concatenate([share, shares]))
            self.way += math.hypot(*moved[:2]) / metre + abs(float(moved[2]))
        return self._recovered(rng)

    def _recovered(self, rng: np.random.Generator) -> GaussianPrior | None:
        """Return where the robot is; search if the belief is in doubt."""
        if self.recovery is None or self.share is None or self.share >= self.recovery.doubt:
            self._drop()
            return None
        if self.compared and self.way >= self.recovery.way:
            belief, *places = np.mean(self.compared, axis=0).tolist()
            best = int(np.argmax(places))
            mean, metre = self.places[best], self.agreement.metre
            least = max(self.recovery.least, belief + self.recovery.margin)
            elsewhere = has_moved(self.pose, mean, _SAME[0] * metre, _SAME[1])
            self._drop()
            if places[best] >= least and elsewhere:
                self.shares.clear()
                return GaussianPrior(
                    mean=mean.tolist(), sd_position=_SPREAD[0] * metre, sd_heading=_SPREAD[1]
                )
        if not len(self.places):
            self._search(self.recovery.poses, rng.spawn(1)[0])
        return None

    def _search(self, poses: int, rng: np.random.Generator) -> None:
        """Find places where the latest scans fit the map, after that of the belief."""
        drawn = random_poses(self.robot.floor_plan, poses, rng, self.robot.radius)
        tried, seen = np.vstack([self.pose, drawn.T]), list(self.seen)
        some = [seen[k] for k in np.linspace(0, len(seen) - 1, 3).astype(int)]
        order = np.argsort(-self.agreement.ranked(tried[1:], some), kind="stable")[:_MATCHED]
        matched, height = self.agreement.matched(tried[[0, *(1 + order)]], seen, *_WIDE)
        places, far = [matched[0]], (_DISTINCT[0] * self.agreement.metre, _DISTINCT[1])
        for pose in matched[np.argsort(-height, kind="stable")]:
            if all(has_moved(place, pose, *far) for place in places):
                places.append(pose)
        self.places = np.array(places[:6])  # the first is the belief's
