"""The noise of a robot's motion, estimated from its odometry against a reference."""

import numpy as np

from deqmcl_gym.logs import Log
from deqmcl_gym.logs.motion import increments_of, lengths_of
from deqmcl_gym.numerics import arrays
from deqmcl_gym.validation import InputError
from localizers import OdometryMotion

_SHARE, _WITHIN = 0.99, 2.5758  # so much of a normal distribution lies within so many σ
_LEAST = 10  # steps to estimate from
_ROUNDS = 50  # of the fit of two numbers, which has converged long before


def motion_noise(log: Log) -> OdometryMotion:
    """Return the motion model whose noise fits the steps of a log best.

    ε_d and ε_φ are what the reference did beyond the odometry at each step. σ_dd is such that 99 %
    of |ε_d| / |d| lie within 2.58 σ_dd, and never less than their root mean square: odometry that
    goes the wrong way for some steps (a speed without its sign, wheels that slip) must stay
    possible. Of the steps only the longer half counts, as the reference has noise of its own.
    σ_φφ and σ_φd maximize the likelihood of all ε_φ ~ N(0, (σ_φφ |φ| +
    σ_φd |d|)²), on a grid that is refined around its best point.

    Args:
        log: with a reference; thinned as it will be played, as the noise is that of a step.

    Raises:
        InputError: fewer than 10 steps with movement have a reference at both ends.
    """
    if log.reference is None:
        raise InputError(f"{log.source} has no reference: give the noise of the motion instead.")
    done, meant = increments_of(log.reference), log.increments
    moving = np.isfinite(done).all(axis=1) & (np.abs(meant).max(axis=1) > 0)
    if moving.sum() < _LEAST:
        raise InputError(
            f"{log.source} has {int(moving.sum())} steps with a reference at both ends, too few to "
            f"estimate the noise of the motion, which needs {_LEAST}: give it by --motion, or in "
            "a scenario by assumed.motion."
        )
    done, meant = done[moving], meant[moving]
    driven, turned = lengths_of(meant), np.abs(meant[:, 2])
    off = done - meant
    missed = (off[:, :2] * meant[:, :2]).sum(axis=1) / np.maximum(driven, 1e-9)  # along the way
    missed_turn = arrays.wrapped(off[:, 2])
    long = driven >= max(np.median(driven), 1e-9)
    ratio = np.abs(missed[long] / driven[long]) if long.any() else np.zeros(1)
    drive = max(np.sqrt(np.square(ratio).mean()), np.quantile(ratio, _SHARE) / _WITHIN)

    def cost(turn: float, drift: float) -> float:
        spread = np.maximum(turn * turned + drift * driven, 1e-6)
        return float((np.log(spread) + 0.5 * np.square(missed_turn / spread)).sum())

    scale = np.sqrt(np.square(missed_turn).mean())
    best = (scale / max(turned.mean(), 1e-9), scale / max(driven.mean(), 1e-9))
    width = 100.0
    for _ in range(_ROUNDS):
        factors = width ** np.linspace(-1, 1, 7)
        tried = [(best[0] * a, best[1] * b) for a in factors for b in factors]
        best = min(tried, key=lambda pair: cost(*pair))
        width = max(np.sqrt(width), 1.001)
    return OdometryMotion(drive=float(drive), turn=float(best[0]), drift=float(best[1]))
