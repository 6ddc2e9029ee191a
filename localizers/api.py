"""The interface of a localizer: its inputs, its belief, and the checks of both.

Lengths are in the map's unit (px or m), angles in rad; a pose is (x, y, heading).
"""

from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.maps.map import LENGTH, pixel
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Reals
from deqmcl_gym.validation import InputError, array, number
from localizers.inference.parts import Motion
from localizers.models import scan as scan_kernels
from localizers.models.beams import BeamDensity, GaussianUniform
from localizers.models.motion import OdometryMotion, increments
from localizers.models.nav2_motion import unknown_motion

T = TypeVar("T")

Points = tuple[Reals, Floats]
_FLOAT64 = np.dtype(np.float64)
METRE_SIGMA = 0.2  # m, of a beam: Nav2's sigma_hit
_COARSEST = 0.1  # px: the largest spacing of float32 poses that is allowed


class Prior(Protocol):
    """p(x_0), what is known of the pose before the first step."""

    @property
    def mean(self) -> tuple[float, float, float] | None:
        """Expected pose (x, y, θ rad); None if no single pose is representative."""
        ...

    def sample(self, n: int, rng: np.random.Generator) -> Floats:
        """Draw n poses, (n, 3)."""
        ...

    def log_density(self, poses: Floats) -> Floats:
        """Log-density of poses (n, 3), (n,)."""
        ...


class Belief(Protocol):
    """What a localizer believes: weighted poses of the present, and of other steps if kept.

    An optional attribute ``quality`` is P(not lost), in [0, 1]; see ``quality_of``.
    """

    def points(self, offset: int = 0) -> Points | None:
        """Return poses (n, 3) and weights (n,) of x_{t+offset}, as fresh arrays.

        One point if the localizer estimates a single pose; cell centres if it keeps a grid. None
        for an offset it does not hold.
        """
        ...


@runtime_checkable
class Localizer(Protocol):
    """Estimates a robot's pose from commands, scans and plans. Plug-ins need not inherit it."""

    def reset(self, prior: Prior, plan: Reals, rng: np.random.Generator) -> Belief:
        """Start anew and return the belief at t = 0.

        Args:
            prior: p(x_0).
            plan: the planned increments, (h, 2) or (h, 3), as ``action``; may be empty.
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
            ranges: the scan taken after the step, (B,), in the map's unit.
            action: the increment carried out: the command (distance, turn rad) of a robot that
                turns, then drives ahead, (2,); or what odometry measured, (forward, left, turn
                rad), (3,): a turn, then a translation in the frame after it. (d, φ) is the same
                as (d, 0, φ).
            plan: the increments planned after it, (h, 2) or (h, 3); h shrinks to 0 at the end.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class RobotModel:
    """The robot as a localizer knows it: its map, its sensor and the assumed noise.

    Attributes:
        floor_plan: the map m.
        lidar: geometry of the sensor.
        radius: of the robot's disc, in the map's unit; None is 8 px, or 0.16 m.
        motion: p(x_t | x_{t-1}, a_t); None is ``OdometryMotion``'s default, or on a map in metres
            that of ``DifferentialMotion``.
        scan: p(o | ô) of one beam; None is ``GaussianUniform``'s default, or with σ = 0.2 m, as
            Nav2's sigma_hit.
    """

    floor_plan: Map
    lidar: Lidar
    radius: float = field(default=None, metadata=LENGTH)  # type: ignore[assignment]
    motion: Motion = None  # type: ignore[assignment]
    scan: BeamDensity = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.radius is None:
            object.__setattr__(self, "radius", 8 * pixel(self.floor_plan.unit))
        metres = self.floor_plan.unit == "m"
        if self.motion is None:
            motion = unknown_motion("differential", "m") if metres else OdometryMotion()
            object.__setattr__(self, "motion", motion)
        if self.scan is None:
            scan = GaussianUniform(sigma=METRE_SIGMA) if metres else GaussianUniform()
            object.__setattr__(self, "scan", scan)
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
    """Return P(not lost | o_{1:t}) of a belief, in [0, 1]; None if it has none."""
    quality = getattr(belief, "quality", None)
    return None if quality is None else number("the belief's quality", quality, low=0, high=1)


def require_reset(running: T | None) -> T:
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
    try:
        empty = np.asarray(plan).size == 0
    except ValueError:  # a ragged list; ``array`` names it
        empty = False
    return np.empty((0, 3)) if empty else increments(_of_actions("the plan", plan, 2))


def checked_action(action: ArrayLike) -> Floats:
    """Return an action as an increment (3,), else refuse it."""
    return increments(_of_actions("the action", action, 1))


def _of_actions(what: str, given: ArrayLike, axes: int) -> Floats:
    try:
        columns = 3 if np.shape(given)[-1:] == (3,) else 2
    except ValueError:  # ragged; ``array`` names it
        columns = 2
    shape: tuple[int | None, ...] = (columns,) if axes == 1 else (None, columns)
    values = array(what, given, shape)
    if not (np.abs(values) <= scan_kernels.LARGEST_ACTION).all():
        largest = float(np.abs(values).max())
        raise InputError(
            f"{what} has a length or turn of size {largest:g}, but the largest allowed is "
            f"{scan_kernels.LARGEST_ACTION:g}."
        )
    return values


def checked_scan(ranges: ArrayLike, lidar: Lidar) -> Floats:
    """Return a copy of a scan, (B,); refuse a wrong number of beams. Values are not checked."""
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
    """Return copies of a scan, an action and a plan, checked, and the number of usable beams.

    Faster than the checks above if nothing is wrong, because this runs at every step.
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
            return scan, increments(command), increments(ahead), usable
    scan, command, ahead = checked_scan(ranges, lidar), checked_action(action), checked_plan(plan)
    return scan, command, ahead, scan_kernels.count_usable(scan, lidar.max_range)


def _as_float64(values: NDArray[Any]) -> Floats:
    """Return a copy in C order."""
    if values.dtype is _FLOAT64:
        return values.copy()  # twice as fast as astype
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
