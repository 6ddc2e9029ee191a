"""Tracker: a localizer in the loop of a robot, fed with messages as they come.

Odometry poses and scans have rates and delays of their own; a localizer takes one scan and the
increment since the last one. What is remembered is bounded, so a tracker runs for good.
"""

import math
from collections import deque
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.logs.motion import composed, has_moved, increments_of, one_pose, relative
from deqmcl_gym.logs.odometry import FASTEST, Odometry, Taken, frame_of
from deqmcl_gym.logs.scans import resampled
from deqmcl_gym.maps import Lidar
from deqmcl_gym.maps.map import PIXELS, pixel
from deqmcl_gym.numerics import Floats, Pose, Reals
from deqmcl_gym.validation import InputError, number, one_of, shown
from localizers.api import Belief, Localizer, Prior, best_cluster, quality_of
from localizers.calibration import Calibration, spread_about
from localizers.models import RobotModel
from localizers.recovery import Lookout, Relocalization
from localizers.registry import LOCALIZER

_EVERY = 10.0, math.radians(5)  # px (0.2 m), rad
_MOST = 10_000  # updates that are remembered
_NO_PLAN = np.empty((0, 3))
_AS_BELIEVED = Calibration()


@dataclass
class Counts:
    """What has become of a tracker's messages."""

    updates: int = 0  # scans that the localizer was given
    still: int = 0  # scans that it was not, as the robot had hardly moved since the last one
    late_odometry: int = 0  # messages older than the newest, or doubled: left out
    odometry_jumps: int = 0  # steps faster than the robot can go: taken as no motion
    # two messages in a row that are more than 1 s older than the newest, in their order: all stamps
    # begin anew, from the first of them
    clock_resets: int = 0
    late_scans: int = 0  # not newer than the last whose odometry was there, or doubled: left out
    crowded_scans: int = 0  # more than 10 waited for odometry: the one that came first is left out
    scans_without_odometry: int = 0  # before the first, or in a gap of over 1 s and 3 usual periods
    scans_before_start: int = 0  # not newer than the start, or no start was told
    unusable: int = 0  # odometry or stamps that are not finite: left out
    frozen_scans: int = 0  # the same as before though the robot has moved: taken as blind
    misdated_scans: int = 0  # used, though ``stamps_late_by`` says 0.2 s or more
    recoveries: int = 0  # beliefs that were replaced, as the robot was found elsewhere


@dataclass(frozen=True)
class Estimate:
    """Where a tracker believes the robot to be at a time."""

    time: float  #: s, of the odometry that it was carried on to
    poses: Floats  #: the cloud, (x, y, θ) in the map, (n, 3)
    weights: Floats  #: their weights, with sum 1, (n,)
    quality: float | None  #: confidence that it is not lost, in [0, 1]; None if not given
    odometry: Pose  #: the pose by odometry at that time
    unit: str  #: of lengths
    #: share of a scan's returns within 0.15 m of a wall of the map, the scan moved a little to fit;
    #: median of five scans 0.2 m or 5° apart; None before them, and of a map that is not known
    agreement: float | None = None
    lost: bool = False  #: whether that is below ``lost_below``
    calibration: Calibration = _AS_BELIEVED  #: of what is published

    @cached_property
    def pose(self) -> Pose:
        """Mean of the best cluster (x, y, θ): see ``best_cluster``."""
        return best_cluster(self.poses, self.weights, unit=self.unit).mean

    @cached_property
    def covariance(self) -> Floats:
        """What is published of the cloud's second moments about ``pose``, (3, 3).

        So a second place far away makes it large. NaN of a single point without a floor.
        """
        return self.calibration.published(spread_about(self.pose, self.poses, self.weights))

    @property
    def map_to_odom(self) -> Pose:
        """The frame of the odometry in the map: ``map_to_odom`` ⊕ odometry = ``pose``."""
        return frame_of(self.pose, self.odometry)


@dataclass(frozen=True)
class _Update:
    """A belief, its time, and the odometry then, without jumps."""

    time: float
    odometry: Pose
    belief: Belief
    agreement: float | None = None


