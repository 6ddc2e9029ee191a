"""What a localizer is, what it is given, and what it answers. Plug-ins inherit nothing.

Lengths are in the map's unit (px or m), angles in rad; a pose is (x, y, heading).
"""

from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.maps.units import LENGTH, pixel
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Reals
from deqmcl_gym.validation import InputError, array, number
from localizers.inference.parts import Motion
from localizers.models import scan_kernels
from localizers.models.beams import BeamDensity, GaussianUniform
from localizers.models.motion import OdometryMotion

T = TypeVar("T")

Points = tuple[Reals, Floats]
_FLOAT64 = np.dtype(np.float64)
_COARSEST = 0.1  # px between poses


class Prior(Protocol):
    """p(x_0), what is known of the pose before the first step."""

    @property
    def mean(self) -> tuple[float, float, float] | None:
        """Expected pose (x, y, θ rad); None if none would mean anything."""
        ...

    def sample(self, n: int, rng: np.random.Generator) -> Floats:
        """Draw n poses, (n, 3)."""
        ...

    def log_density(self, poses: Floats) -> Floats:
        """Log-density of poses (n, 3), (n,)."""
        ...


class Belief(Protocol):
    """What a localizer holds true: weighted poses of the present, and of other steps if kept.

    It may have an attribute ``quality``, P(not lost) in [0, 1]: see ``quality_of``.
    """

    def points(self, offset: int = 0) -> Points | None:
        """Return poses (n, 3) and weights (n,) of x_{t+offset}, as fresh arrays.

        One point if the localizer only gives a pose; cell centres if it keeps a grid. None for an
        offset it does not hold.
        """
        ...


