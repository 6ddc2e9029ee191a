"""Calibration: the covariance that a robot publishes, fitted to how far off it was.

A filter of many beams believes too much; a flatter likelihood makes it honest, but less exact.
Here the belief stays, and only the covariance that is told of it is changed.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics import Floats, arrays
from deqmcl_gym.validation import InputError, number

# in powers of 2, of the scale and of floors in root mean squares of the offsets: first steps of the
# search, how often they are halved, the least it tries, and where it begins
_COARSEST, _HALVINGS, _NARROWEST = 2.0, 8, -10.0
_STARTS = (0.0, -6.0, -6.0), (0.0, -1.0, -1.0), (-6.0, 0.0, 0.0)
_TINY = 1e-9


@dataclass(frozen=True)
class Calibration:
    """Published covariance: scale · P + diag(position², position², heading²)."""

    scale: float = 1.0
    position: float = 0.0  #: SD of the floor in x and in y, in the map's unit
    heading: float = 0.0  #: SD of the floor in θ, rad

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            number(f"{name} of a calibration", value, low=0)

    @property
    def floor(self) -> Floats:
        """What is published of a belief without any spread, (3, 3)."""
        return np.diag(np.square([self.position, self.position, self.heading]))

    def published(self, covariances: ArrayLike) -> Floats:
        """Return what is published of covariances of (x, y, θ), (…, 3, 3).

        One that is not finite, as that of a single point, is published as the floor; without a
        floor it stays unknown.
        """
        given = np.array(covariances, dtype=np.float64)
        if given.shape[-2:] != (3, 3):
            raise InputError(f"covariances have shape {given.shape}, but must be (…, 3, 3).")
        unknown = ~np.isfinite(given).all(axis=(-2, -1))
        calibrated: Floats = self.scale * given + self.floor
        calibrated[unknown] = self.floor if self.position > 0 and self.heading > 0 else math.nan
        return calibrated

    @classmethod
    def fitted(cls, offsets: ArrayLike, covariances: ArrayLike) -> Self:
        """Return the calibration of least mean Gaussian log score, to three digits.

        Of n offsets, truth - estimate, (n, 3), with what was believed of each, (n, 3, 3); those
        that are not finite are left out. The log score is proper: it is least where the covariance
        is that of the offsets, even if they are correlated in time and no normal deviates.
        """
        off, believed = np.array(offsets, np.float64), np.array(covariances, np.float64)
        if off.ndim != 2 or off.shape[1:] != (3,) or believed.shape != (len(off), 3, 3):
            raise InputError(
                f"offsets have shape {off.shape} and covariances {believed.shape}, but must be "
                "(n, 3) and (n, 3, 3)."
            )
        known = np.isfinite(off).all(axis=1)
        if not known.any():
            raise InputError("no offset is finite: a calibration is fitted to one or more.")
        off, believed = off[known], believed[known]
        off[:, 2] = arrays.wrapped(off[:, 2])
        believed[~np.isfinite(believed).all(axis=(1, 2))] = 0.0
        sizes = np.sqrt([np.square(off[:, :2]).mean(), np.square(off[:, 2]).mean()]) + _TINY
        spread = bool(believed.any())  # without any, the scale does not matter
        scores = np.empty((len(off), 3))

        def at(place: Floats) -> Calibration:
            scale, *floor = arrays.exp(math.log(2) * np.maximum(place, _NARROWEST))
            return Calibration(float(scale) if spread else 1.0, *map(float, floor * sizes))

        def cost(place: Floats) -> float:
            arrays.fits(off, at(place).published(believed), scores)
            return float(scores[:, 2].mean())

        places, costs = arrays.compass_search(
            lambda tried: np.array([cost(place) for place in tried]),
            np.array(_STARTS),
            (_COARSEST,) * 3,
            halvings=_HALVINGS,
            least=_TINY,
        )
        best = at(places[costs.argmin()])
        return cls(**{name: float(f"{v:.3g}") for name, v in vars(best).items()})


def spread_about(pose: ArrayLike, poses: ArrayLike, weights: ArrayLike) -> Floats:
    """Return the second moments of a cloud (n, 3) about a pose, (3, 3); NaN of a single point."""
    off = np.asarray(poses, np.float64) - np.asarray(pose, np.float64)
    if len(off) == 1:
        return np.full((3, 3), math.nan)
    off[:, 2] = arrays.wrapped(off[:, 2])
    weight = np.asarray(weights, np.float64)[:, None]
    # sums one pose after another: the same bits on every processor
    return np.asarray(((weight * off)[:, :, None] * off[:, None, :]).sum(axis=0))
