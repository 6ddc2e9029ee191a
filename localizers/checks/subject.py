"""The localizer under check, the short random drive that it is tried on, and what is watched.

That is whether two runs are equal, and of this process its global state, its threads, and the
processes that it started.
"""

import os
import pickle
import random
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from deqmcl_gym.maps import Lidar, Map, PolygonMap
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Floats
from deqmcl_gym.numerics.arrays import wrapped
from deqmcl_gym.validation import SUM_TOLERANCE, digits
from localizers.api import Belief, Localizer, mean_pose
from localizers.kinds import absolute_name, parameters_of
from localizers.models import RobotModel
from localizers.models.motion import OdometryMotion
from localizers.models.prior import GaussianPrior, UniformPrior
from localizers.models.scan import GaussianUniform
from localizers.registry import LOCALIZER, Factory, resolve

DRIVE_STEPS = 12
OFFSETS = range(-DRIVE_STEPS, DRIVE_STEPS + 1)
_TRIES = 100
_LONGEST = 20.0  # px, of a step: 0.4 m

Snapshot = Mapping[int, tuple[Floats, Floats]]  # poses and weights by offset
Seed = int | np.random.Generator


class LawBrokenError(Exception):
    """A law is broken; the text is the reason."""


class LawSkippedError(Exception):
    """A law does not apply; the text is the reason."""


def default_robot() -> RobotModel:
    """Return a robot with eight beams in a rectangular corridor."""
    block = [(100, 100), (250, 100), (250, 200), (100, 200)]
    outer = [(0, 0), (350, 0), (350, 300), (0, 300)]
    return robot_on(PolygonMap(outer=outer, obstacles=(block,)))


def robot_on(floor_plan: Map) -> RobotModel:
    """Return a robot with eight beams of 400 px, or 8 m, on a map."""
    px = pixel(floor_plan.unit)
    return RobotModel(
        floor_plan=floor_plan,
        lidar=Lidar(beams=8, field_of_view=2 * np.pi, max_range=400.0 * px, sigma=10.0 * px),
        motion=OdometryMotion(drive=0.2, turn=0.3, drift=0.01 / px),
        scan=GaussianUniform(sigma=20.0 * px),
    )


def random_drive(robot: RobotModel, rng: np.random.Generator) -> dict[str, Any]:
    """Return a drive from a free pose, which turns on the spot from the first wall on.

    Only half of the plan is driven. The noise is small and not that which the robot assumes: a
    check tests whether a localizer keeps the laws, not how accurate it is. It starts where it sees
    far, and heads slightly below 0: that can be written 2π higher, and half a turn from it is ±π.
    """
    floor_plan, lidar, steps = robot.floor_plan, robot.lidar, 2 * DRIVE_STEPS
    x0, y0, x1, y1 = floor_plan.bounds
    stride = min((x1 - x0) / 30, (y1 - y0) / 30, _LONGEST * pixel(floor_plan.unit))
    poses = UniformPrior(floor_plan=floor_plan, radius=robot.radius).sample(_TRIES, rng)
    poses[:, 2] = rng.uniform(-0.1, 0.0, _TRIES)
    start = poses[floor_plan.ranges(poses, [0.0])[:, 0].argmax()]
    headings, distances = rng.normal(0.0, 0.2, steps), rng.uniform(0.5, 1.0, steps) * stride
    moves = distances[:, None] * np.column_stack([np.cos(headings), np.sin(headings)])
    path = np.vstack([start, np.column_stack([start[:2] + np.cumsum(moves, axis=0), headings])])
    free = ~floor_plan.collides(path[:-1], path[1:], robot.radius)
    driven = np.logical_and.accumulate(free)
    path[1:, :2] = start[:2] + np.cumsum(moves * driven[:, None], axis=0)
    actions = np.column_stack([distances * driven, np.diff(path[:, 2])])
    ranges = np.asarray(lidar.ranges(floor_plan, path[1 : DRIVE_STEPS + 1].T), float)
    x, y, heading = start.tolist()
    return {
        "prior": GaussianPrior(mean=(x, y, heading), sd_position=0.5 * stride, sd_heading=0.1),
        "actions": actions[:DRIVE_STEPS],
        "scans": np.clip(rng.normal(ranges, 0.01 * stride), 0.0, lidar.max_range),
        "plans": [actions[t:] for t in range(DRIVE_STEPS + 1)],
    }


@dataclass(frozen=True, kw_only=True)
class Subject:
    """What is under check: a localizer, and in ``benchmarks`` an agent or a scan model."""

    remedy: ClassVar[str]  # what to use instead of global random numbers
    name: str
    time_limit: float = 60.0  # s

    def history(self) -> Sequence[Any]:
        """Return what it, made anew, answers at each step of one and the same drive."""
        raise NotImplementedError

    def written(self) -> str | None:
        """Name what it writes into of all that it is given on the drive."""
        raise NotImplementedError

    def require_same(self, run: Sequence[Any], otherwise: str) -> None:
        """Raise with ``otherwise`` and from which step on, unless a run is its history, bitwise."""
        for t, (actual, expected) in enumerate(zip_longest(run, self.history())):
            if difference(actual, expected) is not None:
                raise LawBrokenError(f"{otherwise} (from step {t} on)")


