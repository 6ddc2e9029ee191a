"""The localizer under check, and the robot and the short random drive that it is tried on."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from deqmcl_gym.maps import GridMap, Lidar, Map, PolygonMap
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import SUM_TOLERANCE, InputError, digits
from localizers.api import Belief, Localizer, Prior
from localizers.models.beams import GaussianUniform
from localizers.models.motion import OdometryMotion
from localizers.models.prior import GaussianPrior
from localizers.models.robot import RobotModel
from localizers.naming.registry import Factory, made_by

STEPS = 12
_TRIES = 100
_LONGEST = 20.0  # px, of a step: 0.4 m


@dataclass(frozen=True, kw_only=True)
class Drive:
    """The input of a localizer for T steps.

    Attributes:
        prior: p(x_0).
        actions: carried out, (T, 2); the first of those planned.
        scans: taken after them, (T, B).
        plans: at t = 0 … T, each (h, 2).
    """

    prior: GaussianPrior
    actions: Floats
    scans: Floats
    plans: Sequence[Floats]


def default_robot() -> RobotModel:
    """Return a robot with eight beams in a rectangular corridor."""
    return robot_on(
        PolygonMap(
            outer=[(0, 0), (350, 0), (350, 300), (0, 300)],
            obstacles=([(100, 100), (250, 100), (250, 200), (100, 200)],),
        )
    )


def robot_on_cells() -> RobotModel:
    """Return the same robot in a hall of 9 m by 7 m with a pillar, in cells of 0.1 m."""
    cells = np.zeros((70, 90), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[28:40, 28:60] = 100
    return robot_on(GridMap(occupancy=cells, resolution=0.1))


def robot_on(floor_plan: Map) -> RobotModel:
    """Return a robot with eight beams of 400 px, or 8 m, on a map."""
    px = pixel(floor_plan.unit)
    return RobotModel(
        floor_plan=floor_plan,
        lidar=Lidar(beams=8, field_of_view=2 * np.pi, max_range=400.0 * px, sigma=10.0 * px),
        motion=OdometryMotion(drive=0.2, turn=0.3, drift=0.01 / px),
        scan=GaussianUniform(sigma=20.0 * px),
    )


def random_drive(robot: RobotModel, rng: np.random.Generator) -> Drive:
    """Drive from a free pose, turning where a wall is near; only half of the plan is driven.

    The noise is small and not that which the robot assumes: a check tests whether a localizer
    keeps the laws, not how accurate it is.
    """
    longest = _LONGEST * pixel(robot.floor_plan.unit)
    stride = min(size_of(robot.floor_plan) / 30, longest)
    poses = [_free_pose(robot, rng)]
    actions = []
    for _ in range(2 * STEPS):
        action, pose = _free_step(robot, poses[-1], stride, rng)
        actions.append(action)
        poses.append(pose)
    lidar = robot.lidar
    exact = np.asarray(
        lidar.ranges(robot.floor_plan, np.array(poses[1 : STEPS + 1]).T),
        np.float64,
    )
    noisy = exact + rng.normal(0.0, 0.01 * stride, exact.shape)
    x, y, heading = poses[0].tolist()
    return Drive(
        prior=GaussianPrior(mean=(x, y, heading), sd_position=0.5 * stride, sd_heading=0.1),
        actions=np.array(actions[:STEPS]),
        scans=np.clip(noisy, 0.0, lidar.max_range),
        plans=[np.array(actions[t:]) for t in range(STEPS + 1)],
    )


def size_of(floor_plan: Map) -> float:
    """Return the shorter side of the box around a floor plan, in its unit."""
    x0, y0, x1, y1 = floor_plan.bounds
    return min(x1 - x0, y1 - y0)


def _free_pose(robot: RobotModel, rng: np.random.Generator) -> Floats:
    """Draw a pose where the robot fits and sees far, heading about along the x axis.

    Slightly below 0: it can be written 2π higher, and half a turn from it lies ±π.
    """
    x0, y0, x1, y1 = robot.floor_plan.bounds
    for _ in range(_TRIES):
        poses = rng.uniform((x0, y0, -0.1), (x1, y1, 0.0), (_TRIES, 3))
        free = robot.floor_plan.free(poses, robot.radius)
        if free.any():
            room_ahead = np.where(free, robot.floor_plan.ranges(poses, [0.0])[:, 0], -1.0)
            pose: Floats = poses[room_ahead.argmax()]
            return pose
    raise InputError(
        f"the robot's radius is {robot.radius:g} {robot.floor_plan.unit}, but a disc that wide "
        "does not fit into its floor plan: give a smaller radius or another floor plan."
    )


def _free_step(
    robot: RobotModel, pose: Floats, stride: float, rng: np.random.Generator
) -> tuple[tuple[float, float], Floats]:
    """Draw a step that touches no wall; a turn on the spot if there is none.

    As long as there is room the heading stays about 0.
    """
    sd = np.linspace(0.1, 2.0, _TRIES)
    for distance, spread in zip(
        (*rng.uniform(0.5, 1.0, _TRIES - 1) * stride, 0.0), sd, strict=True
    ):
        turn = rng.normal(-0.5 * pose[2], spread)
        heading = pose[2] + turn
        ahead = pose + np.array([distance * np.cos(heading), distance * np.sin(heading), turn])
        if distance == 0.0 or not robot.floor_plan.collides(pose[None], ahead[None], robot.radius):
            break
    return (float(distance), float(turn)), ahead


Snapshot = Mapping[int, tuple[Floats, Floats]]  # poses and weights by offset
Seed = int | np.random.Generator

OFFSETS = range(-STEPS, STEPS + 1)


class LawBrokenError(Exception):
    """A localizer breaks a law; the text is the reason."""


class LawSkippedError(Exception):
    """A law does not apply to a localizer; the text is the reason."""


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
        timeout: how long a worker may take to answer, s.
        before: the state of this process before the localizer was loaded.
        loaded: its state after that.
    """

    name: str
    factory: Factory
    params: Mapping[str, Any]
    robot: RobotModel
    drive: Drive
    sent: str | Factory
    timeout: float
    before: Mapping[str, Any]
    loaded: Mapping[str, Any]

    @property
    def file(self) -> str | None:
        """The file that the localizer is written in."""
        module = sys.modules.get(getattr(self.factory, "__module__", None) or "")
        return getattr(module, "__file__", None)

    def made(self, robot: RobotModel | None = None, **params: Any) -> Localizer:
        """Make a new localizer, with other parameters or for another robot if given."""
        robot = self.robot if robot is None else robot
        return made_by(self.factory, self.name, robot, **(dict(self.params) | params))

    def history(self, localizer: Localizer | None = None, *, seed: Seed = 0) -> list[Snapshot]:
        """Run a localizer (a new one if none is given) along the drive."""
        return history(self.made() if localizer is None else localizer, self.drive, seed=seed)