@dataclass
class Tracker:
    """A localizer that is fed with odometry poses and scans as they come.

    The first message may be of any kind. A scan is used when the odometry has reached its stamp,
    between whose messages it is interpolated, and when the robot has moved far enough since the
    last scan used. Scans of ``initialpose``'s own stamp are not used: p(x_0) is of that time.
    """

    localizer: Localizer
    rng: np.random.Generator  #: the localizer's only source of randomness
    unit: str = "m"  #: of all lengths, "m" or "px"
    #: distance and angle (rad) of which one must be reached between two updates; None is 0.2 m and
    #: 5°, (0, 0) uses every scan
    every: tuple[float, float] | None = None
    #: speeds, per s and rad/s, above which odometry jumps; None is 5 m/s and 2π rad/s
    fastest: tuple[float, float] | None = None
    memory: float = 10.0  #: s of odometry and beliefs that ``at`` can look back
    lidar: Lidar | None = None  #: of the localizer, for scans that vary; None is ``robot.lidar``
    calibration: Calibration = _AS_BELIEVED  #: of ``Estimate.covariance``
    lost_below: float = 0.7  #: agreement with the map below which an estimate is ``lost``
    recovery: Relocalization | None = None  #: how it finds itself when it is lost; None: it doesn't
    counts: Counts = field(default_factory=Counts, init=False)

    def __post_init__(self) -> None:
        LOCALIZER.checked(shown(self.localizer), self.localizer)
        size = pixel(one_of("unit of length", self.unit, PIXELS))
        every = (_EVERY[0] * size, _EVERY[1]) if self.every is None else self.every
        fastest = (FASTEST[0] * size, FASTEST[1]) if self.fastest is None else self.fastest
        self.every, self.fastest = _pair("every", every), _pair("fastest", fastest)
        number("memory", self.memory, low=0, above=True)
        number("lost_below", self.lost_below, low=0, high=1)
        robot = getattr(self.localizer, "robot", None)
        if self.lidar is None:
            self.lidar = getattr(robot, "lidar", None)
        self._lookout = Lookout(robot, self.recovery) if isinstance(robot, RobotModel) else None
        if self.recovery is not None and self._lookout is None:
            raise InputError(
                "recovery is given, but the localizer does not say for which robot it was made: "
                "give it an attribute robot, the RobotModel."
            )
        self._odometry = Odometry(self.unit, self.fastest)
        # a scan, and the odometry at the first of those in a row that are the same
        self._scanned: tuple[bytes, Pose] | None = None
        self._waiting: dict[float, Reals] = {}  # by stamp, in the order in which they came
        self._updates: deque[_Update] = deque(maxlen=_MOST)
        self._looked_at = -math.inf  # stamp of the last scan that waited no longer
        self._start: tuple[Prior, float | None] | None = None

    def initialpose(self, prior: Prior, time: float | None = None) -> bool:
        """Start anew from a prior at a time, s; return whether the belief has begun.

        It begins when the odometry has reached that stamp; at a stamp whose odometry is not known
        any more, and of None, with the latest odometry.
        """
        self._start = prior, time
        self._updates.clear()
        if self._lookout is not None:
            self._lookout.begin()
        return self._begun()

    def odometry(self, time: float, pose: ArrayLike) -> bool:
        """Take a pose by odometry (x, y, θ) with its stamp, s; return whether there was an update.

        The localizer may refuse a scan that waited for it.
        """
        state = np.asarray(pose, dtype=np.float64)
        if state.shape != (3,):
            raise InputError(f"the odometry has shape {state.shape}, but must be a pose (x, y, θ).")
        taken = self._odometry.take(time, one_pose(state[None]))
        if taken in (Taken.UNUSABLE, Taken.LATE):
            self.counts.unusable += taken is Taken.UNUSABLE
            self.counts.late_odometry += taken is Taken.LATE
            return False
        if taken is Taken.RESET:
            self._begin_stretch()
        self.counts.odometry_jumps = self._odometry.jumps
        self._odometry.stretch.forget(time - self.memory)
        self._begun()
        return self._updated()

    def scan(self, time: float, ranges: Reals, bearings: ArrayLike | None = None) -> bool:
        """Take a scan (B,) with its stamp, s; return whether there was an update.

        Bearings are of its beams against the robot's heading, (B,) rad; None: the lidar's. Scans
        may vary: each bearing of the lidar gets the nearest beam; see ``logs.scans.resampled``.
        """
        if not math.isfinite(time):
            self.counts.unusable += 1
            return False
        if time <= self._looked_at or time in self._waiting:
            self.counts.late_scans += 1
            return False
        if bearings is None:
            seen = np.array(ranges)
        elif self.lidar is None:
            raise InputError(
                "bearings are given, but the localizer does not say for which lidar it was made: "
                "give Tracker(…, lidar=…)."
            )
        else:
            seen = resampled(ranges, bearings, self.lidar.bearings)
        self._waiting[time] = seen
        updated = self._updated()
        if len(self._waiting) > 10:
            del self._waiting[next(iter(self._waiting))]
            self.counts.crowded_scans += 1
        return updated

    def at(self, time: float | None = None) -> Estimate | None:
        """Return the estimate at a time, s; None of time is the latest odometry's.

        That is the belief after the last scan used until then, carried on by the odometry without
        its noise; after the latest odometry the robot stands still. None is returned before the
        start, and where the odometry is older than ``memory`` or has a gap.
        """
        if self._odometry.newest is None:
            return None
        newest, _ = self._odometry.newest
        when = newest if time is None else min(time, newest)
        update = next((update for update in reversed(self._updates) if update.time <= when), None)
        pose = self._odometry.stretch.at(when)
        points = None if update is None else update.belief.points()
        if update is None or pose is None or points is None:
            return None
        moved = relative(np.array([update.odometry]), np.array([pose]))
        poses = composed(np.asarray(points[0], np.float64), moved)
        frame = self._odometry.stretch.frame_at(when)
        by = pose if frame is None else one_pose(relative(np.array([frame]), np.array([pose])))
        quality, agreed = quality_of(update.belief), update.agreement
        lost = agreed is not None and agreed < self.lost_below
        return Estimate(
            when, poses, points[1], quality, by, self.unit, agreed, lost, self.calibration
        )

    @property
    def stamps_late_by(self) -> float:
        """How much later scans are stamped than measured, s, by their turns on the map; up to 1."""
        return 0.0 if self._lookout is None else self._lookout.delay.seconds

    def _begun(self) -> bool:
        """Begin the belief if its odometry is there."""
        newest = self._odometry.newest
        if self._start is None or newest is None:
            return False
        prior, time = self._start
        if time is not None and time > newest[0]:
            return False
        past = None if time is None else self._odometry.stretch.at(time)
        at, pose = newest if time is None or past is None else (time, past)
        self._start = None
        belief = self.localizer.reset(prior, _NO_PLAN, self.rng)
        self._updates.append(_Update(at, pose, belief))
        return True

    def _updated(self) -> bool:
        """Give the localizer the scans whose odometry is there."""
        if not self._waiting or self._odometry.newest is None:
            return False
        updated, (newest, _) = False, self._odometry.newest
        for time in sorted(stamp for stamp in self._waiting if stamp <= newest):
            self._looked_at = time
            updated |= self._used(time, self._waiting.pop(time))
        return updated

    def _used(self, time: float, ranges: Reals) -> bool:
        if not self._updates or time <= self._updates[-1].time:
            self.counts.scans_before_start += 1
            return False
        if (pose := self._odometry.stretch.at(time)) is None:
            self.counts.scans_without_odometry += 1
            return False
        assert self.every is not None
        last = self._updates[-1].odometry
        if not has_moved(last, pose, *self.every):
            self.counts.still += 1
            return False
        (moved,) = increments_of(np.array([last, pose])).astype(np.float32)
        if frozen := self._is_frozen(ranges, pose):
            self.counts.frozen_scans += 1
            ranges = np.full(np.shape(ranges), np.nan, np.float32)
        belief = self.localizer.update(ranges, moved, _NO_PLAN)
        self.counts.updates += 1
        agreement = None
        if (lookout := self._lookout) is not None:
            stretch = self._odometry.stretch
            prior = None if frozen else lookout.look(time, stretch, ranges, belief, self.rng)
            if prior is not None:
                self.counts.recoveries += 1
                belief = self.localizer.reset(prior, _NO_PLAN, self.rng)
            agreement = lookout.share
            self.counts.misdated_scans += lookout.delay.seconds >= 0.2
        self._updates.append(_Update(time, pose, belief, agreement))
        while len(self._updates) > 1 and self._updates[1].time <= time - self.memory:
            self._updates.popleft()  # the one before that time is what was believed then
        return True

    def _is_frozen(self, ranges: Reals, pose: Pose) -> bool:
        """Whether a scan with returns is the same as at a place that the robot has left."""
        content = ranges.tobytes()
        if self._scanned is None or self._scanned[0] != content:
            self._scanned = content, pose
            return False
        far = _EVERY[0] * pixel(self.unit), _EVERY[1]
        return has_moved(self._scanned[1], pose, *far) and bool(np.isfinite(ranges).any())

    def _begin_stretch(self) -> None:
        """Begin anew with stamps of a clock that was set back; the belief stays."""
        self.counts.late_odometry -= 1  # the first: it is used after all
        self.counts.clock_resets += 1
        self._waiting.clear()
        self._looked_at = -math.inf
        if self._start is not None:
            self._start = self._start[0], None  # its stamp was of the other clock
        if self._updates:
            latest, begin = self._updates[-1], self._odometry.stretch.times[0]
            self._updates.clear()
            self._updates.append(replace(latest, time=begin))


def _pair(what: str, given: tuple[float, float]) -> tuple[float, float]:
    try:
        first, second = given
    except (TypeError, ValueError):
        raise InputError(f"{what} is {given!r}, but must be two numbers, as (0.2, 0.1).") from None
    return (
        number(f"the first of {what}", first, low=0, finite=False),
        number(f"the second of {what}", second, low=0, finite=False),
    )
