"""The localizer under check, and what laws do with it: run it, read its beliefs, compare them."""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import digits
from localizers.api import Belief, Localizer, Prior, RobotModel
from localizers.checks.drive import STEPS, Drive
from localizers.naming.registry import Factory, made_by

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
    """

    name: str
    factory: Factory
    params: Mapping[str, Any]
    robot: RobotModel
    drive: Drive
    sent: str | Factory
    timeout: float
    before: Mapping[str, Any]

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
    """Raise unless weights are not negative and of sum 1, up to the rounding of a sum of n."""
    for t, found in enumerate(run):
        for offset, (_, weights) in found.items():
            if weights.min() < 0:
                raise LawBrokenError(
                    f"a weight of points({offset}) at step {t} is {weights.min():g}"
                )
            total = float(weights.sum(dtype=np.float64))
            if not abs(total - 1) <= weights.size * np.finfo(weights.dtype).eps:
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
            if len(a) != len(b) or not all(map(_equal, a, b)):
                return f"points({offset}) of step {t}"
    return None


def _equal(a: Floats, b: Floats) -> bool:
    return np.array_equal(a, b, equal_nan=True)
