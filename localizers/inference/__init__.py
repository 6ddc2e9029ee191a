"""A recursive Bayes filter as a localizer: what it is given is checked, then a step is taken.

In the other files: sequential Monte Carlo over any state space, its queue, belief and parts.
"""

from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.maps import Lidar
from deqmcl_gym.numerics import Floats
from deqmcl_gym.numerics.elementary import FARTHEST
from deqmcl_gym.validation import InputError, amount, array, real, shown
from localizers.api import Prior
from localizers.models import RobotModel
from localizers.models.motion import increments
from localizers.models.prior import GaussianPrior, MixturePrior
from localizers.models.scan import Scan

LARGEST_ACTION = FARTHEST  # length or turn: the sine of a larger angle is NaN
_T = TypeVar("_T")
B = TypeVar("B")


class Filter(Protocol[B]):
    """The two steps of a recursive Bayes filter. It is stateless: the belief is the state."""

    def initial(self, prior: Prior, plan: Floats, rng: np.random.Generator) -> B:
        """Return the belief at t = 0."""

    def step(
        self, belief: B, scan: Scan, action: Floats, plan: Floats, rng: np.random.Generator
    ) -> B:
        """Return the belief after one action and one scan."""


class FilterLocalizer(Generic[B]):
    """A ``Localizer`` that runs a filter, checks its input and counts bad beams."""

    def __init__(self, robot: RobotModel, bayes_filter: Filter[B]) -> None:
        """Make a localizer for ``robot`` from a filter made for it."""
        self.robot = robot
        self.filter = bayes_filter
        self.own_plans = bool(getattr(bayes_filter, "own_plans", True))  # see ``Localizer``
        self._running: tuple[B, np.random.Generator] | None = None

    def reset(self, prior: Prior, plan: ArrayLike, rng: np.random.Generator) -> B:
        prior = checked_prior(prior, self.robot)
        belief = self.filter.initial(prior, checked_plan(plan), checked_rng(rng))
        self._running = (belief, rng)
        return belief

    def update(self, ranges: ArrayLike, action: ArrayLike, plan: ArrayLike) -> B:
        belief: Any
        belief, rng = require_reset(self._running)
        scan, command, ahead = checked_step(ranges, action, plan, self.robot.lidar)
        belief = self.filter.step(belief, scan, command, ahead, rng)
        if scan.beams < scan.ranges.size:
            belief = belief._replace(events=belief.events.of_scan(scan))
        self._running = (belief, rng)
        return belief  # type: ignore[no-any-return]


def checked_prior(prior: Prior, robot: RobotModel) -> Prior:
    """Return a prior; refuse what is none, or is not in the unit of the robot's map."""
    if not hasattr(prior, "mean"):
        raise InputError(f"the prior is {shown(prior)}, but must be a Prior, as GaussianPrior.")
    if isinstance(prior, GaussianPrior | MixturePrior):
        prior.check_unit(robot.floor_plan.unit)
    return prior


def require_reset(running: _T | None) -> _T:
    """Return the state that reset created; refuse an update before the first reset."""
    if running is None:
        raise RuntimeError("update was called before reset: call reset(prior, plan, rng) first.")
    return running


def checked_rng(rng: np.random.Generator) -> np.random.Generator:
    """Return ``rng`` if it is a NumPy generator, else refuse it."""
    if not isinstance(rng, np.random.Generator):
        raise InputError(
            f"rng is {rng!r}, but must be a numpy.random.Generator: give "
            "numpy.random.default_rng(seed)."
        )
    return rng


def checked_plan(plan: ArrayLike) -> Floats:
    """Return a plan as increments (h, 3), an empty one of any shape as (0, 3); else refuse it."""
    given = real("the plan", plan)
    return np.empty((0, 3)) if given.size == 0 else _increments("the plan", given, None)


def checked_action(action: ArrayLike) -> Floats:
    """Return an action as an increment (3,), else refuse it."""
    return _increments("the action", real("the action", action, "two or three numbers"))


def _increments(what: str, given: NDArray[Any], *rows: None) -> Floats:
    values = array(what, given, (*rows, 3 if given.shape[-1:] == (3,) else 2))
    if not (np.abs(values) <= LARGEST_ACTION).all():
        largest = float(np.abs(values).max())
        raise InputError(
            f"{what} has a length or turn of size {largest:g}, but the largest allowed is "
            f"{LARGEST_ACTION:g}."
        )
    return increments(values)


def checked_step(
    ranges: ArrayLike, action: ArrayLike, plan: ArrayLike, lidar: Lidar
) -> tuple[Scan, Floats, Floats]:
    """Return checked copies of a scan, an action (3,) and a plan (h, 3); fast, as of every step."""
    if (
        type(ranges) is type(action) is type(plan) is np.ndarray
        and ranges.ndim == action.ndim == 1
        and plan.ndim == 2
        and ranges.dtype.kind == action.dtype.kind == plan.dtype.kind == "f"
    ):
        measured = np.array(ranges, np.float64, order="C")
        command, ahead = np.array(action, np.float64), np.array(plan, np.float64, order="C")
        if (
            measured.size == lidar.beams
            and command.size in (2, 3)
            and ahead.shape[1] in (2, 3)
            and np.abs(command).max() <= LARGEST_ACTION
            and np.abs(ahead).max(initial=0.0) <= LARGEST_ACTION
        ):
            return _scan(measured, lidar), increments(command), increments(ahead)
    measured = np.array(real("the scan", ranges, "numbers, one per beam"), np.float64)
    if measured.shape != (lidar.beams,):
        raise InputError(
            f"the scan has shape {measured.shape}, but this localizer was made for a lidar of "
            f"{amount(lidar.beams, 'beam')}: give ({lidar.beams},) ranges, "
            "or make a localizer for this lidar."
        )
    return _scan(measured, lidar), checked_action(action), checked_plan(plan)


def _scan(ranges: Floats, lidar: Lidar) -> Scan:
    """Return a scan of ranges (B,), which are kept and lose what the lidar does not measure."""
    if lidar.loses:
        lidar.lose(ranges, blind=np.nan)
    return Scan.of(ranges, lidar.max_range)