@dataclass(frozen=True, kw_only=True)
class LocalizerDrive(Subject):
    """A localizer along a drive of T steps.

    The actions (T, 2) are the first of those planned, the scans (T, B) are taken after them, and
    the plans (h, 2) are those at t = 0 … T. ``source`` is its factory, or a name by which any
    process finds that; ``imported`` is what its import changed of the state of this process.
    """

    remedy = "use the rng given to reset"
    source: str | Factory
    params: Mapping[str, Any]
    robot: RobotModel
    prior: GaussianPrior
    actions: Floats
    scans: Floats
    plans: Sequence[Floats]
    imported: tuple[str, ...] = ()

    @property
    def factory(self) -> Factory:
        """What makes the localizer."""
        return resolve(self.source) if isinstance(self.source, str) else self.source

    def made(self) -> Localizer:
        """Make a new localizer."""
        made: Localizer = LOCALIZER.checked(self.name, self.factory(self.robot, **self.params))
        return made

    def inputs(self, t: int) -> dict[str, Floats]:
        """Return copies of what a localizer gets at t: plan, later ranges, action and plan."""
        before = {"ranges": self.scans[t - 1], "action": self.actions[t - 1]} if t else {}
        return {name: array.copy() for name, array in (before | {"plan": self.plans[t]}).items()}

    def steps(
        self, localizer: Localizer | None = None, seed: Seed = 0
    ) -> Iterator[tuple[Belief, dict[str, Floats]]]:
        """Run a localizer, a new one if none is given; yield beliefs and their inputs."""
        localizer = self.made() if localizer is None else localizer
        inputs = self.inputs(0)
        yield localizer.reset(self.prior, inputs["plan"], np.random.default_rng(seed)), inputs
        for t in range(1, len(self.plans)):
            inputs = self.inputs(t)
            yield localizer.update(*inputs.values()), inputs

    def history(
        self, localizer: Localizer | None = None, *, seed: Seed = 0, **changes: Any
    ) -> list[Snapshot]:
        """Return what it believes at each step, with some fields of this changed."""
        run = replace(self, **changes).steps(localizer, seed)
        return [snapshot(belief, t) for t, (belief, _) in enumerate(run)]

    def written(self) -> str | None:
        for t, (_, inputs) in enumerate(self.steps()):
            if name := difference(self.inputs(t), inputs):
                return f"the {name} at step {t}"
        return None

    def require_valid(self, *, sums: bool = True, **changes: Any) -> None:
        """Raise unless all of a run is finite and, if ``sums``, weights are 0 or more, of sum 1."""
        run = enumerate(self.history(**changes))
        for t, offset, (poses, weights) in ((t, *each) for t, held in run for each in held.items()):
            where = f"points({offset}) at step {t}"
            for name, array in (("pose", poses), ("weight", weights)):
                for bad in array[~np.isfinite(array)]:
                    raise LawBrokenError(f"a {name} of {where} is {bad:g}")
            total, least = float(weights.sum(dtype=np.float64)), weights.min()
            if sums and (least < 0 or abs(total - 1) > SUM_TOLERANCE):
                raise LawBrokenError(
                    f"the weights of {where} add up to {digits(total)}, the least is {least:g}: "
                    "they must be 0 or more and add up to 1"
                )

    def require_alike(self, other: Sequence[Snapshot], when: str) -> None:
        """Raise unless the mean poses of the present agree with its own at every step.

        Within one standard deviation of the belief, plus a hundredth of the map's shorter side, or
        0.1 rad: rounding may send a particle another way, which moves a mean by far less than that;
        headings that are not treated as angles move it by far more.
        """
        x0, y0, x1, y1 = self.robot.floor_plan.bounds
        slack = min(x1 - x0, y1 - y0) / 100
        for t, (expected, actual) in enumerate(zip(self.history(), other, strict=True)):
            poses, weights = expected[0]
            mean = np.array(mean_pose(poses, weights))
            off, spread = np.array(mean_pose(*actual[0])) - mean, poses - mean
            off[2], spread[:, 2] = wrapped(off[2]), wrapped(spread[:, 2])
            allowed = np.sqrt(weights @ np.square(spread)) + np.array([slack, slack, 0.1])
            if not (np.abs(off) <= allowed).all():
                raise LawBrokenError(
                    f"{when} the mean pose at step {t} differs by ({off[0]:.3g}, {off[1]:.3g}, "
                    f"{off[2]:.3g} rad) in (x, y, heading)"
                )


def localizer_drive(
    localizer: str | Factory, robot: RobotModel | None = None, **params: Any
) -> LocalizerDrive:
    """Return a localizer along a random drive; see ``check_localizer``."""
    robot = default_robot() if robot is None else robot
    source, before = localizer, process_state()
    if isinstance(localizer, str):
        name, factory = localizer, resolve(localizer)
        source = factory if name in LOCALIZER.added else absolute_name(name)
    else:
        name, factory = getattr(localizer, "__name__", repr(localizer)), localizer
    LOCALIZER.check_parameters(name, params, parameters_of(factory))
    imported = tuple(changes_since(before))
    drive = random_drive(robot, np.random.default_rng(0))
    drive |= {"source": source, "params": params, "robot": robot, "imported": imported}
    return LocalizerDrive(name=name, **drive)