def history(
    localizer: Localizer, drive: Drive, *, seed: Seed = 0, prior: Prior | None = None
) -> list[Snapshot]:
    """Run a localizer along a drive; return its beliefs at t = 0 … T."""
    return [snapshot(belief, t) for t, belief in enumerate(beliefs(localizer, drive, seed, prior))]


def beliefs(
    localizer: Localizer, drive: Drive, seed: Seed = 0, prior: Prior | None = None
) -> Iterator[Belief]:
    """Run a localizer along a drive; yield its beliefs at t = 0 … T."""
    rng = np.random.default_rng(seed)
    yield localizer.reset(drive.prior if prior is None else prior, drive.plans[0].copy(), rng)
    yield from continued(localizer, drive, 0)


def continued(localizer: Localizer, drive: Drive, t: int) -> Iterator[Belief]:
    """Run on from t; yield the beliefs at t + 1 … T."""
    for action, scan, plan in zip(
        drive.actions[t:], drive.scans[t:], drive.plans[t + 1 :], strict=True
    ):
        yield localizer.update(scan.copy(), action.copy(), plan.copy())


def snapshot(belief: Belief, t: int) -> Snapshot:
    """Copy all points of a belief at step t.

    Raises:
        LawBrokenError: it has none, or not in the form of ``Belief.points``.
    """
    verb = f"{'reset' if t == 0 else 'update'} (step {t})"
    if not callable(getattr(belief, "points", None)):
        raise LawBrokenError(
            f"{verb} returned {_shown(belief)}, but must return a belief with points(offset)"
        )
    found = {k: _copied(points, k, t) for k in OFFSETS if (points := belief.points(k)) is not None}
    if 0 not in found:
        raise LawBrokenError(f"the belief of {verb} has no points(0): it must hold the present")
    return found