@runtime_checkable
class Localizer(Protocol):
    """Follows a robot by its commands, its scans and its plan."""

    def reset(self, prior: Prior, plan: Reals, rng: np.random.Generator) -> Belief:
        """Start anew and return the belief at t = 0.

        Args:
            prior: p(x_0).
            plan: the planned actions (distance, turn), (h, 2); may be empty.
            rng: the localizer's only source of randomness.
        """
        ...

    def update(
        self,
        ranges: Reals,
        action: Reals,
        plan: Reals,
    ) -> Belief:
        """Return the belief after one step.

        Args:
            ranges: the scan taken after the step, (B,).
            action: the command carried out, (distance, turn).
            plan: the actions planned after it, (h, 2); shrinks to (0, 2) at the end.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class RobotModel:
    """What a localizer is made for: the map, the sensor and the noise it assumes.

    Attributes:
        floor_plan: the map m.
        lidar: geometry of the sensor.
        radius: of the robot's disc; None is 8 px, or as much in the map's unit.
        motion: p(x_t | x_{t-1}, a_t).
        scan: p(o | ô) of one beam.
    """

    floor_plan: Map
    lidar: Lidar
    radius: float = field(default=None, metadata=LENGTH)  # type: ignore[assignment]
    motion: Motion = field(default_factory=OdometryMotion)
    scan: BeamDensity = field(default_factory=GaussianUniform)

    def __post_init__(self) -> None:
        if self.radius is None:
            object.__setattr__(self, "radius", 8 * pixel(self.floor_plan.unit))
        number("radius", self.radius, low=0)
        farthest = max(map(abs, self.floor_plan.bounds))
        coarse = float(np.spacing(np.float32(farthest)))
        if coarse > _COARSEST * pixel(self.floor_plan.unit):
            unit = self.floor_plan.unit
            raise InputError(
                f"the floor plan reaches to {farthest:g} {unit}, where the float32 poses of a "
                f"localizer are {coarse:g} {unit} apart: move it towards (0, 0)."
            )


def quality_of(belief: Belief) -> float | None:
    """Return P(not lost | o_{1:t}) of a belief, in [0, 1]; None if its localizer gives none."""
    quality = getattr(belief, "quality", None)
    return None if quality is None else number("the belief's quality", quality, low=0, high=1)


def require_reset(running: T | None) -> T:
    """Return what a localizer holds since reset; refuse an update before."""
    if running is None:
        raise RuntimeError("update was called before reset: call reset(prior, plan, rng) first.")
    return running


def checked_rng(rng: np.random.Generator) -> np.random.Generator:
    """Return a generator of random numbers, else refuse it."""
    if not isinstance(rng, np.random.Generator):
        raise InputError(
            f"rng is {rng!r}, but must be a numpy.random.Generator: give "
            "numpy.random.default_rng(seed)."
        )
    return rng


def checked_plan(plan: ArrayLike) -> Floats:
    """Return a plan as (h, 2) actions, (0, 2) for an empty one in any shape; else refuse."""
    try:
        empty = np.asarray(plan).size == 0
    except ValueError:  # a ragged list; ``array`` names it
        empty = False
    return np.empty((0, 2)) if empty else _of_actions("the plan", plan, (None, 2))


def checked_action(action: ArrayLike) -> Floats:
    """Return an action as (2,) numbers, else refuse it."""
    return _of_actions("the action", action, (2,))


def _of_actions(what: str, given: ArrayLike, shape: tuple[int | None, ...]) -> Floats:
    values = array(what, given, shape)
    if not (np.abs(values) <= scan_kernels.LARGEST_ACTION).all():
        largest = float(np.abs(values).max())
        raise InputError(
            f"{what} has a distance or turn of size {largest:g}, but the largest allowed is "
            f"{scan_kernels.LARGEST_ACTION:g}."
        )
    return values


def checked_scan(ranges: ArrayLike, lidar: Lidar) -> Floats:
    """Return a scan as (B,) fresh numbers, whatever they are; refuse one of another lidar."""
    try:
        scan = np.array(ranges, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"the scan is {ranges!r}, but must be numbers, one per beam.") from None
    if scan.shape != (lidar.beams,):
        raise InputError(
            f"the scan has shape {scan.shape}, but this localizer was made for a lidar of "
            f"{lidar.beams} beams: give ({lidar.beams},) ranges, "
            "or make a localizer for this lidar."
        )
    return scan


def checked_step(
    ranges: ArrayLike, action: ArrayLike, plan: ArrayLike, lidar: Lidar
) -> tuple[Floats, Floats, Floats, int]:
    """Return a scan, an action and a plan, each as checked above, and how many beams are usable.

    Quicker than those where nothing is wrong: this is done at every step.
    """
    if (
        type(ranges) is type(action) is type(plan) is np.ndarray
        and ranges.ndim == action.ndim == 1
        and plan.ndim == 2
        and ranges.dtype.kind == action.dtype.kind == plan.dtype.kind == "f"
    ):
        scan, command, ahead = _as_float64(ranges), _as_float64(action), _as_float64(plan)
        usable = scan_kernels.usable_if_sound(scan, command, ahead, lidar.beams, lidar.max_range)
        if usable >= 0:
            return scan, command, ahead, usable
    scan, command, ahead = checked_scan(ranges, lidar), checked_action(action), checked_plan(plan)
    return scan, command, ahead, scan_kernels.count_usable(scan, lidar.max_range)


def _as_float64(values: NDArray[Any]) -> Floats:
    """Return a copy, row by row."""
    if values.dtype is _FLOAT64:
        return values.copy()  # takes half the time
    return values.astype(_FLOAT64, "C")


def mean_pose(poses: Reals, weights: Floats) -> tuple[float, float, float]:
    """Weighted mean of poses (n, 3), the heading as the direction of the mean (cos θ, sin θ)."""
    x, y, heading = np.asarray(poses, dtype=np.float64).T
    sine, cosine = (weights * arrays.sin(heading)).sum(), (weights * arrays.cos(heading)).sum()
    return (
        float((weights * x).sum()),
        float((weights * y).sum()),
        float(arrays.arctan2(sine, cosine)),
    )