def snapshot(belief: Belief, t: int) -> Snapshot:
    """Copy all points of a belief at step t; they must be in the form of ``Belief.points``."""
    held = getattr(belief, "points", lambda _: None)
    all_points = {offset: held(offset) for offset in OFFSETS}
    by_offset = {n: _copied(p, n, t) for n, p in all_points.items() if p is not None}
    if 0 not in by_offset:
        raise LawBrokenError(
            f"{'update' if t else 'reset'} (step {t}) returned {_kind(belief)}, but must return a "
            "belief that holds points(0), the present"
        )
    return by_offset


def _copied(points: Any, offset: int, t: int) -> tuple[Floats, Floats]:
    match points:
        case (np.ndarray(shape=(n, 3)) as poses, np.ndarray(shape=(m,)) as weights) if n == m > 0:
            is_of_floats = poses.dtype.kind == weights.dtype.kind == "f"
            if is_of_floats and not any(map(np.ma.isMaskedArray, points)):
                return poses.copy(), weights.copy()
    raise LawBrokenError(
        f"points({offset}) at step {t} is {_kind(points)}, but must be None or (poses, weights), "
        "arrays of floats of shapes (n, 3) and (n,), n ≥ 1"
    )


def _kind(thing: object) -> str:
    if isinstance(thing, tuple):
        return f"({', '.join(map(_kind, thing))})"
    of = f" of {thing.dtype} {thing.shape}" if isinstance(thing, np.ndarray) else ""
    return "None" if thing is None else f"an object of type {type(thing).__name__}{of}"


_PLAIN: Any = (type(None), np.ndarray, np.generic, int, float, str)


def difference(before: Any, after: Any, name: str = "", depth: int = 8) -> str | None:
    """Name the first number, word or array inside ``before`` that is another one in ``after``.

    What an object has only ``after``, such as caches, is no difference.
    """
    if isinstance(before, _PLAIN):
        numeric = np.asarray(before).dtype.kind == "f"
        return None if np.array_equal(before, after, equal_nan=numeric) else name
    held, now = _parts(before), _parts(after)
    if isinstance(before, tuple | list | Mapping) and len(held) != len(now):
        return name
    for key, value in held.items() if depth else ():
        numbered = isinstance(before, tuple | list)
        where = f"{name}[{key}]" if numbered else f"{name}.{key}".lstrip(".")
        if key not in now:
            return where
        if (at := difference(value, now[key], where, depth - 1)) is not None:
            return at
    return None


def _parts(thing: Any) -> Mapping[Any, Any]:
    if isinstance(thing, tuple | list):
        return dict(enumerate(thing))
    return thing if isinstance(thing, Mapping) else getattr(thing, "__dict__", {})


GLOBAL_RNG = "the global random numbers of numpy or random"
ADDED_BY_IMPORTS = ("the filters of warnings", "os.environ", "sys.path", GLOBAL_RNG)


def process_state() -> dict[str, Any]:
    """Return the global state of this process, by name."""
    return {
        "the working folder": os.getcwd(),
        "signal handlers": {n: signal.getsignal(n) for n in signal.valid_signals()},
        "np.seterr": np.geterr(),
        "np.set_printoptions": np.get_printoptions(),
        "the filters of warnings": list(warnings.filters),
        "os.environ": dict(os.environ),
        "the recursion limit": sys.getrecursionlimit(),
        "sys.path": list(sys.path),
        GLOBAL_RNG: pickle.dumps((np.random.get_state(), random.getstate())),  # noqa: NPY002
    }


def changes_since(before: Mapping[str, Any]) -> list[str]:
    """Name what is not as it was."""
    return [name for name, now in process_state().items() if now != before[name]]


@contextmanager
def state_kept() -> Iterator[None]:
    """Put the global state of this process back after a block."""
    folder, handlers, errors, printed, filters, variables, limit, path, rngs = (
        process_state().values()
    )
    try:
        yield
    finally:
        os.chdir(folder)
        for number, handler in handlers.items():
            if handler not in (None, signal.getsignal(number)):
                signal.signal(number, handler)
        np.seterr(**errors)
        np.set_printoptions(**printed)
        warnings.filters[:] = filters  # type: ignore[index]
        if variables != dict(os.environ):
            os.environ.clear()
            os.environ.update(variables)
        sys.setrecursionlimit(limit)
        sys.path[:] = path
        of_numpy, of_random = pickle.loads(rngs)
        np.random.set_state(of_numpy)  # noqa: NPY002
        random.setstate(of_random)


def running() -> dict[str, str]:
    """Name this process's threads and, as far as /proc shows them, the processes it started."""
    names = {f"thread {t.ident}": f"the thread {t.name!r}" for t in threading.enumerate()}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it is gone
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
            if state != "Z" and parent == str(os.getpid()):
                names[f"process {stat.parent.name}"] = f"the process {stat.parent.name}"
    return names