def _copied(points: Any, offset: int, t: int) -> tuple[Floats, Floats]:
    where = f"points({offset}) at step {t}"
    if not (isinstance(points, tuple) and len(points) == 2):
        raise LawBrokenError(f"{where} is {_shown(points)}, but must be (poses, weights) or None")
    poses, weights = points
    for name, array in (("poses", poses), ("weights", weights)):
        if isinstance(array, np.ma.MaskedArray):
            raise LawBrokenError(f"the {name} of {where} are masked, but must be plain numbers")
        if not isinstance(array, np.ndarray) or not np.issubdtype(array.dtype, np.floating):
            raise LawBrokenError(
                f"the {name} of {where} are {_shown(array)}, but must be an array of floats"
            )
    n = len(weights) if weights.ndim else 0
    if weights.shape != (n,) or n == 0 or poses.shape != (n, 3):
        raise LawBrokenError(
            f"{where} has poses {poses.shape} and weights {weights.shape}, but must have (n, 3) "
            "and (n,), n ≥ 1"
        )
    return poses.copy(), weights.copy()


def _shown(thing: object) -> str:
    if isinstance(thing, np.ndarray):
        return f"an array of {thing.dtype}"
    return "None" if thing is None else f"an object of type {type(thing).__name__}"


def require_valid(run: list[Snapshot]) -> None:
    """Raise unless all poses and weights are finite, the weights not negative and of sum 1."""
    require_finite(run)
    require_normalized(run)


def require_finite(run: list[Snapshot]) -> None:
    """Raise unless all poses and weights are finite."""
    for t, found in enumerate(run):
        for offset, (poses, weights) in found.items():
            for name, array in (("pose", poses), ("weight", weights)):
                if not np.isfinite(array).all():
                    bad = array[~np.isfinite(array)][0]
                    raise LawBrokenError(f"a {name} of points({offset}) at step {t} is {bad:g}")


def require_normalized(run: list[Snapshot]) -> None:
    """Raise unless weights are not negative and of sum 1, as near as the benchmarks require."""
    for t, found in enumerate(run):
        for offset, (_, weights) in found.items():
            if weights.min() < 0:
                raise LawBrokenError(
                    f"a weight of points({offset}) at step {t} is {weights.min():g}"
                )
            total = float(weights.sum(dtype=np.float64))
            if not abs(total - 1) <= SUM_TOLERANCE:
                raise LawBrokenError(
                    f"the weights of points({offset}) at step {t} add up to {digits(total)}, not 1"
                )


def require_same(run: list[Snapshot], other: list[Snapshot], otherwise: str) -> None:
    """Raise with ``otherwise`` and where, unless two runs are equal bit by bit."""
    where = first_difference(run, other)
    if where is not None:
        raise LawBrokenError(f"{otherwise}, first at {where}")


def first_difference(run: list[Snapshot], other: list[Snapshot]) -> str | None:
    """Say where two runs first differ; None if they are equal bit by bit."""
    for t, (one, two) in enumerate(zip(run, other, strict=True)):
        for offset in OFFSETS:
            a, b = one.get(offset, ()), two.get(offset, ())
            same = (np.array_equal(*pair, equal_nan=True) for pair in zip(a, b, strict=True))
            if len(a) != len(b) or not all(same):
                return f"points({offset}) of step {t}"
    return None
