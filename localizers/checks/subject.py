"""The localizer under check, and the robot and the short random drive that it is tried on."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from deqmcl_gym.maps import Lidar, Map, PolygonMap
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import SUM_TOLERANCE, digits
from localizers.api import Belief, Localizer
from localizers.models.beams import GaussianUniform
from localizers.models.motion import OdometryMotion
from localizers.models.prior import GaussianPrior, UniformPrior
from localizers.models.robot import RobotModel
from localizers.registry import LOCALIZER, Factory

DRIVE_STEPS = 12
OFFSETS = range(-DRIVE_STEPS, DRIVE_STEPS + 1)
_TRIES = 100
_LONGEST = 20.0  # px, of a step: 0.4 m

Snapshot = Mapping[int, tuple[Floats, Floats]]  # poses and weights by offset
Seed = int | np.random.Generator
_T = TypeVar("_T")
Law = Callable[[_T], str | None]
Laws = Mapping[Law[_T], Law[_T] | None]  # each with the one that must hold before it is tried


class LawBrokenError(Exception):
    """A law is broken; the text is the reason."""


class LawSkippedError(Exception):
    """A law does not apply; the text is the reason."""


@dataclass(frozen=True, kw_only=True)
class RandomDrive:
    """The input of a localizer for T steps.

    Attributes:
        prior: p(x_0); in the drive itself it is Gaussian.
        actions: carried out, (T, 2); the first of those planned.
        scans: taken after them, (T, B).
        plans: at t = 0 … T, each (h, 2).
    """

    prior: Any
    actions: Floats
    scans: Floats
    plans: Sequence[Floats]

    def inputs(self, t: int) -> list[Floats]:
        """Return copies of what a localizer gets at t: plan, later ranges, action and plan."""
        before = [self.scans[t - 1], self.actions[t - 1]] if t else []
        return [array.copy() for array in (*before, self.plans[t])]


def default_robot() -> RobotModel:
    """Return a robot with eight beams in a rectangular corridor."""
    return robot_on(
        PolygonMap(
            outer=[(0, 0), (350, 0), (350, 300), (0, 300)],
            obstacles=([(100, 100), (250, 100), (250, 200), (100, 200)],),
        )
    )


def robot_on(floor_plan: Map) -> RobotModel:
    """Return a robot with eight beams of 400 px, or 8 m, on a map."""
    px = pixel(floor_plan.unit)
    return RobotModel(
        floor_plan=floor_plan,
        lidar=Lidar(beams=8, field_of_view=2 * np.pi, max_range=400.0 * px, sigma=10.0 * px),
        motion=OdometryMotion(drive=0.2, turn=0.3, drift=0.01 / px),
        scan=GaussianUniform(sigma=20.0 * px),
    )


def random_drive(robot: RobotModel, rng: np.random.Generator) -> RandomDrive:
    """Drive from a free pose, turning where a wall is near; only half of the plan is driven.

    The noise is small and not that which the robot assumes: a check tests whether a localizer
    keeps the laws, not how accurate it is.
    """
    longest = _LONGEST * pixel(robot.floor_plan.unit)
    stride = min(size_of(robot.floor_plan) / 30, longest)
    poses = [_free_pose(robot, rng)]
    actions = []
    for _ in range(2 * DRIVE_STEPS):
        action, pose = _free_step(robot, poses[-1], stride, rng)
        actions.append(action)
        poses.append(pose)
    lidar = robot.lidar
    seen_from = np.array(poses[1 : DRIVE_STEPS + 1]).T
    exact = np.asarray(lidar.ranges(robot.floor_plan, seen_from), float)
    noisy = exact + rng.normal(0.0, 0.01 * stride, exact.shape)
    x, y, heading = poses[0].tolist()
    return RandomDrive(
        prior=GaussianPrior(mean=(x, y, heading), sd_position=0.5 * stride, sd_heading=0.1),
        actions=np.array(actions[:DRIVE_STEPS]),
        scans=np.clip(noisy, 0.0, lidar.max_range),
        plans=[np.array(actions[t:]) for t in range(DRIVE_STEPS + 1)],
    )


def size_of(floor_plan: Map) -> float:
    """Return the shorter side of the box around a floor plan, in its unit."""
    x0, y0, x1, y1 = floor_plan.bounds
    return min(x1 - x0, y1 - y0)


def _free_pose(robot: RobotModel, rng: np.random.Generator) -> Floats:
    """Draw a pose where the robot fits and sees far, heading about along the x axis.

    Slightly below 0: it can be written 2π higher, and half a turn from it lies ±π.
    """
    poses = UniformPrior(floor_plan=robot.floor_plan, radius=robot.radius).sample(_TRIES, rng)
    poses[:, 2] = rng.uniform(-0.1, 0.0, _TRIES)
    farthest: Floats = poses[robot.floor_plan.ranges(poses, [0.0])[:, 0].argmax()]
    return farthest


def _free_step(
    robot: RobotModel, pose: Floats, stride: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Draw a step that touches no wall, (d, φ), and where it ends; a turn on the spot if none.

    As long as there is room the heading stays about 0.
    """
    distances = np.append(rng.uniform(0.5, 1.0, _TRIES - 1) * stride, 0.0)
    turns = rng.normal(-0.5 * pose[2], np.linspace(0.1, 2.0, _TRIES))
    headings = pose[2] + turns
    moves = [distances * np.cos(headings), distances * np.sin(headings), turns]
    ends = pose + np.column_stack(moves)
    starts = np.broadcast_to(pose, ends.shape)
    touches = robot.floor_plan.collides(starts, ends, robot.radius) & (distances > 0)
    first = touches.argmin()
    return np.array([distances[first], turns[first]]), ends[first]


