"""Errors of a trajectory as evo computes them: absolute (APE) and relative (RPE) pose error."""

import warnings
from dataclasses import dataclass

import numpy as np

from deqmcl_gym.logs import Log, LogWarning, Trajectory, referenced
from deqmcl_gym.logs.motion import relative
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, array, integer


@dataclass(frozen=True, kw_only=True)
class PoseErrors:
    """Errors of poses, in position and heading.

    Attributes:
        translation: lengths, (n,): evo's ``trans_part``.
        rotation: rad in [0, π], (n,): evo's ``angle_rad``.
    """

    translation: Floats
    rotation: Floats

    @property
    def rmse(self) -> float:
        """Root mean square of the translations, evo's first figure."""
        return float(np.sqrt(np.square(self.translation).mean()))


def absolute(estimate: Floats, reference: Floats) -> PoseErrors:
    """APE: how far each pose (n, 3) is from its reference (n, 3), without any alignment.

    A localizer estimates in the map's frame: an alignment would hide its error.
    """
    given, true = _pairs(estimate, reference)
    return _errors(relative(true, given))


def relative_errors(estimate: Floats, reference: Floats, delta: int = 1) -> PoseErrors:
    """RPE: how far the motion over ``delta`` poses is from that of the reference.

    Pairs are consecutive, as evo's default: 0 to delta, delta to 2 delta, …

    Raises:
        InputError: fewer than delta + 1 poses.
    """
    given, true = _pairs(estimate, reference)
    step = integer("delta", delta, low=1)
    if len(given) <= step:
        raise InputError(
            f"the relative error over {step} poses needs {step + 1} poses or more, but there are "
            f"{len(given)}: choose a smaller delta."
        )
    driven, meant = (relative(poses[:-step:step], poses[step::step]) for poses in (given, true))
    return _errors(relative(meant, driven))


def interpolation_errors(log: Log) -> tuple[Floats, Floats] | None:
    """How far off every second reference pose is if it is interpolated between its neighbours.

    More than at the records between, as here the neighbours are twice as far apart.

    Returns:
        Lengths and angles, (k,) each; None if there are none.
    """
    at = log.referenced
    if log.interpolated is not None:
        at = at[~log.interpolated[at]]
    if log.reference is None or at.size < 3:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LogWarning)  # of few records: half of them are left out
        half = referenced(log, Trajectory(log.times[at[::2]], log.reference[at[::2]]))
    hidden = at[1:-1:2]
    assert half.reference is not None
    if not np.isfinite(half.reference[hidden]).any():
        return None
    off = absolute(log.reference[hidden], half.reference[hidden])
    return off.translation, off.rotation


def _errors(off: Floats) -> PoseErrors:
    return PoseErrors(
        translation=np.hypot(off[:, 0], off[:, 1]), rotation=np.abs(arrays.wrapped(off[:, 2]))
    )


def _pairs(estimate: Floats, reference: Floats) -> tuple[Floats, Floats]:
    """Return the poses that have a reference."""
    given = array("the estimate", estimate, (None, 3))
    true = np.asarray(reference, dtype=np.float64)
    if true.shape != given.shape:
        raise InputError(
            f"the reference has shape {true.shape}, but must have that of the estimate, "
            f"{given.shape}."
        )
    known = np.isfinite(true).all(axis=1)
    if not known.any():
        raise InputError("no pose has a reference, so there is no error.")
    return given[known], true[known]