@dataclass(frozen=True, kw_only=True)
class Subject:
    """A localizer under check.

    Attributes:
        name: what it is called.
        factory: makes it.
        params: given to the factory.
        robot: what it is made for.
        drive: along which it is run.
        sent: how another process finds it: a name to resolve, or the factory itself.
        imported: what its import changed of the state of this process.
    """

    name: str
    factory: Factory
    params: Mapping[str, Any]
    robot: RobotModel
    drive: RandomDrive
    sent: str | Factory | None = None
    imported: tuple[str, ...] = ()

    @property
    def file(self) -> str | None:
        """The file that the localizer is written in."""
        module = sys.modules.get(getattr(self.factory, "__module__", None) or "")
        return getattr(module, "__file__", None)

    def made(self, robot: RobotModel | None = None, **params: Any) -> Localizer:
        """Make a new localizer, with other parameters or for another robot if given."""
        robot = self.robot if robot is None else robot
        made: Localizer = self.factory(robot, **(dict(self.params) | params))
        LOCALIZER.checked(self.name, made)
        return made

    def history(
        self, localizer: Localizer | None = None, *, seed: Seed = 0, **changes: Any
    ) -> list[Snapshot]:
        """Run a localizer, a new one if none is given, along the drive, changed as told."""
        drive = replace(self.drive, **changes)
        run = steps(self.made() if localizer is None else localizer, drive, seed)
        return [snapshot(belief, t) for t, (belief, _) in enumerate(run)]


def steps(
    localizer: Localizer, drive: RandomDrive, seed: Seed = 0
) -> Iterator[tuple[Belief, list[Floats]]]:
    """Run a localizer along a drive; yield its beliefs, each with the arrays given for it."""
    given = drive.inputs(0)
    yield localizer.reset(drive.prior, given[0], np.random.default_rng(seed)), given
    for t in range(1, len(drive.plans)):
        given = drive.inputs(t)
        yield localizer.update(*given), given


def snapshot(belief: Belief, t: int) -> Snapshot:
    """Copy all points of a belief at step t.

    Raises:
        LawBrokenError: it has none, or not in the form of ``Belief.points``.
    """
    verb = f"{'reset' if t == 0 else 'update'} (step {t})"
    if not callable(getattr(belief, "points", None)):
        raise LawBrokenError(
            f"{verb} returned {_kind(belief)}, but must return a belief with points(offset)"
        )
    by_offset = {
        k: _copied(points, f"points({k}) at step {t}")
        for k in OFFSETS
        if (points := belief.points(k)) is not None
    }
    if 0 not in by_offset:
        raise LawBrokenError(f"the belief of {verb} has no points(0): it must hold the present")
    return by_offset


def _copied(points: Any, where: str) -> tuple[Floats, Floats]:
    if not (isinstance(points, tuple) and len(points) == 2):
        raise LawBrokenError(f"{where} is {_kind(points)}, but must be (poses, weights) or None")
    for name, array in zip(("poses", "weights"), points, strict=True):
        masked = isinstance(array, np.ma.MaskedArray)
        if masked or not isinstance(array, np.ndarray) or array.dtype.kind != "f":
            raise LawBrokenError(
                f"the {name} of {where} are {_kind(array)}, but must be an array of floats"
            )
    poses, weights = points
    n = weights.size
    if weights.shape != (n,) or n == 0 or poses.shape != (n, 3):
        raise LawBrokenError(
            f"{where} has poses {poses.shape} and weights {weights.shape}, but must have (n, 3) "
            "and (n,), n ≥ 1"
        )
    return poses.copy(), weights.copy()


def _kind(thing: object) -> str:
    of = f" of {thing.dtype}" if isinstance(thing, np.ndarray) else ""
    return "None" if thing is None else f"an object of type {type(thing).__name__}{of}"


def first_difference(run: Sequence[Snapshot], other: Sequence[Snapshot]) -> str | None:
    """Say where two runs first differ; None if they are equal bit by bit."""
    for t, (one, two) in enumerate(zip(run, other, strict=True)):
        for offset in OFFSETS:
            a, b = one.get(offset, ()), two.get(offset, ())
            same = (np.array_equal(*pair, equal_nan=True) for pair in zip(a, b, strict=True))
            if len(a) != len(b) or not all(same):
                return f"points({offset}) of step {t}"
    return None


def require_same(run: Sequence[Snapshot], other: Sequence[Snapshot], otherwise: str) -> None:
    """Raise with ``otherwise`` and where, unless two runs are equal bit by bit."""
    where = first_difference(run, other)
    if where is not None:
        raise LawBrokenError(f"{otherwise}, first at {where}")


def require_finite(run: Sequence[Snapshot]) -> None:
    """Raise unless all poses and weights are finite."""
    for where, *points in _points_of(run):
        for name, array in zip(("pose", "weight"), points, strict=True):
            bad = array[~np.isfinite(array)]
            if bad.size:
                raise LawBrokenError(f"a {name} of {where} is {bad[0]:g}")


def require_valid(run: Sequence[Snapshot]) -> None:
    """Raise unless all is finite, and weights are not negative and of sum 1, as benchmarks need."""
    require_finite(run)
    for where, _, weights in _points_of(run):
        if weights.min() < 0:
            raise LawBrokenError(f"a weight of {where} is {weights.min():g}")
        total = float(weights.sum(dtype=np.float64))
        if not abs(total - 1) <= SUM_TOLERANCE:
            raise LawBrokenError(f"the weights of {where} add up to {digits(total)}, not 1")


def _points_of(run: Sequence[Snapshot]) -> Iterator[tuple[str, Floats, Floats]]:
    for t, belief in enumerate(run):
        for offset, points in belief.items():
            yield f"points({offset}) at step {t}", *points
